"""The client without ``async``: the same calls, carried out by a loop in a thread of its own.

::

    with Machine.connect() as machine:
        with machine.program() as program:
            program.send("G01 X10 F600")
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, Self

from mcclient import machine as asynchronous
from mcclient import program as asynchronous_program
from mcclient import servo as asynchronous_servo
from mcclient.blocking import Blocking, LoopThread, P, Stream, T, waited
from mcclient.blocking_calls import BlockingCalls
from mcclient.discovery import CONNECT_S
from mcclient.feed import Feed
from mcclient.lines import from_thread
from mcclient.machine import PATIENCE_S
from mcclient.reports import Report
from mcclient.servo import COUNTS_S
from mcclient.types import Info, ProgramState


def _opened(
    method: Callable[Concatenate[Any, P], Awaitable[asynchronous_program.Program]],
) -> Callable[Concatenate[Blocking[Any], P], Program]:
    """Make the same method, which opens a program, for callers that wait."""
    wait_for = waited(method)

    @wraps(method)
    def call(self: Blocking[Any], /, *arguments: P.args, **options: P.kwargs) -> Program:
        return Program(self._loop, wait_for(self, *arguments, **options))

    return call


def _streamed(
    method: Callable[Concatenate[Any, P], Feed[T]],
) -> Callable[Concatenate[Blocking[Any], P], Stream[T]]:
    """Make the same method, which begins to listen, for callers that wait."""

    @wraps(method)
    def call(self: Blocking[Any], /, *arguments: P.args, **options: P.kwargs) -> Stream[T]:
        async def listen() -> Feed[T]:
            return method(self._inner, *arguments, **options)

        return Stream(self._loop, self._loop.run(listen()))

    return call


def _reports(program: asynchronous_program.Program) -> Feed[Report]:
    return program.reports


class Line(Blocking[asynchronous_program.Line]):
    """A line that the server has taken."""

    done = waited(asynchronous_program.Line.done)

    @property
    def number(self) -> int:
        return self._inner.number


class Program(Blocking[asynchronous_program.Program]):
    """As `mcclient.Program`."""

    done = waited(asynchronous_program.Program.done)
    close = waited(asynchronous_program.Program.close)
    finish = waited(asynchronous_program.Program.finish)
    hold = waited(asynchronous_program.Program.hold)
    resume = waited(asynchronous_program.Program.resume)
    step = waited(asynchronous_program.Program.step)
    abort = waited(asynchronous_program.Program.abort)
    override = waited(asynchronous_program.Program.override)
    status = waited(asynchronous_program.Program.status)
    __exit__ = waited(asynchronous_program.Program.__aexit__)

    def __enter__(self) -> Self:
        return self

    @property
    def id(self) -> str:
        return self._inner.id

    @property
    def axes(self) -> tuple[int, ...]:
        return self._inner.axes

    @property
    def state(self) -> ProgramState:
        return self._inner.state

    @property
    def accepted_through(self) -> int:
        return self._inner.accepted_through

    @property
    def done_through(self) -> int:
        return self._inner.done_through

    @property
    def given_through(self) -> int:
        return self._inner.given_through

    @property
    def lines_ahead(self) -> int:
        return self._inner.lines_ahead

    @property
    def reports(self) -> Stream[Report]:
        return _streamed(_reports)(self)

    def send(self, line: str) -> Line:
        return Line(self._loop, self._loop.run(self._inner.send(line)))

    def send_lines(self, lines: Iterable[str]) -> int:
        return self._loop.run(self._inner.send_lines(from_thread(lines)))


class Servo(Blocking[asynchronous_servo.Servo]):
    """As `mcclient.Servo`."""

    send = waited(asynchronous_servo.Servo.send)
    status = waited(asynchronous_servo.Servo.status)
    close = waited(asynchronous_servo.Servo.close)
    abort = waited(asynchronous_servo.Servo.abort)
    __exit__ = waited(asynchronous_servo.Servo.__aexit__)

    def __enter__(self) -> Self:
        return self

    @property
    def id(self) -> str:
        return self._inner.id

    @property
    def axes(self) -> tuple[int, ...]:
        return self._inner.axes


class Machine(BlockingCalls[asynchronous.Machine]):
    """As `mcclient.Machine`."""

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

        loop = LoopThread()
        try:
            return cls(loop, loop.run(start()))
        except BaseException:
            loop.stop()
            raise

    def close(self) -> None:
        self._loop.run(self._inner.close())
        self._loop.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def name(self) -> str:
        return self._inner.name

    @property
    def client(self) -> str:
        return self._inner.client

    @property
    def info(self) -> Info:
        return self._inner.info

    program = _opened(asynchronous.Machine.program)
    continue_program = _opened(asynchronous.Machine.continue_program)

    def servo(
        self,
        axes: Sequence[int] | None = None,
        *,
        name: str = "",
        within: Mapping[int, tuple[float, float]] | None = None,
        counts_s: float = COUNTS_S,
        armed: bool = False,
    ) -> Servo:
        """As `mcclient.Machine.servo`."""

        async def opened() -> asynchronous_servo.Servo:
            return await self._inner.servo(axes, name=name, within=within, counts_s=counts_s, armed=armed)

        return Servo(self._loop, self._loop.run(opened()))

    refresh_info = waited(asynchronous.Machine.refresh_info)
    clients = waited(asynchronous.Machine.clients)
    put_text = waited(asynchronous.Machine.put_text)

    estop = waited(asynchronous.Machine.estop)

    read_mesh = waited(asynchronous.Machine.read_mesh)

    telemetry = _streamed(asynchronous.Machine.telemetry)
    samples = _streamed(asynchronous.Machine.samples)
    events = _streamed(asynchronous.Machine.events)
