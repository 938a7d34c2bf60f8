"""Interpret G00-G03, G1020, G1030 and G1040 on directly named axes (D-20 to D-26)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from mcserver.gcode.profiles.directions import along, back
from mcserver.gcode.semantics.arc_geometry import plane_extrema
from mcserver.gcode.semantics.arc_plane import PLANES
from mcserver.gcode.semantics.arcs import find_arc, find_plane
from mcserver.gcode.semantics.axis_words import Target, Words, resolve_targets
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.feed_time import FeedBasis, FeedMove, feed_basis, profile_feed_basis
from mcserver.gcode.semantics.program_units import motor_speed
from mcserver.gcode.semantics.rapids import rapid_group
from mcserver.gcode.semantics.travel_limits import check_speed, check_travel
from mcserver.gcode.text.syntax import Command
from mcserver.gcode.text.words import INCREMENTAL_LETTERS, Word
from mcserver.motion.canonical import FeedGroup, RapidGroup, SpeedGroup, TorqueGroup
from mcserver.motion.geometry.curves import ArcCurve, LineCurve
from mcserver.motion.geometry.turned_arc import TurnedArc
from mcserver.units import AxisType


def rapid(block: BlockState, command: Command, words: Words, *, wait: bool) -> FeedGroup | RapidGroup | None:
    """Interpret G00 (waited for) or G1020: each axis moves to its target independently."""
    targets = resolve_targets(block, words.axes)
    for target in targets:
        start = block.commanded.positions[target.axis.index]
        low, high = min(start, target.end), max(start, target.end)
        check_travel(block, target.axis, start, low, high, target.end, target.word)
    block.claim((target.axis.index for target in targets), command, _words(targets))
    starts = {target.axis.index: block.commanded.start(target.axis.index) for target in targets}
    for target in targets:
        block.end_at(target.axis.index, target.end)
        if not wait:
            block.commanded.send_to(target.axis.index, target.end)
    if not targets:
        return None
    ends = {target.axis.index: target.end for target in targets}
    if wait:
        # an offset path, and directions not along axes, need a straight line
        straight = block.compensation is not None or block.transformation.directions is not None
        return rapid_group(block.setup, block.modal, starts, ends, straight=straight)
    return RapidGroup(tuple(ends), tuple(ends.values()), wait, block.modal.carried)


def follow_paths(block: BlockState, targets: list[Target]) -> bool:
    """Check that no axis in a coordinated motion has a drive that makes its own profile."""
    profiled = [target for target in targets if target.axis.profiled]
    for target in profiled:
        block.faults.add(
            "MC138",
            f"axis {target.axis.index} follows no path: its drive goes to points on profiles of its own",
            block.span(target.word),
            'move it by G00 or G1020 (mode = "pp" in the machine file)',
            axis=target.axis.index,
        )
    return not profiled


def line(block: BlockState, command: Command, words: Words) -> FeedMove | None:
    """Interpret G01: all axes share one path parameter (D-21)."""
    targets = resolve_targets(block, words.axes)
    starts = [block.commanded.start(target.axis.index) for target in targets]
    for target, start in zip(targets, starts, strict=True):
        begin = target.end if target.axis.index in block.commanded.guessed else start
        low, high = min(begin, target.end), max(begin, target.end)
        check_travel(block, target.axis, begin, low, high, target.end, target.word)
    block.claim((target.axis.index for target in targets), command, _words(targets))
    for target in targets:
        block.end_at(target.axis.index, target.end)
    if not targets or not follow_paths(block, targets):
        return None
    linear = [
        target.end - start
        for target, start in zip(targets, starts, strict=True)
        if target.axis.type is AxisType.LINEAR
    ]
    travel = math.hypot(*linear)
    if block.setup.machine.dialect.reference:
        measure = feed_basis(len(linear), len(targets) - len(linear))
        length = abs(targets[0].end - starts[0]) if measure is FeedBasis.TURN else travel
    else:
        measure, length = profile_feed_basis(
            [target.axis.type for target in targets],
            [target.axis.index for target in targets],
            [target.end - start for target, start in zip(targets, starts, strict=True)],
        )
        travel = length if measure is FeedBasis.PATH else 0.0
    block.feed_length += travel
    curve = LineCurve(
        axes=tuple(target.axis.index for target in targets),
        start=tuple(starts),
        end=tuple(target.end for target in targets),
        length=length,
    )
    return FeedMove(command, curve, measure, block.modal.inverse_time, block.modal.feed)


def arc(block: BlockState, command: Command, words: Words) -> FeedMove | None:
    """Interpret G02 and G03: a plane's two axes; further axes in proportion to the angle (D-22, D-23)."""
    if block.transformation.unsettled.intersection(PLANES[block.modal.plane or 17]):
        block.faults.add(
            "MC186",
            "controllers differ in where this arc starts",
            block.span(command),
            "write a G0 or G1 under G90 with both axes of the plane before it",
        )
    targets = resolve_targets(block, words.axes)
    by_axis = {target.axis.index: target for target in targets}
    found = _arc(block, command, words, targets, by_axis)
    for target in targets:
        block.end_at(target.axis.index, target.end)
    return found


