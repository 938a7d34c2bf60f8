"""Read G68.2, which tilts the plane of a program, and G53.1, which turns the tool to it (D-111)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import msgspec
import numpy as np
from mckinematics.errors import KinematicsError
from mckinematics.pose import Array

from mcserver.gcode.profiles.directions import (
    OFF_SQUARE,
    UNTURNED,
    Directions,
    Vector,
    about,
    along,
    by_euler_angles,
    by_roll_pitch_yaw,
    by_three_points,
    by_two_vectors,
    product,
)
from mcserver.gcode.profiles.frame import Facing, Frame, PlaneLine, TiltedPlane
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_units import length_scale
from mcserver.gcode.semantics.tip_moves import leading_tool, tip_frame
from mcserver.gcode.semantics.tool_directions import turns_along
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.motion.canonical import (
    Canonical,
    FeedGroup,
    Group,
    MotionLine,
    ProbeLine,
    RapidGroup,
    ThreadLine,
)

# of each P the words of its lines: of P2 and P3 by Q
_EULER, _ROLL_PITCH_YAW, _POINTS, _VECTORS = range(4)
_WORDS: Mapping[int, Mapping[int, str]] = MappingProxyType(
    {
        _EULER: {0: "XYZIJK"},
        _ROLL_PITCH_YAW: {0: "XYZIJK"},
        _POINTS: dict.fromkeys(range(4), "XYZ"),
        _VECTORS: {1: "XYZIJK", 2: "IJK"},
    }
)
_NOUNS: Mapping[int, str] = MappingProxyType(
    {
        _EULER: "the origin X Y Z and the Euler angles I J K",
        _ROLL_PITCH_YAW: "the origin X Y Z and the angles I J K about X, Y and Z",
        _POINTS: "a point X Y Z",
        _VECTORS: "in Q1 the origin X Y Z and where X points I J K, in Q2 where Z points I J K",
    }
)
_EXAMPLES: Mapping[int, str] = MappingProxyType(
    {
        _EULER: "such as G68.2 X0 Y0 Z0 I30 J45 K0; angles of 0 are written, too",
        _ROLL_PITCH_YAW: "such as G68.2 P1 Q123 X0 Y0 Z0 I30 J45 K0; angles of 0 are written, too",
        _POINTS: "such as G68.2 P2 Q1 X0 Y0 Z0, G68.2 P2 Q2 X40 Y0 Z9 and G68.2 P2 Q3 X0 Y30 Z5",
        _VECTORS: "such as G68.2 P3 Q1 X0 Y0 Z0 I1 J0 K1 and G68.2 P3 Q2 I-1 J0 K1",
    }
)
_ORDERS = frozenset({123, 132, 213, 231, 312, 321})


class _Refusal(Exception):
    """Why a line of G68.2 is not read, and what to write; carries a code where it is not MC175."""

    def __init__(self, message: str, hint: str, code: str = "MC175") -> None:
        super().__init__(message)
        self.message, self.hint, self.code = message, hint, code


class _OutOfOrder(_Refusal):
    """A line of a plane by points or vectors is not the next one."""


def tilt(block: BlockState, action: Action) -> None:
    """Put a plane in force by angles, points or vectors; nothing moves until G53.1 has turned the tool."""
    try:
        line, order = _read(block, action)
        before = () if block.frame.plane is None else block.frame.plane.lines
        origin, directions = _plane_of((*before, line), order)
    except _Refusal as refusal:
        if not (block.commanded.plane_lost and isinstance(refusal, _OutOfOrder)):
            block.faults.add(refusal.code, refusal.message, action.span, refusal.hint)
        return
    tool = leading_tool(block, action)
    if tool is not None:
        open_lines = (*before, line) if directions is None else ()
        block.commanded.plane_lost = False
        _put(block, TiltedPlane(tool, origin, directions or UNTURNED, lines=open_lines))


def _read(block: BlockState, action: Action) -> tuple[PlaneLine, tuple[int, ...]]:
    """Return a line of G68.2, and the axes of P1 in the order of its turns.

    Raises:
        _Refusal: it does not go here, or its words are not those of its P.
    """
    found, plane = block.transformation, block.frame.plane
    before = () if plane is None else plane.lines
    given = {word.letter: word for word in (*action.words.values(), *action.axes) if word.letter not in "ST"}
    if found.changed or (found.tilted and not before):
        hint = f"end that by {found.enders} first"
        raise _Refusal(f"G68.2 does not go together with {found.names}", hint, "MC185")
    parts = {letter: given.pop(letter) for letter in "PQR" if letter in given}
    form = _whole(parts.get("P"), 0)
    if form not in _WORDS:
        hint = "let the post write Euler angles (P0), turns about X Y Z (P1), points (P2) or vectors (P3)"
        raise _Refusal(f"G68.2 P{parts['P'].text} is not read", hint)
    if block.modal.incremental:
        raise _Refusal("under G91 controllers read the origin of G68.2 differently", "write G90 ahead")
    several = form in (_POINTS, _VECTORS)
    number = _whole(parts.get("Q"), -1 if several else 123)
    if before or several:
        _check_sequence(before, form, number)
    elif form == _EULER and "Q" in parts:
        raise _Refusal(
            "G68.2 P0 takes no Q: it is Z, the X that results, and the Z that results", _EXAMPLES[form]
        )
    elif form == _ROLL_PITCH_YAW and number not in _ORDERS:
        raise _Refusal(f"Q{parts['Q'].text} is no order of X, Y and Z", "write one, such as Q123")
    turn = parts.get("R") if form == _POINTS else None
    needed = _WORDS[form][number if several else 0]
    strays = given.keys() - set(needed) or (parts.keys() & {"R"} and turn is None)
    if strays or set(needed) - given.keys() or len(action.axes) != needed.count("X") * 3:
        raise _Refusal(f"G68.2 P{form} takes {_NOUNS[form]}, each once, and nothing else", _EXAMPLES[form])
    if turn is not None and any(each.turn is not None for each in before):
        raise _Refusal("R has been given already", "write it in one of the lines of the plane")
    scale = length_scale(block.modal.inch)
    x, y, z, i, j, k = (given[letter].value if letter in given else 0.0 for letter in "XYZIJK")
    point = (x * scale, y * scale, z * scale)
    line = PlaneLine(form, number, point, (i, j, k), None if turn is None else turn.value)
    return line, tuple(int(digit) - 1 for digit in str(number)) if form == _ROLL_PITCH_YAW else ()


def _whole(word: ProfileWord | None, default: int) -> int:
    """Return a number that is whole; -1 of another one."""
    if word is None:
        return default
    return int(word.value) if word.value == int(word.value) else -1


def _check_sequence(before: Sequence[PlaneLine], form: int, number: int) -> None:
    """Refuse a line of a plane by points or vectors that is not the next one."""
    if before and before[0].form != form:
        raise _Refusal(_incomplete(before), "write its other lines, or G69")
    expected = {before[-1].number + 1} if before else {0, 1} if form == _POINTS else {1}
    if number not in expected:
        shown = " or ".join(f"Q{each}" for each in sorted(expected))
        raise _OutOfOrder(f"here G68.2 P{form} needs {shown}", _EXAMPLES[form])


def _incomplete(lines: Sequence[PlaneLine]) -> str:
    return f"G68.2 P{lines[0].form} is not complete: Q{lines[-1].number + 1} is missing"


def _plane_of(lines: Sequence[PlaneLine], order: Sequence[int]) -> tuple[Vector, Directions | None]:
    """Return origin [m] and directions of a plane; no directions as long as lines are missing.

    Raises:
        _Refusal: they give none.
    """
    last = lines[-1]
    if last.form == _EULER:
        return last.point, by_euler_angles(*last.vector)
    if last.form == _ROLL_PITCH_YAW:
        return last.point, by_roll_pitch_yaw(last.vector, order)
    if last.number < max(_WORDS[last.form]):
        return last.point, None
    if last.form == _VECTORS:
        found = by_two_vectors(lines[0].vector, last.vector)
        if found is None:
            what = f"the two vectors are off a right angle by {OFF_SQUARE:g} degrees or more, or one is 0"
            raise _Refusal(what, "Q1 is where X of the plane points, Q2 where its Z does")
        return lines[0].point, found
    first, second, third = lines[-3:]
    found = by_three_points(first.point, second.point, third.point)
    if found is None:
        raise _Refusal("the three points lie on one line", "Q1 and Q2 give X of the plane, Q3 lies beside it")
    turn = next((each.turn for each in lines if each.turn is not None), None)
    found = found if turn is None else product(found, about(2, turn)) or found
    # Q0 is where the origin is on the plane, seen from the first point (Fanuc)
    shift = along(found, dict(enumerate(lines[0].point))) if lines[0].number == 0 else {}
    x, y, z = (each + shift.get(axis, 0.0) for axis, each in enumerate(first.point))
    return (x, y, z), found


def face(block: BlockState, action: Action) -> dict[int, float]:
    """Return where G53.1 turns the rotary axes, by number [rad]; none after a fault (MC175, MC176)."""
    frame, setup = block.frame, block.setup
    plane = frame.plane
    if plane is None and block.commanded.plane_lost:
        return {}
    if plane is None or action.axes or action.words.keys() - {"S", "T"}:
        what = "G53.1 takes no words" if plane is not None else "no G68.2 gives a plane for G53.1"
        block.faults.add("MC175", what, action.span, "write G68.2 X… Y… Z… I… J… K…, and G53.1 behind it")
        return {}
    if plane.lines:
        block.faults.add("MC175", _incomplete(plane.lines), action.span, "write it ahead of G53.1")
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
    block.commanded.plane_lost = False
    if block.frame.plane is not None:
        _put(block, None)


def lose_plane(block: BlockState, codes: frozenset[str]) -> None:
    """Continue a check without the plane of a line with G68.2 or G53.1 that has a fault."""
    if "G68.2" in codes or block.frame.plane is not None:
        end_plane(block)
        block.commanded.plane_lost = True


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
