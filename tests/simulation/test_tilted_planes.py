"""G68.2 and G53.1 on machines from a URDF alone, held against matrices of the test's own (D-111)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from random import Random

import numpy as np
import pytest

from mcserver.errors import ProgramRejected
from mcserver.gcode.modal_codes import modal_codes
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.canonical import FeedGroup, MotionLine, RapidGroup
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.units import DEGREE, MM
from tests.bench.rs274_programs import MACHINE
from tests.gcode.test_transformations import travels

from .five_axes import (
    HEAD_HEAD,
    HEAD_TABLE,
    LENGTH,
    MILLS,
    TABLE_TABLE,
    ZERO,
    Array,
    FiveAxes,
    assert_within_limits,
    reader,
    run,
)

BEGIN = ("G10 L2 P1 X5 Y-7 Z-200", "G54 G64 F1000")
ORIGIN, ANGLES = np.array([4.0, -3.0, 12.0]), (25.0, 35.0, -70.0)
PLANE = "G68.2 X4 Y-3 Z12 I25 J35 K-70"
POINTS = ("G68.2 P2 Q1 X0 Y0 Z0", "G68.2 P2 Q2 X5 Y0 Z5", "G68.2 P2 Q3 X0 Y5 Z0")
VECTORS = ("G68.2 P3 Q1 X1 Y2 Z3 I1 J0 K1", "G68.2 P3 Q2 I-1 J0 K1")


def turned(angles: Sequence[float]) -> Array:
    """Euler angles about Z, the new X and the new Z [deg]."""
    (a, b), (c, d), (e, f) = ((math.cos(math.radians(each)), math.sin(math.radians(each))) for each in angles)
    about_z = np.array([[a, -b, 0.0], [b, a, 0.0], [0.0, 0.0, 1.0]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, -d], [0.0, d, c]])
    found: Array = about_z @ about_x @ np.array([[e, -f, 0.0], [f, e, 0.0], [0.0, 0.0, 1.0]])
    return found


def about(axis: int, degrees: float) -> Array:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    found = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return np.roll(np.roll(found, axis, axis=0), axis, axis=1)


def on_plane(mill: FiveAxes, rows: Array, origin: Array, angles: Sequence[float]) -> Array:
    """The tip in coordinates of the plane [mm], from rows of all six axes in mm and degrees."""
    still = {axis: np.zeros(1) for axis in range(6)}
    upright = mill.tip({**still, **{axis: np.array([each]) for axis, each in enumerate(ZERO)}})[0]
    # the program's zero is where the spindle's point is there, without a cutter
    zero = upright + np.array([0.0, 0.0, mill.length])
    across = np.stack(
        [mill.tip({**still, axis: np.ones(1)})[0] - mill.tip(still)[0] for axis in range(3)], axis=1
    )
    tips = mill.tip({axis: rows[:, axis] for axis in range(6)})
    places: Array = ((tips - zero) @ across - origin) @ turned(angles)
    return places


def read(found: Interpreter, *lines: str) -> Array:
    """Interpret lines; the axes in the middle and at the end of each motion, shape (n, 6) [mm, deg]."""
    units = np.array([MM, MM, MM, DEGREE, DEGREE, DEGREE])
    rows = []
    for number, text in enumerate(lines, 1):
        parsed = found.parse(text, number)
        if found.capture_before(parsed) is not None:
            found.sync_positions(found.positions)
        place = np.array([found.positions.get(axis, 0.0) for axis in range(6)])
        for value in found.interpret(parsed):
            for group in value.groups if isinstance(value, MotionLine) else ():
                middle, end = place.copy(), place.copy()
                if isinstance(group, FeedGroup):
                    axes = list(group.curves[0].axes)
                    middle[axes], end[axes] = group.curves[0].position(np.array([0.5, 1.0]))
                elif isinstance(group, RapidGroup):
                    end[list(group.axes)] = group.targets
                    middle = (place + end) / 2.0
                rows += [middle / units, end / units]
                place = end
    return np.array(rows)


def faults(machine: Machine, *lines: str) -> list[tuple[str, int]]:
    found = reader(machine)
    for number, text in enumerate(lines, 1):
        try:
            read(found, text)
        except ProgramRejected as rejected:
            return [(each.code, number) for each in rejected.diagnostics if each.severity == "error"]
    return []


class Writer:
    """Write random lines of a program that begins at a place that is known."""

    def __init__(self, seed: int, *, compensated: bool) -> None:
        self._random = Random(seed)
        self._compensated = compensated

    def lines(self) -> list[str]:
        writes = [self._lines, self._arc, self._arc, self._cycle, self._polar, self._scaled]
        writes += [self._contour] if self._compensated else []
        found = [f"G90 G0 {self._place('XYZ')}"]
        for _ in range(5):
            found += self._random.choice(writes)()
        return found

    def _number(self, least: float = -15.0, most: float = 15.0) -> str:
        return f"{self._random.uniform(least, most):.3f}"

    def _place(self, letters: str) -> str:
        return " ".join(f"{letter}{self._number()}" for letter in letters)

    def _lines(self) -> list[str]:
        inch = [f"G20 G1 X{self._number(-0.5, 0.5)}", "G21"]
        return [f"G1 {self._place('XY')}", f"G91 G1 {self._place('Z')}", f"X{self._number()}", "G90", *inch]

    def _arc(self) -> list[str]:
        code, plane, letters, centre = self._random.choice(
            [("G17", 0, "XY", "IJ"), ("G18", 1, "ZX", "KI"), ("G19", 2, "YZ", "JK")]
        )
        way = self._random.choice(["G2", "G3"])
        circle = f"{way} {centre[0]}{self._number(2.0, 9.0)} {centre[1]}{self._number(-9.0, 9.0)}"
        third = {0: "Z", 1: "Y", 2: "X"}[plane]
        ends = " ".join(f"{letter}{self._number(-6.0, 6.0)}" for letter in letters)
        return [
            f"{code} {circle} {third}{self._number()}",
            f"G91 {way} {ends} R{self._random.choice(['', '-'])}{self._number(10.0, 20.0)}",
            "G90 G17",
        ]

    def _cycle(self) -> list[str]:
        code = self._random.choice(["G81", "G82 P0.1", "G83 Q2.5", "G73 Q3", "G89 P0.1", "G85"])
        code = f"{self._random.choice(['G98', 'G99'])} {code} {self._place('XY')}"
        drilled = f"R{self._number(2.0, 5.0)} Z{self._number(-9, 1)}"
        return [f"G0 Z{self._number(5, 15)}", f"{code} {drilled}", "G91 X3 R-1 Z-4 L2", "G80 G90"]

    def _polar(self) -> list[str]:
        polar = f"G1 X{self._number(1, 20)} Y{self._number(-300, 300)}"
        return ["G16", polar, "G15", f"G1 {self._place('XYZ')}"]

    def _scaled(self) -> list[str]:
        lines = [f"G51 {self._place('XYZ')} P1.5", f"G1 {self._place('XYZ')}", "G3 I3 J-2", "G50"]
        return [*lines, f"G0 {self._place('XYZ')}"]

    def _contour(self) -> list[str]:
        lines = ["G0 X-10 Y-5", "G41.1 D2", "G1 X0 Y0", "Y9", "G2 X9 Y18 I9 J0 Z3", "G1 X14 Y18"]
        return [*lines, "G40 G1 X20 Y25"]


@pytest.mark.parametrize("name", MILLS)
def test_the_tip_does_on_the_plane_what_the_program_does_without_one(name: str, tmp_path: Path) -> None:
    mill = MILLS[name]
    machine = mill.machine(tmp_path)
    random = Random(7)
    for seed in range(12):
        angles = [round(random.uniform(*each), 3) for each in ((-180, 180), (-60, 60), (-180, 180))]
        origin = np.round([random.uniform(-15, 15) for _ in range(3)], 3)
        words = "X{} Y{} Z{}".format(*origin) + " I{} J{} K{}".format(*angles)
        lines = Writer(seed, compensated=name == "tables").lines()
        # as posts write it: with the length, on the first line there
        begin = [*BEGIN, f"G68.2 {words}", "G53.1"]
        found = read(reader(machine), *begin, lines[0].replace("G0", "G0 G43 H1"), *lines[1:])
        places = on_plane(mill, found, origin, angles).reshape(-1, 6)
        expected = np.array(travels("F1000", *lines))
        # G53.1 comes first, and the way to the first place begins elsewhere
        assert len(places) == len(expected) + 1, lines
        np.testing.assert_allclose(places[1, 3:], expected[0, 3:], atol=1e-6)
        np.testing.assert_allclose(places[2:], expected[1:], atol=1e-6, err_msg="\n".join([words, *lines]))


@pytest.mark.parametrize("name", MILLS)
def test_turns_points_and_vectors_give_the_plane_that_euler_angles_give(name: str, tmp_path: Path) -> None:
    machine = MILLS[name].machine(tmp_path)
    random = Random(3)
    for _ in range(8):
        angles = [round(random.uniform(*each), 3) for each in ((-180, 180), (-60, 60), (-180, 180))]
        origin = np.round([random.uniform(-15, 15) for _ in range(3)], 3)
        matrix = turned(angles)
        x, y, z = matrix.T
        tilt = math.asin(-matrix[2, 0])
        turns = (math.atan2(matrix[2, 1], matrix[2, 2]), tilt, math.atan2(matrix[1, 0], matrix[0, 0]))
        first = origin - matrix @ np.array([2.0, -3.0, 1.0])
        ways = [
            ["G68.2 P0 " + words("XYZ", origin) + words("IJK", angles)],
            ["G68.2 P1 " + words("XYZ", origin) + words("IJK", np.degrees(turns))],
            [
                f"G68.2 P2 Q{q} " + words("XYZ", p)
                for q, p in ((1, origin), (2, origin + 9 * x), (3, origin + y - 4 * x))
            ],
            [
                "G68.2 P2 Q0 X2 Y-3 Z1 R30",
                "G68.2 P2 Q1 " + words("XYZ", first),
                "G68.2 P2 Q2 " + words("XYZ", first + 20 * (matrix @ about(2, -30.0))[:, 0]),
                "G68.2 P2 Q3 " + words("XYZ", first + 30 * (matrix @ about(2, -30.0))[:, 1] + x),
            ],
            [
                "G68.2 P3 Q1 " + words("XYZ", origin) + words("IJK", 3 * x),
                "G68.2 P3 Q2 " + words("IJK", z + 0.05 * x),
            ],
        ]
        found = [read(reader(machine), *BEGIN, *way, "G53.1", "G1 X3 Y4 Z5", "X-8 Y2")[-3:] for way in ways]
        for way, rows in zip(ways[1:], found[1:], strict=True):
            np.testing.assert_allclose(rows, found[0], atol=1e-6, err_msg="\n".join(way))


def words(letters: str, values: Sequence[float] | Array) -> str:
    return " ".join(f"{letter}{value:.9f}" for letter, value in zip(letters, values, strict=True)) + " "


@pytest.mark.parametrize("order", ["123", "132", "213", "231", "312", "321"])
def test_turns_of_p1_are_about_axes_that_stay_in_the_order_of_q(trunnion: Machine, order: str) -> None:
    """I is about X, J about Y and K about Z, whatever the order."""
    angles = (20.0, -35.0, 50.0)
    expected = np.eye(3)
    for digit in order:
        expected = about(int(digit) - 1, angles[int(digit) - 1]) @ expected
    found = reader(trunnion)
    read(found, f"G68.2 P1 Q{order} X1 Y2 Z3 I20 J-35 K50")
    assert found.modal.frame is not None
    assert found.modal.frame.plane is not None
    np.testing.assert_allclose(found.modal.frame.plane.directions, expected, atol=1e-12)


def test_right_angles_of_planes_are_exact(trunnion: Machine) -> None:
    """So that arcs on them are those of two axes."""
    for lines in (
        ["G68.2 P1 X0 Y0 Z0 I90 J0 K-180"],
        (POINTS[0], "G68.2 P2 Q2 X0 Y7 Z0", "G68.2 P2 Q3 X0 Y3 Z8"),
    ):
        found = reader(trunnion)
        read(found, *lines)
        assert found.modal.frame is not None
        assert found.modal.frame.plane is not None
        assert {abs(each) for row in found.modal.frame.plane.directions for each in row} == {0.0, 1.0}


@pytest.fixture(scope="module", params=MILLS)
def mill(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[FiveAxes, Machine]:
    found = MILLS[request.param]
    return found, found.machine(tmp_path_factory.mktemp("mill"))


def test_length_and_zero_of_the_part_count_as_everywhere(mill: tuple[FiveAxes, Machine]) -> None:
    """G43 ahead of the plane or in it, G52 and R of the system ahead of it, G53 and G69 behind it."""
    model, machine = mill
    ways = [
        ["G43 H1", PLANE, "G53.1", "G1 X3 Y4 Z5"],
        [PLANE, "G53.1", "G1 X3 Y4 Z5", "G43 H1 G1 X3 Y4 Z5"],
        ["G43 H1", PLANE, "G53.1", "G53 G0 Z0", "G1 X3 Y4 Z5"],
        ["G43 H1", PLANE, "G53.1", "G69", "G1 X0 Y0 Z0", PLANE, "G53.1", "G1 X3 Y4 Z5"],
    ]
    for way in ways:
        places = on_plane(model, read(reader(machine), *BEGIN, *way), ORIGIN, ANGLES)
        np.testing.assert_allclose(places[-1], [3.0, 4.0, 5.0], atol=1e-9)
    within = PLANE.replace("X4 Y-3", "X0 Y0")
    shifted = read(reader(machine), *BEGIN, "G52 X4 Y-3", "G43 H1", within, "G53.1", "G1 X3 Y4 Z5")
    np.testing.assert_allclose(on_plane(model, shifted, ORIGIN, ANGLES)[-1], [3.0, 4.0, 5.0], atol=1e-9)
    begin = [*BEGIN, "G10 L2 P1 R30", "G43 H1", within.replace("I25", "I-5"), "G53.1"]
    places = on_plane(model, read(reader(machine), *begin, "G1 X3 Y4 Z5"), np.array([0.0, 0.0, 12.0]), ANGLES)
    np.testing.assert_allclose(places[-1], [3.0, 4.0, 5.0], atol=1e-9)
    behind = reader(machine)
    read(behind, *BEGIN, "G43 H1", PLANE, "G53.1", "G1 X3 Y4 Z5", "G69", "G1 X1 Y2 Z3")
    ends = [behind.positions[axis] / MM for axis in range(3)]
    np.testing.assert_allclose(ends, [6.0, -5.0, -117.0], atol=1e-9)


def test_the_tool_stands_on_the_plane_and_only_rotary_axes_turn_to_it(
    mill: tuple[FiveAxes, Machine],
) -> None:
    model, machine = mill
    _, end = read(reader(machine), *BEGIN, PLANE, "G53.1")
    assert (end[:3] == 0.0).all()
    longer = dataclasses.replace(model, length=2.0 * LENGTH)
    away = on_plane(longer, end[None], ORIGIN, ANGLES) - on_plane(model, end[None], ORIGIN, ANGLES)
    np.testing.assert_allclose(away, [[0.0, 0.0, -LENGTH]], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "lines", "turns"),
    [
        # the axis that carries the other one goes the least way, then that one
        ("tables", ["G68.2 X0 Y0 Z0 I0 J30 K0"], {3: 30.0, 5: 0.0}),
        ("tables", ["G0 A-20 C170", "G68.2 X0 Y0 Z0 I0 J30 K0"], {3: -30.0, 5: 180.0}),
        # of the table and the head the table
        ("mixed", ["G68.2 X0 Y0 Z0 I90 J30 K0"], {4: 30.0, 5: 0.0}),
        ("mixed", ["G0 B25 C170", "G68.2 X0 Y0 Z0 I90 J30 K0"], {4: -30.0, 5: 180.0}),
        # one that may stand anywhere stays
        ("tables", ["G0 A-20 C77", "G68.2 X0 Y0 Z0 I0 J0 K45"], {3: 0.0, 5: 77.0}),
        ("heads", ["G0 B-20 C77", "G68.2 X0 Y0 Z0 I0 J0 K45"], {4: 0.0, 5: 77.0}),
    ],
)
def test_of_two_positions_that_of_fanuc_s_rule_is_taken(
    name: str, lines: list[str], turns: dict[int, float], tmp_path: Path
) -> None:
    found = reader(MILLS[name].machine(tmp_path))
    read(found, *BEGIN, *lines, "G53.1")
    assert {axis: round(found.positions[axis] / DEGREE, 6) for axis in turns} == turns


def test_a_position_beyond_the_travel_is_not_taken_and_none_is_refused(tmp_path: Path) -> None:
    machine = TABLE_TABLE.machine(tmp_path)
    text = (tmp_path / "mill.urdf").read_text().replace('"j3" type="continuous"', '"j3" type="revolute"')
    link, limit = '<child link="l3"/>', '<limit lower="-1.6" upper="0.2" effort="1" velocity="1"/>'
    (tmp_path / "mill.urdf").write_text(text.replace(link, link + limit))
    found = reader(machine)
    read(found, *BEGIN, "G68.2 X0 Y0 Z0 I0 J30 K0", "G53.1")
    assert [round(found.positions[axis] / DEGREE, 6) for axis in (3, 5)] == [-30.0, 180.0]
    with pytest.raises(ProgramRejected, match=r"MC176.*beyond their travel"):
        read(reader(machine), *BEGIN, "G68.2 X0 Y0 Z0 I0 J120 K0", "G53.1")
    with pytest.raises(ProgramRejected, match=r"MC176.*no position"):
        read(reader(HEAD_HEAD.machine(tmp_path)), *BEGIN, "G68.2 X0 Y0 Z0 I0 J120 K0", "G53.1")


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        (["G53.1"], "MC175"),
        (["G68.2 P4 X0 Y0 Z0 I10 J20 K0"], "MC175"),
        (["G68.2 P1.5 X0 Y0 Z0 I10 J20 K0"], "MC175"),
        (["G68.2 P0 Q313 X0 Y0 Z0 I10 J20 K0"], "MC175"),
        (["G68.2 P1 Q122 X0 Y0 Z0 I10 J20 K0"], "MC175"),
        (["G68.2 P1 X0 Y0 Z0 I10 J20 K0 R5"], "MC175"),
        (["G68.2 X0 Y0 Z0 I10 I20 J0 K0"], "MC111"),
        # points and vectors come in their order, all of them, and give a plane
        (["G68.2 P2 X0 Y0 Z0"], "MC175"),
        (["G68.2 P2 Q2 X0 Y0 Z0"], "MC175"),
        (["G68.2 P2 Q1 X0 Y0 Z0 I3"], "MC175"),
        ([POINTS[0], POINTS[2]], "MC175"),
        ([POINTS[0], "G53.1"], "MC175"),
        ([POINTS[0], "G0 X5"], "MC175"),
        ([POINTS[0], PLANE], "MC175"),
        ([POINTS[0], VECTORS[1]], "MC175"),
        ([POINTS[0], "G55"], "MC185"),
        ([*POINTS, *POINTS[:1]], "MC185"),
        ([f"{POINTS[0]} R3", f"{POINTS[1]} R4"], "MC175"),
        ([*POINTS[:2], "G68.2 P2 Q3 X10 Y0 Z10"], "MC175"),
        ([POINTS[0], POINTS[0].replace("Q1", "Q2"), POINTS[2]], "MC175"),
        (["G68.2 P3 Q2 I0 J0 K1"], "MC175"),
        ([VECTORS[0], "G68.2 P3 Q2 X0 Y0 Z0 I0 J0 K1"], "MC175"),
        ([VECTORS[0], "G68.2 P3 Q2 I0 J0 K0"], "MC175"),
        ([VECTORS[0], "G68.2 P3 Q2 I-1 J0 K1.2"], "MC175"),
        (["G68.2 X0 Y0 Z0 I0 J30"], "MC175"),
        (["G68.2 X0 Y0 I0 J30 K0"], "MC175"),
        (["G68.2 X0 Y0 Z0 A3 I0 J30 K0"], "MC175"),
        (["G91 G68.2 X0 Y0 Z0 I0 J30 K0"], "MC175"),
        ([PLANE, "G53.1 X3"], "MC175"),
        # nothing moves before the tool stands on the plane, nor when it has left it
        ([PLANE, "G0 X0 Y0 Z0"], "MC175"),
        ([PLANE, "G0 C30"], "MC175"),
        ([PLANE, "G53 G0 Z0"], "MC175"),
        ([PLANE, "G53.1", "G0 X0 Y0 Z0 C90"], "MC175"),
        # where controllers differ
        ([PLANE, "G53.1", "G0 X0"], "MC186"),
        ([PLANE, "G53.1", "G91 G0 X0 Y0 Z1"], "MC186"),
        ([PLANE, "G53.1", "G0 X0 Y0 Z9", "G53 G0 X0", "Y3"], "MC186"),
        ([PLANE, "G53.1", "G0 X0 Y0 Z9", "G43 H1", "G91 G1 Z3"], "MC186"),
        ([PLANE, "G53.1", "G0 X0 Y0 Z9", "G69", "G91 G1 X3"], "MC186"),
        # what does not go together
        ([PLANE, "G53.1", "G55"], "MC185"),
        ([PLANE, "G52 X3"], "MC185"),
        ([PLANE, "G92 X3"], "MC185"),
        ([PLANE, "G10 L20 P1 X3"], "MC185"),
        ([PLANE, PLANE], "MC185"),
        ([PLANE, "G68 X0 Y0 R30"], "MC185"),
        (["G68 X0 Y0 R30", PLANE], "MC185"),
        (["G16", PLANE], "MC185"),
        ([PLANE, "G43.4 H1"], "MC172"),
        (["G43.4 H1", PLANE], "MC172"),
        (["G41.1 D3", "G1 X9 Y9", PLANE], "MC170"),
    ],
)
def test_what_could_go_elsewhere_is_refused(trunnion: Machine, lines: list[str], code: str) -> None:
    assert faults(trunnion, *BEGIN, *lines) == [(code, len(BEGIN) + len(lines))]


REFUSED = "G68.2 P4 X0 Y0 Z0 I0 J0 K0"
ON_IT = ("F100 G53.1", "G0 X5 Y5 Z9000", "G2 X9 Y5 I2", "G0 C30")


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ((REFUSED, *ON_IT), [(1, "P4 is not read")]),
        ((REFUSED, *ON_IT, "G69", "G0 Z0", REFUSED, *ON_IT), [(1, "P4 is not read (2 lines)")]),
        ((POINTS[0], POINTS[2], POINTS[2], *ON_IT), [(2, "here G68.2 P2 needs Q2")]),
        (("G68.2 P3 Q1 X1 Y2 Z3 I1", VECTORS[1], *ON_IT), [(1, "G68.2 P3 takes")]),
        ((POINTS[0], *ON_IT), [(2, "P2 is not complete")]),
        (
            (PLANE, "G0 X5 Y5 Z5", "G1 X6 Y6 Z6 F100"),
            [(2, "does not stand on the tilted plane yet (2 lines)")],
        ),
        # what stands in such a line by itself, and what comes when the plane has ended, is told
        ((REFUSED, "G53.1", "G2 X5 Y5", "G69", "G0 Z9000"), [(1, "P4"), (3, "neither R nor"), (5, "beyond")]),
        ((REFUSED, *ON_IT, PLANE.replace("G68.2", "G68.2 Q2")), [(1, "P4"), (6, "P0 takes no Q")]),
        (("G53.1", "G0 Z9000"), [(1, "no G68.2"), (2, "beyond")]),
    ],
)
def test_a_plane_that_is_refused_is_told_once_and_nothing_that_follows_from_it(
    trunnion: Machine, lines: tuple[str, ...], told: list[tuple[int, str]]
) -> None:
    text = "\n".join((*lines, "M2"))
    found = check_program(text, trunnion, build_kinematics(trunnion))
    errors = [each for each in found if each.severity == "error"]
    assert [each.line for each in errors] == [line for line, _ in told], errors
    assert all(says in each.message for each, (_, says) in zip(errors, told, strict=True)), errors


def test_a_head_s_plane_has_no_compensation_and_a_machine_without_kinematics_no_plane(tmp_path: Path) -> None:
    machine = HEAD_TABLE.machine(tmp_path)
    lines = (*BEGIN, "G68.2 X0 Y0 Z0 I90 J30 K0", "G53.1", "G0 X0 Y0 Z9", "G41.1 D3")
    assert faults(machine, *lines) == [("MC185", len(lines))]
    with pytest.raises(ProgramRejected, match="MC171"):
        Interpreter(MACHINE).interpret_text(PLANE, 1)


def test_it_is_shown_and_ends_with_g69_and_with_the_program(trunnion: Machine) -> None:
    found = reader(trunnion)
    read(found, *BEGIN, PLANE, "G53.1", "G0 X0 Y0 Z9")
    assert "G68.2" in modal_codes(found.modal)
    assert found.interpret_batch(["G1 X1 Y1"] * 50, 9) is None
    zeros = (found.modal.frame or Frame()).zeros()
    assert {axis: round(at / MM, 6) for axis, at in zeros["G54"].items()} == {0: 5.0, 1: -7.0, 2: -200.0}
    read(found, "G69", "G0 X0 Y0 Z0")
    assert "G68.2" not in modal_codes(found.modal)
    assert found.modal.transformation is None
    read(found, PLANE, "M30")
    assert found.modal.transformation is None


def test_a_program_begins_in_its_middle_as_it_comes_there(mill: tuple[FiveAxes, Machine]) -> None:
    _, machine = mill
    kinematics = build_kinematics(machine)
    lines = [
        *BEGIN,
        "G1010",
        "G43 H1",
        PLANE,
        "G53.1",
        "G0 X0 Y0 Z9",
        "G1 X3",
        "G91 Y4",
        "G90 G69",
        "G0 X0 Y0 Z0",
    ]
    whole = reader(machine)
    read(whole, *lines)
    for first in (8, 9, 10, 11):
        before = state_before(lines, first, machine, StartState.of(machine), kinematics=kinematics)
        rest = Interpreter(machine, kinematics=kinematics, positions=before.positions, modal=before.modal)
        read(rest, *lines[first - 1 :])
        assert rest.positions == pytest.approx(whole.positions, abs=1e-12)


def test_a_program_begins_between_the_lines_of_a_plane_by_points(trunnion: Machine) -> None:
    kinematics = build_kinematics(trunnion)
    lines = [*BEGIN, "G1010", "G43 H1", *POINTS, "G53.1", "G0 X0 Y0 Z9", "G1 X3"]
    whole = reader(trunnion)
    read(whole, *lines)
    for first in (6, 7, 8):
        before = state_before(lines, first, trunnion, StartState.of(trunnion), kinematics=kinematics)
        rest = Interpreter(trunnion, kinematics=kinematics, positions=before.positions, modal=before.modal)
        read(rest, *lines[first - 1 :])
        assert rest.positions == pytest.approx(whole.positions, abs=1e-12)


def test_after_a_jog_of_a_rotary_axis_in_a_pause_g53_1_turns_the_tool_again(trunnion: Machine) -> None:
    found = reader(trunnion)
    read(found, *BEGIN, "G43 H1", PLANE, "G53.1", "G0 X0 Y0 Z9", "M0")
    turn = found.positions[3]
    found.end_pause({3: turn + 0.2}, None)
    with pytest.raises(ProgramRejected, match=r"MC175.*G53\.1 again"):
        found.interpret_text("G1 X3 Y0 Z9", 9)
    rows = read(found, "G53.1", "G1 X3 Y0 Z9")
    assert found.positions[3] == pytest.approx(turn)
    np.testing.assert_allclose(on_plane(TABLE_TABLE, rows, ORIGIN, ANGLES)[-1], [3.0, 0.0, 9.0], atol=1e-9)


def test_arcs_and_holes_on_a_head_s_plane_keep_every_axis_s_limits(tmp_path: Path) -> None:
    machine = HEAD_HEAD.machine(tmp_path)
    text = [*BEGIN, PLANE, "G53.1", "G0 G43 H1 X0 Y0 Z20", "G1 Z5 F6000", "G2 I15 J5", "G3 X20 Y9 R15 Z8"]
    text += ["G83 X5 Y5 Z-5 R3 Q3", "X12", "G80", "G18 G2 X0 Z8 R30", "G69", "G53 G0 Z0", "G91 G28 Z0"]
    found = run(machine, "\n".join(text))
    assert found.recording is not None
    assert_within_limits(found, machine)
    rows = np.zeros((len(found.recording.setpoint), 6))
    rows[:, [axis.index for axis in machine.axes]] = found.recording.setpoint
    circle = on_plane(HEAD_HEAD, rows[found.recording.line == 7], ORIGIN, ANGLES)
    assert np.abs(np.hypot(circle[:, 0] - 15, circle[:, 1] - 5) - math.hypot(15, 5)).max() < 0.021
    assert np.abs(circle[:, 2] - 5.0).max() < 0.021
    # in and out of the hole the tool goes along itself, by rapids, too
    hole = on_plane(HEAD_HEAD, rows[found.recording.line == 9], ORIGIN, ANGLES)
    inside = hole[hole[:, 2] < 2.99]
    assert len(inside) > 100
    assert np.abs(inside[:, :2] - 5.0).max() < 1e-6
