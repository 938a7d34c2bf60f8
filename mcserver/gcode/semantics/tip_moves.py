"""Interpret moves under tool centre point control: X Y Z are the tip's place on the work piece (D-86, D-140).

X Y Z are coordinates in the work piece's frame, which turns with its rotary axes. With the rotary axes at the
program's zero they are those of the axes X Y Z under G43. The rotary axes follow their own words under G43.4;
under G43.5 I J K give the tool's direction in the same frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec
import numpy as np
from mckinematics.errors import KinematicsError, ModelError
from mckinematics.pose import Array, Pose, Triple
from mckinematics.tip_control import Lead, TipControl

from mcserver.gcode.profiles.codes import COMPENSATING, TAKES_AXES
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.arcs import find_plane
from mcserver.gcode.semantics.axis_words import ModalWord, Words
from mcserver.gcode.semantics.block_state import BlockState, Setup
from mcserver.gcode.semantics.feed_time import FeedBasis, FeedMove
from mcserver.gcode.semantics.program_places import absolute_end
from mcserver.gcode.semantics.program_units import axis_scale
from mcserver.gcode.semantics.rapids import NO_TIME
from mcserver.gcode.semantics.tip_lines import tip_line
from mcserver.gcode.semantics.tool_directions import turns_along
from mcserver.gcode.semantics.tool_moves import NO_TRAVEL, report_unsolved, tool_curve
from mcserver.gcode.semantics.travel_limits import check_travel
from mcserver.gcode.text.profile_words import Action, ProfileWords
from mcserver.gcode.text.syntax import Command
from mcserver.motion.canonical import FeedGroup, RapidGroup
from mcserver.motion.geometry.curves import SampledCurve, TipLine
from mcserver.units import AxisType

# shorter vectors have no direction [1]
NO_DIRECTION = 1e-9
# axes X, Y and Z
_COORDINATES = (0, 1, 2)
_ENDS = np.array([0.0, 1.0])
# codes that read or set positions of axes, not of the tip
_REFUSED = TAKES_AXES | COMPENSATING.keys() | {"M6", "G16", "G92.1", "G92.2", "G92.3"}


class TipFrame(msgspec.Struct, frozen=True):
    """Coordinates of X Y Z under tip control: the tip is at base + across·(x, y, z) on the work piece.

    Attributes:
        control: of the tip. across: shape (3, 3), base: shape (3,) [m].
        columns: of the axes X Y Z in the chain.
    """

    control: TipControl
    across: Array
    base: Array
    columns: tuple[int, ...]

    @property
    def turning(self) -> tuple[int, ...]:
        """Numbers of the rotary axes, in the chain's order."""
        return tuple(self.control.tool.chain.axes[column] for column in self.control.turning)

    def coordinates(self, joints: Array) -> Triple:
        """Return the tip's position at joints (K,) of the chain, in coordinates of the axes [m]."""
        x, y, z = (self.control.tip(joints[None])[0] - self.base) @ self.across
        return float(x), float(y), float(z)

    def points(self, coordinates: Array) -> Array:
        """Return the places on the work piece at coordinates (n, 3) [m]."""
        return np.asarray(self.base + coordinates @ self.across.T)


def tip_frame(setup: Setup, frame: Frame, *, turns: Array | None = None) -> TipFrame:
    """Return the coordinates of a frame with G43.4 or G43.5 in force.

    Args:
        turns: positions of the rotary axes at which these are coordinates of the axes, shape (T,) [rad];
            None: the program's zero.

    Raises:
        KinematicsError: the tool does not allow tip control.
    """
    assert setup.kinematics is not None
    assert frame.tip_tool is not None
    control = setup.kinematics.tip_control(frame.tip_tool, frame.tool_length)
    axes = control.tool.chain.axes
    zero = frame.shift() or {}
    if turns is None:
        turns = np.array([zero.get(axes[column], 0.0) for column in control.turning])
    across, base = control.base(turns)
    sliding = [axes[column] for column in control.sliding]
    order = [sliding.index(axis) for axis in _COORDINATES]
    columns = tuple(int(control.sliding[place]) for place in order)
    return TipFrame(control, across[:, order], base, columns)


