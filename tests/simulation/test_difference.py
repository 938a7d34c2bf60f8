"""The motion of two programs is compared: axes at the same time, tips' paths whatever their time."""

from __future__ import annotations

from typing import Any

import pytest

from mcserver.errors import Refused
from mcserver.machine.machine_file import load_machine
from mcserver.simulation.difference import MOST_CYCLES, CycleKeeper
from mcserver.simulation.program_checker import simulate_text

SQUARE = "G1010\nG94 F6000\nG01 X20\nY20\nX0\nY0\n"


def difference(text: str, other: str, machine: str = "cartesian") -> dict[str, Any]:
    report, _ = simulate_text(text, load_machine(machine), against=other)
    return dict(report["difference"])


def test_the_same_motion_written_otherwise_is_the_same_to_the_bit() -> None:
    found = difference(SQUARE, "(square)\n" + SQUARE.replace("G01", "g1"))
    assert found == {
        "same": True,
        "duration_s": 0.0,
        "axes": [],
        "tips": [{"tool": None, "apart_mm": 0.0, "time_s": 0.0, "line": 0, "other": False}],
    }


def test_another_place_is_named_by_axis_line_and_time() -> None:
    found = difference(SQUARE, SQUARE.replace("Y20", "Y23"))
    (axis,) = [each for each in found["axes"] if each["axis"] == 1]
    assert (axis["max"], axis["end"]) == (pytest.approx(3.0), pytest.approx(0.0))
    assert {each["axis"] for each in found["axes"]} == {0, 1}
    (tip,) = found["tips"]
    assert tip["apart_mm"] == pytest.approx(3.0, abs=1e-3)
    assert tip["line"] in (4, 5)
    assert found["duration_s"] > 0.0


def test_the_same_path_at_another_speed_differs_in_time_alone() -> None:
    found = difference(SQUARE, SQUARE.replace("F6000", "F3000"))
    assert found["duration_s"] == pytest.approx(0.8, abs=0.1)
    assert max(abs(each["most"]) for each in found["axes"]) > 10.0
    assert [each["apart_mm"] for each in found["tips"]] == [pytest.approx(0.0, abs=0.03)]


def test_a_detour_of_either_program_is_found() -> None:
    straight, bulge = "G1010\nG94 F6000\nG01 X40\n", "G1010\nG94 F6000\nG01 X20 Y7\nX40 Y0\n"
    for text, other, strays in ((straight, bulge, True), (bulge, straight, False)):
        (tip,) = difference(text, other)["tips"]
        assert tip["apart_mm"] == pytest.approx(7.0, abs=0.02)
        assert tip["other"] is strays


def test_tips_of_tools_are_compared() -> None:
    found = difference("G1010\nG94 F6000\nG01 T1 X470 Y10\n", "G1010\nG94 F6000\nG01 T1 X470 Y15\n", "arm6")
    (tip,) = found["tips"]
    assert tip["tool"] == 1
    assert tip["apart_mm"] == pytest.approx(5.0, abs=0.01)


def test_a_text_to_compare_with_that_has_faults_is_refused_with_its_line() -> None:
    with pytest.raises(Refused, match="in its line 2") as refused:
        difference(SQUARE, "G1010\nG01 X1O\n")
    assert refused.value.code == "MC332"


def test_a_run_that_is_too_long_to_be_kept_is_refused() -> None:
    keeper = CycleKeeper()

    class _Many:
        def __len__(self) -> int:
            return MOST_CYCLES + 1

    with pytest.raises(Refused, match="MC332"):
        keeper.take(_Many(), _Many(), _Many())  # type: ignore[arg-type]
