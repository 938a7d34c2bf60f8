"""A long program is simulated part by part, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from mcserver.machine.machine_file import builtin_text, parse_machine
from mcserver.simulation import line_times
from mcserver.simulation.foresight import Foreseen, foresee_file
from mcserver.simulation.line_times import LineTimes
from mcserver.simulation.simulation import simulate, simulate_lines

IDEAL = parse_machine(builtin_text("cartesian").replace('kind = "simulated"', 'kind = "ideal"'))
BLOCK = 48
LINES = ["G1010", "G64", "F60000", "M0", *(f"G01 X{n % 5} Y{n % 3}" for n in range(6 * BLOCK)), "G04 P2"]


@pytest.fixture(scope="module", autouse=True)
def small_blocks() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(line_times, "BLOCK", BLOCK)
        yield


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> list[Foreseen]:
    path = tmp_path_factory.mktemp("texts") / "long.gcode"
    path.write_text("\n".join(LINES))
    parts: list[Foreseen] = []
    # every look at the clock is a second
    ticks = count()
    foresee_file(str(path), IDEAL, parts.append, lambda: float(next(ticks)), 5.0)
    return parts


def test_the_times_come_in_parts_and_end_complete(parts: list[Foreseen]) -> None:
    marks = [each.marks for each in parts]
    assert all(each is not None for each in marks)
    reached = [each.through for each in marks if each is not None]
    assert len(reached) > 3
    assert reached == sorted(reached)
    assert [each.complete for each in marks if each is not None] == [False] * (len(marks) - 1) + [True]
    assert reached[-1] == len(LINES)


def test_the_marks_are_those_of_the_whole_simulation(parts: list[Foreseen]) -> None:
    whole = simulate("\n".join(LINES), IDEAL)
    last = parts[-1].marks
    assert last is not None
    assert last.duration_s == pytest.approx(whole.report["duration_s"])
    assert last.pauses == (4,)
    for each in whole.report["lines"]:
        assert last.end_of(each["line"]) == pytest.approx(each["end_s"], abs=last.within_s + 1e-6)


def test_only_the_latest_lines_are_kept() -> None:
    times = LineTimes(keep=False)
    simulate_lines(lambda: iter(LINES), IDEAL, times=times)
    assert len(times) <= 4 * BLOCK < len(LINES)


def test_a_fault_far_down_is_said_without_any_times(tmp_path: Path) -> None:
    path = tmp_path / "faulty.gcode"
    path.write_text("\n".join([*LINES, "G01 Q5"]))
    parts: list[Foreseen] = []
    foresee_file(str(path), IDEAL, parts.append)
    (found,) = parts
    assert found.marks is None
    assert found.fault is not None
    assert found.fault.line == len(LINES) + 1


def test_a_program_read_line_by_line_runs_as_one_read_whole() -> None:
    text = "\n".join(LINES[:200])
    streamed = simulate_lines(lambda: iter(LINES[:200]), IDEAL)
    assert list(streamed.times.rows()) == simulate(text, IDEAL).report["lines"]
