"""G02 and G03 (D-22, D-23)."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.arc_geometry import arc_by_centre, arc_by_radius, plane_extrema
from mcserver.machine.dialect_section import Dialect
from tests.bench.rs274_programs import MACHINE, moves_here
from tests.gcode.support import CARTESIAN, Program, feeding, machine_of

QUARTER = math.pi / 2.0
FOUR_LINEAR = machine_of("0:linear 1:linear 2:linear 3:rotary 6:linear 7:linear")


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Program:
    return feeding(f"G00 X{x} Y{y} Z{z}")


@pytest.mark.parametrize(
    ("text", "sweep", "centre"),
    [
        ("G02 X10 Y10 R10", -QUARTER, (10, 0)),
        ("G03 X10 Y10 R10", QUARTER, (0, 10)),
        ("G02 X10 Y10 R-10", -3 * QUARTER, (0, 10)),
        ("G03 X10 Y10 R-10", 3 * QUARTER, (10, 0)),
        ("G02 X20 Y0 R10", -2 * QUARTER, (10, 0)),
        ("G03 X20 Y0 R-10", 2 * QUARTER, (10, 0)),
        ("G02 X10 Y10 I10 J0", -QUARTER, (10, 0)),
        ("G03 X10 Y10 I0 J10", QUARTER, (0, 10)),
        ("G03 X10 Y10 I10 J0", 3 * QUARTER, (10, 0)),
        ("G02 X10 Y10 I10", -QUARTER, (10, 0)),
        ("G02 U10 V10 R10", -QUARTER, (10, 0)),
        ("G02 X10 Y10 R10 P1", -QUARTER, (10, 0)),
        ("G02 X10 Y10 R10 P3", -9 * QUARTER, (10, 0)),
        ("G02 X0 Y0 I10 J0", -4 * QUARTER, (10, 0)),
        ("G03 I10 J0", 4 * QUARTER, (10, 0)),
        ("G03 I0 J-5 P2", 8 * QUARTER, (0, -5)),
        ("G02 X0.0005 Y0 I10 J0", -4 * QUARTER, (10, 0)),
    ],
)
def test_sweep_and_centre_in_the_xy_plane(text: str, sweep: float, centre: tuple[float, float]) -> None:
    arc = at().arc(text)
    assert arc.axes == (0, 1)
    assert arc.sweep == pytest.approx(sweep, abs=1e-4)
    assert arc.centre == pytest.approx((centre[0] / 1e3, centre[1] / 1e3), abs=1e-9)


@pytest.mark.parametrize(
    ("text", "axes"),
    [
        ("G02 X10 Y10 R10", (0, 1)),
        ("G02 Y10 Z10 R10", (1, 2)),
        ("G02 X10 Z10 R10", (2, 0)),
        ("G02 W10 U10 R10", (2, 0)),
        ("G02 X10 Y10 Z5 R10", (0, 1, 2)),
        ("G18 G02 X10 Y5 Z10 R10", (2, 0, 1)),
        ("G19 G02 X5 Y10 Z10 R10", (1, 2, 0)),
        ("G17 G02 X20 R10", (0, 1)),
        ("G18 G02 Z20 R10", (2, 0)),
        ("G02 X10 Z10 I10 K0", (2, 0)),
        ("G02 Y10 Z10 J10 K0", (1, 2)),
        ("G02 I10", (0, 1)),
        ("G02 J10", (0, 1)),
        ("G02 X0 I10", (0, 1)),
        ("G02 X10 Z10 I10", (2, 0)),
        ("G02 Z10 X10 K10", (2, 0)),
        ("G02 Y10 Z10 J10", (1, 2)),
        ("G02 Z10 Y10 K10", (1, 2)),
        ("G18 G02 K10", (2, 0)),
        ("G02 X10 Y10 Z5 I10", (0, 1, 2)),
        ("G02 X20 I10 J0", (0, 1)),
        ("G02 Z5 I10 J0", (0, 1, 2)),
    ],
)
def test_the_plane_is_the_one_in_force_or_follows_from_the_words(text: str, axes: tuple[int, ...]) -> None:
    assert at().arc(text).axes == axes


def test_clockwise_is_seen_from_the_positive_normal() -> None:
    """From +Y, Z goes up on the right-handed first axis and X on the second: G02 from Z to X is -90°."""
    arc = at(0, 0, 10).arc("G03 X10 Z0 I0 K-10")
    assert arc.axes == (2, 0)
    assert arc.sweep == pytest.approx(QUARTER)
    arc = at(0, 10, 0).arc("G03 Y0 Z10 J-10 K0")
    assert arc.axes == (1, 2)
    assert arc.sweep == pytest.approx(QUARTER)
    arc = at(10, 0, 0).arc("G03 X0 Y10 I-10 J0")
    assert arc.sweep == pytest.approx(QUARTER)


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        ("G02 X10 Y10", ["MC130"]),
        ("G02 X10 Y10 R10 I5", ["MC130"]),
        ("G02 X10 Y10 K5 G17", ["MC132"]),
        ("G17 G02 X10 Y10 I10 K0", ["MC131"]),
        ("G18 G02 X10 Z10 J10", ["MC131"]),
        ("G02 X10 Y10 I10 J0 K0", ["MC132"]),
        ("G02 X10 R10", ["MC132"]),
        ("G02 R10", ["MC132"]),
        ("G02 K10", ["MC132"]),
        ("G02 X10 Y10 Z1 K10", ["MC132"]),
        ("G17 G02 R10", ["MC134"]),
        ("G02 X0 Y0 R10", ["MC134"]),
        ("G02 X0.000009 Y0 R10", ["MC134"]),
        ("G02 X0 Y0 Z5 R10", ["MC134"]),
        ("G02 X10 Y10 R0", ["MC135"]),
        ("G02 X10 Y10 I0 J0", ["MC135"]),
        ("G02 I0", ["MC135"]),
        ("G02 X10 Y10 R10 P0", ["MC136"]),
        ("G02 X10 Y10 R10 P1.5", ["MC136"]),
        ("G02 X10 Y10 R10 P-1", ["MC136"]),
        ("G02 P2", ["MC130"]),
        ("G02 X100 Y0 R30", ["MC104"]),
        ("G02 X10 Y11 I10 J0", ["MC133"]),
        ("G02 X10 Y10 [3]5 R10", ["MC137"]),
        ("G02 A10 B10 R10", ["MC132", "MC137", "MC137"]),
    ],
)
def test_arcs_that_are_not_defined_are_refused(text: str, codes: list[str]) -> None:
    assert at().codes(text) == codes


def test_the_chord_fault_stands_at_the_r_word_and_offers_the_least_radius() -> None:
    (fault,) = at().faults("G02 X100 Y0 R30")
    assert (fault.code, fault.column, fault.end_column) == ("MC104", 13, 16)
    assert fault.message == "the chord is 100 mm, so R must be at least 50 mm"
    assert fault.hint == "use R50, or give the centre with I and J"


@pytest.mark.parametrize("sign", ["", "-"])
def test_the_radius_that_the_hint_offers_is_accepted(sign: str) -> None:
    program = at()
    (fault,) = program.faults(f"G02 X33.333 Y71.7 R{sign}30")
    radius = fault.hint.split(",")[0].removeprefix("use ")
    assert program.codes(f"G02 X33.333 Y71.7 {radius}") == []


def test_a_chord_longer_by_less_than_the_radius_tolerance_is_a_half_circle() -> None:
    arc = at().arc("G02 X20.004 Y0 R10")
    assert arc.sweep == pytest.approx(-math.pi)
    assert at().codes("G02 X20.02 Y0 R10") == ["MC104"]
    assert at().arc("G02 X2000.9 Y0 R1000").centre == pytest.approx((1.00045, 0.0))


def test_radii_may_differ_by_5_micrometres_or_a_thousandth_of_the_start_radius() -> None:
    assert at().arc("G03 X-1 Y1.005 I-1 J0").end_radius == pytest.approx(1.005e-3)
    assert at().codes("G03 X-1 Y1.0051 I-1 J0") == ["MC133"]
    spiral = at(100).arc("G03 X0 Y100.1 I-100 J0")
    assert (spiral.start_radius, spiral.end_radius) == pytest.approx((0.1, 0.1001))
    assert at(100).codes("G03 X0 Y100.11 I-100 J0") == ["MC133"]


def test_a_helix_moves_further_linear_axes_with_the_angle() -> None:
    program = Program(FOUR_LINEAR)
    program.run("F6000")
    curve = program.arc("G02 X10 Y10 R10 [6]4")
    assert curve.axes == (0, 1, 6)
    assert curve.length == pytest.approx(math.hypot(QUARTER * 0.01, 0.004))
    assert program.codes("G02 X0 Y0 R10 [6]0 [7]9") == ["MC122"]
    program.run("G93 F60")
    assert program.arc("G02 X0 Y0 R10 [6]0 [7]9").axes == (0, 1, 6, 7)


def test_arcs_need_the_planes_axes_and_linear_ones() -> None:
    assert Program(machine_of("0:linear 2:linear")).codes("G02 X10 I5 F100") == ["MC108"]
    assert Program(machine_of("0:linear 1:rotary 2:linear")).codes("G17 G02 X10 R5 F100") == ["MC137"]
    assert Program(machine_of("0:rotary 1:rotary")).codes("G02 X10 Y10 R10 F100") == ["MC137", "MC137"]


def test_endpoint_words_left_out_stay() -> None:
    arc = at(5, 7).arc("G02 X25 I10 J0")
    assert arc.end == pytest.approx((0.025, 0.007))
    arc = at(5, 7).arc("G02 Y27 I0 J10")
    assert arc.end == pytest.approx((0.005, 0.027))


def test_an_arc_that_bulges_out_of_an_axiss_travel_is_refused_at_that_axiss_word() -> None:
    program = at(4990, 0)
    (fault,) = program.faults("G02 X4990 Y-40 R20 F100")
    assert (fault.code, fault.axis, fault.column) == ("MC201", 0, 5)
    assert "5010" in fault.message
    assert program.codes("G03 X4990 Y-40 R20 F100") == []


def test_a_bulge_along_an_unnamed_axis_is_shown_at_the_command() -> None:
    (fault,) = at(0, 4990).faults("G02 X40 I20 J0")
    assert (fault.code, fault.axis, fault.column, fault.end_column) == ("MC201", 1, 1, 15)


coordinate = st.integers(-100_000, 100_000).map(lambda n: n * 1e-5)


@settings(max_examples=150)
@given(coordinate, coordinate, coordinate, coordinate, st.floats(1.0, 20.0), st.booleans(), st.booleans())
def test_the_radius_form_has_that_radius_and_the_asked_size_of_arc(
    x0: float, y0: float, x1: float, y1: float, stretch: float, major: bool, clockwise: bool
) -> None:
    chord = math.hypot(x1 - x0, y1 - y0)
    if chord < 1e-4:
        return
    radius = stretch * chord / 2.0 * (-1.0 if major else 1.0)
    arc = arc_by_radius((x0, y0), (x1, y1), radius, clockwise, 1)
    for point in ((x0, y0), (x1, y1)):
        assert math.dist(arc.centre, point) == pytest.approx(abs(radius), rel=1e-6)
    assert (arc.sweep < 0.0) == clockwise
    if stretch > 1.0001:
        assert (abs(arc.sweep) > math.pi) == major


@settings(max_examples=150)
@given(
    st.floats(0.0, 6.28),
    st.floats(0.001, 6.28),
    st.booleans(),
    st.integers(1, 3),
    st.floats(0.001, 2.0),
    coordinate,
)
def test_an_arc_ends_where_it_was_programmed_and_its_extrema_are_its_bounds(
    angle: float, turn: float, clockwise: bool, turns: int, radius: float, centre: float
) -> None:
    middle = (centre, -centre)
    sweep = -turn if clockwise else turn
    start = (middle[0] + radius * math.cos(angle), middle[1] + radius * math.sin(angle))
    end = (middle[0] + radius * math.cos(angle + sweep), middle[1] + radius * math.sin(angle + sweep))
    if math.dist(start, end) < 2e-6:
        return
    arc = arc_by_centre(start, end, middle, clockwise, turns)
    expected = sweep + math.copysign(2.0 * math.pi * (turns - 1), sweep)
    assert arc.sweep == pytest.approx(expected, abs=1e-6)
    curve = arc.curve((0, 1), start, end)
    low, high = curve.bounds()
    assert np.allclose(np.array(plane_extrema(curve)), np.array([low, high]), atol=1e-9)


@pytest.mark.parametrize(
    ("text", "sweep"),
    [
        # from public files: ends that lie less than a micrometre from the start
        ("G03 X0.0008 Y0 I0 J0.05", 0.016),
        ("G03 X0.0005 Y0 I0 J2", 0.00025),
        ("G02 X0.0009 Y0 R10", 0.00009),
    ],
)
def test_an_arc_of_less_than_a_micrometre_is_no_full_circle(text: str, sweep: float) -> None:
    assert abs(at().arc(text).sweep) == pytest.approx(sweep, rel=0.01)


def test_a_sweep_that_cannot_be_told_from_none_is_a_full_circle() -> None:
    assert abs(at().arc("G02 X0.000009 Y0 I0 J10").sweep) == pytest.approx(2.0 * math.pi, abs=2e-6)
    assert abs(at().arc("G02 X0.000011 Y0 I0 J-10").sweep) == pytest.approx(1.1e-6, rel=0.01)


def test_an_arc_that_all_but_closes_is_warned_of_and_driven() -> None:
    (fault,) = check_program("G94 F600 G17\nG02 X-0.0005 Y0 I0 J-5", CARTESIAN)
    assert (fault.code, fault.severity, fault.line) == ("MC139", "warning", 2)
    assert "0.0005 mm apart" in fault.message
    many = "\n".join(
        ["G94 F600 G17", *[f"G01 X{step} Y0" for step in range(30, -1, -1)], "G02 X-0.0005 Y0 I0 J-5"]
    )
    assert [(fault.code, fault.line) for fault in check_program(many, CARTESIAN)] == [("MC139", 33)]
    assert abs(at().arc("G02 X-0.0005 Y0 I0 J-5").sweep) > 6.28


def test_linuxcnc_s_tolerance_of_radii_holds_in_the_profile_cnc_alone() -> None:
    text = "G17 F600\nG02 X10 Y10.02 I10 J0"
    assert [fault.code for fault in check_program(text, CARTESIAN)] == ["MC133"]
    machine = msgspec.structs.replace(CARTESIAN, dialect=Dialect(profile="cnc", auto_capture=True))
    assert check_program(text, machine) == []
    beyond = "G17 F600\nG02 X10 Y10.03 I10 J0"
    assert [fault.code for fault in check_program(beyond, machine)] == ["MC133"]
    inches = "G20 G17 F60\nG02 X1 Y1.0025 I1 J0"
    assert check_program(inches, machine) == []


def test_an_arc_counts_its_unnamed_plane_axis_as_moved() -> None:
    assert feeding().codes("G02 X20 I10 J0 G01 Y5") == ["MC114"]
    assert feeding().codes("G01 Y5, G02 X20 I10 J0") == ["MC114"]


def test_plane_codes_are_modal() -> None:
    program = at()
    program.run("G18")
    assert program.arc("G02 Z20 X0 R10").axes == (2, 0)
    assert program.arc("G02 Z0 X0 R10").axes == (2, 0)
    program.run("G17")
    assert program.arc("G02 X0 Y20 R10").axes == (0, 1)


def test_centres_are_positions_under_g90_1_in_the_zero_in_force() -> None:
    moves, fault = moves_here(
        "F1000 G92 X5 Y3\nG0 X10 Y0\nG90.1\nG2 X30 Y0 I20 J0\nG91.1 G91 G3 X10 Y0 I5 J0"
    )
    assert not fault
    # the zero lies at -5, -3 of the machine
    assert moves[1] == pytest.approx((25.0, -3.0, 0.0, 15.0, -3.0))
    assert moves[2] == pytest.approx((35.0, -3.0, 0.0, 30.0, -3.0))


def test_a_centre_that_is_a_position_needs_both_of_its_words() -> None:
    found = check_program("F1000 G90.1\nG2 X10 I5", MACHINE)
    assert [(each.code, each.line) for each in found] == [("MC130", 2)]


def test_arcs_in_columns_keep_to_g90_1() -> None:
    lines = [f"G{2 + n % 2} X{10 * (n % 2)} Y0 I5 J0" for n in range(100)]
    moves, fault = moves_here("\n".join(["F1000 G90.1", "G1 X10 Y0", *lines]))
    assert not fault
    found = check_program("\n".join(["F1000 G90.1", "G1 X10 Y0", *lines]), MACHINE)
    assert found == []
    assert {tuple(round(each, 6) for each in move[3:]) for move in moves[1:]} == {(5.0, 0.0)}


def test_a_centre_that_only_fits_as_a_position_is_said_to_lack_g90_1() -> None:
    start = "F1000 G92 X5 Y3\nG0 X-40 Y50"
    (fault,) = check_program(f"{start}\nG3 X-30 Y40 I-40 J40", MACHINE)
    assert (fault.code, fault.hint.endswith("is G90.1 missing?")) == ("MC133", True)
    assert check_program(f"{start}\nG90.1\nG3 X-30 Y40 I-40 J40", MACHINE) == []
    (neither,) = check_program(f"{start}\nG3 X-30 Y40 I-40 J45", MACHINE)
    assert "increments" in neither.hint
    assert "G90.1" not in neither.hint
    (position,) = check_program(f"{start}\nG90.1\nG3 X-30 Y40 I-40 J45", MACHINE)
    assert "increments" not in position.hint
    # there is no G90.1 to write
    (reference,) = check_program("G94 F1000 G17\nG0 X-40 Y50\nG3 X-30 Y40 I-40 J40", CARTESIAN)
    assert "G90.1" not in reference.hint