def _arc(
    block: BlockState, command: Command, words: Words, targets: list[Target], by_axis: dict[int, Target]
) -> FeedMove | None:
    block.claim(by_axis, command, _words(targets))
    rotary = [target for target in targets if target.axis.type is not AxisType.LINEAR]
    for target in rotary:
        block.faults.add(
            "MC137",
            f"axis {target.axis.index} is rotary; an arc moves linear axes",
            block.span(target.word),
            "choose a tool by T, or move the axis by a G01 of its own in the same line",
            axis=target.axis.index,
        )
    plane = find_plane(block, command, words)
    if plane is None or not _plane_axes(block, command, plane, by_axis):
        return None
    # a rotated plane moves the third axis too
    further = {*(target.axis.index for target in targets), *block.transformation.coupled(frozenset(plane))}
    axes = (*plane, *sorted(further.difference(plane)))
    block.claim(plane, command, _words(targets))
    if not follow_paths(block, targets):
        return None
    if rotary or len(targets) < len(words.axes) or block.commanded.guessed.intersection(axes):
        return None
    starts = {axis: block.commanded.start(axis) for axis in axes}
    ends = {axis: by_axis[axis].end if axis in by_axis else starts[axis] for axis in axes}
    curve = _arc_curve(block, command, words, axes, starts, ends)
    if curve is None:
        return None
    _check_arc_travel(block, command, curve, by_axis)
    for axis in plane:
        block.end_at(axis, ends[axis])
    block.feed_length += curve.length
    measure = feed_basis(len(axes), 0) if block.setup.machine.dialect.reference else FeedBasis.PATH
    return FeedMove(command, curve, measure, block.modal.inverse_time, block.modal.feed)


def _arc_curve(
    block: BlockState,
    command: Command,
    words: Words,
    axes: tuple[int, ...],
    starts: Mapping[int, float],
    ends: Mapping[int, float],
) -> ArcCurve | TurnedArc | None:
    """Return the arc between positions of ``axes`` [m], the plane's first; None after a fault."""
    plane, zero, directions = (axes[0], axes[1]), block.modal.shift or {}, block.transformation.directions
    begin, finish = (tuple(each[axis] for axis in axes) for each in (starts, ends))
    xyz = not block.setup.machine.dialect.reference
    if directions is None:
        shape = find_arc(block, command, words, plane, starts, ends, zero)
        return None if shape is None else shape.curve(axes, begin, finish, xyz=xyz)
    first, last = (
        back(directions, {axis: each[axis] - zero.get(axis, 0.0) for axis in axes}) for each in (starts, ends)
    )
    shape = find_arc(block, command, words, plane, first, last, {})
    if shape is None:
        return None
    if block.transformation.in_plane(plane):
        around = along(directions, dict(zip(plane, shape.centre, strict=True)))
        centre = around[axes[0]] + zero.get(axes[0], 0.0), around[axes[1]] + zero.get(axes[1], 0.0)
        sweep = -shape.sweep if block.transformation.reverses(plane) else shape.sweep
        return msgspec.structs.replace(shape, centre=centre, sweep=sweep).curve(axes, begin, finish, xyz=xyz)
    flat = shape.curve(axes, tuple(first[axis] for axis in axes), tuple(last[axis] for axis in axes), xyz=xyz)
    place = tuple(zero.get(axis, 0.0) for axis in axes)
    matrix = tuple(
        tuple(directions[row][column] if max(row, column) < 3 else float(row == column) for column in axes)
        for row in axes
    )
    return TurnedArc(axes, flat, matrix, place, begin, finish)