def tip_coordinates(setup: Setup, frame: Frame, positions: Mapping[int, float]) -> Triple:
    """Return the tip's coordinates at axis positions [m or rad], in [m]."""
    found = tip_frame(setup, frame)
    return found.coordinates(np.array([positions[axis] for axis in found.control.tool.chain.axes]))


def lead_by_tip(block: BlockState, action: Action) -> None:
    """Begin tool centre point control of the machine's tool that X Y Z and rotary axes move."""
    reason = ""
    if block.modal.tool is not None:
        reason = f"T{block.modal.tool} is in force"
    elif block.compensation is not None:
        reason = f"cutter compensation is on since line {block.compensation.line}"
    elif block.transformation.axes or block.transformation.tilted:
        reason = f"{block.transformation.names} is in force"
    if reason:
        block.faults.add("MC172", f"{action.code} while {reason}", action.span, "end that before it")
        return
    tool = leading_tool(block, action)
    if tool is not None:
        block.frame = msgspec.structs.replace(block.frame, tip_tool=tool, by_direction=action.code == "G43.5")


def leading_tool(block: BlockState, action: Action) -> int | None:
    """Return the machine's tool that X Y Z and rotary axes move; None after a fault (MC171, MC313)."""
    setup = block.setup
    if setup.kinematics is None and setup.machine.tools:
        block.faults.add(
            "MC313", f"{action.code} needs inverse kinematics, which is not installed", action.span,
            "pip install pin scipy",
        )  # fmt: skip
        return None
    fitting = [number for number, chain in setup.chains.items() if _leads(setup, chain)]
    if len(fitting) != 1:
        known = ", ".join(f"T{number}" for number in fitting)
        block.faults.add(
            "MC171",
            f"{action.code}: the machine {setup.machine.name} has "
            + (
                f"several tools that X Y Z and rotary axes move: {known}" if known else "no kinematics for it"
            ),
            action.span,
            "keep one of them in the machine file"
            if known
            else "give the machine file [kinematics] urdf and one [[tool]] whose axes lead from the work "
            "piece's frame (work) to the spindle: X Y Z and the rotary ones (docs/five-axis.md)",
        )
        return None
    try:
        tip_frame(setup, msgspec.structs.replace(block.frame, tip_tool=fitting[0]))
    except ModelError as error:
        block.faults.add("MC171", f"{action.code}: {error.message}", action.span, error.hint)
        return None
    return fitting[0]


def _leads(setup: Setup, chain: tuple[int, ...]) -> bool:
    linear = {axis for axis in chain if axis in setup.axes and setup.axes[axis].type is AxisType.LINEAR}
    return linear == set(_COORDINATES) and len(chain) > len(linear)


def refuse_beside_tip(block: BlockState, profile: ProfileWords) -> None:
    """Report what conflicts with tool centre point control (MC172)."""
    code = next((each.code for each in profile.actions if each.code in _REFUSED), "")
    what = "G53" if profile.machine_frame else code
    turned = block.transformation.axes or block.transformation.tilted
    what = what or (block.transformation.names if turned else "")
    if what:
        shown = "a canned cycle" if what == "REPEAT" else what
        block.faults.add(
            "MC172",
            f"{shown} does not go together with {block.frame.tip_code}",
            (1, len(block.parsed.text) + 1),
            "write it behind G49",
        )
    if what in COMPENSATING:
        # no further faults of later lines
        block.compensation = None


class _Way(msgspec.Struct, frozen=True):
    """A move of the tip as written.

    Attributes:
        travel: of the tip on the work piece [m]. turn: of the rotary axes together [rad].
    """

    control: TipControl
    lead: Lead
    travel: float
    turn: float

    @property
    def only_turns(self) -> bool:
        """Whether only rotary axes move, about a tip that stays on the work piece."""
        return self.travel <= NO_TRAVEL and self.turn > 0.0

    @property
    def length(self) -> float:
        """What F counts [m or rad] (D-86)."""
        return self.turn if self.only_turns else self.travel


