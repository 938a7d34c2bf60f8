"""Read G68.2, which tilts the plane of a program, and G53.1, which turns the tool to it (D-111)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import msgspec
import numpy as np
from mckinematics.errors import KinematicsError
from mckinematics.pose import Array

from mcserver.gcode.profiles.directions import UNTURNED, Directions, by_euler_angles, product
from mcserver.gcode.profiles.frame import Facing, Frame, TiltedPlane
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_units import length_scale
from mcserver.gcode.semantics.tip_moves import leading_tool, tip_frame
from mcserver.gcode.semantics.tool_directions import turns_along
from mcserver.gcode.text.profile_words import Action
from mcserver.motion.canonical import (
    Canonical,
    FeedGroup,
    Group,
    MotionLine,
    ProbeLine,
    RapidGroup,
    ThreadLine,
)

_WORDS = "XYZIJK"


def tilt(block: BlockState, action: Action) -> None:
    """Put a plane in force by its origin and Euler angles; nothing moves until G53.1 has turned the tool."""
    found = block.transformation
    given = {word.letter: word for word in (*action.words.values(), *action.axes)}
    form = given.pop("P", None)
    what = hint = ""
    if found.changed or found.tilted:
        block.faults.add(
            "MC185",
            f"G68.2 does not go together with {found.names}",
            action.span,
            f"end that by {found.enders} first",
        )
        return
    if form is not None and form.value != 0.0:
        what, hint = f"G68.2 P{form.text} is not read", "let the post write Euler angles: G68.2 X Y Z I J K"
    elif block.modal.incremental:
        what, hint = "under G91 controllers read the origin of G68.2 differently", "write G90 ahead"
    elif sorted(letter for letter in given if letter not in "ST") != sorted(_WORDS) or len(action.axes) != 3:
        what = "G68.2 takes the origin X Y Z and the Euler angles I J K, each once, and nothing else"
        hint = "such as G68.2 X0 Y0 Z0 I30 J45 K0; angles of 0 are written, too"
    tool = None if what else leading_tool(block, action)
    if what:
        block.faults.add("MC175", what, action.span, hint)
    if tool is None:
        return
    x, y, z = (given[letter].value * length_scale(block.modal.inch) for letter in "XYZ")
    directions = by_euler_angles(*(given[letter].value for letter in "IJK"))
    _put(block, TiltedPlane(tool, (x, y, z), directions))


def face(block: BlockState, action: Action) -> dict[int, float]:
    """Return where G53.1 turns the rotary axes, by number [rad]; none after a fault (MC175, MC176)."""
    frame, setup = block.frame, block.setup
    plane = frame.plane
    if plane is None or action.axes or action.words.keys() - {"S", "T"}:
        what = "G53.1 takes no words" if plane is not None else "no G68.2 gives a plane for G53.1"
        block.faults.add("MC175", what, action.span, "write G68.2 X… Y… Z… I… J… K…, and G53.1 behind it")
        return {}
    assert setup.kinematics is not None
    flat = msgspec.structs.replace(frame, plane=None, tip_tool=plane.tool, tool_length=0.0)
    try:
        upright = tip_frame(setup, flat)
        axes = upright.turning
        near = np.array([block.commanded.positions[axis] for axis in axes])
        directions = np.array(product(flat.directions, plane.directions))
        turns = turns_along(upright.control, upright.across @ directions[:, 2], near)
        tilted = tip_frame(setup, flat, turns=turns)
    except KinematicsError as error:
        block.faults.add("MC176", f"G53.1: {error.message}", action.span, error.hint, axis=error.axis)
        return {}
    back = tilted.across.T
    x, y, z = (back @ (upright.base - tilted.base)).tolist()
    found = dict(zip(axes, turns.tolist(), strict=True))
    facing = Facing(found, _directions(back @ upright.across), (x, y, z))
    _put(block, msgspec.structs.replace(plane, facing=facing))
    return found


def end_plane(block: BlockState) -> None:
    """Carry out G69: the axes stay where they are."""
    if block.frame.plane is not None:
        _put(block, None)


def check_plane(
    block: BlockState, before: Frame | None, values: Iterable[Canonical], groups: Sequence[Group]
) -> None:
    """Report a motion ahead of G53.1, or with the tool not on the plane any more (MC175)."""
    plane = block.frame.plane
    lines = list(values)
    own = [*groups, *(group for each in lines if isinstance(each, MotionLine) for group in each.groups)]
    moves = any(isinstance(group, FeedGroup | RapidGroup) for group in own)
    if plane is None or not (moves or any(isinstance(each, ProbeLine | ThreadLine) for each in lines)):
        return
    whole = (1, len(block.parsed.text) + 1)
    if plane.facing is None:
        what = "the tool does not stand on the tilted plane yet"
        block.faults.add("MC175", what, whole, "write G53.1 behind G68.2, and rotary axes ahead of it")
        return
    known = before is not None and before.plane == plane
    for axis, turn in plane.facing.turns.items():
        if known and abs(block.commanded.positions[axis] - turn) > block.setup.axes[axis].in_position:
            what = f"axis {axis} is not where G53.1 has turned it, or would leave it"
            block.faults.add("MC175", what, whole, "write G53.1 again, or end the plane by G69", axis=axis)


def _put(block: BlockState, plane: TiltedPlane | None) -> None:
    block.frame = msgspec.structs.replace(block.frame, plane=plane)
    found = block.transformation
    block.transformation = msgspec.structs.replace(found, unsettled=found.unsettled | {0, 1, 2})


def _directions(matrix: Array) -> Directions:
    """Return the nearest rotation, free of what rounding has left."""
    left, _, right = np.linalg.svd(matrix)
    x, y, z = ((row[0], row[1], row[2]) for row in (left @ right).tolist())
    return product((x, y, z), UNTURNED) or UNTURNED
