"""A slow disk makes what is said later; it stops no motion, no stop, and no call of another program."""

from __future__ import annotations

import asyncio
import contextlib
import sqlite3
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from mcserver.errors import ServiceError
from mcserver.machine.machine_file import parse_machine
from mcserver.service.journal_file import open_journal
from mcserver.service.journal_reader import read_programs, read_recorded
from mcserver.service.kept_file import replace_file
from mcserver.service.line_queue import LineQueue
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.progress_reports import LINES, ProgressReports
from mcserver.service.servo import open_servo
from mcserver.service.work_offsets import WorkOffsets
from tests.machine_text import axes_text
from tests.service.test_done import machine
from tests.service.test_homing import machine as machine_with_homing
from tests.service.virtual_cell import VirtualCell

MILL = '[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n' + axes_text()


class StallingDisk:
    """A journal's connection whose commits wait while the disk stalls."""

    def __init__(self) -> None:
        self.goes_on = threading.Event()
        self.goes_on.set()
        self._connection: sqlite3.Connection | None = None

    def connect(self, path: Path) -> StallingDisk:
        self._connection = open_journal(path)
        return self

    def execute(self, statement: str, parameters: tuple[object, ...] = ()) -> Iterable[Any]:
        assert self._connection is not None
        if statement == "COMMIT":
            self.goes_on.wait()
        return self._connection.execute(statement, parameters)

    def close(self) -> None:
        assert self._connection is not None
        self._connection.close()


@pytest.fixture
def disk() -> StallingDisk:
    return StallingDisk()


@pytest.fixture
async def cell(tmp_path: Path, disk: StallingDisk) -> AsyncIterator[VirtualCell]:
    made = VirtualCell(machine(), tmp_path, connect=disk.connect)
    yield made
    disk.goes_on.set()
    await made.stop()


def journaled_done(cell: VirtualCell, program: str) -> int:
    (kept,) = read_programs(cell.service.options.journal, limit=1, program=program)
    return kept.done


async def test_a_program_runs_on_and_gives_its_axes_away_while_the_disk_stalls(
    cell: VirtualCell, disk: StallingDisk
) -> None:
    service = cell.service
    first = await service.open("test", ProgramOptions(axes=[0], hold=True))
    second = await service.open("test", ProgramOptions(axes=[0]))
    await service.lines.submit("test", first.program, 1, ["G1010 P0", "G01 X20 F600"], judge=False)
    await service.lines.submit("test", second.program, 1, ["G01 X40 F600"], judge=False)
    await service.lines.close("test", first.program)
    await service.lines.close("test", second.program)
    # what ends a text comes to the planner through the journal too
    committed = asyncio.Event()
    service._table.journal.after(committed.set)
    await cell.until(committed.is_set)
    disk.goes_on.clear()
    service.resume(first.program)
    await cell.until(lambda: first.over)
    await cell.until(lambda: cell.position(0) > 0.03)
    said = [first.status(), first.ack()]
    assert {each.state for each in said} == {"ending"}
    assert {each.done for each in said} <= {0, 1}
    assert not any(event.kind == "program.ended" for event in cell.events)
    assert journaled_done(cell, first.program) >= max(each.done for each in said)
    disk.goes_on.set()
    await cell.ended(first)
    assert (first.status().state, first.done) == ("finished", 2)


async def test_a_hold_and_a_stop_wait_for_no_disk(cell: VirtualCell, disk: StallingDisk) -> None:
    service = cell.service
    program = await service.open("test", ProgramOptions(axes=[0]))
    await service.lines.submit("test", program.program, 1, ["G1010 P0", "G01 X900 F600"], judge=False)
    await cell.until(lambda: program.progress.started == 2)
    disk.goes_on.clear()
    service.hold(program.program)
    await cell.until(lambda: not any(service.port.snapshot().velocity))
    service.resume(program.program)
    await cell.until(lambda: any(service.port.snapshot().velocity))
    service.latch.emergency_stop("hmi", "test")
    assert service.latch.state == "estop"
    await cell.until(lambda: program.over)
    # the machine can be used again, whatever the disk does
    service.reset(None)
    assert service.latch.state == "ready"


async def test_a_program_is_said_to_be_open_once_it_can_be_found_after_a_kill(
    cell: VirtualCell, disk: StallingDisk
) -> None:
    disk.goes_on.clear()
    program = await cell.service.open("test", ProgramOptions(axes=[0]))
    said = asyncio.ensure_future(cell.service.recorded(program))
    await cell.until(lambda: program.state == "running")
    assert not said.done()
    disk.goes_on.set()
    await cell.until(said.done)
    (kept,) = read_programs(cell.service.options.journal, limit=1, program=program.program)
    assert kept.program == program.program


