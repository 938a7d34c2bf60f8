"""A cell in which drives are disturbed: three axes in one motion over two buses, and the way back."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field

from mcclient import Event, Machine, MachineStatus, Program, ProgramFaulted, ProgramRejected, RequestRefused

from tests.e2e.observing import Recording, known, listening_events, recorded, run
from tests.e2e_can.bus_log import BusLog
from tests.e2e_can.cell import Cell

# X and Y with nodes 1 and 2 on the first bus, Z and a fourth axis on the second one
AXES = 4
GROUP = (0, 1, 2)
VICTIM = 1
NODE = VICTIM + 1
CYCLE_HZ = 100.0
START = ["G1010", "G00 X0 Y0 Z0"]
# 100 mm/s; line 3 is on its way when the fault comes
LINE = 3
END = (400.0, 300.0, 200.0)
MOTION = ["G1010", "G94 F6000", "G01 X400 Y300 Z200"]
# the same where the victim goes to points: each axis by itself
MOTION_TO_POINTS = ["G1010", "G94 F6000", "G00 X400 Y300 Z200"]
ENERGIZE = "G1010"
# a program of its own, which no fault of the group concerns: 5 s
OTHER = 3
OTHER_START = ["G1010", "G00 [3]0"]
OTHER_MOTION = ["G1010", "G94 F3000", "G01 [3]250"]
UNDER_WAY_MM = 20.0
LIMIT_S = 60.0
# a latch that opens by itself would do so within this time [s of the executor]
LATCH_S = 0.5


@dataclass(frozen=True)
class Moving:
    """A motion of the group, and every cycle since before its beginning."""

    program: Program
    recording: Recording


@dataclass
class Bench:
    """What a fault is put in, and what shows what came of it.

    Attributes:
        mode: of the victim's drive. events: of the machine, from the bench's beginning on.
    """

    cell: Cell
    machine: Machine
    log: BusLog
    mode: str = "csp"
    events: list[Event] = field(default_factory=list)
    _arrived: asyncio.Event = field(default_factory=asyncio.Event)

    async def until_event(self, begin: int, *kinds: str) -> Event:
        """The first event of these kinds from one number on."""
        async with asyncio.timeout(LIMIT_S):
            while True:
                for event in self.events[begin:]:
                    if event.kind in kinds:
                        return event
                self._arrived.clear()
                await self._arrived.wait()

    async def until(self, condition: str, *, axes: tuple[int, ...] = GROUP) -> MachineStatus:
        """The first state in which the axes move, or stand."""
        async with asyncio.timeout(LIMIT_S):
            async for status in self.machine.telemetry():
                if condition == "under way" and status.axes.setpoint[0] > UNDER_WAY_MM:
                    return status
                if condition == "at rest" and all(abs(status.axes.velocity[axis]) < 0.01 for axis in axes):
                    return status
        raise AssertionError("the states ended")

    async def later(self, seconds: float) -> MachineStatus:
        """The state after so much time of the executor."""
        since = (await self.machine.status()).t
        async with asyncio.timeout(LIMIT_S):
            async for status in self.machine.telemetry():
                if status.t >= since + seconds:
                    return status
        raise AssertionError("the states ended")

    @contextlib.asynccontextmanager
    async def moving(self) -> AsyncIterator[Moving]:
        """The group in the middle of its motion, recorded, and another program beside it."""
        await run(self.machine, START, list(GROUP))
        await run(self.machine, OTHER_START, [OTHER])
        async with recorded(self.machine) as recording:
            program = await self.machine.program(axes=list(GROUP))
            other = await self.machine.program(axes=[OTHER])
            await program.send_lines(MOTION_TO_POINTS if self.mode == "pp" else MOTION)
            await other.send_lines(OTHER_MOTION)
            await self.until("under way")
            yield Moving(program, recording)
            async with asyncio.timeout(LIMIT_S):
                await other.finish()

    async def refused_without_reset(self) -> str:
        """What the server says to a motion of the latched axes before G1000; empty: it moves."""
        try:
            step = "G91 G00 X1 Y1" if self.mode == "pp" else "G91 G94 F600 G01 X1 Y1"
            await run(self.machine, ["G1010", step], list(GROUP))
        except ProgramFaulted as faulted:
            ended = (await known(self.machine, faulted.program)).fault
            return faulted.code if ended is None else ended.code
        except (ProgramRejected, RequestRefused) as refused:
            return refused.code
        return ""

    async def recover(self) -> bool:
        """G1000 and G1010, then a motion to the start; again while a drive boots."""
        for _ in range(4):
            with contextlib.suppress(ProgramFaulted, ProgramRejected, RequestRefused):
                await run(self.machine, ["G1000", *START], list(GROUP))
                return True
            await self.later(0.5)
        return False

    async def keep_events(self) -> None:
        """For a task: fills `events`."""
        async for event in await listening_events(self.machine):
            self.events.append(event)
            self._arrived.set()
