"""G00-G03, G1020, G1030 and G1040 on directly named axes (D-20 to D-26)."""

from __future__ import annotations

import math

from mcserver.gcode.semantics.arc_geometry import plane_extrema
from mcserver.gcode.semantics.arcs import find_arc, find_plane
from mcserver.gcode.semantics.axis_words import Target, Words, resolve_targets
from mcserver.gcode.semantics.block_state import Draft
from mcserver.gcode.semantics.feed_time import FeedMove, Measure, measure_axes
from mcserver.gcode.semantics.program_units import motor_rpm, motor_speed, shown_number
from mcserver.gcode.semantics.travel_limits import check_travel
from mcserver.gcode.text.syntax import Command
from mcserver.gcode.text.words import INCREMENTAL_LETTERS, Word
from mcserver.motion.canonical import RapidGroup, SpeedGroup, TorqueGroup
from mcserver.motion.geometry.curves import ArcCurve, LineCurve
from mcserver.units import AxisType


def rapid(draft: Draft, command: Command, words: Words, *, wait: bool) -> RapidGroup | None:
    """G00 (waited for) or G1020: each axis by itself to its target."""
    targets = resolve_targets(draft, words.axes)
    for target in targets:
        start = draft.commanded.positions[target.axis.index]
        low, high = min(start, target.end), max(start, target.end)
        check_travel(draft, target.axis, start, low, high, target.end, target.word)
    draft.claim((target.axis.index for target in targets), command, _words(targets))
    for target in targets:
        draft.end_at(target.axis.index, target.end)
        if not wait:
            draft.commanded.send_to(target.axis.index, target.end)
    if not targets:
        return None
    axes = tuple(target.axis.index for target in targets)
    return RapidGroup(axes, tuple(target.end for target in targets), wait)


def line(draft: Draft, command: Command, words: Words) -> FeedMove | None:
    """G01: all axes share one path parameter."""
    targets = resolve_targets(draft, words.axes)
    starts = [draft.commanded.start(target.axis.index) for target in targets]
    for target, start in zip(targets, starts, strict=True):
        begin = target.end if target.axis.index in draft.commanded.assumed else start
        low, high = min(begin, target.end), max(begin, target.end)
        check_travel(draft, target.axis, begin, low, high, target.end, target.word)
    draft.claim((target.axis.index for target in targets), command, _words(targets))
    for target in targets:
        draft.end_at(target.axis.index, target.end)
    if not targets:
        return None
    linear = [
        target.end - start
        for target, start in zip(targets, starts, strict=True)
        if target.axis.type is AxisType.LINEAR
    ]
    measure = measure_axes(len(linear), len(targets) - len(linear))
    travel = math.hypot(*linear)
    draft.feed_length += travel
    curve = LineCurve(
        axes=tuple(target.axis.index for target in targets),
        start=tuple(starts),
        end=tuple(target.end for target in targets),
        length=abs(targets[0].end - starts[0]) if measure is Measure.TURN else travel,
    )
    return FeedMove(command, curve, measure, draft.modal.inverse_time, draft.modal.feed)


def arc(draft: Draft, command: Command, words: Words) -> FeedMove | None:
    """G02 and G03: two axes of a plane, and further linear axes that go with the angle (D-22, D-23)."""
    targets = resolve_targets(draft, words.axes)
    by_axis = {target.axis.index: target for target in targets}
    found = _arc(draft, command, words, targets, by_axis)
    for target in targets:
        draft.end_at(target.axis.index, target.end)
    return found


