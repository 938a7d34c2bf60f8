"""Rotary axes whose absolute words are angles within one turn (D-139)."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.errors import ConfigurationError
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.semantics.program_places import rolled_over
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.sections import Rollover
from mcserver.simulation.simulation import simulate
from mcserver.units import DEGREE, TURN

ANGLES = st.floats(-2000.0, 2000.0) | st.integers(-24, 24).map(lambda each: 90.0 * each)


def machine_of(rollover: str, further: str = "", profile: str = "cnc") -> Machine:
    limits = "max_velocity = 1e5\nmax_acceleration = 1e6\n"
    return parse_machine(
        f'[machine]\nname = "mill"\n[dialect]\nprofile = "{profile}"\n'
        f'[[axis]]\nindex = 0\ntype = "linear"\n{limits}'
        f'[[axis]]\nindex = 3\ntype = "rotary"\nrollover = "{rollover}"\n{limits}{further}'
    )


def ends(rollover: str, *lines: str, by_hand: bool = False) -> list[float]:
    """Return where axis A stands behind each line [deg]."""
    interpreter = Interpreter(machine_of(rollover), machine_coordinates=by_hand)
    found = []
    for number, text in enumerate(lines, 1):
        interpreter.interpret_text(text, number)
        found.append(round(interpreter.positions[3] / DEGREE, 6) + 0.0)
    return found


def test_the_shortest_way_is_that_of_the_example_of_fanucs_manual() -> None:
    lines = ("G90 G0 A0", "A-150", "A540", "A-620", "G91 A380", "A-840")

    # its display reads 210, 180, 100, 120 and 0
    assert ends("shortest", *lines) == [0.0, -150.0, -180.0, -260.0, 120.0, -720.0]


def test_half_a_turn_goes_forwards_and_an_axis_at_its_angle_stays() -> None:
    assert ends("shortest", "G0 A180", "A0", "A360", "A-180", "A180") == [180, 360, 360, 540, 540]


def test_the_sign_is_the_direction_as_in_linuxcnc() -> None:
    lines = ("G0 A90", "A45", "A-90", "A-0", "A0", "A-359", "A10", "G91 A-20")

    assert ends("sign", *lines) == [90, 405, 90, 0, 0, -1, 10, -10]


@pytest.mark.parametrize(("rollover", "end"), [("shortest", -20.0), ("sign", 340.0)])
def test_an_angle_counts_from_the_zero_in_force(rollover: str, end: float) -> None:
    assert ends(rollover, "G10 L2 P1 A-30", "G0 A10") == [0.0, end]


def test_a_feed_move_and_a_machine_position_turn_within_a_turn_too() -> None:
    assert ends("shortest", "G94 F1000 G1 A350", "G53 G0 A700", "G1 X10 A5") == [-10, -20, 5]


def test_the_way_to_a_stored_position_undoes_no_turns() -> None:
    assert ends("shortest", "G91 G0 A3700", "G28 A0")[-1] == 3600.0
    assert ends("sign", "G91 G0 A3700", "G28 A0")[-1] == 3600.0


def test_a_jog_and_the_way_to_a_line_go_as_written() -> None:
    assert ends("shortest", "G90 G00 [3]700", by_hand=True) == [700.0]


@given(ANGLES, ANGLES, ANGLES, st.sampled_from(["shortest", "sign"]))
def test_an_axis_comes_to_its_angle_in_less_than_a_turn(
    written: float, zero: float, start: float, rollover: Rollover
) -> None:
    end = rolled_over(rollover, written * DEGREE, zero * DEGREE, start * DEGREE)

    way = end - start * DEGREE
    angle = abs(written) if rollover == "sign" else written
    assert math.remainder(end - (zero + angle) * DEGREE, TURN) == pytest.approx(0.0, abs=2e-9)
    assert abs(way) <= (TURN / 2.0 + 2e-9 if rollover == "shortest" else TURN)
    if rollover == "sign" and abs(way) > 2e-9:
        assert math.copysign(1.0, way) == math.copysign(1.0, written)


def test_many_lines_are_planned_as_they_are_read() -> None:
    text = "\n".join(["G90 F20000", *(f"G1 A{k * 20 % 360}" for k in range(200))])

    found = simulate(text, machine_of("shortest"))

    assert found.end is not None
    assert found.end.positions[3] == pytest.approx(199 * 20 * DEGREE)


@pytest.mark.parametrize(
    ("machine", "said"),
    [
        (("shortest", "min_position = -360\n"), "turn without end"),
        (("backwards",), "shortest"),
        (("shortest", "", "robot"), "as written"),
    ],
)
def test_rollover_is_refused_where_it_means_nothing(machine: tuple[str, ...], said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        machine_of(*machine)


def test_a_program_beyond_many_turns_has_no_faults() -> None:
    assert check_program("G90 G0 A7200\nA-7290", machine_of("shortest")) == []
