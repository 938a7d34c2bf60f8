"""The Python SDK's calls, each as a client's program makes it, timed one by one."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager

from mcclient import Machine

from tests.bench.server import Server

# of a block of calls: the first ones find nothing in the processor's cache
WARMING = 50


class SdkCalls:
    """A connected client, whose loop runs while calls are made.

    Args:
        runner: of the loop. machine: connected in it.
    """

    def __init__(self, runner: asyncio.Runner, machine: Machine) -> None:
        self._runner = runner
        self._machine = machine

    def status(self, calls: int, pause_s: float) -> list[float]:
        """Time of `Machine.status` [µs]."""
        return self._runner.run(_timed(self._machine.status, calls, pause_s))

    def acknowledged(self, calls: int, pause_s: float) -> list[float]:
        """Time of streaming one line, to its acknowledgement [µs]."""
        return self._runner.run(self._lines(calls, pause_s, judge=False))

    def judged(self, calls: int, pause_s: float) -> list[float]:
        """Time of sending one line, to the verdict on it [µs]."""
        return self._runner.run(self._lines(calls, pause_s, judge=True))

    async def _lines(self, calls: int, pause_s: float, *, judge: bool) -> list[float]:
        async with self._machine.program(name="bench") as program:

            async def send() -> object:
                return await (program.send("G04 P0") if judge else program.send_lines(["G04 P0"]))

            return await _timed(send, calls, pause_s)


async def _timed(call: Callable[[], Awaitable[object]], calls: int, pause_s: float) -> list[float]:
    taken = []
    for _ in range(calls):
        if pause_s:
            await asyncio.sleep(pause_s)
        start = time.perf_counter()
        await call()
        taken.append(1e6 * (time.perf_counter() - start))
    return taken[WARMING:]


@contextmanager
def sdk_calls(reached: Server) -> Iterator[SdkCalls]:
    """Connect the SDK to a server, as a program's only client would."""
    with asyncio.Runner() as runner:

        async def connect() -> Machine:
            return await Machine.connect(reached.machine, reached.endpoint)

        machine = runner.run(connect())
        try:
            yield SdkCalls(runner, machine)
        finally:
            runner.run(machine.close())