def _arc(
    draft: Draft, command: Command, words: Words, targets: list[Target], by_axis: dict[int, Target]
) -> FeedMove | None:
    draft.claim(by_axis, command, _words(targets))
    rotary = [target for target in targets if target.axis.type is not AxisType.LINEAR]
    for target in rotary:
        draft.faults.add(
            "MC137",
            f"axis {target.axis.index} is rotary; an arc moves linear axes",
            draft.span(target.word),
            "choose a tool by T, or move the axis by a G01 of its own in the same line",
            axis=target.axis.index,
        )
    plane = find_plane(draft, command, words)
    if plane is None or not _plane_axes(draft, command, plane, by_axis):
        return None
    axes = (*plane, *(target.axis.index for target in targets if target.axis.index not in plane))
    draft.claim(plane, command, _words(targets))
    if rotary or len(targets) < len(words.axes) or draft.commanded.assumed.intersection(axes):
        return None
    starts = {axis: draft.commanded.start(axis) for axis in axes}
    ends = {axis: by_axis[axis].end if axis in by_axis else starts[axis] for axis in axes}
    shape = find_arc(draft, command, words, plane, starts, ends)
    if shape is None:
        return None
    curve = shape.curve(axes, tuple(starts[axis] for axis in axes), tuple(ends[axis] for axis in axes))
    _check_arc_travel(draft, command, curve, by_axis)
    for axis in plane:
        draft.end_at(axis, ends[axis])
    draft.feed_length += curve.length
    measure = measure_axes(len(axes), 0)
    return FeedMove(command, curve, measure, draft.modal.inverse_time, draft.modal.feed)


def _plane_axes(draft: Draft, command: Command, plane: tuple[int, int], by_axis: dict[int, Target]) -> bool:
    """Whether the plane's unnamed axes are there, leased and linear."""
    named = {item.axis for item in command.items if isinstance(item, Word)}
    usable = True
    for index in plane:
        if index in named:
            usable = usable and index in by_axis
            continue
        axis = draft.usable_axis(index, command)
        if axis is not None and axis.type is not AxisType.LINEAR:
            draft.faults.add(
                "MC137",
                f"the arc's plane needs axis {index}, which is rotary",
                draft.span(command),
                "choose another plane by G17, G18 or G19, or a tool by T",
                axis=index,
            )
            axis = None
        usable = usable and axis is not None
    return usable


def _check_arc_travel(draft: Draft, command: Command, curve: ArcCurve, by_axis: dict[int, Target]) -> None:
    low, high = plane_extrema(curve)
    for column, index in enumerate(curve.axes):
        start, end = curve.start[column], curve.end[column]
        least, greatest = (low[column], high[column]) if column < 2 else (min(start, end), max(start, end))
        target = by_axis.get(index)
        place = command if target is None else target.word
        check_travel(draft, draft.setup.axes[index], start, least, greatest, end, place)


def transmit_speed(draft: Draft, command: Command, words: Words) -> SpeedGroup | None:
    """G1030: RPM of the motors as speeds of the axes (D-26)."""
    axes: list[int] = []
    speeds: list[float] = []
    for word, index in _transmitted(draft, command, words):
        axis = draft.setup.axes[index]
        speed = motor_speed(word.value, axis.travel_per_motor_turn)
        if abs(speed) > axis.max_velocity * (1.0 + 1e-9):
            most = motor_rpm(axis.max_velocity, axis.travel_per_motor_turn)
            draft.faults.add(
                "MC202",
                f"{word.value:g} RPM drives axis {index} beyond its max_velocity",
                draft.span(word),
                f"its motor may turn at {shown_number(most)} RPM at most",
                axis=index,
            )
        axes.append(index)
        speeds.append(speed)
    return SpeedGroup(tuple(axes), tuple(speeds)) if axes else None


def transmit_torque(draft: Draft, command: Command, words: Words) -> TorqueGroup | None:
    """G1040: torques [N·m] (D-26)."""
    found = _transmitted(draft, command, words)
    if not found:
        return None
    return TorqueGroup(tuple(index for _, index in found), tuple(word.value for word, _ in found))


def _transmitted(draft: Draft, command: Command, words: Words) -> list[tuple[Word, int]]:
    found: list[tuple[Word, int]] = []
    for placed in words.axes:
        word = placed.word
        if word.letter in INCREMENTAL_LETTERS:
            name = "G1030" if command.spec is None else command.spec.name
            draft.faults.add(
                "MC112",
                f"{name} does not take {word.letter}: a speed or torque is no increment",
                draft.span(word),
                f"write {'XYZ'[word.axis]}",
            )
        elif word.axis >= 0 and draft.usable_axis(word.axis, word) is not None:
            draft.commanded.lose((word.axis,))
            draft.commanded.stale.update(draft.setup.tools_of[word.axis])
            if word.value == word.value:
                found.append((word, word.axis))
    draft.claim((index for _, index in found), command, {index: word for word, index in found})
    return found


def _words(targets: list[Target]) -> dict[int, Word]:
    return {target.axis.index: target.word for target in targets}
