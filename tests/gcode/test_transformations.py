"""Rotation, scaling, mirrors and polar coordinates (D-94 to D-96), against homogeneous matrices."""

from __future__ import annotations

import math
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.errors import ProgramRejected
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import FeedGroup, MotionLine, RapidGroup
from mcserver.motion.geometry.curves import Array
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.units import MM
from tests.bench.rs274_programs import MACHINE, moves_here
from tests.gcode.support import Program
from tests.machine_text import axes_text

PLANES = {17: (0, 1), 18: (2, 0), 19: (1, 2)}
PROBING = parse_machine(
    '[machine]\nname = "mill"\n[probe]\ninput = 0\n[[input]]\nnumber = 0\nname = "probe"\n'
    '[dialect]\nprofile = "cnc"\nspindle_axis = 6\n'
    + axes_text(range(3), velocity=1e5, acceleration=1e6)
    + axes_text((3, 6), rotary=True, velocity=1e5, acceleration=1e6)
)


def travels(*lines: str) -> list[tuple[float, ...]]:
    """Return the middle and the end of each move [mm]."""
    interpreter, place = Interpreter(MACHINE), np.zeros(3)
    found: list[tuple[float, ...]] = []
    for number, text in enumerate(lines, 1):
        for value in interpreter.interpret_text(text, number):
            for group in value.groups if isinstance(value, MotionLine) else ():
                middle, end = place.copy(), place.copy()
                if isinstance(group, FeedGroup):
                    axes = list(group.curves[0].axes)
                    middle[axes], end[axes] = group.curves[0].position(np.array([0.5, 1.0])) / MM
                elif isinstance(group, RapidGroup):
                    end[list(group.axes)] = np.array(group.targets) / MM
                    middle = (place + end) / 2.0
                found.append((*middle, *end))
                place = end
    return found


def after(machine: Machine, *lines: str) -> Interpreter:
    program = Program(machine)
    program.run(*lines)
    return program.interpreter


def ends(*lines: str) -> list[tuple[float, ...]]:
    return [tuple(round(value, 6) + 0.0 for value in each[3:]) for each in travels("F1000", *lines)]


def faults(*lines: str) -> list[tuple[str, int]]:
    found = check_program("\n".join(["F1000", *lines]), PROBING)
    return [(each.code, each.line - 1) for each in found if each.severity == "error"]