def tip_rapid(block: BlockState, command: Command, words: Words) -> FeedGroup | RapidGroup | None:
    """Interpret G00: a straight line of the tip on the work piece, as fast as the slowest axis allows."""
    try:
        way = _way(block, command, words, 0)
        curve = None if way is None else _curve(way)
    except KinematicsError as error:
        report_unsolved(block, command, block.frame.tip_tool or 0, error)
        return None
    if curve is None:
        return None
    end = _arrive(block, curve.axes, curve.ends()[1])
    slopes = np.abs(curve.derivatives(curve.samples())[0]).max(axis=0)
    limits = np.array([block.setup.axes[axis].max_velocity for axis in curve.axes])
    least = float((slopes / limits).max())
    if least <= 0.0:
        return RapidGroup(curve.axes, end, True, block.modal.carried)
    return FeedGroup((curve,), NO_TIME, speed=curve.length / least, carried=block.modal.carried)


def tip_feed_move(block: BlockState, command: Command, words: Words, number: int) -> FeedMove | None:
    """Interpret G01, G02 or G03: a line or an arc of the tip on the work piece; F is its speed there.

    A line on which all joints may move evenly is a line for the planner too, so that chords can be smoothed.
    """
    try:
        way = _way(block, command, words, number)
        if way is None:
            return None
        line = _line(block, way) if number == 1 and not way.only_turns else None
        curve = line or msgspec.structs.replace(
            _curve(way), tool_rates=way.control.rates if block.path_tolerance > 0.0 else None
        )
    except KinematicsError as error:
        report_unsolved(block, command, block.frame.tip_tool or 0, error)
        return None
    _arrive(block, curve.axes, curve.ends()[1])
    block.feed_length += way.travel
    measure = FeedBasis.TURN if way.only_turns else FeedBasis.PATH
    return FeedMove(command, curve, measure, block.modal.inverse_time, block.modal.feed)


def _way(block: BlockState, command: Command, words: Words, number: int) -> _Way | None:
    """Read a move; None after a fault, or from a guessed position.

    Raises:
        KinematicsError: the tool does not allow tip control.
    """
    pointing: Mapping[int, ModalWord] = {}
    if block.frame.by_direction:
        # an arc then needs R for its centre
        words, pointing = msgspec.structs.replace(words, offsets={}), words.offsets
    plane = find_plane(block, command, words) if number > 1 else None
    frame = tip_frame(block.setup, block.frame)
    control = frame.control
    axes = control.tool.chain.axes
    base = np.array([block.commanded.positions[axis] for axis in axes])
    start = np.array([block.commanded.start(axis) for axis in axes])
    place = frame.coordinates(base)
    targets = _targets(block, words, frame, base, place)
    near = base[control.turning]
    turned = _turned(block, frame, pointing, near) if pointing else near
    usable = [block.usable_axis(axis, command) is not None for axis in axes]
    block.claim(axes, command, {})
    if targets is None or turned is None or not all(usable) or (plane is None and number > 1):
        return None
    if not block.commanded.guessed.isdisjoint(axes):
        return None
    first = frame.coordinates(start) if block.commanded.starts else place
    # an arc's omitted endpoint word stays at the path's start (D-22)
    stays = first if number > 1 else place
    x, y, z = (targets.get(index, stays[index]) for index in _COORDINATES)
    turns = np.array([targets.get(axis, turn) for axis, turn in zip(frame.turning, turned, strict=True)])
    path = tool_curve(block, command, words, plane, Pose(first), Pose((x, y, z)))
    if path is None:
        return None
    position, derivative, travel = path
    lead = Lead(lambda s: frame.points(position(s)), lambda s: derivative(s) @ frame.across.T, start, turns)
    return _Way(control, lead, travel, math.dist(turns, start[control.turning]))


