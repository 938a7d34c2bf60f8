"""A hundred runs with faults at random moments: every line once and in order, or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from mcserver.planning.planner_messages import Validated
from mcserver.service import line_intake, program_table
from mcserver.service.planner_reports import PlannerReports
from mcserver.service.program import Program
from mcserver.service.program_table import ProgramTable
from mcserver.service.progress import LineProgress
from mcserver.service.progress_reports import ProgressReports
from mcserver.service.reports import ProgramState
from tests.service.simulated_cell import Cell, VirtualLoop
from tests.service.simulated_laws import Violation

# thousands more: make schedules
SEEDS = 60
FAULTS = 6


class NoHeartbeat:
    """The clock of the simulation is not that of threads."""

    def __init__(self, *_: object) -> None:
        pass

    def start(self) -> None:
        pass


def simulate(seed: int, journal: Path) -> tuple[dict[str, list[int]], float]:
    """One run; the lines that ran, by program, and when it ended."""
    loop = VirtualLoop()

    async def run() -> dict[str, list[int]]:
        cell = Cell(seed, journal, loop)
        try:
            await cell.run(FAULTS)
        finally:
            cell.close()
        return cell.executed

    try:
        return loop.run_until_complete(run()), loop.time()
    finally:
        loop.close()


@pytest.mark.parametrize("first", range(0, SEEDS, 20))
def test_every_line_runs_once_and_in_order_whatever_fails(
    first: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program_table, "Heartbeat", NoHeartbeat)
    for seed in range(first, first + 20):
        try:
            simulate(seed, tmp_path / f"{seed}.db")
        except Violation as violation:
            pytest.fail(f"seed {seed}: {violation}")


def test_a_server_that_takes_lines_of_before_a_rejection_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program_table, "Heartbeat", NoHeartbeat)
    monkeypatch.setattr(line_intake, "_of_now", lambda _program, _rejections: True)
    found = 0
    for seed in range(10):
        try:
            simulate(seed, tmp_path / f"{seed}.db")
        except Violation:
            found += 1
    assert found


def _simulate_many(count: int, folder: Path) -> None:
    for seed in range(count):
        simulate(seed, folder / f"{seed}.db")


def _say_what_is_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    validated = PlannerReports._validated

    def planned(reports: PlannerReports, program: Program, event: Validated) -> None:
        program.progress.passed(event.through)
        validated(reports, program, event)

    monkeypatch.setattr(PlannerReports, "_validated", planned)


def _say_before_the_journal(monkeypatch: pytest.MonkeyPatch) -> None:
    write = ProgressReports._write

    def ahead(reports: ProgressReports, program: Program) -> None:
        write(reports, program)
        program.done = program.progress.done

    monkeypatch.setattr(ProgressReports, "_write", ahead)


def _end_before_the_journal(monkeypatch: pytest.MonkeyPatch) -> None:
    end = ProgramTable.end

    def ahead(table: ProgramTable, program: Program, state: ProgramState) -> None:
        end(table, program, state)
        program.state = program.ended_as

    monkeypatch.setattr(ProgramTable, "end", ahead)


def _count_what_other_axes_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LineProgress, "faulted", lambda *_, **__: None)


@pytest.mark.parametrize(
    "plant",
    [_say_what_is_planned, _say_before_the_journal, _end_before_the_journal, _count_what_other_axes_pass],
)
def test_a_server_that_says_what_is_not_so_is_found(
    plant: Callable[[pytest.MonkeyPatch], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program_table, "Heartbeat", NoHeartbeat)
    plant(monkeypatch)
    with pytest.raises(Violation):
        _simulate_many(40, tmp_path)


def test_a_seed_is_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program_table, "Heartbeat", NoHeartbeat)
    assert simulate(7, tmp_path / "a.db") == simulate(7, tmp_path / "b.db")
