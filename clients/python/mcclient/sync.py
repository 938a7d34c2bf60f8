"""The client without ``async``: the same calls, carried out by a loop in a thread of its own.

::

    with Machine.connect() as machine:
        with machine.program() as program:
            program.send("G01 X10 F600")
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

from mcclient import machine as asynchronous
from mcclient import program as asynchronous_program
from mcclient.calls import DEADLINE_S
from mcclient.discovery import CONNECT_S
from mcclient.feed import Feed
from mcclient.lines import from_thread
from mcclient.machine import PATIENCE_S
from mcclient.program import ProgramResult
from mcclient.reports import Report
from mcclient.telemetry import Samples
from mcclient.types import (
    BusScan,
    CheckResult,
    DriveInfo,
    Event,
    Info,
    MachineStatus,
    OnDisconnect,
    ProgramStatus,
    SdoObject,
    SdoValue,
)

T = TypeVar("T")


class _LoopThread:
    """A loop that runs in a thread until it is stopped."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="mcclient", daemon=True)
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """The result; when the caller is interrupted, the work is cancelled."""
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def stop(self) -> None:
        async def wind_up() -> None:
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)
            await asyncio.get_running_loop().shutdown_default_executor()

        self.run(wind_up())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


class Stream(Generic[T]):
    """``for item in stream``; it listens from its making on, until closed."""

    def __init__(self, loop: _LoopThread, feed: Feed[T]) -> None:
        self._loop = loop
        self._feed = feed

    def close(self) -> None:
        async def close() -> None:
            self._feed.close()

        self._loop.run(close())

    def __iter__(self) -> Iterator[T]:
        return self

    def __next__(self) -> T:
        try:
            return self._loop.run(self._feed.__anext__())
        except StopAsyncIteration:
            raise StopIteration from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Line:
    """A line that the server has taken."""

    def __init__(self, loop: _LoopThread, line: asynchronous_program.Line) -> None:
        self._loop = loop
        self._line = line
        self.number = line.number

    def done(self) -> None:
        """Waits until the line has ended."""
        self._loop.run(self._line.done())


class Program:
    """As `mcclient.Program`."""

    def __init__(self, loop: _LoopThread, program: asynchronous_program.Program) -> None:
        self._loop = loop
        self._program = program
        self.id = program.id
        self.axes = program.axes

    @property
    def state(self) -> str:
        return self._program.state

    @property
    def accepted_through(self) -> int:
        return self._program.accepted_through

    @property
    def done_through(self) -> int:
        return self._program.done_through

    @property
    def given_through(self) -> int:
        return self._program.given_through

    @property
    def lines_ahead(self) -> int:
        return self._program.lines_ahead

    @property
    def reports(self) -> Stream[Report]:
        async def open_reports() -> Feed[Report]:
            return self._program.reports

        return Stream(self._loop, self._loop.run(open_reports()))

    def send(self, line: str) -> Line:
        return Line(self._loop, self._loop.run(self._program.send(line)))

    def send_lines(self, lines: Iterable[str]) -> int:
        return self._loop.run(self._program.send_lines(from_thread(lines)))

    def done(self) -> None:
        self._loop.run(self._program.done())

    def close(self) -> None:
        self._loop.run(self._program.close())

    def finish(self) -> ProgramResult:
        return self._loop.run(self._program.finish())

    def hold(self) -> None:
        self._loop.run(self._program.hold())

    def resume(self) -> None:
        self._loop.run(self._program.resume())

    def step(self) -> None:
        self._loop.run(self._program.step())

    def abort(self) -> None:
        self._loop.run(self._program.abort())

    def override(self, percent: float) -> None:
        self._loop.run(self._program.override(percent))

    def status(self) -> ProgramStatus:
        return self._loop.run(self._program.status())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: Any) -> None:
        self._loop.run(self._program.__aexit__(kind, *rest))