class Writer:
    """Write a random program, and where a controller of these words goes."""

    def __init__(self, seed: int) -> None:
        self._random = random = Random(seed)
        self._number = random.choice([17, 17, 18, 19])
        self._plane = PLANES[self._number]
        self._zero = np.array([round(random.uniform(-20, 20), 3) for _ in range(3)])
        self._scale, self._turn, self._place = np.eye(4), np.eye(4), np.zeros(3)
        self._degrees, self._equal, self._mirrored = 0.0, True, False
        self._inch, self._incremental = False, False
        words = " ".join(f"{letter}{value}" for letter, value in zip("XYZ", self._zero, strict=True))
        self.lines = [f"G21 G90 G{self._number} F1000", f"G10 L2 P1 {words}", "G0 X0 Y0 Z0"]
        self.expected: list[tuple[float, ...]] = [(*self._zero / 2.0, *self._zero)]

    def write(self) -> Writer:
        for _ in range(self._random.randint(1, 3)):
            self._transform()
            self._settle()
            for _ in range(self._random.randint(1, 6)):
                self._random.choice([self._line, self._line, self._arc, self._modes])()
        self._incremental = False
        self.lines += ["G90 G69", "G50"]
        self._scale, self._turn, self._degrees = np.eye(4), np.eye(4), 0.0
        self._equal, self._mirrored = True, False
        self._settle()
        return self

    def _at(self, place: Array) -> Array:
        found: Array = self._zero + (self._turn @ self._scale @ [*place, 1.0])[:3]
        return found

    def _go(self, place: Array, middle: Array | None = None) -> None:
        end = self._at(place)
        between = (np.array(self.expected[-1][3:]) + end) / 2.0 if middle is None else self._at(middle)
        self.expected.append((*between, *end))
        self._place = place

    def _transform(self) -> None:
        random, (first, second) = self._random, self._plane
        if self._degrees == 0.0 and random.random() < 0.6:
            centre = np.array([self._round() for _ in range(3)])
            even = random.random() < 0.5
            factors = (
                [random.choice([0.5, 2.0, 1.25])] * 3
                if even
                else [random.choice([-1.0, 0.5, -1.5, 3.0]) for _ in range(3)]
            )
            factors = [round(each, 3) for each in factors]
            self._scale = np.diag([*factors, 1.0])
            self._scale[:3, 3] = centre * (1.0 - np.array(factors))
            self._equal = abs(factors[first]) == abs(factors[second])
            self._mirrored = factors[first] * factors[second] < 0.0
            words = f"P{factors[0]}" if even else "I{} J{} K{}".format(*factors)
            words = f"P{1000 * factors[0]:.0f}" if even and random.random() < 0.5 else words
            self.lines += [f"{self._absolute()}G51 {self._words(centre)} {words}"]
        if self._equal and not self._mirrored and random.random() < 0.7:
            degrees = round(random.choice([random.uniform(-200, 200), 90.0, -180.0]), 3)
            if self._degrees and random.random() < 0.5:
                self.lines.append("G91")
                self._incremental = True
            added = self._degrees if self._incremental else 0.0
            centre = np.array([self._round() for _ in range(3)])
            self._degrees = degrees + added
            words = " ".join(f"{'XYZ'[axis]}{self._shown(centre[axis])}" for axis in self._plane)
            self.lines += [f"G68 {words} R{degrees}"]
            about = (self._scale @ [*centre, 1.0])[:3]
            angle = math.radians(self._degrees)
            self._turn = np.eye(4)
            self._turn[np.ix_(self._plane, self._plane)] = [
                [math.cos(angle), -math.sin(angle)],
                [math.sin(angle), math.cos(angle)],
            ]
            self._turn[:3, 3] = about - self._turn[:3, :3] @ about

    def _round(self) -> float:
        return round(self._random.uniform(-30, 30), 3)

    def _shown(self, value: float) -> str:
        return f"{value / 25.4 if self._inch else value:.9f}"

    def _absolute(self) -> str:
        if not self._incremental:
            return ""
        self._incremental = False
        return "G90 "

    def _words(self, values: Array, axes: tuple[int, ...] = (0, 1, 2)) -> str:
        return " ".join(f"{'XYZ'[axis]}{self._shown(float(values[axis]))}" for axis in axes)

    def _settle(self) -> None:
        place = np.array([self._round() for _ in range(3)])
        self.lines.append(f"{self._absolute()}G{self._random.choice('01')} {self._words(place)}")
        self._go(place)

    def _line(self) -> None:
        axes = tuple(axis for axis in range(3) if self._random.random() < 0.6) or (0,)
        place = self._place.copy()
        values = np.zeros(3)
        for axis in axes:
            values[axis] = self._round()
            place[axis] = values[axis] + (self._place[axis] if self._incremental else 0.0)
        self.lines.append(f"G1 {self._words(values, axes)}")
        self._go(place)

    def _arc(self) -> None:
        if not self._equal:
            return
        plane, third = list(self._plane), 3 - sum(self._plane)
        radius, start = self._random.uniform(2, 20), self._random.uniform(-math.pi, math.pi)
        sweep = self._random.uniform(0.3, 5.9) * self._random.choice([-1, 1])
        around = np.array([math.cos(start), math.sin(start)]) * radius
        centre, place, middle = self._place.copy(), self._place.copy(), self._place.copy()
        centre[plane] -= around
        for share, target in ((0.5, middle), (1.0, place)):
            angle = start + share * sweep
            target[plane] = centre[plane] + radius * np.array([math.cos(angle), math.sin(angle)])
        if self._random.random() < 0.3:
            place[third] += 3.0
            middle[third] += 1.5
        # by R the centre of half a circle hangs on the last digits that are written
        if self._random.random() < 0.5 and abs(abs(sweep) - math.pi) > 0.05:
            size = radius / 25.4 if self._inch else radius
            words = f"R{'-' if abs(sweep) > math.pi else ''}{size:.9f}"
        else:
            words = " ".join(
                f"{'IJK'[axis]}{self._shown(centre[axis] - self._place[axis])}" for axis in plane
            )
        values = place - self._place if self._incremental else place
        self.lines.append(f"G{3 if sweep > 0 else 2} {self._words(values)} {words}")
        self._go(place, middle)

    def _modes(self) -> None:
        self._inch, self._incremental = self._random.random() < 0.4, self._random.random() < 0.5
        self.lines.append(f"G{20 if self._inch else 21} G{91 if self._incremental else 90}")


