"""G00-G03 with a tool in force: poses in, joint paths out (D-20, D-50 to D-53)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from mckinematics.errors import KinematicsError
from mckinematics.pose import Array, Kinematics, Pose, ToolPath

from mcserver.gcode.semantics.arcs import find_arc, find_plane
from mcserver.gcode.semantics.axis_words import Words
from mcserver.gcode.semantics.block_state import Draft
from mcserver.gcode.semantics.feed_time import FeedMove, Measure
from mcserver.gcode.semantics.program_units import angle, length_scale, millimetres
from mcserver.gcode.semantics.tool_pose import commanded_pose, start_pose, with_words
from mcserver.gcode.text.syntax import Command
from mcserver.motion.canonical import RapidGroup
from mcserver.motion.geometry.curves import LineCurve, SampledCurve

NO_TRAVEL = 1e-9  # m; below it a move only turns


def tool_rapid(draft: Draft, command: Command, words: Words) -> RapidGroup | None:
    """G00: the target is solved, the joints go by themselves (D-20)."""
    found = _read_poses(draft, command, words)
    if found is None:
        return None
    tool, kinematics, _, end = found
    chain = kinematics.axes(tool)
    draft.claim(chain, command, {})
    try:
        joints = kinematics.solve_pose(tool, end, draft.commanded.positions)
    except KinematicsError as error:
        _report(draft, command, tool, error)
        return None
    _arrive(draft, tool, end, tuple(joints))
    return RapidGroup(tuple(chain), tuple(joints), wait=True)


def tool_feed_move(draft: Draft, command: Command, words: Words, number: int) -> FeedMove | None:
    """G01, G02 or G03 along the tool's path; the whole of it is solved here (D-53)."""
    plane = None
    if number != 1:
        plane = find_plane(draft, command, words)
    found = _read_poses(draft, command, words)
    if found is None or (plane is None and number != 1):
        return None
    tool, kinematics, start, end = found
    if plane is not None:
        # an arc's endpoint word left out stays where the path starts (D-22)
        named = {placed.word.axis for placed in words.axes}
        stay = {index: start.position[index] for index in range(3) if index not in named}
        end = with_words(end, stay)
    draft.claim(kinematics.axes(tool), command, {})
    try:
        path = _tool_curve(draft, command, words, plane, start, end)
        if path is None:
            return None
        position, derivative, travel = path
        oriented = kinematics.has_orientation(tool)
        turn = kinematics.rotation_angle(tool, start.angles, end.angles) if oriented else 0.0
        measure = Measure.TURN if travel <= NO_TRAVEL and turn > 0.0 else Measure.PATH
        joint_path = kinematics.solve_path(
            tool,
            ToolPath(
                position=position,
                derivative=derivative,
                start_angles=start.angles if oriented else None,
                end_angles=end.angles if oriented else None,
            ),
            draft.commanded.path_starts(),
        )
    except KinematicsError as error:
        _report(draft, command, tool, error)
        _recover(draft, tool, end)
        return None
    curve = SampledCurve(
        axes=tuple(joint_path.axes),
        knots=joint_path.knots,
        coefficients=joint_path.coefficients,
        length=turn if measure is Measure.TURN else travel,
    )
    draft.feed_length += travel
    _arrive(draft, tool, end, tuple(float(value) for value in curve.position(np.array([1.0]))[0]))
    return FeedMove(command, curve, measure, draft.modal.inverse_time, draft.modal.feed)


Found = tuple[int, Kinematics, Pose, Pose]