async def test_of_a_program_whose_opening_is_said_ahead_of_the_journal_no_line_runs(
    tmp_path: Path, cell: VirtualCell, disk: StallingDisk
) -> None:
    await cell.run("G1010 P0", axes=[0])
    disk.goes_on.clear()
    program = await cell.service.open("test", ProgramOptions(axes=[0]))
    taken = cell.service.lines.submit("test", program.program, 1, ["G1010 P0", "G01 X20 F600"], judge=False)
    kinds = {"program.opened", "program.started"}
    await cell.until(lambda: kinds <= {each.kind for each in cell.events if each.program == program.program})
    turns = iter(range(50))
    await cell.until(lambda: next(turns, None) is None)
    # what a killed server would leave behind
    with pytest.raises(ServiceError, match="MC503"):
        read_recorded(tmp_path / "journal.db", program.program)
    assert (cell.position(0), program.progress.started) == (0.0, 0)
    disk.goes_on.set()
    await taken


async def test_a_text_is_said_to_be_whole_once_the_journal_has_it(
    cell: VirtualCell, disk: StallingDisk
) -> None:
    program = await cell.service.open("test", ProgramOptions(axes=[0]))
    await cell.service.lines.submit("test", program.program, 1, ["G04 P9"], judge=False)
    disk.goes_on.clear()
    closed = cell.service.lines.close("test", program.program, 1)
    turns = iter(range(20))
    await cell.until(lambda: next(turns, None) is None)
    assert not closed.done()
    disk.goes_on.set()
    await cell.until(closed.done)
    kept = read_recorded(cell.service.options.journal, program.program)
    assert kept.whole


async def test_lines_are_taken_while_a_sync_lasts(cell: VirtualCell, monkeypatch: pytest.MonkeyPatch) -> None:
    syncing, synced = threading.Event(), threading.Event()

    def slow(_file: int) -> None:
        syncing.set()
        synced.wait()

    with contextlib.ExitStack() as stack:
        stack.callback(synced.set)
        monkeypatch.setattr("os.fdatasync", slow)
        program = await cell.service.open("test", ProgramOptions(axes=[0]))
        await cell.until(syncing.is_set)
        taken = await cell.service.lines.submit("test", program.program, 1, ["G04 P0"])
        assert taken.journaled == 1
        await cell.until(lambda: program.done == 1)


async def test_a_disk_that_stalls_under_the_tables_stalls_nothing_else_and_their_line_is_not_done_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = VirtualCell(parse_machine(MILL), tmp_path)
    syncing, goes_on, in_vain = threading.Event(), threading.Event(), []

    def slow(_file: int) -> None:
        syncing.set()
        if not goes_on.wait(60.0):
            in_vain.append("nobody else could go on")

    monkeypatch.setattr("os.fsync", slow)
    lines = ["G10 L2 P1 X5", "G04 P0.01", "G04 P0.01"]
    program = await cell.service.open("test", ProgramOptions(axes=[0]))
    await cell.service.lines.submit("test", program.program, 1, lines, judge=False)
    await cell.until(syncing.is_set)
    await cell.until(lambda: program.progress.done == 3)
    assert program.done == 0
    assert cell.service.work_tables.systems
    goes_on.set()
    await cell.until(lambda: program.done == 3)
    assert in_vain == []
    await cell.stop()


HOMED = axes_text(keys='homing = { method = "manual" }')
REFERENCED = f'[machine]\nname = "referenced"\n{HOMED}{axes_text([1])}'


