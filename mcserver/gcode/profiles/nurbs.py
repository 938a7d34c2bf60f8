"""Read G5.2 and G5.3: a curve by weighted control points over several lines, with LinuxCNC's words (D-97).

The first control point is the position of the axes. Knots are whole numbers; the end knots are repeated as
often as the order. Each span between two knots is a rational Bezier curve whose control points its polar form
gives (Ramshaw, Blossoming: a connect-the-dots approach to splines).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from mcserver.gcode.profiles.splines import PLANE, allowed, curve_line, refuse, takes_exact_stop
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.modal import ControlPoints
from mcserver.gcode.semantics.program_places import ends_of, given_by
from mcserver.gcode.text.profile_words import Action, ProfileWords
from mcserver.motion.canonical import Canonical, FeedGroup, Group, MotionLine
from mcserver.motion.geometry.curves import Array

LEAST_ORDER, GREATEST_ORDER = 3, 10
MOST_POINTS = 1000
_OWN = frozenset({"G5.2", "G5.3", "REPEAT"})


def read_control_line(block: BlockState) -> list[Canonical]:
    """Return the motion of a line between G5.2 and G5.3: none for a control point, the curve for G5.3."""
    points = block.modal.control_points
    assert points is not None
    profile = block.parsed.profile or ProfileWords()
    actions, moved = profile.actions, any(block.parsed.groups) or profile.machine_frame
    if not actions and not moved:
        return []
    if len(actions) != 1 or actions[0].code not in _OWN or moved:
        block.faults.add(
            "MC189",
            f"this is no control point, and no G5.3 ends the curve that line {points.line} begins",
            (1, len(block.parsed.text) + 1),
            "write X, Y and P, the weight, in each line, and G5.3 behind the last one",
        )
        block.change(control_points=None)
        return []
    action = actions[0]
    if action.code == "G5.3":
        block.end_motion_code()
        return _close(block, action, points)
    add_control_point(block, action)
    return []


def add_control_point(block: BlockState, action: Action) -> None:
    """Add the control point of G5.2, or of a later line of words only."""
    points = block.modal.control_points
    block.end_motion_code()
    block.change(control_points=points)
    if not allowed(block, action, "PL"):
        return
    weight = action.words["P"].value if "P" in action.words else None
    if weight is None or weight <= 0.0:
        refuse(block, action, "a control point has a weight above 0", "write P, such as P1", "MC118")
        return
    order = LEAST_ORDER if points is None else points.order
    if "L" in action.words:
        order = int(action.words["L"].value)
        if order != action.words["L"].value or not LEAST_ORDER <= order <= GREATEST_ORDER:
            what = f"the order of a curve is from {LEAST_ORDER} to {GREATEST_ORDER}"
            refuse(block, action, what, "write such as L3", "MC116")
            return
    if points is None:
        x, y = (block.commanded.start(axis) for axis in PLANE)
        points = ControlPoints(block.parsed.number, order, ((x, y, 1.0 if action.axes else weight),))
        if not action.axes:
            block.change(control_points=points)
            return
    if len(points.points) >= MOST_POINTS:
        refuse(block, action, f"a curve has at most {MOST_POINTS} control points", "divide it")
        return
    named = {word.axis: word for word in action.axes}
    if block.modal.incremental or named.keys() != set(PLANE):
        refuse(block, action, "a control point needs X and Y, as positions", "write both, under G90")
        return
    ends = ends_of(block, given_by(block, named), action)
    if ends is not None:
        place = (ends[PLANE[0]], ends[PLANE[1]], weight)
        block.change(control_points=ControlPoints(points.line, order, (*points.points, place)))


def _close(block: BlockState, action: Action, given: ControlPoints) -> list[Canonical]:
    """Return the spans of the curve as consecutive lines."""
    if len(given.points) < given.order:
        what = f"a curve of order {given.order} has as many control points at least, not {len(given.points)}"
        refuse(block, action, what, "give more, or a lower order by L")
        return []
    if block.commanded.guessed.intersection(PLANE):
        return []
    weighted = np.array(given.points)
    weighted[:, :2] *= weighted[:, 2:]
    found: list[MotionLine] = []
    for span in _spans(weighted, given.order - 1):
        places = span[:, :2] / span[:, 2:]
        # each begins exactly where the one before ended
        places[0] = [block.commanded.start(axis) for axis in PLANE]
        line = curve_line(block, action, places, span[:, 2])
        if line is None:
            return []
        found.append(line)
    whole = math.fsum(line.feed_length for line in found)
    exact = takes_exact_stop(block)
    return [
        msgspec.structs.replace(
            line,
            groups=tuple(_shared(group, line.feed_length / whole) for group in line.groups),
            exact_stop=exact and line is found[-1],
        )
        for line in found
    ]


def _shared(group: Group, share: float) -> Group:
    """Return a span with its share of G93's duration."""
    if not isinstance(group, FeedGroup) or group.duration is None:
        return group
    duration = share * group.duration
    return msgspec.structs.replace(group, requested=duration, duration=duration)


def _spans(points: Array, degree: int) -> list[Array]:
    """Return the control points of the Bezier curves of a B-spline in any number of coordinates."""
    inner = len(points) - degree
    knots = [0.0] * degree + [float(knot) for knot in range(inner + 1)] + [float(inner)] * degree
    found = []
    for span in range(degree, len(points)):
        low, high = knots[span], knots[span + 1]
        places = ([low] * (degree - count) + [high] * count for count in range(degree + 1))
        found.append(np.array([_polar(points, knots, span, each) for each in places]))
    return found


def _polar(points: Array, knots: Sequence[float], span: int, arguments: Sequence[float]) -> Array:
    """Return a span's polar form at ``degree`` arguments, by de Boor's scheme."""
    degree = len(arguments)
    values = points[span - degree : span + 1]
    for level, argument in enumerate(arguments, start=1):
        left = np.array([knots[span - degree + level + each] for each in range(len(values) - 1)])
        right = np.array([knots[span + 1 + each] for each in range(len(values) - 1)])
        share = ((argument - left) / (right - left))[:, None]
        values = (1.0 - share) * values[:-1] + share * values[1:]
    found: Array = values[0]
    return found