def _read_poses(draft: Draft, command: Command, words: Words) -> Found | None:
    """Tool, kinematics, start pose and end pose; None where a fault or a guess forbids it."""
    setup = draft.setup
    tool = draft.modal.tool
    kinematics = setup.kinematics
    refused = refuse_indices(draft, words)
    if tool is None or kinematics is None or tool not in setup.chains:
        return None
    usable = True
    for axis in setup.chains[tool]:
        usable = draft.usable_axis(axis, command) is not None and usable
    if not kinematics.has_orientation(tool):
        for placed in words.axes:
            if placed.word.axis > 2:
                usable = False
                draft.faults.add(
                    "MC311",
                    f"T{tool} takes no orientation, so {placed.word.name} has no meaning",
                    draft.span(placed.word),
                    "leave A B C out, or set orientation = true for the tool in the machine file",
                    tool=tool,
                )
    euler = next((entry.euler for entry in setup.machine.tools if entry.number == tool), "ZYX")
    try:
        pose = commanded_pose(kinematics, tool, euler, draft.commanded)
        start = start_pose(kinematics, tool, draft.commanded, pose)
    except KinematicsError as error:
        _report(draft, command, tool, error)
        return None
    values: dict[int, float] = {}
    for placed in words.axes:
        word = placed.word
        if word.value != word.value:
            usable = False
        elif 0 <= word.axis <= 5:
            value = word.value * length_scale(placed.inch) if word.axis <= 2 else angle(word.value)
            if placed.incremental:
                value += pose.position[word.axis] if word.axis <= 2 else pose.angles[word.axis - 3]
            values[word.axis] = value
    if refused or not usable or not draft.commanded.assumed.isdisjoint(setup.chains[tool]):
        return None
    return tool, kinematics, start, with_words(pose, values)


def refuse_indices(draft: Draft, words: Words) -> bool:
    """A fault for each ``[n]`` word while a tool is in force (D-52)."""
    found = False
    for placed in words.axes:
        if placed.word.letter == "[":
            found = True
            draft.faults.add(
                "MC312",
                f"{placed.word.name} names an axis, but a tool is in force and moves its own axes",
                draft.span(placed.word),
                "write G1050 before the command that moves axes directly",
                tool=draft.modal.tool,
            )
    return found


Callables = tuple[Callable[[Array], Array], Callable[[Array], Array], float]


def _tool_curve(
    draft: Draft, command: Command, words: Words, plane: tuple[int, int] | None, start: Pose, end: Pose
) -> Callables | None:
    """Position and derivative in X Y Z over s, and the length of the tool's path [m]."""
    first, last = start.position, end.position
    if plane is None:
        travel = math.dist(first, last)
        line = LineCurve((0, 1, 2), first, last, travel)
        return line.position, lambda s: line.derivatives(s)[0], travel
    shape = find_arc(draft, command, words, plane, first, last)
    if shape is None:
        return None
    order = (*plane, 3 - plane[0] - plane[1])
    arc = shape.curve(
        order, tuple(first[column] for column in order), tuple(last[column] for column in order)
    )
    columns = [order.index(column) for column in range(3)]
    return lambda s: arc.position(s)[:, columns], lambda s: arc.derivatives(s)[0][:, columns], arc.length


def _arrive(draft: Draft, tool: int, end: Pose, joints: tuple[float, ...]) -> None:
    for axis, position in zip(draft.setup.chains[tool], joints, strict=True):
        draft.end_at(axis, position)
    draft.commanded.poses[tool] = end
    draft.commanded.stale.discard(tool)


def _recover(draft: Draft, tool: int, end: Pose) -> None:
    """After a path that could not be solved: goes on from its end if that can be reached, else stays."""
    kinematics = draft.setup.kinematics
    assert kinematics is not None
    try:
        joints = kinematics.solve_pose(tool, end, draft.commanded.positions)
    except KinematicsError:
        return
    _arrive(draft, tool, end, tuple(joints))


def _report(draft: Draft, command: Command, tool: int, error: KinematicsError) -> None:
    draft.faults.add(
        error.code,
        error.message,
        draft.span(command),
        error.hint,
        axis=error.axis,
        tool=tool if error.tool is None else error.tool,
        residual_mm=None if error.residual is None else millimetres(error.residual),
    )
