"""G96 and G97: a spindle speed that follows the tool's distance from the spindle's axis (D-120)."""

from __future__ import annotations

import math
from itertools import pairwise

import msgspec

from mcserver.gcode.profiles.frame import Frame, Surface
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_units import motor_speed
from mcserver.gcode.text.profile_words import Action
from mcserver.machine.axis import Axis
from mcserver.motion.canonical import Canonical, FeedGroup, MotionLine, SpeedGroup, SurfaceSpeed
from mcserver.motion.geometry.curves import LineCurve
from mcserver.units import FOOT, MINUTE, TURN, AxisType

# the axis whose distance from the spindle's axis is the radius
RADIUS_AXIS = 0
# under G95 a line is split so that the spindle's speed varies by this ratio within a part
_PART = 1.05
# radius below which lines are not split [m]
_LEAST_RADIUS = 1e-5
_MOST_PARTS = 1000


def choose_speed(block: BlockState, action: Action, *, stops: bool) -> None:
    """Begin or end constant surface speed; ``stops``: the line has M5."""
    frame = block.frame
    speed = action.words.get("S")
    if action.code == "G97":
        if frame.surface is not None and speed is None and frame.direction and not stops:
            block.faults.add(
                "MC203",
                "G97 ends the constant surface speed and does not say how fast the spindle turns then",
                action.span,
                "add S in turns a minute, such as G97 S800",
            )
        rpm = 0.0 if frame.surface is not None and speed is None else frame.spindle_rpm
        block.frame = msgspec.structs.replace(frame, surface=None, spindle_rpm=rpm)
        return
    dialect = block.setup.machine.dialect
    radial = block.setup.axes.get(RADIUS_AXIS)
    spindle = None if dialect.spindle is None else block.usable_axis(dialect.spindle, action)
    endless = spindle is not None and spindle.type is AxisType.ROTARY and math.isinf(spindle.max_position)
    if spindle is None or not endless or radial is None or radial.type is not AxisType.LINEAR:
        block.faults.add(
            "MC203",
            "G96 needs a spindle that is a rotary axis without limits of travel, and a linear axis X",
            action.span,
            "name it as spindle_axis in [dialect] of the machine file, or write G97 and turns a minute",
        )
    elif frame.directions is not None:
        block.faults.add(
            "MC203", "X is turned, so it is no distance from the spindle's axis", action.span, "write G97"
        )
    elif speed is None or speed.value <= 0.0:
        block.faults.add(
            "MC203",
            f"G96 needs S above 0, the surface speed in {'feet' if block.modal.inch else 'm'} a minute",
            action.span if speed is None else speed.span,
            "such as G96 S150 D2500",
        )
    else:
        bound = action.words.get("D")
        if bound is not None and bound.value <= 0.0:
            block.faults.add("MC203", f"D{bound.text} lets the spindle stand", bound.span, "such as D2500")
            return
        greatest = spindle.max_velocity
        if bound is not None:
            greatest = min(greatest, bound.value * TURN / MINUTE)
        surface = Surface(0.0, greatest, _zero(block), block.parsed.number)
        block.frame = msgspec.structs.replace(frame, surface=surface)


def set_surface_speed(block: BlockState, surface: Surface, value: float) -> None:
    """Set S, above 0, as a surface speed: m/min, or ft/min under G20."""
    speed = value * (FOOT if block.modal.inch else 1.0) / MINUTE
    block.frame = msgspec.structs.replace(
        block.frame, surface=msgspec.structs.replace(surface, speed=speed, line=block.parsed.number)
    )


def spindle_group(block: BlockState, frame: Frame, spindle: Axis) -> SpeedGroup:
    """Return the spindle's motion in a frame, for X at the end of the last line."""
    if frame.surface is None:
        speed = motor_speed(frame.spindle_rpm * frame.direction, spindle.travel_per_motor_turn)
        return SpeedGroup((spindle.index,), (speed,))
    law = _law(frame.surface)
    sign = math.copysign(1.0, spindle.travel_per_motor_turn) * frame.direction
    velocity = sign * law.at(block.commanded.positions.get(RADIUS_AXIS, law.zero))
    return SpeedGroup((spindle.index,), (velocity,), law if velocity else None)


