"""What a run shows: samples as a path, and the times of its lines."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterable
from dataclasses import dataclass, field

import numpy as np
from mcclient import Event, Feed, LineReport, Machine, Program, ProgramStatus, Report, RequestRefused, Samples
from numpy.typing import NDArray

Array = NDArray[np.float64]

LIMIT_S = 30.0


@dataclass
class Recording:
    """Cycles of all axes.

    Attributes:
        blocks: as they came.
        since_s: executor time from which on they count.
    """

    blocks: list[Samples] = field(default_factory=list)
    since_s: float = 0.0

    def _joined(self, name: str) -> Array:
        rows = np.concatenate([block.fields[name] for block in self.blocks])
        return rows[self._all_times() >= self.since_s]

    def _all_times(self) -> Array:
        return np.concatenate([block.time_s for block in self.blocks])

    @property
    def time_s(self) -> Array:
        """Shape (N,), executor time [s]."""
        times = self._all_times()
        return times[times >= self.since_s]

    @property
    def setpoint(self) -> Array:
        """Shape (N, axes) [mm, deg]."""
        return self._joined("setpoint")

    @property
    def actual(self) -> Array:
        """The encoders' readings, shape (N, axes) [mm, deg]."""
        return self._joined("position")

    @property
    def velocity(self) -> Array:
        """Shape (N, axes) [mm/s, deg/s]."""
        return self._joined("velocity")

    def between(self, start_s: float, end_s: float) -> Array:
        """Setpoints of the cycles in this span of executor time."""
        time_s = self.time_s
        return self.setpoint[(time_s >= start_s) & (time_s <= end_s)]


@contextlib.asynccontextmanager
async def recorded(machine: Machine) -> AsyncIterator[Recording]:
    """Every cycle from before the block until the state that the server had at its end."""
    recording = Recording()
    feed = machine.samples()
    arrived = asyncio.Event()

    async def keep() -> None:
        async for block in feed:
            recording.blocks.append(block)
            arrived.set()

    async def reach(time_s: float) -> None:
        async with asyncio.timeout(LIMIT_S):
            while not recording.blocks or recording.blocks[-1].time_s[-1] < time_s:
                arrived.clear()
                await arrived.wait()

    keeping = asyncio.create_task(keep())
    try:
        # the first message may hold cycles from before
        recording.since_s = (await machine.status()).t
        await reach(recording.since_s)
        yield recording
        await reach((await machine.status()).t)
    finally:
        feed.close()
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)


@dataclass(frozen=True)
class Ran:
    """A program that has finished, with the reports of its lines in the order in which they came."""

    program: str
    lines: list[LineReport]

    def line(self, number: int) -> LineReport:
        """The one report of a line."""
        (found,) = [each for each in self.lines if each.line == number]
        return found


async def run(machine: Machine, lines: Iterable[str], axes: list[int] | None = None) -> Ran:
    """Runs a program to its end, which has to be a good one."""
    async with asyncio.timeout(LIMIT_S), machine.program(axes=axes) as program:
        reports = await listening(machine, program)
        await program.send_lines(lines)
        await program.finish()
        ended = await ended_lines(reports)
    return Ran(program.id, ended)


async def listening(machine: Machine, program: Program) -> Feed[Report]:
    """The program's reports, once the server knows that somebody listens."""
    reports = program.reports
    # a question on the same link arrives after the subscription
    await machine.status()
    return reports


async def ended_lines(reports: Feed[Report]) -> list[LineReport]:
    """Reports of all lines, up to the program's end."""
    async with asyncio.timeout(LIMIT_S):
        return [report.timing async for report in reports if report.timing is not None]


async def line_started(reports: Feed[Report], line: int) -> None:
    """Until this line or a later one has started."""
    async with asyncio.timeout(LIMIT_S):
        async for report in reports:
            if report.kind == "started" and report.line >= line:
                return
    raise AssertionError(f"the program ended before line {line} started")


async def listening_events(machine: Machine) -> Feed[Event]:
    """The machine's events, once the server knows that somebody listens."""
    events = machine.events()
    await machine.status()
    return events


async def event(events: Feed[Event], kind: str, program: str | None = None) -> Event:
    """The next event of a kind, of one program or any."""
    async with asyncio.timeout(LIMIT_S):
        async for each in events:
            if each.kind == kind and program in (None, each.program):
                return each
    raise AssertionError(f"no event {kind}")


async def reset(machine: Machine) -> None:
    """Clears latched faults; asked again while motion comes to rest."""
    async with asyncio.timeout(LIMIT_S):
        while True:
            try:
                return await machine.reset()
            except RequestRefused as error:
                if error.code != "MC509":
                    raise


async def known(machine: Machine, program: str) -> ProgramStatus:
    """A program as the server knows it."""
    (found,) = await machine.programs(program)
    return found
