"""Interpret G00-G03 with a tool in force: poses to joint paths (D-20, D-50 to D-53)."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from mckinematics.errors import KinematicsError
from mckinematics.pose import Array, Kinematics, Pose, ToolPath

from mcserver.gcode.semantics.arcs import find_arc, find_plane
from mcserver.gcode.semantics.axis_words import Words
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.feed_time import FeedBasis, FeedMove
from mcserver.gcode.semantics.program_units import length_scale
from mcserver.gcode.semantics.tip_lines import tip_line
from mcserver.gcode.semantics.tool_pose import commanded_pose, start_pose, with_words
from mcserver.gcode.text.profile_words import Action
from mcserver.gcode.text.syntax import Command
from mcserver.motion.canonical import RapidGroup
from mcserver.motion.geometry.curves import LineCurve, SampledCurve, TipLine
from mcserver.units import DEGREE, MM

NO_TRAVEL = 1e-9  # m; below it a move only turns


def tool_rapid(block: BlockState, command: Command, words: Words) -> RapidGroup | None:
    """Interpret G00: the target is solved, each joint goes by itself (D-20)."""
    found = _read_poses(block, command, words)
    if found is None:
        return None
    tool, kinematics, _, end = found
    chain = kinematics.axes(tool)
    block.claim(chain, command, {})
    try:
        joints = kinematics.solve_pose(tool, end, block.commanded.positions)
    except KinematicsError as error:
        report_unsolved(block, command, tool, error)
        return None
    _arrive(block, tool, end, tuple(joints))
    return RapidGroup(tuple(chain), tuple(joints), wait=True, carried=block.modal.carried)


def tool_feed_move(block: BlockState, command: Command, words: Words, number: int) -> FeedMove | None:
    """Interpret G01, G02 or G03 along the tool's path, which is solved as a whole (D-53)."""
    plane = None
    if number != 1:
        plane = find_plane(block, command, words)
    found = _read_poses(block, command, words)
    if found is None or (plane is None and number != 1):
        return None
    tool, kinematics, start, end = found
    if plane is not None:
        # an arc's endpoint word left out stays where the path starts (D-22)
        named = {entry.word.axis for entry in words.axes}
        stay = {index: start.position[index] for index in range(3) if index not in named}
        end = with_words(end, stay)
    block.claim(kinematics.axes(tool), command, {})
    try:
        path = tool_curve(block, command, words, plane, start, end)
        if path is None:
            return None
        position, derivative, travel = path
        oriented = kinematics.has_orientation(tool)
        turn = kinematics.rotation_angle(tool, start.angles, end.angles) if oriented else 0.0
        measure = FeedBasis.TURN if travel <= NO_TRAVEL and turn > 0.0 else FeedBasis.PATH
        angles = (start.angles, end.angles) if oriented else (None, None)
        tool_path = ToolPath(position, derivative, *angles)
        length = turn if measure is FeedBasis.TURN else travel
        rounded = block.path_tolerance > 0.0
        line = _line(block, tool, start, end, travel) if rounded and number == 1 else None
        curve = line or _curve(block, tool, tool_path, length)
    except KinematicsError as error:
        report_unsolved(block, command, tool, error)
        _recover(block, tool, end)
        return None
    block.feed_length += travel
    _arrive(block, tool, end, tuple(curve.ends()[1].tolist()))
    return FeedMove(command, curve, measure, block.modal.inverse_time, block.modal.feed)


def _line(block: BlockState, tool: int, start: Pose, end: Pose, travel: float) -> TipLine | None:
    """Return a straight line of the joints that keeps the tool within tolerance, or None."""
    kinematics = block.setup.kinematics
    assert kinematics is not None
    if travel <= NO_TRAVEL:
        return None
    angles = np.array((start.angles, end.angles)) if kinematics.has_orientation(tool) else None
    points = np.array((start.position, end.position))
    found = kinematics.solve_even_paths(tool, points, angles, block.commanded.path_starts())
    rates = partial(kinematics.jacobians, tool)
    return tip_line(block, kinematics.axes(tool), found, kinematics.tolerances(tool), travel, rates)


def _curve(block: BlockState, tool: int, path: ToolPath, length: float) -> SampledCurve:
    """Return the joints' path as a spline; raises `KinematicsError`."""
    kinematics = block.setup.kinematics
    assert kinematics is not None
    found = kinematics.solve_path(tool, path, block.commanded.path_starts())
    return SampledCurve(
        axes=tuple(found.axes),
        knots=found.knots,
        coefficients=found.coefficients,
        length=length,
        tool_rates=partial(kinematics.jacobians, tool) if block.path_tolerance > 0.0 else None,
    )