def follow_zero(block: BlockState) -> list[Canonical]:
    """Return the spindle's motion after a line that has shifted the zero of X; empty if unchanged."""
    frame, index = block.frame, block.setup.machine.dialect.spindle
    surface = frame.surface
    if surface is None or index is None or surface.zero == _zero(block):
        return []
    block.frame = frame = msgspec.structs.replace(
        frame, surface=msgspec.structs.replace(surface, zero=_zero(block))
    )
    group = spindle_group(block, frame, block.setup.axes[index])
    return [MotionLine(block.parsed.number, (group,))] if group.surface is not None else []


def turns_at(block: BlockState, surface: Surface) -> float:
    """Return the spindle's revolutions per minute at the end of the last line."""
    law = _law(surface)
    return law.at(block.commanded.positions.get(RADIUS_AXIS, law.zero)) * MINUTE / TURN


def part_by_turns(block: BlockState, line: MotionLine) -> list[MotionLine]:
    """Split a line of G95 so that each part has F for the spindle's speed there.

    Each part takes the lower speed at its ends. Arcs are not split, and take the speed at their greatest
    radius.

    Args:
        line: with its speed at one revolution per minute [m/s].
    """
    surface = block.frame.surface if block.modal.per_turn else None
    group = line.groups[0]
    if surface is None or not isinstance(group, FeedGroup) or group.speed is None:
        return [line]
    if block.compensation is not None:
        block.faults.add(
            "MC203",
            "F per turn of a spindle that the radius leads does not go together with cutter compensation",
            (1, len(block.parsed.text) + 1),
            "write G94 and F a minute, or G97 and S",
        )
        return [line]
    law, curve = _law(surface), group.curves[group.reference]
    if RADIUS_AXIS not in curve.axes:
        return [_paced(line, group, law.at(block.commanded.positions.get(RADIUS_AXIS, law.zero)))]
    column = curve.axes.index(RADIUS_AXIS)
    if not isinstance(curve, LineCurve) or len(group.curves) > 1 or len(line.groups) > 1:
        return [_paced(line, group, min(law.at(float(each[column])) for each in curve.bounds()))]
    shares = _shares(curve.start[column], curve.end[column], law)
    parts: list[MotionLine] = []
    start = curve.start
    for first, last in pairwise(shares):
        end = tuple(a + last * (b - a) for a, b in zip(curve.start, curve.end, strict=True))
        end = curve.end if last == 1.0 else end
        part = msgspec.structs.replace(
            group, curves=(LineCurve(curve.axes, start, end, curve.length * (last - first)),)
        )
        laid = msgspec.structs.replace(
            line,
            exact_stop=line.exact_stop and last == 1.0,
            feed_length=line.feed_length * (last - first),
        )
        parts.append(_paced(laid, part, min(law.at(start[column]), law.at(end[column]))))
        start = end
    return parts


def _shares(start: float, end: float, law: SurfaceSpeed) -> list[float]:
    """Return where to split a line, from 0 to 1: the spindle's speed differs by `_PART` between places."""
    radii = sorted({abs(start - law.zero), abs(end - law.zero)})
    if (start - law.zero) * (end - law.zero) < 0.0:
        radii.insert(0, 0.0)
    # inside it the spindle has its greatest speed
    least = max(law.speed / law.greatest, _LEAST_RADIUS)
    found: set[float] = {0.0, 1.0}
    radius = max(least, radii[0])
    for _ in range(_MOST_PARTS):
        if radius >= radii[-1]:
            break
        for place in (law.zero + radius, law.zero - radius):
            share = (place - start) / (end - start) if end != start else 0.0
            if 1e-9 < share < 1.0 - 1e-9:
                found.add(share)
        radius *= _PART
    return sorted(found)


def _paced(line: MotionLine, group: FeedGroup, turning: float) -> MotionLine:
    """Return a line with this group, and the speed of its F at a spindle's speed [rad/s]."""
    assert group.speed is not None
    speed = group.speed * turning * MINUTE / TURN
    length = group.curves[group.reference].length
    paced = msgspec.structs.replace(group, speed=speed, requested=length / speed)
    return msgspec.structs.replace(line, groups=(paced, *line.groups[1:]))


def _law(surface: Surface) -> SurfaceSpeed:
    return SurfaceSpeed(RADIUS_AXIS, surface.zero, surface.speed, surface.greatest)


def _zero(block: BlockState) -> float:
    return (block.frame.shift() or {}).get(RADIUS_AXIS, 0.0)
