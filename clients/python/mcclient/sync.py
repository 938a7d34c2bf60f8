"""The client without ``async``: the same calls, carried out by a loop in a thread of its own.

::

    with Machine.connect() as machine:
        with machine.program() as program:
            program.send("G01 X10 F600")
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable, Coroutine, Iterable, Iterator, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, Generic, ParamSpec, Self, TypeVar

from mcclient import machine as asynchronous
from mcclient import program as asynchronous_program
from mcclient.discovery import CONNECT_S
from mcclient.feed import Feed
from mcclient.lines import from_thread
from mcclient.machine import PATIENCE_S
from mcclient.reports import Report
from mcclient.types import Info

P = ParamSpec("P")
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


class _Blocking(Generic[T]):
    """Something asynchronous, and the loop that it lives in."""

    def __init__(self, loop: _LoopThread, inner: T) -> None:
        self._loop = loop
        self._inner = inner


def _waited(
    method: Callable[Concatenate[Any, P], Awaitable[T]],
) -> Callable[Concatenate[_Blocking[Any], P], T]:
    """Make the same method for callers that wait for its end."""

    @wraps(method)
    def call(self: _Blocking[Any], /, *arguments: P.args, **options: P.kwargs) -> T:
        async def work() -> T:
            return await method(self._inner, *arguments, **options)

        return self._loop.run(work())

    return call


def _opened(
    method: Callable[Concatenate[Any, P], Awaitable[asynchronous_program.Program]],
) -> Callable[Concatenate[_Blocking[Any], P], Program]:
    """Make the same method, which opens a program, for callers that wait."""
    waited = _waited(method)

    @wraps(method)
    def call(self: _Blocking[Any], /, *arguments: P.args, **options: P.kwargs) -> Program:
        return Program(self._loop, waited(self, *arguments, **options))

    return call


def _streamed(
    method: Callable[Concatenate[Any, P], Feed[T]],
) -> Callable[Concatenate[_Blocking[Any], P], Stream[T]]:
    """Make the same method, which begins to listen, for callers that wait."""

    @wraps(method)
    def call(self: _Blocking[Any], /, *arguments: P.args, **options: P.kwargs) -> Stream[T]:
        async def listen() -> Feed[T]:
            return method(self._inner, *arguments, **options)

        return Stream(self._loop, self._loop.run(listen()))

    return call


def _reports(program: asynchronous_program.Program) -> Feed[Report]:
    return program.reports


class Line(_Blocking[asynchronous_program.Line]):
    """A line that the server has taken."""

    done = _waited(asynchronous_program.Line.done)

    @property
    def number(self) -> int:
        return self._inner.number


class Program(_Blocking[asynchronous_program.Program]):
    """As `mcclient.Program`."""

    done = _waited(asynchronous_program.Program.done)
    close = _waited(asynchronous_program.Program.close)
    finish = _waited(asynchronous_program.Program.finish)
    hold = _waited(asynchronous_program.Program.hold)
    resume = _waited(asynchronous_program.Program.resume)
    step = _waited(asynchronous_program.Program.step)
    abort = _waited(asynchronous_program.Program.abort)
    override = _waited(asynchronous_program.Program.override)
    status = _waited(asynchronous_program.Program.status)
    __exit__ = _waited(asynchronous_program.Program.__aexit__)

    def __enter__(self) -> Self:
        return self

    @property
    def id(self) -> str:
        return self._inner.id

    @property
    def axes(self) -> tuple[int, ...]:
        return self._inner.axes

    @property
    def state(self) -> str:
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


class Machine(_Blocking[asynchronous.Machine]):
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

        loop = _LoopThread()
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
    resume_program = _opened(asynchronous.Machine.resume_program)

    refresh_info = _waited(asynchronous.Machine.refresh_info)
    status = _waited(asynchronous.Machine.status)
    programs = _waited(asynchronous.Machine.programs)
    clients = _waited(asynchronous.Machine.clients)
    put_text = _waited(asynchronous.Machine.put_text)
    check = _waited(asynchronous.Machine.check)
    simulate = _waited(asynchronous.Machine.simulate)

    hold = _waited(asynchronous.Machine.hold)
    resume = _waited(asynchronous.Machine.resume)
    step = _waited(asynchronous.Machine.step)
    abort = _waited(asynchronous.Machine.abort)
    override = _waited(asynchronous.Machine.override)
    jog = _waited(asynchronous.Machine.jog)
    home = _waited(asynchronous.Machine.home)
    reference = _waited(asynchronous.Machine.reference)
    reset = _waited(asynchronous.Machine.reset)
    estop = _waited(asynchronous.Machine.estop)

    request_run = _waited(asynchronous.Machine.request_run)
    run_requests = _waited(asynchronous.Machine.run_requests)
    run_preview = _waited(asynchronous.Machine.run_preview)
    arm = _waited(asynchronous.Machine.arm)
    reject = _waited(asynchronous.Machine.reject)
    withdraw = _waited(asynchronous.Machine.withdraw)
    run_armed = _waited(asynchronous.Machine.run_armed)

    set_output = _waited(asynchronous.Machine.set_output)
    set_simulated_input = _waited(asynchronous.Machine.set_simulated_input)

    model = _waited(asynchronous.Machine.model)
    read_mesh = _waited(asynchronous.Machine.read_mesh)

    drives = _waited(asynchronous.Machine.drives)
    drives_scan = _waited(asynchronous.Machine.drives_scan)
    sdo_read = _waited(asynchronous.Machine.sdo_read)
    sdo_write = _waited(asynchronous.Machine.sdo_write)

    start_recording = _waited(asynchronous.Machine.start_recording)
    stop_recording = _waited(asynchronous.Machine.stop_recording)
    save_black_box = _waited(asynchronous.Machine.save_black_box)
    recordings = _waited(asynchronous.Machine.recordings)

    telemetry = _streamed(asynchronous.Machine.telemetry)
    samples = _streamed(asynchronous.Machine.samples)
    events = _streamed(asynchronous.Machine.events)
