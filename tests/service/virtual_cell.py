"""A service with the real planner and the real executor on a virtual clock, all in this process."""

from __future__ import annotations

import asyncio
import sqlite3
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mcserver.errors import ServiceError
from mcserver.executor.entries import ExecutorEvent
from mcserver.executor.shm.feedback import FeedbackState, SlotView
from mcserver.executor.shm.rings import ProgramRing
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.planning.planner import Planner
from mcserver.planning.planner_messages import OnPlannerEvents
from mcserver.planning.process import PipelineFactory
from mcserver.planning.start_state import StartState, StateBefore
from mcserver.planning.state_before import state_before
from mcserver.service.executor_port import ExecutorPort
from mcserver.service.homing import HomingService
from mcserver.service.jog import Jogging
from mcserver.service.journal_file import open_journal
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.references import References, references_file
from mcserver.service.reports import Event
from mcserver.service.service import MachineService
from mcserver.service.service_options import ServiceOptions
from mcserver.service.work_offsets import WorkOffsets, offsets_file
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.service.fakes import LoopPlanner

TURN_S = 0.05
GIVE_WAY_S = 1e-4
TURNS = 60_000


class _Faces:
    """A virtual executor as a server's process sees one."""

    def __init__(self, executor: VirtualExecutor) -> None:
        self._executor = executor
        self.mailbox, self.history = executor.mailbox, executor.history
        self.sink, self.open_slot = executor.sink, executor.open_slot
        self.epoch = time.time()
        self.alive = True
        self.ending = ""

    @property
    def feedback(self) -> FeedbackState:
        return self._executor.feedback

    def beat(self) -> None:
        """Nobody listens."""

    def stop(self) -> None:
        self.alive = False


class _Planning:
    """Plans in this loop."""

    def __init__(self, machine: Machine, executor: VirtualExecutor) -> None:
        self._machine = machine
        self._executor = executor
        self._pipelines = PipelineFactory(machine, lambda: executor.feedback)

    def planner(self, on_events: OnPlannerEvents) -> LoopPlanner:
        return LoopPlanner(Planner(self, self._pipelines, time.monotonic), on_events)

    def state_before(self, lines: Sequence[str], start: StartState, axes: frozenset[int]) -> StateBefore:
        return state_before(lines, len(lines) + 1, self._machine, start, lease=axes)

    def poll_events(self) -> list[ExecutorEvent]:
        return self._executor.events()

    def views(self, slots: Sequence[int]) -> list[SlotView]:
        override_of = self._executor.mailbox.effective_override
        newest = self._executor.history.newest_slots()
        return [SlotView(newest[slot][0], newest[slot][1], override_of(slot)) for slot in slots]

    def sink(self, slot: int) -> ProgramRing:
        ring = self._executor.sink(slot)
        ring.restart()
        return ring


class VirtualCell:
    """One start of a server; a second one on the same folder is a restart.

    Args:
        turn_s: the time that passes while the planner does a piece of work.

    Attributes:
        events: as published.
    """

    def __init__(
        self,
        machine: Machine,
        folder: Path,
        instance: str = "cell",
        connect: Callable[[Path], sqlite3.Connection] = open_journal,
        turn_s: float = TURN_S,
    ) -> None:
        self._cycles_a_turn = round(turn_s / machine.cycle_s)
        journal = folder / "journal.db"
        references = References(references_file(journal), machine).holding
        self.executor = VirtualExecutor(machine, homed=False, references=references)
        self.executor.executor.mount(WorkOffsets(offsets_file(journal)).tool)
        self.executor.step()
        self.events: list[Event] = []
        self._faces = _Faces(self.executor)
        self.service = MachineService(
            machine,
            ExecutorPort(machine, self._faces),
            _Planning(machine, self.executor),  # type: ignore[arg-type]
            ServiceOptions(journal=journal, instance=instance, connect=connect),
            on_ack=lambda _ack: None,
            on_event=self.events.append,
        )
        self.homing = HomingService(self.service)
        self.jogging = Jogging(self.service, build_kinematics(machine))
        self.service.start()
        self._clock = asyncio.ensure_future(self._run())

    async def _run(self) -> None:
        while True:
            self.executor.step(self._cycles_a_turn)
            # a loop that never waits takes the interpreter's lock again before the journal's thread has woken
            # up for it: virtual minutes would go by between a line's end and its place in the journal
            time.sleep(GIVE_WAY_S)
            await asyncio.sleep(0)

    async def until(self, done: Callable[[], bool]) -> None:
        for _ in range(TURNS):
            if done():
                return
            await asyncio.sleep(0.001)
        raise AssertionError(self.shown(), [(event.kind, event.message) for event in self.events])

    def shown(self) -> str:
        """Where programs and the executor are, for a test that fails."""
        newest = self.executor.feedback
        programs = [
            (each.program, each.state, each.done, each.fault, each.status().waits_for)
            for each in self.service._table.programs.values()
        ]
        return f"{programs} {newest.time} {newest.slots} {newest.setpoint} {newest.velocity}"

    async def ended(self, program: Program) -> Program:
        await self.until(lambda: program.ended)
        return program

    async def begin(self, *lines: str, client: str = "test", **opened: Any) -> Program:
        """A program that has all of its lines."""
        program = await self.service.open(client, ProgramOptions(**opened))
        self.service.lines.submit(client, program.program, 1, list(lines))
        self.service.lines.close(client, program.program)
        return program

    async def run(self, *lines: str, client: str = "test", **opened: Any) -> Program:
        return await self.ended(await self.begin(*lines, client=client, **opened))

    async def jog(
        self, axis: int, distance: float | None, velocity: float = 100.0, client: str = "page"
    ) -> Program:
        """A jog that has begun; without a distance it is held for ten seconds."""
        hold_s = 10.0 if distance is None else None
        name = await self.jogging.jog(
            client, axis, distance=distance, velocity=velocity, hold_s=hold_s, program_id=None
        )
        return self.service.program(name)

    def homed(self) -> list[bool]:
        return list(self.service.port.snapshot().homed)

    def position(self, axis: int) -> float:
        return self.service.port.snapshot().position[axis]

    async def stop(self) -> None:
        await self.service.stop()
        self._clock.cancel()

    def kill(self) -> None:
        """End without a word; the journal's lock and the thread that beats go with the process."""
        self._clock.cancel()
        self.service._table.heartbeat.stop()
        self.service._table.close_journal()


async def refused(cell: VirtualCell, call: Callable[[VirtualCell], object]) -> str:
    """The code with which a call is refused."""
    try:
        await call(cell)  # type: ignore[misc]
    except ServiceError as error:
        return error.code
    raise AssertionError("it was not refused")