def _curve(way: _Way) -> SampledCurve:
    """Return the joints' path as a spline; raises `KinematicsError`."""
    found = way.control.path(way.lead)
    return SampledCurve(found.axes, found.knots, found.coefficients, way.length)


def _line(block: BlockState, way: _Way) -> TipLine | None:
    """Return a straight line of the joints that keeps the tip within tolerance, or None."""
    control, lead = way.control, way.lead
    tool = control.tool
    turns = np.array((lead.start[control.turning], lead.turns))
    found = control.even_paths(lead.position(_ENDS), turns, lead.start)
    own = tool.tolerance, tool.tolerance_angle
    return tip_line(block, tool.chain.axes, found, own, way.travel, control.rates)


def _arrive(block: BlockState, axes: tuple[int, ...], joints: Array) -> tuple[float, ...]:
    end = tuple(joints.tolist())
    for axis, joint in zip(axes, end, strict=True):
        block.end_at(axis, joint)
    return end


def _targets(
    block: BlockState, words: Words, frame: TipFrame, base: Array, place: Triple
) -> dict[int, float] | None:
    """Return the ends that words give, of the tip in X Y Z and of rotary axes [m or rad]; None after a fault.

    Args:
        base, place: base of increments: the commanded joints, shape (K,), and the tip's coordinates [m].
    """
    chain = frame.control.tool.chain
    found: dict[int, float] = {}
    usable = True
    for entry in words.axes:
        word = entry.word
        axis = block.setup.axes.get(word.axis)
        by_index = word.letter == "[" and word.axis in _COORDINATES
        if axis is None or word.axis not in chain.axes or by_index:
            block.faults.add(
                "MC172",
                f"{word.name} does not name a coordinate of the tip, nor a rotary axis of its tool",
                block.span(word),
                f"under {block.frame.tip_code} X Y Z and the tool's rotary axes move; write the others "
                "behind G49",
            )
            usable = False
            continue
        if block.frame.by_direction and word.axis not in _COORDINATES:
            block.faults.add(
                "MC172",
                f"{word.name} moves a rotary axis, which follows the tool's direction under G43.5",
                block.span(word),
                "give the direction by I J K, or write rotary axes under G43.4",
                axis=word.axis,
            )
            usable = False
            continue
        if word.value != word.value:
            usable = False
            continue
        end = word.value * axis_scale(axis.type, entry.inch)
        column = chain.axes.index(word.axis)
        start = place[word.axis] if word.axis in _COORDINATES else float(base[column])
        end = end + start if entry.incremental else absolute_end(block, word.axis, end)
        if word.axis not in _COORDINATES:
            known = len(block.faults.found)
            check_travel(block, axis, start, min(start, end), max(start, end), end, word)
            usable = usable and len(block.faults.found) == known
        found[word.axis] = end
    return found if usable else None


def _turned(block: BlockState, frame: TipFrame, given: Mapping[int, ModalWord], near: Array) -> Array | None:
    """Return the rotary axes' positions for I J K, shape (T,) [rad]; None after a fault (MC176).

    I J K are the tool's direction at the end of the move, along X Y Z of the work piece's frame, of any
    length; omitted ones are 0 (Fanuc).

    Args:
        near: present positions of the rotary axes, shape (T,) [rad].
    """
    words = [given[index].word for index in sorted(given)]
    values = np.array([given[index].word.value if index in given else 0.0 for index in _COORDINATES])
    span = block.parsed.span(min(word.index for word in words), max(word.index for word in words))
    if np.isnan(values).any():
        return None
    if not np.linalg.norm(values) > NO_DIRECTION:
        shown = " ".join(word.shown for word in words)
        block.faults.add("MC176", f"{shown} is no direction", span, "give one, such as I0 J0 K1")
        return None
    try:
        return turns_along(frame.control, frame.across @ values, near)
    except KinematicsError as error:
        block.faults.add("MC176", f"G43.5: {error.message}", span, error.hint, axis=error.axis)
        return None