def _plane_axes(
    block: BlockState, command: Command, plane: tuple[int, int], by_axis: dict[int, Target]
) -> bool:
    """Return whether the plane's axes are usable and linear; report those without words that are not."""
    named = {item.axis for item in command.items if isinstance(item, Word)}
    usable = True
    for index in plane:
        if index in named:
            usable = usable and index in by_axis
            continue
        axis = block.usable_axis(index, command, along=True)
        if axis is not None and axis.type is not AxisType.LINEAR:
            block.faults.add(
                "MC137",
                f"the arc's plane needs axis {index}, which is rotary",
                block.span(command),
                "choose another plane by G17, G18 or G19, or a tool by T",
                axis=index,
            )
            axis = None
        usable = usable and axis is not None
    return usable


def _check_arc_travel(
    block: BlockState, command: Command, curve: ArcCurve | TurnedArc, by_axis: dict[int, Target]
) -> None:
    low, high = curve.bounds() if isinstance(curve, TurnedArc) else plane_extrema(curve)
    for column, index in enumerate(curve.axes):
        start, end = curve.start[column], curve.end[column]
        known = column < len(low)
        least, greatest = (low[column], high[column]) if known else (min(start, end), max(start, end))
        target = by_axis.get(index)
        source = command if target is None else target.word
        check_travel(block, block.setup.axes[index], start, least, greatest, end, source)


def transmit_speed(block: BlockState, command: Command, words: Words) -> SpeedGroup | None:
    """Interpret G1030: convert motor rpm to axis speeds (D-26)."""
    axes: list[int] = []
    speeds: list[float] = []
    for word, index in _transmitted(block, command, words):
        axis = block.setup.axes[index]
        speed = motor_speed(word.value, axis.travel_per_motor_turn)
        check_speed(block, axis, speed, f"{word.value:g} RPM drives axis {index}", word)
        axes.append(index)
        speeds.append(speed)
    return SpeedGroup(tuple(axes), tuple(speeds)) if axes else None


def transmit_torque(block: BlockState, command: Command, words: Words) -> TorqueGroup | None:
    """Interpret G1040: torques [N·m] (D-26)."""
    found = _transmitted(block, command, words)
    if not found:
        return None
    return TorqueGroup(tuple(index for _, index in found), tuple(word.value for word, _ in found))


def _transmitted(block: BlockState, command: Command, words: Words) -> list[tuple[Word, int]]:
    found: list[tuple[Word, int]] = []
    for entry in words.axes:
        word = entry.word
        if word.letter in INCREMENTAL_LETTERS:
            name = "G1030" if command.spec is None else command.spec.name
            block.faults.add(
                "MC112",
                f"{name} does not take {word.letter}: a speed or torque is no increment",
                block.span(word),
                f"write {'XYZ'[word.axis]}",
            )
        elif word.axis >= 0 and block.usable_axis(word.axis, word) is not None:
            block.commanded.invalidate((word.axis,))
            block.commanded.stale.update(block.setup.tools_of[word.axis])
            if word.value == word.value:
                found.append((word, word.axis))
    block.claim((index for _, index in found), command, {index: word for word, index in found})
    return found


def _words(targets: list[Target]) -> dict[int, Word]:
    return {target.axis.index: target.word for target in targets}