class Machine:
    """As `mcclient.Machine`."""

    def __init__(self, loop: _LoopThread, machine: asynchronous.Machine) -> None:
        self._loop = loop
        self._machine = machine
        self.name = machine.name
        self.client = machine.client

    @classmethod
    def connect(
        cls,
        name: str | None = None,
        connect: str | Sequence[str] | None = None,
        *,
        client: str = "py",
        timeout_s: float = CONNECT_S,
        patience_s: float = PATIENCE_S,
        config_file: Path | None = None,
    ) -> Self:
        """As `mcclient.Machine.connect`."""

        async def start() -> asynchronous.Machine:
            return await asynchronous.Machine.connect(
                name,
                connect,
                client=client,
                timeout_s=timeout_s,
                patience_s=patience_s,
                config_file=config_file,
            )

        loop = _LoopThread()
        try:
            return cls(loop, loop.run(start()))
        except BaseException:
            loop.stop()
            raise

    def close(self) -> None:
        self._loop.run(self._machine.close())
        self._loop.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def info(self) -> Info:
        return self._machine.info

    def status(self) -> MachineStatus:
        return self._loop.run(self._machine.status())

    def programs(self, program: str | None = None, *, ended: bool = True) -> list[ProgramStatus]:
        return self._loop.run(self._machine.programs(program, ended=ended))

    def program(
        self,
        name: str = "",
        axes: Sequence[int] | None = None,
        *,
        on_disconnect: OnDisconnect = "stop",
        start_line: int = 1,
        before: Sequence[str] = (),
        step: bool = False,
        hold: bool = False,
    ) -> Program:
        """As `mcclient.Machine.program`."""

        async def start() -> asynchronous_program.Program:
            return await self._machine.program(
                name,
                axes,
                on_disconnect=on_disconnect,
                start_line=start_line,
                before=before,
                step=step,
                hold=hold,
            )

        return Program(self._loop, self._loop.run(start()))

    def resume_program(
        self,
        program: str,
        *,
        start_line: int,
        axes: Sequence[int] | None = None,
        on_disconnect: OnDisconnect = "stop",
        hold: bool = False,
    ) -> Program:
        """As `mcclient.Machine.resume_program`."""

        async def start() -> asynchronous_program.Program:
            return await self._machine.resume_program(
                program, start_line=start_line, axes=axes, on_disconnect=on_disconnect, hold=hold
            )

        return Program(self._loop, self._loop.run(start()))

    def hold(self, program: str | None = None) -> list[str]:
        return self._loop.run(self._machine.hold(program))

    def resume(self, program: str | None = None) -> list[str]:
        return self._loop.run(self._machine.resume(program))

    def abort(self, program: str | None = None) -> list[str]:
        return self._loop.run(self._machine.abort(program))

    def override(self, percent: float, program: str | None = None) -> float:
        return self._loop.run(self._machine.override(percent, program))

    def jog(
        self,
        axis: int,
        distance: float | None = None,
        *,
        velocity: float | None = None,
        hold_s: float | None = None,
        program: str | None = None,
    ) -> str:
        """As `mcclient.Machine.jog`."""
        return self._loop.run(
            self._machine.jog(axis, distance, velocity=velocity, hold_s=hold_s, program=program)
        )

    def home(self, axes: Sequence[int] | None = None) -> str:
        """As `mcclient.Machine.home`."""
        return self._loop.run(self._machine.home(axes))

    def reference(self, positions: Mapping[int, float]) -> None:
        """As `mcclient.Machine.reference`."""
        self._loop.run(self._machine.reference(positions))

    def reset(self, axes: Sequence[int] | None = None) -> None:
        self._loop.run(self._machine.reset(axes))

    def estop(self, reason: str = "", *, timeout_s: float = DEADLINE_S) -> None:
        self._loop.run(self._machine.estop(reason, timeout_s=timeout_s))

    def request_run(self, text: str, name: str = "", axes: list[int] | None = None) -> dict[str, Any]:
        """As `mcclient.arming.ArmingCalls.request_run`."""
        return self._loop.run(self._machine.request_run(text, name, axes))

    def run_requests(self) -> list[dict[str, Any]]:
        """As `mcclient.arming.ArmingCalls.run_requests`."""
        return self._loop.run(self._machine.run_requests())

    def run_preview(self, sha256: str) -> dict[str, Any]:
        """As `mcclient.arming.ArmingCalls.run_preview`."""
        return self._loop.run(self._machine.run_preview(sha256))

    def arm(
        self, sha256: str, *, seconds: float = 60.0, override: float = 100.0, number: int | None = None
    ) -> dict[str, Any]:
        """As `mcclient.arming.ArmingCalls.arm`."""
        return self._loop.run(self._machine.arm(sha256, seconds=seconds, override=override, number=number))

    def run_armed(self, text: str) -> dict[str, Any]:
        """As `mcclient.arming.ArmingCalls.run_armed`."""
        return self._loop.run(self._machine.run_armed(text))

    def set_output(self, name: str, value: bool | float) -> float:
        """As `mcclient.channels.ChannelCalls.set_output`."""
        return self._loop.run(self._machine.set_output(name, value))

    def set_simulated_input(self, name: str, value: bool | float) -> float:
        """As `mcclient.channels.ChannelCalls.set_simulated_input`."""
        return self._loop.run(self._machine.set_simulated_input(name, value))

    def drives(self) -> list[DriveInfo]:
        return self._loop.run(self._machine.drives())

    def drives_scan(self, bus: str = "") -> list[BusScan]:
        """As `mcclient.drives.DriveCalls.drives_scan`."""
        return self._loop.run(self._machine.drives_scan(bus))

    def sdo_read(
        self,
        axis: int | None,
        index: int,
        subindex: int = 0,
        *,
        type: str | None = None,
        node: int | None = None,
        bus: str = "",
    ) -> SdoObject:
        return self._loop.run(self._machine.sdo_read(axis, index, subindex, type=type, node=node, bus=bus))

    def sdo_write(
        self,
        axis: int | None,
        index: int,
        subindex: int,
        value: SdoValue,
        *,
        type: str | None = None,
        node: int | None = None,
        bus: str = "",
    ) -> SdoObject:
        return self._loop.run(
            self._machine.sdo_write(axis, index, subindex, value, type=type, node=node, bus=bus)
        )

    def put_text(self, path: Path, sha256: str | None = None) -> str:
        """As `mcclient.Machine.put_text`."""
        return self._loop.run(self._machine.put_text(path, sha256))

    def check(
        self,
        text: str | None = None,
        positions: dict[int, float] | None = None,
        *,
        sha256: str | None = None,
    ) -> CheckResult:
        return self._loop.run(self._machine.check(text, positions, sha256=sha256))

    def clients(self, *, timeout_s: float = 1.0) -> list[str]:
        """As `mcclient.Machine.clients`."""
        return self._loop.run(self._machine.clients(timeout_s=timeout_s))

    def simulate(
        self,
        text: str,
        positions: dict[int, float] | None = None,
        *,
        path_points: int = 0,
        lines: bool = True,
    ) -> dict[str, Any]:
        return self._loop.run(self._machine.simulate(text, positions, path_points=path_points, lines=lines))

    def telemetry(self) -> Stream[MachineStatus]:
        async def listen() -> Feed[MachineStatus]:
            return self._machine.telemetry()

        return Stream(self._loop, self._loop.run(listen()))

    def samples(self) -> Stream[Samples]:
        async def listen() -> Feed[Samples]:
            return self._machine.samples()

        return Stream(self._loop, self._loop.run(listen()))

    def events(self, *, history: bool = False) -> Stream[Event]:
        async def listen() -> Feed[Event]:
            return self._machine.events(history=history)

        return Stream(self._loop, self._loop.run(listen()))