@given(st.integers(0, 2**32))
def test_moves_are_those_of_a_matrix(seed: int) -> None:
    written = Writer(seed).write()
    found = travels(*written.lines)
    assert len(found) == len(written.expected)
    np.testing.assert_allclose(found, written.expected, atol=2e-5, err_msg="\n".join(written.lines))


@given(st.integers(0, 2**32))
def test_polar_words_are_those_of_complex_numbers(seed: int) -> None:
    random = Random(seed)
    number = random.choice([17, 18, 19])
    first, second = PLANES[number]
    radius, degrees, incremental = 10.0, 20.0, False
    turned = random.uniform(-90, 90) if random.random() < 0.3 else 0.0
    lines = ["G90", f"G{number}", "G16", f"G0 {'XYZ'[first]}{radius} {'XYZ'[second]}{degrees}"]
    found = [radius * np.exp(1j * math.radians(degrees))]
    for _ in range(6):
        pick = random.random()
        if pick < 0.3:
            incremental = not incremental
            lines.append("G91" if incremental else "G90")
        elif pick < 0.6 and not incremental:
            radius = random.uniform(1, 30)
            lines.append(f"G1 {'XYZ'[first]}{radius:.9f}")
        else:
            angle = random.uniform(-400, 400)
            degrees = angle + (degrees if incremental else 0.0)
            lines.append(f"G1 {'XYZ'[second]}{angle:.9f}")
        if lines[-1].startswith("G1 "):
            found.append(radius * np.exp(1j * math.radians(degrees)))
    if turned:
        # rotation is commanded ahead of polar coordinates
        lines.insert(2, f"G68 {'XYZ'[first]}0 {'XYZ'[second]}0 R{turned:.9f}")
        found = [each * np.exp(1j * math.radians(turned)) for each in found]
    there = [(each[first], each[second]) for each in ends(*lines)]
    np.testing.assert_allclose(there, [(each.real, each.imag) for each in found], atol=1e-5)


def test_radius_and_angle_of_one_move_are_those_of_linuxcnc() -> None:
    # as its rs274 has them, to four decimals
    lines = ["G0 X10 Y0", "G1 @20 ^30", "^60", "@5", "G91", "G1 ^30", "@5", "G90 G1 @3 ^180", "G1 @-3 ^90 Z1"]
    expected = [(10, 0), (17.3205, 10), (10, 17.3205), (2.5, 4.3301), (0, 5), (0, 10), (-3, 0), (0, -3)]
    np.testing.assert_allclose([each[:2] for each in ends(*lines)], expected, atol=1e-4)
    assert ends("G10 L2 P1 X5", "G1 X3 Y0", "G3 @3 ^90 I-3")[-1] == (5.0, 3.0, 0.0)
    holes = [each[:2] for each in ends("G0 Z2", "G81 @3 ^90 Z-1 R1", "G91 ^90 Z-2 R-1") if each[2] < 0.0]
    assert holes == [(0.0, 3.0), (-3.0, 0.0)]
    interpreter = after(PROBING, "F1000 G1 X1 Y1", "G1010 P1")
    assert interpreter.axes_to_sync(interpreter.parse("G1 @3", 3)) == {1}


