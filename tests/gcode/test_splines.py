"""Curves by control points (D-97), against de Casteljau's construction."""

from __future__ import annotations

import math
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mcserver.errors import ProgramRejected
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import parse_machine
from mcserver.motion.canonical import FeedGroup, MotionLine
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.rational_curve import RationalCurve
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.units import MM
from tests.bench.rs274_programs import MACHINE
from tests.gcode.support import Program
from tests.machine_text import axes_text


def lines_of(*lines: str) -> list[MotionLine]:
    values = Program(MACHINE).run("G21 G90 F1000", *lines)
    return [each for each in values if isinstance(each, MotionLine)]


def curves(*lines: str) -> list[RationalCurve]:
    groups = [group for line in lines_of(*lines) for group in line.groups if isinstance(group, FeedGroup)]
    return [curve for group in groups for curve in group.curves if isinstance(curve, RationalCurve)]


def faults(*lines: str) -> list[tuple[str, int]]:
    found = check_program("\n".join(["F1000", *lines]), MACHINE)
    return [(each.code, each.line - 1) for each in found if each.severity == "error"]


def de_casteljau(points: Array, t: float) -> Array:
    while len(points) > 1:
        points = points[:-1] + t * (points[1:] - points[:-1])
    return points[0]


def beside(curve: RationalCurve, places: Array) -> float:
    """Return how far places [mm] are beside a curve, as a share of its length."""
    path = curve.position(np.linspace(0.0, 1.0, 2001)) / MM
    gaps = []
    for place in places:
        nearest = int(np.linalg.norm(path - place, axis=1).argmin())
        low, high = path[max(nearest - 1, 0)], path[min(nearest + 1, 2000)]
        along, away = (high - low) / np.linalg.norm(high - low), place - low
        gaps.append(abs(float(along[0] * away[1] - along[1] * away[0])))
    return max(gaps) * MM / curve.length


@given(st.integers(0, 2**32))
def test_curves_are_those_of_de_casteljau(seed: int) -> None:
    random = Random(seed)

    def vector() -> Array:
        return np.array([round(random.uniform(3, 20), 3), round(random.uniform(-8, 8), 3)])

    inch, incremental = random.random() < 0.3, random.random() < 0.5
    unit, place, lines, expected = 25.4 if inch else 1.0, np.zeros(2), [], []
    leaving: Array | None = None
    lines.append(f"G{20 if inch else 21} G{91 if incremental else 90}")
    if random.random() < 0.4:
        lines.append("G90 G51 X0 Y0 I-1.5 J1.5")
    across = np.diag([-1.5, 1.5]) if len(lines) > 1 else np.eye(2)
    lines.append("G90 G0 X0 Y0")
    lines += ["G91"] if incremental else []
    for _ in range(random.randint(1, 4)):
        first, last, way = vector() / 2.0, vector() / -2.0, vector()
        way[0] += 20.0
        quadratic = random.random() < 0.3
        end = way if incremental else place / unit + way
        words = f"X{end[0]:.9f} Y{end[1]:.9f}"
        bend = f" I{first[0]} J{first[1]}"
        if quadratic:
            lines.append(f"G5.1 {words}{bend}")
            points = np.array([place, place + unit * first, place + unit * way])
            leaving = None
        else:
            if leaving is not None and random.random() < 0.5:
                bend, first = "", leaving / unit
            lines.append(f"G5 {words}{bend} P{last[0]} Q{last[1]}")
            points = np.array([place, place + unit * first, place + unit * (way + last), place + unit * way])
            leaving = -last * unit
        expected.append(points @ across)
        place = place + unit * way
    # one that all but turns back is refused, and seldom drawn
    assume("MC189" not in [code for code, _ in faults(*lines)])
    found = curves(*lines)
    assert len(found) == len(expected)
    for curve, points in zip(found, expected, strict=True):
        places = np.array([de_casteljau(points, t) for t in np.linspace(0.0, 1.0, 31).tolist()])
        assert beside(curve, places) < 2e-5, lines


def cox_de_boor(degree: int, index: int, u: float, knots: list[float]) -> float:
    if degree == 0:
        return float(knots[index] <= u < knots[index + 1])
    found = 0.0
    for basis in (index, index + 1):
        low, high = knots[basis], knots[basis + degree]
        if high > low:
            share = (u - low) / (high - low)
            found += (share if basis == index else 1.0 - share) * cox_de_boor(degree - 1, basis, u, knots)
    return found


