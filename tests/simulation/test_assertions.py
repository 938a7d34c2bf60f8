"""Assertions are judged on every setpoint; each that does not hold is named with line, time and value."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mcserver.errors import Refused, UsageFault
from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.assertions import Assertion, read_assertion
from mcserver.simulation.program_checker import simulate_text
from mcserver.simulation.simulation import simulate

PROGRAM = "G1010\nG94 F6000\nG01 X30 Y40\nG01 Z-3\nG00 Z5\n"
POST = str(Path(__file__).parents[2] / "examples" / "post-and-door.toml")


def judged(asked: str, text: str = PROGRAM, machine: str = "cartesian") -> dict[str, Any]:
    described = load_machine(machine)
    found = simulate(
        text, described, kinematics=build_kinematics(described), assertions=[read_assertion(asked)]
    )
    (one,) = found.report["assertions"]
    faults = [each for each in found.report["diagnostics"] if each["code"] == "MC330"]
    assert found.report["ok"] is one["holds"] is (not faults) is (found.exit_code == 0)
    return {**one, "faults": faults}


@pytest.mark.parametrize(
    ("asked", "holds", "value", "line"),
    [
        ("end X least=29.95 most=30.05", True, 30.0, 5),
        ("end Z most=0", False, 5.0, 5),
        ("position Z least=-3", True, -3.0, 5),
        ("position Z least=-2.5", False, -3.0, 4),
        ("position Z least=-2.5 most=100", False, -3.0, 4),
        ("position Y most=39", False, 40.0, 3),
        ("travel A most=0", True, 0.0, 0),
        ("travel Z most=1", False, 8.0, 5),
        ("speed X most=60.1", True, 60.0, 3),
        ("speed Y most=60", False, 80.0, 3),
        ("speed Y least=90", False, 80.0, 3),
        ("duration least=0.5 most=2", True, None, 5),
        ("duration most=0.1", False, None, 5),
    ],
)
def test_each_quantity_is_bounded_to_both_sides(
    asked: str, holds: bool, value: float | None, line: int
) -> None:
    found = judged(asked)
    assert found["holds"] is holds
    assert value is None or found["value"] == pytest.approx(value, abs=1e-6)
    assert found["line"] == line
    assert [each["line"] for each in found["faults"]] == ([] if holds else [line])


def test_a_fault_says_what_was_asked_and_what_is() -> None:
    (fault,) = judged("position Z least=-2.5")["faults"]
    assert fault["message"].startswith("the position of Z is -3 mm, asked is at least -2.5 mm, at 0.59")


def test_coordinates_and_the_speed_of_a_tool_are_bounded() -> None:
    text = "G1010\nG94 F3000\nG01 T1 X480 Y20 Z665\n"
    assert judged("end T1.Z least=664.9 most=665.1", text, "arm6")["holds"]
    assert judged("travel T1.B most=0.01", text, "arm6")["holds"]
    assert judged("speed T1 most=50.1", text, "arm6")["holds"]
    assert not judged("speed T1 most=45", text, "arm6")["holds"]


def test_the_least_clearance_is_bounded() -> None:
    text = "G1010\nG0 T3 X460 Y0 Z500\nG1 X420 Y-150 Z400 F6000\n"
    least = judged("clearance least=5", text, POST)
    assert least["holds"]
    assert least["value"] is not None
    found = judged(f"clearance least={least['value'] + 1}", text, POST)
    assert not found["holds"]
    assert found["line"] == least["line"]


def test_a_run_that_fails_is_judged_as_far_as_it_went() -> None:
    found = simulate(
        "G1010\nG94 F6000\nG01 X30\nG01 X1\nG1011\nG01 X2",
        load_machine("cartesian"),
        assertions=[Assertion("position", "X", most=20)],
    )
    assert found.exit_code == 1
    assert [each["line"] for each in found.report["assertions"]] == [3]


def test_times_of_a_program_that_does_not_keep_to_them_are_its_times() -> None:
    report, marks = simulate_text(
        PROGRAM, load_machine("cartesian"), assertions=[Assertion("end", "X", most=1.0)]
    )
    assert not report["ok"]
    assert marks is not None


@pytest.mark.parametrize(
    "asked",
    [
        Assertion("position", "T3.X", most=1.0),
        Assertion("position", "40", most=1.0),
        Assertion("position", "", most=1.0),
        Assertion("position", "X"),
        Assertion("position", "X", 2.0, 1.0),
        Assertion("position", "X", most=float("nan")),
        Assertion("duration", "X", most=1.0),
        Assertion("clearance", least=1.0),
        Assertion("end", "T1", most=1.0),
    ],
)
def test_what_cannot_be_judged_is_refused(asked: Assertion) -> None:
    with pytest.raises(Refused, match="MC331"):
        simulate(PROGRAM, load_machine("cartesian"), assertions=[asked])


def test_a_clearance_below_the_margin_is_refused_as_only_first_contacts_are_measured() -> None:
    for asked in (Assertion("clearance", least=4.9), Assertion("clearance", least=1.0, most=9.0)):
        with pytest.raises(Refused, match="nearer than the margin, 5 mm, is a contact"):
            simulate("G1010", load_machine(POST), assertions=[asked])


def test_a_clearance_of_the_margin_itself_is_judged_whatever_its_digits(tmp_path: Path) -> None:
    # 1.3e-3 * 1e3 is more than 1.3
    file = tmp_path / "machine.toml"
    file.write_text(Path(POST).read_text("utf-8").replace("margin_mm = 5.0", "margin_mm = 1.3"), "utf-8")
    asked = [Assertion("clearance", least=1.3)]
    assert simulate("G1010", load_machine(str(file)), assertions=asked).report["assertions"][0]["holds"]


def test_a_clearance_that_is_not_measured_is_refused() -> None:
    with pytest.raises(Refused, match="distances up to 55 mm are told"):
        simulate("G1010", load_machine(POST), assertions=[Assertion("clearance", least=56.0)])


@pytest.mark.parametrize(
    "text", ["", "positions X most=1", "position X Y most=1", "position X most=far", "position X above=3"]
)
def test_words_that_are_no_assertion_are_refused(text: str) -> None:
    with pytest.raises(UsageFault, match="MC331"):
        read_assertion(text)