def test_a_subprogram_s_part_is_repeated_by_increments_of_r() -> None:
    lines = ["G91 G68 X0 Y0 R45", "G90 G1 X10 Y0"] * 3
    side = round(10 * math.sqrt(0.5), 6)
    assert ends(*lines) == [(side, side, 0.0), (0.0, 10.0, 0.0), (-side, side, 0.0)]


def test_without_a_centre_it_turns_about_where_the_axes_are() -> None:
    assert ends("G1 X10 Y10", "G68 R90", "X20 Y10")[-1] == (10.0, 20.0, 0.0)


def test_the_centre_of_a_rotation_is_scaled() -> None:
    assert ends("G51 X0 Y0 Z0 P2.0", "G68 X5 Y0 R90", "G1 X10 Y0")[-1] == (10.0, 10.0, 0.0)


def test_mirrors_come_and_go_by_axis() -> None:
    lines = ["G51.1 X0", "G51.1 Y5", "G1 X1 Y1", "G50.1 X0", "G1 X1 Y1", "G50.1", "G1 X1 Y1"]
    assert ends(*lines) == [(-1.0, 9.0, 0.0), (1.0, 9.0, 0.0), (1.0, 1.0, 0.0)]


def test_canned_cycles_drill_where_the_holes_are_turned_to() -> None:
    lines = ["G0 Z10", "G16", "G81 X100 Y30 Z-20 R-5", "G91 Y120 Z-15 R-15 L2", "G15 G80"]
    holes = [each[:2] for each in ends(*lines) if each[2] == -20.0]
    expected = [(100 * math.cos(math.radians(a)), 100 * math.sin(math.radians(a))) for a in (30, 150, 270)]
    np.testing.assert_allclose(holes, expected, atol=1e-6)
    turned = ends("G0 Z10", "G68 X0 Y0 R90", "G81 X10 Y0 Z-3 R2", "X20", "G80 G69")
    assert [each for each in turned if each[2] == -3.0] == [(0.0, 10.0, -3.0), (0.0, 20.0, -3.0)]


@pytest.mark.parametrize(
    ("begin", "matrix"),
    [
        ("G68 X3 Y4 R30", None),
        ("G51 X0 Y0 I-1.0 J1.0", [[-1.0, 0.0], [0.0, 1.0]]),
        ("G51 X0 Y0 I-1000 J-1000", [[-1.0, 0.0], [0.0, -1.0]]),
    ],
)
def test_the_cutter_is_beside_the_turned_path(begin: str, matrix: list[list[float]] | None) -> None:
    contour = ["G0 X-10 Y-5", "G41.1 D6", "G1 X0 Y0", "Y20", "G2 X20 Y20 I10 J0", "G1 Y0", "G3 X30 Y-10 R10"]
    contour += ["G40 G1 X40 Y-10"]
    plain = travels("F1000", *contour)
    found = travels("F1000", begin, *contour)
    across, centre = np.array(matrix), np.zeros(2)
    if matrix is None:
        cosine, sine = math.cos(math.radians(30)), math.sin(math.radians(30))
        across, centre = np.array([[cosine, -sine], [sine, cosine]]), np.array([3.0, 4.0])
    assert len(found) == len(plain)
    for columns in (slice(0, 2), slice(3, 5)):
        # the way to the first place begins at the machine's zero
        expected = [centre + across @ (np.array(each[columns]) - centre) for each in plain][1:]
        np.testing.assert_allclose([each[columns] for each in found][1:], expected, atol=1e-6)