@given(st.integers(0, 2**32))
@settings(max_examples=25)
def test_curves_over_several_lines_are_those_of_cox_and_de_boor(seed: int) -> None:
    random = Random(seed)
    order = random.choice([3, 3, 4, 5])
    points = [(0.0, 0.0, 1.0)]
    for number in range(order - 1 + random.randint(0, 4)):
        points.append((20.0 * (number + 1), random.uniform(-10, 10), random.choice([0.5, 1.0, 2.0])))
    across = np.array([[0.0, -1.0], [1.0, 0.0]]) if random.random() < 0.3 else np.eye(2)
    lines = ["G68 X0 Y0 R90", "G0 X0 Y0"] if across[0, 1] else []
    lines += [f"X{x} Y{y:.9f} P{weight}" for x, y, weight in points[1:]]
    first = 2 if across[0, 1] else 0
    lines[first] = f"G5.2 {lines[first]} L{order}"
    found = curves(*lines, "G5.3")
    degree, spans = order - 1, len(points) - order + 1
    assert len(found) == spans
    knots = [0.0] * degree + [float(each) for each in range(spans + 1)] + [float(spans)] * degree
    control = np.array(points)
    for span, curve in enumerate(found):
        places = []
        for share in (0.0, 0.2, 0.5, 0.9):
            basis = [cox_de_boor(degree, at, span + share, knots) for at in range(len(points))]
            weights = np.array(basis) * control[:, 2]
            places.append(across @ (weights @ control[:, :2]) / weights.sum())
        assert beside(curve, np.array(places)) < 5e-6, lines
    # spans meet, and go on in one direction
    for before, after in pairwise(found):
        assert before.end == after.start
        leaving, coming = before.derivatives(np.ones(1))[0][0], after.derivatives(np.zeros(1))[0][0]
        assert leaving / before.length == pytest.approx(coming / after.length, abs=1e-9)


def test_a_curve_over_several_lines_is_one_line_s_motion() -> None:
    block = ["G5.2 P2", "(a comment)", "X10 Y10 P1 L3", "", "X20 Y0 P1", "X30 Y9 P1", "G5.3"]
    found = lines_of(*block)
    assert [each.line for each in found] == [8, 8]
    assert [each.exact_stop for each in lines_of("G61", *block)] == [False, True]
    timed = [each.groups[0] for each in lines_of("G93 F30", *block)]
    assert sum(each.duration for each in timed) == pytest.approx(2.0)  # type: ignore[union-attr, misc]
    assert faults("G5.2 X0 Y9 P1", "X9 Y9 P1", "") == [("MC189", 1)]
    assert faults("G1 X3", *block, "X3") == [("MC113", 9)]


def test_it_goes_at_f_and_flows_or_stops_as_its_neighbours_do() -> None:
    flowing, stopping = "G5 X10 Y5 I5 J0 P-3 Q0", "G61 G5 X10 Y5 I5 J0 P-3 Q0"
    (line,) = lines_of(flowing)
    (group,) = line.groups
    assert isinstance(group, FeedGroup)
    assert (line.exact_stop, lines_of(stopping)[0].exact_stop) == (False, True)
    assert [each.exact_stop for each in lines_of("G9", flowing, flowing.replace("10", "20"))] == [True, False]
    assert group.requested == pytest.approx(line.feed_length / (1000 * MM / 60))
    assert lines_of("G93 F30", flowing)[0].groups[0].duration == 2.0  # type: ignore[union-attr]


def test_a_straight_one_is_a_line() -> None:
    (curve,) = curves("G5 X9 Y9 I3 J3 P-3 Q-3")
    assert curve.length == pytest.approx(9 * math.sqrt(2) * MM)
    assert curve.position(np.array([0.5]))[0] == pytest.approx([4.5 * MM] * 2)