class StallingSync:
    """`os.fsync`, which waits while the disk stalls."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.waits, self.goes_on = threading.Event(), threading.Event()
        self.in_vain = False
        monkeypatch.setattr("os.fsync", self._sync)

    def _sync(self, _file: int) -> None:
        self.waits.set()
        self.in_vain |= not self.goes_on.wait(60.0)


@pytest.mark.parametrize("order", ["", "hold", "abort", "estop"])
async def test_an_axis_moves_once_the_disk_has_it_that_its_reading_holds_no_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, order: str
) -> None:
    cell = VirtualCell(parse_machine(REFERENCED), tmp_path)
    service = cell.service
    other = await service.open("test", ProgramOptions(axes=[1]))
    await service.lines.submit("test", other.program, 1, ["G1010 P1", "G01 Y900 F600"], judge=False)
    await cell.homing.reference("test", {0: 0.0})
    await cell.until(lambda: cell.position(1) > 0.0)
    disk = StallingSync(monkeypatch)
    program = await service.open("test", ProgramOptions(axes=[0]))
    await cell.until(disk.waits.is_set)
    assert program.state == "running"
    taken = service.lines.submit("test", program.program, 1, ["G1010 P0", "G01 X20 F600"], judge=False)
    # the others neither wait for it
    service.hold(other.program)
    await cell.until(lambda: not service.port.snapshot().velocity[1])
    if order == "hold":
        service.hold(program.program)
    elif order == "abort":
        service.abort(program.program)
    elif order == "estop":
        service.latch.emergency_stop("hmi", "test")
    turns = iter(range(50))
    await cell.until(lambda: next(turns, None) is None)
    assert (cell.position(0), program.slot) == (0.0, None)
    disk.goes_on.set()
    if order in ("abort", "estop"):
        await cell.until(lambda: program.ended)
        assert cell.position(0) == 0.0
    else:
        await taken
        await cell.until(lambda: program.slot is not None)
        assert program.state == ("held" if order else "running")
        service.resume(None)
        await cell.until(lambda: cell.position(0) == pytest.approx(0.02))
    assert not disk.in_vain
    await cell.stop()


async def test_on_a_full_disk_a_line_that_changes_the_tables_is_not_done_and_no_program_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = VirtualCell(parse_machine(MILL), tmp_path)
    full = True

    def write(path: Path, content: bytes) -> None:
        if full:
            raise OSError(28, "No space left on device")
        replace_file(path, content)

    monkeypatch.setattr("mcserver.service.kept_file.replace_file", write)
    program = await cell.service.open("test", ProgramOptions(axes=[0]))
    await cell.service.lines.submit("test", program.program, 1, ["G10 L2 P1 X5", "G04 P0.01"], judge=False)
    await cell.until(lambda: program.progress.done == 2)
    await cell.until(lambda: any(event.reason == "MC519" for event in cell.events))
    assert program.done == 0
    assert journaled_done(cell, program.program) == 0
    with pytest.raises(ServiceError, match=r"MC519.*No space left"):
        await cell.service.open("test", ProgramOptions(axes=[0]))
    full = False
    await cell.until(lambda: program.done == 2)
    again = WorkOffsets(tmp_path / "journal.db.offsets.json")
    assert again.systems == {1: {0: pytest.approx(0.005)}}
    await cell.stop()


class WaitingJournal:
    """Takes records of progress; the test commits them."""

    def __init__(self) -> None:
        self.waiting: list[tuple[int, Callable[[], None]]] = []
        self.started = 0

    def progress(self, _program: str, started: int, done: int, committed: Callable[[], None]) -> None:
        self.started = started
        self.waiting.append((done, committed))

    def commit(self) -> None:
        self.waiting.pop(0)[1]()


class Reported:
    """A program of short lines, on a loop whose ticks the test makes."""

    def __init__(self) -> None:
        self.journal = WaitingJournal()
        self.ticks: list[Callable[[], None]] = []
        self.program = Program("p", "hmi", [0], ProgramOptions(), opened_at=0.0, queue=LineQueue())
        loop: Any = self
        journal: Any = self.journal
        self._reports = ProgressReports(loop, journal, lambda *_, **__: None, lambda _program: None)

    def call_later(self, _delay_s: float, tick: Callable[[], None]) -> None:
        self.ticks.append(tick)

    def run(self, lines: int) -> None:
        for _ in range(lines):
            self.program.progress.passed(self.program.progress.done + 1)
            self._reports.moved(self.program)

    def begin(self, line: int) -> None:
        self.program.progress.line_started(line, 0.0)
        self._reports.moved(self.program)


def test_what_has_ended_goes_to_the_journal_with_the_tick_or_so_many_lines() -> None:
    reported = Reported()
    reported.run(LINES - 1)
    assert (len(reported.journal.waiting), len(reported.ticks)) == (0, 1)
    reported.run(1)
    assert [done for done, _ in reported.journal.waiting] == [LINES]
    reported.journal.commit()
    reported.run(1)
    reported.ticks.pop()()
    assert [done for done, _ in reported.journal.waiting] == [LINES + 1]


def test_one_record_is_on_its_way_and_the_next_has_all_that_came_meanwhile() -> None:
    reported = Reported()
    reported.run(10 * LINES)
    assert [done for done, _ in reported.journal.waiting] == [LINES]
    assert reported.program.done == 0
    reported.journal.commit()
    assert reported.program.done == LINES
    assert [done for done, _ in reported.journal.waiting] == [10 * LINES]


def test_a_line_that_has_only_begun_is_in_the_journal_also_behind_one_that_moves_nothing() -> None:
    reported = Reported()
    reported.run(1)
    reported.ticks.pop()()
    # while that record is on its way
    reported.begin(2)
    reported.ticks.pop()()
    reported.journal.commit()
    assert (reported.journal.waiting, reported.journal.started) == ([], 0)
    reported.ticks.pop()()
    assert ([done for done, _ in reported.journal.waiting], reported.journal.started) == ([1], 2)
    reported.journal.commit()
    assert (reported.journal.waiting, reported.ticks) == ([], [])


BEGINNINGS: dict[str, Callable[[VirtualCell], Awaitable[Program]]] = {
    "jog": lambda cell: cell.jog(4, 1.0),
    "home": lambda cell: cell.homing.home("test", [1]),
    "servo": lambda cell: open_servo(cell.service, "test", [4]),
}


@pytest.mark.parametrize("what", BEGINNINGS)
async def test_what_has_no_lines_of_a_client_is_said_to_have_begun_once_it_can_be_found_after_a_kill(
    tmp_path: Path, disk: StallingDisk, what: str
) -> None:
    cell = VirtualCell(machine_with_homing(), tmp_path, connect=disk.connect)
    try:
        disk.goes_on.clear()
        said = asyncio.ensure_future(BEGINNINGS[what](cell))
        turns = iter(range(50))
        await cell.until(lambda: next(turns, None) is None)
        assert not said.done()
        disk.goes_on.set()
        await cell.until(said.done)
        begun = said.result().program
        (kept,) = read_programs(cell.service.options.journal, limit=1, program=begun)
        assert kept.program == begun
    finally:
        disk.goes_on.set()
        await cell.stop()