def test_machine_positions_and_the_way_home_are_not_turned() -> None:
    lines = ["G10 L2 P1 X5", "G68 X0 Y0 R90", "G0 X10 Y0", "G53 G0 X1 Y2", "G0 X10 Y0", "G91 G28 X0 Y0"]
    assert ends(*lines) == [(5.0, 10.0, 0.0), (1.0, 2.0, 0.0), (5.0, 10.0, 0.0), (0.0, 0.0, 0.0)]


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        # where controllers differ
        (["G68 X0 Y0 R30", "G1 X10"], "MC186"),
        (["G68 X0 Y0 R30", "G91 G1 X10 Y0"], "MC186"),
        (["G68 X0 Y0 R30", "G2 X10 Y0 R20"], "MC186"),
        (["G68 X0 Y0 R30", "G1 X1 Y1", "G69", "G91 G1 X1"], "MC186"),
        (["G68 X0 Y0 R30", "G0 X1 Y1", "G53 G0 X0", "G1 Y3"], "MC186"),
        (["G68 X0 Y0 R30", "G0 X1 Y1", "G28 X0 Y0"], "MC186"),
        (["G51 X0 Y0 I2.0 J2.0", "G91 G1 X1"], "MC186"),
        (["G18 G68 X0 Z0 R30", "G0 X1 Z1", "G10 L1 P3 Z5", "G43 H3", "X3"], "MC186"),
        (["G16", "G1 X3 Y3", "G52 X1", "Y9"], "MC186"),
        (["G16", "G1 Y30"], "MC186"),
        (["G68 X0 Y0 R30", "G1 X1 Y1", "G1 X#5420"], "MC187"),
        (["G68 X0 Y0 R30", "G1 X1 Y1", "G1 X#<_y>"], "MC187"),
        (["G68 X0 R30"], "MC188"),
        (["G1 @3"], "MC188"),
        (["G91 G1 @3 ^30"], "MC188"),
        (["G1 @3 X3"], "MC153"),
        (["G53 G1 @3 ^3"], "MC153"),
        (["G92 @3 ^3"], "MC153"),
        (["G68 X0 Y0 R30", "G1 @3 ^3"], "MC185"),
        (["G51 X0 Y0 P2.0"], "MC188"),
        (["G51 X0 Y0 Z0 P2"], "MC188"),
        (["G51 X0 I0.0"], "MC116"),
        (["G91 G51 X0 I2.0"], "MC188"),
        (["G91 G16"], "MC188"),
        (["G16", "G1 X-3 Y3"], "MC188"),
        (["G16", "G1 X3 Y3", "G91 X1"], "MC188"),
        (["G51.1"], "MC188"),
        (["G68 X0 Y0"], "MC118"),
        (["G68 X0 Y0 K1 R3"], "MC112"),
        (["G68 X0 Y0 A3 R3"], "MC112"),
        # what would be no arc
        (["G51 X0 Y0 I2.0 J1.0", "G1 X1 Y1", "G2 X3 Y1 I1"], "MC188"),
        (["G16", "G1 X3 Y3", "G2 X3 Y90 I-3"], "MC188"),
        # what does not go together
        (["G68 X0 Y0 R30", "G55"], "MC185"),
        (["G68 X0 Y0 R30", "G52 X1"], "MC185"),
        (["G51 X0 I2.0", "G92 X1"], "MC185"),
        (["G51 X0 I2.0", "G10 L2 P1 X1"], "MC185"),
        (["G68 X0 Y0 R30", "G18"], "MC185"),
        (["G16", "G19"], "MC185"),
        (["G51 X0 Y0 Z0 P2.0", "G81 X1 Y1 Z-1 R1"], "MC185"),
        (["G68 X0 Y0 R30", "G51 X0 I2.0"], "MC185"),
        (["G51 X0 Y0 I2.0 J2.0", "G68 X0 Y0 R30", "G50"], "MC185"),
        (["G51.1 X0", "G68 X0 Y0 R30"], "MC185"),
        (["G16", "G68 X0 Y0 R30"], "MC185"),
        (["G68 X0 Y0 R30", "G1 X1 Y1", "G38.2 X3"], "MC185"),
        (["S100 M3", "G68 X0 Y0 R30", "G1 X1 Y1", "G33 X3 K1"], "MC185"),
        (["G41.1 D2", "G1 X10 Y0", "G68 X0 Y0 R30"], "MC170"),
        (["G68 X0 Y0 R30", "G41.1 D2", "G1 X10 Y0", "G69"], "MC170"),
    ],
)
def test_what_could_go_elsewhere_is_refused(lines: list[str], code: str) -> None:
    assert faults(*lines) == [(code, len(lines))]


