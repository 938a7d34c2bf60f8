"""A hundred runs with faults at random moments: every line once and in order, or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcserver.service import line_intake, program_table
from tests.service.simulated_cell import Cell, VirtualLoop
from tests.service.simulated_laws import Violation

# thousands more: make schedules
SEEDS = 100
FAULTS = 6
# A planner that is behind begins a program after its end, when its slot is another one's.
BROKEN_ONCE = (210064,)


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


@pytest.mark.parametrize("seed", BROKEN_ONCE)
def test_what_was_broken_once_holds(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program_table, "Heartbeat", NoHeartbeat)
    simulate(seed, tmp_path / "journal.db")


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


def test_a_seed_is_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program_table, "Heartbeat", NoHeartbeat)
    assert simulate(7, tmp_path / "a.db") == simulate(7, tmp_path / "b.db")