def test_a_program_goes_on_smoothly_from_a_line() -> None:
    lines = ["F1000", "G5 X10 Y0 I3 J3 P-3 Q3", "G5 X20 Y0 P-3 Q3", "M30"]
    before = state_before(lines, 3, MACHINE, StartState.of(MACHINE))
    rest = Interpreter(MACHINE, positions=before.positions, modal=before.modal)
    (line,) = rest.interpret_text(lines[2], 3)
    assert isinstance(line, MotionLine)
    (group,) = line.groups
    assert isinstance(group, FeedGroup)
    slope = group.curves[0].derivatives(np.array([0.0]))[0][0]
    assert slope[1] == pytest.approx(-slope[0])


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        (["G5 X10 Y5 P-3 Q0"], "MC189"),
        (["G5 X10 Y5 I5 J0 P-3 Q0", "G1 X20", "G5 X30 Y5 P-3 Q0"], "MC189"),
        (["G5 X10 Y5 I5 J0 P-3 Q0", "G5.1 X20 Y5 I3 J3", "G5 X30 Y5 P-3 Q0"], "MC189"),
        (["G5 X10 Y5 I5 J0"], "MC118"),
        (["G5 X10 Y5 I5 P-3 Q0"], "MC118"),
        (["G5.1 X10 Y5 I5"], "MC118"),
        (["G5.1 X10 Y5"], "MC118"),
        (["G5 X10 Y5 Z3 I5 J0 P-3 Q0"], "MC112"),
        (["G5 X10 Y5 I5 J0 K1 P-3 Q0"], "MC112"),
        (["G18 G5 X10 Y5 I5 J0 P-3 Q0"], "MC189"),
        (["G5 X10 Y5 I0 J0 P-3 Q0"], "MC189"),
        (["G5 X0.5 Y0 I40 J0.1 P40 Q0.1"], "MC189"),
        (["G5 X10 Y5 I5 J0 P-3 Q0", "X20"], "MC113"),
        (["G81 X1 Y1 Z-1 R1", "G5 X10 Y5 I5 J0 P-3 Q0", "X20"], "MC113"),
        (["G41.1 D2", "G1 X9 Y0", "G5 X30 Y5 I5 J0 P-3 Q0"], "MC170"),
        (["G16", "G5 X30 Y5 I5 J0 P-3 Q0"], "MC185"),
        (["G68 X0 Y0 R30", "G5 X30 Y5 I5 J0 P-3 Q0"], "MC186"),
        (["G53 G5 X30 Y5 I5 J0 P-3 Q0"], "MC153"),
        (["G5.3"], "MC189"),
        (["G5.2 X0 Y9 P1", "X9 Y9 P1", "G1 X5"], "MC189"),
        (["G5.2 X0 Y9 P1", "X9 Y9 P1", "M2"], "MC189"),
        (["G5.2 X0 Y9 P1", "X9 Y9 P1", "G53 X3 Y3 P1"], "MC189"),
        (["G5.2 X0 Y9 P1", "X9 Y9"], "MC189"),
        (["G5.2 X0 Y9 P1", "X9 P1"], "MC189"),
        (["G5.2 X0 Y9 P1", "X9 Y9 P-1"], "MC118"),
        (["G5.2 X0 Y9"], "MC118"),
        (["G5.2 X0 Y9 P1 L2"], "MC116"),
        (["G91 G5.2 X0 Y9 P1"], "MC189"),
        (["G5.2 X0 Y9 P1 L4", "X9 Y9 P1", "G5.3"], "MC189"),
        (["G5.2 X5 Y0 P1", "X0 Y0 P1", "G5.3"], "MC189"),
    ],
)
def test_what_is_no_such_curve_is_refused(lines: list[str], code: str) -> None:
    # what follows in a curve that is broken off is told, too
    assert faults(*lines)[:1] == [(code, len(lines))]


def test_a_curve_that_leaves_the_travel_is_refused() -> None:
    axes = axes_text(range(3), keys="min_position = 0.0\nmax_position = 10.0")
    machine = parse_machine(f'[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n{axes}')
    # its top is at three quarters of the height of its control points
    for height, expected in ((13.3, []), (13.4, ["MC201"])):
        text = f"F1000\nG5 X10 Y0 I1 J{height} P-1 Q{height}"
        assert [each.code for each in check_program(text, machine)] == expected


def test_without_f_it_is_refused() -> None:
    with pytest.raises(ProgramRejected, match="MC121"):
        Interpreter(MACHINE).interpret_text("G5 X10 Y5 I5 J0 P-3 Q0", 1)