@pytest.mark.parametrize(
    "lines",
    [
        ["G40 G49 G50 G69 G15 G80"],
        ["G51 X0 Y0 I2.0 J2.0", "G68 X0 Y0 R30", "G0 X1 Y1", "G50 G69", "G0 X0", "G0 Y0"],
        ["G68 X0 Y0 R30", "G54 G43 H0", "G0 X1 Y1", "Z3", "G53 G0 Z0", "X4", "G38.3 Z-1", "G91 G28 Z0"],
        ["G17 G90 G16", "G52 X3", "G1 X1 Y1", "G15 G52 X0"],
        ["G68 X0 Y0 R30", "G69 G0 X1 Y1", "G91 X2"],
    ],
)
def test_what_programs_write_beside_it_is_taken(lines: list[str]) -> None:
    assert faults(*lines) == []


@pytest.mark.parametrize("line", ["G1 @3 ^30", "G68 X0 Y0 R3", "G16", "G5 X3 I1 J1 P-1 Q1", "G81 X1 Z-1 R1"])
def test_an_axis_that_is_missing_or_rotary_is_a_fault(line: str) -> None:
    for axes in (axes_text([0]), axes_text([0]) + axes_text([1], rotary=True)):
        machine = parse_machine(f'[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n{axes}')
        assert check_program(f"F1000\n{line}", machine)[0].code in ("MC108", "MC188", "MC189")
    for lease in (frozenset({0}), frozenset({1, 2})):
        with pytest.raises(ProgramRejected):
            Interpreter(MACHINE, lease=lease).interpret_text(f"F1000 {line}", 1)


def test_it_ends_with_the_program_and_with_its_own_codes() -> None:
    interpreter = Interpreter(MACHINE)
    for number, text in enumerate(["G68 X0 Y0 R30", "G0 X1 Y1", "G69", "G0 X0 Y0"], 1):
        interpreter.interpret_text(text, number)
        assert (interpreter.modal.transformation is None) == (number == 4)
        assert number == 4 or interpreter.interpret_batch(["G1 X1 Y1"] * 50, number + 1) is None
    interpreter.interpret_text("G68 X0 Y0 R30", 5)
    interpreter.interpret_text("M30", 6)
    assert interpreter.modal.transformation is None


def test_a_program_goes_on_turned_from_a_line() -> None:
    lines = ["F1000", "G68 X0 Y0 R90", "G0 X10 Y0", "G1 X20", "Y5", "G69", "M30"]
    before = state_before(lines, 5, MACHINE, StartState.of(MACHINE))
    rest = Interpreter(MACHINE, positions=before.positions, modal=before.modal)
    rest.interpret_text(lines[4], 5)
    assert [round(rest.positions[axis] / MM, 6) for axis in range(2)] == [-5.0, 20.0]


def test_both_axes_of_the_plane_are_read_where_one_is_named() -> None:
    interpreter = after(PROBING, "G68 X0 Y0 R30", "F1000 G0 X1 Y1", "G1 X3", "G1010 P1")
    assert interpreter.axes_to_sync(interpreter.parse("G1 X3", 5)) == {1}
    assert interpreter.axes_to_sync(interpreter.parse("G1 Z3", 5)) == frozenset()


def test_after_a_jog_in_a_pause_the_next_move_says_both_axes() -> None:
    interpreter = after(MACHINE, "G68 X0 Y0 R90", "F1000 G0 X1 Y1", "M0")
    interpreter.end_pause({0: 3 * MM}, None)
    with pytest.raises(ProgramRejected, match="MC186"):
        interpreter.interpret_text("G1 X3", 4)
    interpreter.interpret_text("G1 X3 Y0", 4)
    assert interpreter.positions[1] == pytest.approx(3 * MM)


def test_computed_factors_are_read_as_they_are_written() -> None:
    text = "F1000\n#1=1.5\nG51 X0 Y0 I[#1] J[#1]\nG1 X2 Y0\nM2"
    assert moves_here(text)[0][-1] == pytest.approx((3.0, 0.0, 0.0))
