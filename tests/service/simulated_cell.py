"""Clients, network, service, journal, planner and executor on one virtual clock, with faults from one seed.

Nothing here waits: time goes on to the next thing that is due. Messages are lost, doubled, late and out of
order; the disk is full or stalls for a while; drives fail; the planner and the server are killed at any
moment. After each step that can be seen from outside, what has to hold is checked. The same seed is the same
run.
"""

from __future__ import annotations

import asyncio
import random
import selectors
import sqlite3
from collections import defaultdict
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from mcserver.errors import ServiceError
from mcserver.service.reports import Ack, Event
from mcserver.service.service import MachineService
from mcserver.service.service_options import ServiceOptions
from tests.service.simulated_client import SimulatedClient
from tests.service.simulated_laws import Said, Violation, require
from tests.service.simulated_machine import SimulatedDisk, SimulatedPlanner, SimulatedPlanning, SimulatedPort

LIMIT_S = 60.0


class _NothingToRead(selectors.SelectSelector):
    """Asks the system for nothing: all that happens here is in timers and callbacks."""

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:  # noqa: ARG002
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop whose time goes on to the next timer when nothing else is to be done."""

    def __init__(self) -> None:
        self._virtual = 0.0
        super().__init__(_NothingToRead())

    def time(self) -> float:
        return self._virtual

    def _run_once(self) -> None:
        # asyncio's own names: the one place where the next timer can be seen
        timers = self._scheduled  # type: ignore[attr-defined]
        if not self._ready and timers:  # type: ignore[attr-defined]
            self._virtual = max(self._virtual, timers[0]._when)
        super()._run_once()  # type: ignore[misc]


class Cell:
    """One run.

    Args:
        seed: of all that happens. journal: its file.
    """

    def __init__(self, seed: int, journal: Path, loop: VirtualLoop) -> None:
        self.random = random.Random(seed)
        self.loop = loop
        self._tasks: set[asyncio.Task[None]] = set()
        self.executed: dict[str, list[int]] = {}
        # the last line of each that has ended, and the line under way in a slot
        self.ended: defaultdict[str, int] = defaultdict(int)
        self.under_way: defaultdict[int, int] = defaultdict(int)
        self.said = Said(lambda program: self.ended[program], self._journaled_end)
        # the same by text
        self.texts: defaultdict[str, dict[int, str]] = defaultdict(dict)
        self.calm = False
        # in callbacks of the loop, and within the planner, which takes them for defects of its own
        self._violations: list[Violation] = []
        # lines of the programs that a kill of the server has ended
        self._kept: dict[str, int] = {}
        loop.set_exception_handler(self._on_exception)
        self._journal = journal
        # reads what is committed; opened by the first question after a start of the server
        self._reader: sqlite3.Connection | None = None
        self._starts = 0
        self.port: SimulatedPort
        self.planner: SimulatedPlanner
        self.service: MachineService
        self._disk: SimulatedDisk
        self._start()
        self._clients = [
            SimulatedClient(self, f"c{n}", self.random.randint(1, 40), axes)
            for n, axes in enumerate([[0], [1], [0, 1], [2]])
        ]

    # ------------------------------------------------------------ what happens

    def later(self, function: Callable[..., None], *arguments: object) -> None:
        self.loop.call_later(self.random.expovariate(50.0), function, *arguments)

    def begin(self, work: Coroutine[Any, Any, None]) -> None:
        """Begins what waits for answers."""
        task = self.loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def network(self, deliver: Callable[[], None]) -> None:
        """Delivers a message late, twice or not at all."""
        copies = 1 if self.calm else self.random.choice([0, 1, 1, 1, 1, 2])
        for _ in range(copies):
            self.loop.call_later(self.random.expovariate(20.0), deliver)

    def execute(self, program: str, number: int, text: str) -> None:
        """A line begins to move."""
        try:
            self._execute(program, number, text)
        except Violation as violation:
            self._violations.append(violation)
            raise

    def _on_exception(self, _loop: asyncio.AbstractEventLoop, context: dict[str, object]) -> None:
        error = context.get("exception")
        violation = error if isinstance(error, Violation) else Violation(f"{context['message']}: {error!r}")
        self._violations.append(violation)

    def _execute(self, program: str, number: int, text: str) -> None:
        ran = self.executed.setdefault(program, [])
        require(not self.port.stopped, f"{program} runs line {number} in an emergency stop")
        require(number == (ran[-1] if ran else 0) + 1, f"{program} runs line {number} after {ran[-1:]}")
        require(text.startswith(f"move {program}:{number} "), f"{program} runs {text!r} as line {number}")
        require(self._journaled(program) >= number, f"{program} runs line {number}, which is not journaled")
        ran.append(number)
        self.texts[program][number] = text
        for client in self._clients:
            accepted = client.accepted_text(program, number)
            require(
                accepted in (None, text), f"{program} runs {text!r}, not {accepted!r}, which was accepted"
            )

    def agree(self, program: str, accepted: dict[int, str]) -> None:
        """What ran is what a client takes for accepted."""
        for number, text in accepted.items():
            ran = self.texts[program].get(number)
            require(ran == text, f"{program} ran {ran!r}, and {text!r} was said to be accepted")

    async def run(self, faults: int) -> None:
        """Lets faults happen, then a calm in which every program has to come to its end."""
        for client in self._clients:
            client.work()
        self._write()
        try:
            await self._pass(faults)
        finally:
            if self._violations:
                raise self._violations[0]

    async def _pass(self, faults: int) -> None:
        kinds = [
            self.planner_killed,
            self.server_killed,
            self.disk_full,
            self.disk_stalled,
            self.drive_failed,
            self.stopped,
            self.aborted,
        ]
        for _ in range(faults):
            await asyncio.sleep(self.random.expovariate(3.0))
            if self._violations:
                return
            self.random.choice(kinds)()
        self.calm, self._disk.full, self._disk.stalled = True, False, False
        self._reset()
        until = self.loop.time() + LIMIT_S
        while not (self._violations or all(client.done for client in self._clients)):
            require(self.loop.time() < until, f"programs do not end: {self._states()}")
            await asyncio.sleep(0.1)
        for program, kept in self._kept.items():
            found = self._journaled(program)
            require(found == kept, f"{program} was killed with {kept} lines journaled, {found} came back")

    def planner_killed(self) -> None:
        self.planner.kill()

    def server_killed(self) -> None:
        self.close()
        for program, ran in self.executed.items():
            self._kept[program] = self._journaled(program)
            require(self._kept[program] >= len(ran), f"{program} ran lines that the journal has lost")
            done = self._journaled_end(program)[0]
            require(done <= self.ended[program], f"the journal has {program} done through {done}, {ran} ran")
        self.said.judge_after_a_kill()
        self._start()
        for client in self._clients:
            client.forget()

    def disk_full(self) -> None:
        self._disk.full = not self._disk.full

    def disk_stalled(self) -> None:
        disk = self._disk
        disk.stalled = True
        self.loop.call_later(self.random.expovariate(0.5), setattr, disk, "stalled", False)

    def drive_failed(self) -> None:
        moving = self.port.moving()
        if moving:
            slot = self.random.choice(moving)
            self.port.fail(slot, self.under_way[slot])
            self.later(self._reset)

    def stopped(self) -> None:
        self.service.latch.emergency_stop("", "seed")
        require(self.service.latch.state == "estop", "an emergency stop does not show")
        self.later(self._reset)

    def aborted(self) -> None:
        self.service.abort(None, "seed")

    # ------------------------------------------------------------ inside

    def _start(self) -> None:
        self._starts += 1
        start = self._starts
        self.port = SimulatedPort(self)
        self.service = MachineService(
            self.port.machine,
            self.port,
            SimulatedPlanning(self),
            ServiceOptions(
                journal=self._journal,
                instance=f"i{start}",
                clock=self.loop.time,
                monotonic=self.loop.time,
                connect=self._connect,
                journal_thread=False,
            ),
            on_ack=lambda ack: self._on_ack(start, ack),
            on_event=lambda event: self._on_event(start, event),
        )
        self._seq = 0
        self.service.start()

    def _connect(self, path: Path) -> SimulatedDisk:
        self._disk = SimulatedDisk(path)
        return self._disk

    def close(self) -> None:
        """Ends the server at once: what was not committed is lost, nobody hears what was under way."""
        self._starts += 1
        self._forget_reader()
        self.planner._life += 1
        self.service._table.close_journal()

    def _write(self) -> None:
        if not self._disk.stalled:
            self.service._table.journal.write_pending()
        for program in self.service.current():
            status = program.status()
            self.said.hear("status", status.program, status.done, status.state)
        self.later(self._write)

    def _reset(self) -> None:
        try:
            self.service.reset(None)
        except ServiceError:
            self.later(self._reset)

    def _on_ack(self, start: int, ack: Ack) -> None:
        if start != self._starts:
            return
        require(ack.accepted <= self._journaled(ack.program), f"{ack} before its lines are journaled")
        self.said.hear("ack", ack.program, ack.done, ack.state)
        for client in self._clients:
            self.network(lambda client=client: client.on_ack(ack))  # type: ignore[misc]

    def _on_event(self, start: int, event: Event) -> None:
        repeated = event.kind == "estop" and event.seq <= self._seq
        if start == self._starts and not repeated:
            self._seq += 1
            require(event.seq == self._seq, f"event {event.seq} after {self._seq - 1}")
            if event.kind == "lines.ended" and event.program:
                last = event.lines[-1].line
                # it is done once what comes next has begun
                self.said.hear("lines.ended", event.program, last - 1, None)
                require(last <= self.ended[event.program], f"{event.program} has not ended {last}")
            if event.kind == "program.ended" and event.program:
                self.said.hear("program.ended", event.program, event.line, event.state)

    def _journaled(self, program: str) -> int:
        return self._ask("SELECT coalesce(max(last), 0) FROM chunks WHERE program=?", program)

    def _journaled_end(self, program: str) -> tuple[int, str | None]:
        """How far the journal has a program, and its state there."""
        rows = self._rows("SELECT done, state FROM programs WHERE program=?", program)
        return (int(rows[0][0]), rows[0][1]) if rows else (0, None)

    def _ask(self, sql: str, *parameters: str) -> int:
        return int(self._rows(sql, *parameters)[0][0])

    def _rows(self, sql: str, *parameters: str) -> list[tuple[Any, ...]]:
        if self._reader is None:
            self._reader = sqlite3.connect(self._journal, isolation_level=None)
        return self._reader.execute(sql, parameters).fetchall()

    def _forget_reader(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _states(self) -> list[str]:
        programs = [program.status() for program in self.service.current()]
        return [
            f"{each.program} of {each.client}: {each.state}, {each.accepted}/{each.done}" for each in programs
        ]