Found = tuple[int, Kinematics, Pose, Pose]


def _read_poses(block: BlockState, command: Command, words: Words) -> Found | None:
    """Return tool, kinematics, start pose and end pose; None after a fault or from a guessed position."""
    setup = block.setup
    tool = block.modal.tool
    kinematics = setup.kinematics
    refused = refuse_indices(block, words)
    if tool is None or kinematics is None or tool not in setup.chains:
        return None
    usable = True
    for axis in setup.chains[tool]:
        usable = block.usable_axis(axis, command, along=True) is not None and usable
    if not kinematics.has_orientation(tool):
        for entry in words.axes:
            if entry.word.axis > 2:
                usable = False
                block.faults.add(
                    "MC311",
                    f"T{tool} takes no orientation, so {entry.word.name} has no meaning",
                    block.span(entry.word),
                    "leave A B C out, or set orientation = true for the tool in the machine file",
                    tool=tool,
                )
    try:
        pose = commanded_pose(kinematics, tool, setup.machine, block.commanded)
        start = start_pose(kinematics, tool, block.commanded, pose)
    except KinematicsError as error:
        report_unsolved(block, command, tool, error)
        return None
    values: dict[int, float] = {}
    for entry in words.axes:
        word = entry.word
        if word.value != word.value:
            usable = False
        elif 0 <= word.axis <= 5:
            value = word.value * length_scale(entry.inch) if word.axis <= 2 else word.value * DEGREE
            if entry.incremental:
                value += pose.position[word.axis] if word.axis <= 2 else pose.angles[word.axis - 3]
            values[word.axis] = value
    if refused or not usable or not block.commanded.guessed.isdisjoint(setup.chains[tool]):
        return None
    return tool, kinematics, start, with_words(pose, values)


def refuse_indices(block: BlockState, words: Words) -> bool:
    """Report each ``[n]`` word while a tool is in force (D-52); return True if there is one."""
    found = False
    for entry in words.axes:
        if entry.word.letter == "[":
            found = True
            block.faults.add(
                "MC312",
                f"{entry.word.name} names an axis, but a tool is in force and moves its own axes",
                block.span(entry.word),
                "write G1050 before the command that moves axes directly",
                tool=block.modal.tool,
            )
    return found


Callables = tuple[Callable[[Array], Array], Callable[[Array], Array], float]


def tool_curve(
    block: BlockState, command: Command, words: Words, plane: tuple[int, int] | None, start: Pose, end: Pose
) -> Callables | None:
    """Return position and derivative in X Y Z over s, and the path's length [m]; None after a fault."""
    first, last = start.position, end.position
    if plane is None:
        travel = math.dist(first, last)
        line = LineCurve((0, 1, 2), first, last, travel)
        return line.position, lambda s: line.derivatives(s)[0], travel
    shape = find_arc(block, command, words, plane, first, last, block.modal.shift or {})
    if shape is None:
        return None
    order = (*plane, 3 - plane[0] - plane[1])
    arc = shape.curve(
        order, tuple(first[column] for column in order), tuple(last[column] for column in order)
    )
    columns = [order.index(column) for column in range(3)]
    return lambda s: arc.position(s)[:, columns], lambda s: arc.derivatives(s)[0][:, columns], arc.length


def _arrive(block: BlockState, tool: int, end: Pose, joints: tuple[float, ...]) -> None:
    for axis, position in zip(block.setup.chains[tool], joints, strict=True):
        block.end_at(axis, position)
    block.commanded.poses[tool] = end
    block.commanded.stale.discard(tool)


def _recover(block: BlockState, tool: int, end: Pose) -> None:
    """Go on from the end of an unsolved path if it can be reached, else stay at its start."""
    kinematics = block.setup.kinematics
    assert kinematics is not None
    try:
        joints = kinematics.solve_pose(tool, end, block.commanded.positions)
    except KinematicsError:
        return
    _arrive(block, tool, end, tuple(joints))


def report_unsolved(block: BlockState, command: Command | Action, tool: int, error: KinematicsError) -> None:
    """Report why a path of a tool has no solution."""
    block.faults.add(
        error.code,
        error.message,
        block.span(command),
        error.hint,
        axis=error.axis,
        tool=tool if error.tool is None else error.tool,
        residual_mm=None if error.residual is None else error.residual / MM,
    )
