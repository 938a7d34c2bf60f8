"""Read G5 and G5.1: curves by control points, with LinuxCNC's words (D-97)."""

from __future__ import annotations

import msgspec
import numpy as np

from mcserver.gcode.profiles.directions import along
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.feed_time import FeedBasis, FeedMove, feed_group
from mcserver.gcode.semantics.modal import SplineEnd
from mcserver.gcode.semantics.program_places import ends_of, given_by
from mcserver.gcode.semantics.program_units import length_scale, shown_length
from mcserver.gcode.semantics.travel_limits import check_travel
from mcserver.gcode.text.profile_words import Action
from mcserver.motion.canonical import MotionLine
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.rational_curve import Cusp, rational_curve
from mcserver.units import AxisType

PLANE = (0, 1)


def read_spline(block: BlockState, action: Action) -> MotionLine | None:
    """Return the curve of a line; faults are reported and None is returned (MC112, MC118, MC185 to MC189)."""
    # G0 to G3 in between end a chain of G5
    before = block.modal.spline_end if block.modal.motion is None else None
    block.end_motion_code()
    if action.code == "G5.3":
        refuse(block, action, "no G5.2 begins a curve that G5.3 could end", "write G5.2 before it")
        return None
    if not allowed(block, action, "IJ" if action.code == "G5.1" else "IJPQ"):
        return None
    start = np.array([block.commanded.start(axis) for axis in PLANE])
    ends = ends_of(block, given_by(block, {word.axis: word for word in action.axes}), action)
    if ends is None or not block.commanded.guessed.isdisjoint(PLANE):
        return None
    end = np.array([ends.get(axis, start[axis]) for axis in PLANE])
    quadratic = action.code == "G5.1"
    first, last = _vector(block, action, "IJ"), None if quadratic else _vector(block, action, "PQ")
    goes_on = before is not None and before.place == tuple(start.tolist())
    if first is None and not quadratic and goes_on and before is not None:
        first = np.array(before.leaving)
    if block.faults.found:
        return None
    if first is None or (last is None and not quadratic):
        if quadratic or last is None:
            what, hint = f"lacks {'I and J' if quadratic else 'P and Q'}", "write both: its control point"
            refuse(block, action, f"{action.code} {what}", hint, "MC118")
        else:
            hint = "give the first control point from the start"
            refuse(block, action, "G5 lacks I and J, and no G5 ends here", hint)
        return None
    points = [start, start + first, end]
    if last is not None:
        points.insert(2, end + last)
        block.change(spline_end=SplineEnd(tuple(end.tolist()), tuple((-last).tolist())))
    line = curve_line(block, action, np.array(points))
    return None if line is None else msgspec.structs.replace(line, exact_stop=takes_exact_stop(block))


def allowed(block: BlockState, action: Action, taken: str) -> bool:
    """Report a curve that is not allowed here, and words not in ``taken``; return whether all is right."""
    transformation = block.transformation
    axes = [block.usable_axis(axis, action) for axis in PLANE]
    strays = [word for word in action.words.values() if word.letter in "IJKRPQL" and word.letter not in taken]
    strays += [word for word in action.axes if word.axis not in PLANE]
    for word in strays:
        block.faults.add("MC112", f"{action.code} does not take {word.letter}", word.span, "take it out")
    seen = [word.axis for word in action.axes]
    if len(seen) > len(set(seen)):
        block.faults.add("MC111", "an axis stands twice in one command", action.span, "keep one of them")
    if block.modal.plane != 17:
        refuse(block, action, f"{action.code} is for the plane of X and Y", "write G17 before it")
    elif any(axis is not None and (axis.type is not AxisType.LINEAR or axis.profiled) for axis in axes):
        refuse(
            block,
            action,
            f"{action.code} needs linear axes X and Y that follow paths",
            "write lines and arcs",
        )
    elif transformation.polar is not None:
        refuse(block, action, f"{action.code} does not go together with G16", "write G15 before it", "MC185")
    elif not transformation.in_plane(PLANE):
        what = f"{action.code} does not go together with {transformation.names}"
        refuse(block, action, what, "write arcs and lines", "MC185")
    elif transformation.unsettled.intersection(PLANE):
        what = "controllers differ in where this curve starts"
        refuse(block, action, what, "write a G0 or G1 under G90 with X and Y before it", "MC186")
    return not block.faults.found and None not in axes


def takes_exact_stop(block: BlockState) -> bool:
    """Return whether the line stops exactly, and use up a G9 (D-15)."""
    exact = block.modal.exact_stop or block.modal.exact_next
    block.change(exact_next=False)
    return exact


def refuse(block: BlockState, action: Action, what: str, hint: str, code: str = "MC189") -> None:
    """Report a fault of a curve's line."""
    block.faults.add(code, what, action.span, hint)


def _vector(block: BlockState, action: Action, letters: str) -> Array | None:
    """Return a control point relative to its end of the curve [m]; None if one of the letters is missing."""
    given = [action.words[letter].value for letter in letters if letter in action.words]
    if len(given) == 1:
        refuse(block, action, f"{' and '.join(letters)} belong together", "write both", "MC118")
    if len(given) < len(letters):
        return None
    scale = length_scale(block.modal.inch)
    transformation = block.transformation
    scaled = transformation.vector(PLANE, scale * given[0], scale * given[1])
    turned = along(transformation.directions, dict(zip(PLANE, scaled, strict=True)))
    return np.array([turned[axis] for axis in PLANE])


def curve_line(
    block: BlockState, action: Action, points: Array, weights: Array | None = None
) -> MotionLine | None:
    """Return the motion along the curve of control points, shape (n, 2) [m]; None after a fault."""
    try:
        curve = rational_curve(PLANE, points, weights)
    except Cusp as fault:
        what = "the curve comes to a stand or has a cusp"
        if fault.radius:
            what = f"the curve bends within {shown_length(fault.radius, block.modal.inch)}"
        hint = "keep its control points away from its ends and from each other, or divide it into several"
        refuse(block, action, what, hint)
        return None
    if block.faults.found:
        return None
    low, high = curve.bounds()
    words = {word.axis: word for word in action.axes}
    for column, axis in enumerate(PLANE):
        limits = block.setup.axes[axis]
        extremes = float(low[column]), float(high[column])
        check_travel(
            block, limits, curve.start[column], *extremes, curve.end[column], words.get(axis, action)
        )
        block.end_at(axis, curve.end[column])
    move = FeedMove(action, curve, FeedBasis.PATH, block.modal.inverse_time, block.modal.feed)
    group = feed_group(block, [move])
    if group is None:
        return None
    return MotionLine(block.parsed.number, (group,), tolerance=block.path_tolerance, feed_length=curve.length)
