"""Cutter compensation: offset the cutter's centre from the path: G40, G41, G42, G41.1, G42.1 (D-85).

Each move in the plane is held back until the next one is known, since their corner decides where it ends.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec

from mcserver.gcode.profiles.codes import TAKES_AXES
from mcserver.gcode.semantics.arc_geometry import Arc, Point
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.compensation_state import Compensation, HeldMove
from mcserver.gcode.semantics.modal import ModalState
from mcserver.gcode.semantics.offset_path import ONE_PLACE, Piece, meet, piece_of, turn_between
from mcserver.gcode.semantics.program_units import shown_length
from mcserver.gcode.semantics.rapids import NO_TIME, straight_speed
from mcserver.gcode.semantics.travel_limits import ROUNDING, travel_of
from mcserver.motion.canonical import (
    Canonical,
    DwellGroup,
    EndLine,
    FeedGroup,
    Group,
    MotionLine,
    OutputLine,
    PauseLine,
    RapidGroup,
)
from mcserver.motion.geometry.curves import ArcCurve, LineCurve
from mcserver.units import TURN

# corners below this angle get no arc and cut nothing off (LinuxCNC's TOLERANCE_CONCAVE_CORNER) [rad]
FLAT_CORNER = 0.05
# most values between two moves in the plane
MOST_BEHIND = 1000
# actions whose words would be read relative to the programmed path
_REFUSED = TAKES_AXES | {"M6", "M66"}


def compensate(
    block: BlockState, before: ModalState, starts: Mapping[int, float], values: list[Canonical]
) -> list[Canonical]:
    """Return a line's values under compensation: offset moves, delayed by one move.

    Args:
        block: after its line; this sets its compensation to that after the line.
        before, starts: modal state and path starts by axis [m or rad] before the line.
        values: of the line without compensation.
    """
    compensation = block.compensation
    assert compensation is not None
    if block.faulty or not _is_allowed(block, before, values):
        released = release(compensation)
        block.compensation = msgspec.structs.replace(compensation, held=None, place=None, lost=True)
        return [*released, *values]
    stage = _Stage(block, compensation, starts)
    for value in values:
        stage.take(value)
    block.compensation = stage.state
    return stage.out


def release(compensation: Compensation | None) -> list[Canonical]:
    """Return the held move, ended without a corner, and the values after it."""
    if compensation is None or compensation.held is None:
        return []
    held = compensation.held
    return [*_laid_out(held.line, compensation.plane, held.piece, held.begin), *held.behind]


def _is_allowed(block: BlockState, before: ModalState, values: Sequence[Canonical]) -> bool:
    """Report what conflicts with compensation (MC170); return whether nothing does."""
    compensation, profile = block.compensation, block.parsed.profile
    assert compensation is not None
    off = "write it behind G40 and the straight move that leads out"
    what = ""
    if profile is not None:
        code = next((each.code for each in profile.actions if each.code in _REFUSED), "")
        what = "G53" if profile.machine_frame else code
    ended = any(isinstance(value, EndLine) for value in values)
    if not what and not ended and block.modal.shift != before.shift:
        what = "another zero"
    elif not what and not ended and not block.transformation.like(before.transformation):
        what = "another rotation or scaling"
    elif not what and not ended and block.modal.plane != before.plane:
        what = "another plane"
    elif not what and block.drilling and any(isinstance(value, MotionLine) for value in values):
        what = "a canned cycle"
    if not what and any(isinstance(value, PauseLine) for value in values):
        # jogging during a pause would move the axes away from the start of the held move
        what = "a pause"
    kept = (MotionLine, OutputLine, EndLine)
    if not what and not all(isinstance(value, kept) for value in values):
        what = "what this line does"
    if what:
        _refuse(
            block, f"{what} does not go together with cutter compensation (line {compensation.line})", off
        )
    return not what


def _refuse(block: BlockState, message: str, hint: str, code: str = "MC170") -> None:
    block.faults.add(code, message, (1, len(block.parsed.text) + 1), hint)


class _Stage:
    """Applies compensation to the values of one line."""

    def __init__(self, block: BlockState, compensation: Compensation, starts: Mapping[int, float]) -> None:
        self._block = block
        self._starts = starts
        self.state: Compensation | None = compensation
        self.out: list[Canonical] = []
        if compensation.side == 0 and compensation.held is not None:
            # the lead-out begins at the end of the last move, without a corner
            self.out += release(compensation)
            self.state = msgspec.structs.replace(compensation, held=None, place=compensation.held.piece.end)

    def take(self, value: Canonical) -> None:
        """Process one value of the line."""
        state = self.state
        if state is None:
            self.out.append(value)
        elif isinstance(value, EndLine):
            self.out += [*release(state), value]
            self.state = None
        elif not isinstance(value, MotionLine):
            self._put(value)
        else:
            self._split(value, state)

    def _put(self, value: Canonical) -> None:
        """Add a value after the held move."""
        state = self.state
        if state is None or state.held is None:
            self.out.append(value)
            return
        behind = (*state.held.behind, value)
        if len(behind) > MOST_BEHIND:
            _refuse(
                self._block,
                f"more than {MOST_BEHIND} lines stand between two moves under cutter compensation",
                "write G40 before them",
            )
            return
        self.state = msgspec.structs.replace(state, held=msgspec.structs.replace(state.held, behind=behind))

    def _split(self, value: MotionLine, state: Compensation) -> None:
        """Separate a line's move in the plane from its other groups."""
        plane = set(state.plane)
        beside: list[Group] = []
        curves: list[FeedGroup] = []
        for group in value.groups:
            if isinstance(group, DwellGroup) or not plane.intersection(group.axes):
                beside.append(group)
            elif isinstance(group, FeedGroup) and len(group.curves) == 1:
                curves.append(group)
            elif isinstance(group, RapidGroup) and group.wait and self._stands(group, plane):
                beside += _without(group, plane)
            else:
                _refuse(self._block, "the line moves axes of the plane by themselves", "write G1 or G0")
        if len(curves) > 1:
            _refuse(self._block, "the line moves the plane's axes twice", "write one G1 or G0")
        if beside:
            self._put(
                msgspec.structs.replace(
                    value, groups=tuple(beside), feed_length=0.0 if curves else value.feed_length
                )
            )
        for group in curves[:1]:
            self._move(msgspec.structs.replace(value, groups=(group,)), group, state)

    def _stands(self, group: RapidGroup, plane: set[int]) -> bool:
        """Return whether a rapid leaves the plane's axes in place."""
        ends = zip(group.axes, group.targets, strict=True)
        return all(abs(end - self._starts[axis]) <= ONE_PLACE for axis, end in ends if axis in plane)

    def _move(self, value: MotionLine, group: FeedGroup, state: Compensation) -> None:
        """Process a line with one curve that has axes of the plane."""
        curve = group.curves[0]
        if not isinstance(curve, LineCurve | ArcCurve):
            _refuse(self._block, "a curve of other planes has no cutter compensation", "write G40 before it")
            return
        # an axis that the line does not name keeps its position
        starts = {**self._starts, **dict(zip(curve.axes, curve.start, strict=True))}
        ends = {**starts, **dict(zip(curve.axes, curve.end, strict=True))}
        first, second = state.plane
        start, end = (starts[first], starts[second]), (ends[first], ends[second])
        if not isinstance(curve, ArcCurve) and math.dist(start, end) <= ONE_PLACE:
            for rest in _without_plane(value, group, curve, state.plane):
                self._put(rest)
            return
        if group.duration is not None:
            _refuse(self._block, "G93 does not go together with cutter compensation", "write G94 and F")
            return
        path = piece_of(curve, start, end)
        if state.side == 0:
            self._lead_out(value, path, state)
        elif state.held is None and not state.lost:
            self._lead_in(value, path, state)
        else:
            self._follow(value, path, state)

    def _lead_out(self, value: MotionLine, path: Piece, state: Compensation) -> None:
        if path.centre is not None:
            _refuse(
                self._block,
                "an arc does not lead out of cutter compensation",
                "write G1 or G0 behind G40 first",
            )
            return
        begin = state.place or path.start
        laid = self._paced(value, state.plane, path, begin)
        self.out += _laid_out(laid, state.plane, path, begin)
        self.state = None

    def _lead_in(self, value: MotionLine, path: Piece, state: Compensation) -> None:
        """Move from the programmed path to the offset point square to the end of the first move."""
        begin = state.place or path.start
        length = math.dist(begin, path.end)
        if length <= state.radius:
            inch = self._block.modal.inch
            _refuse(
                self._block,
                f"the move that leads into cutter compensation is {shown_length(length, inch)} long, "
                f"no longer than the cutter's radius of {shown_length(state.radius, inch)}",
                "begin farther away, or take a smaller cutter",
            )
            return
        whole = self._beside(path, state)
        if whole is None:
            return
        if path.centre is not None:
            entry = _entry_arc(whole, begin)
            if entry is None:
                self._gouge(state, "the arc does not lead in: its start lies across its end")
                return
            whole = entry
        self._hold(value, whole, whole, begin, state)

    def _follow(self, value: MotionLine, path: Piece, state: Compensation) -> None:
        """Round the corner after the held move, which ends it, and hold this move."""
        whole = self._beside(path, state)
        if whole is None:
            return
        held = state.held
        if held is None:
            self._hold(value, whole, whole, whole.start, state)
            return
        beta = (-state.side * turn_between(held.piece, whole)) % TURN
        beta = beta if beta <= 0.75 * TURN else beta - TURN
        joint = _joint(held.piece, whole, path.start, beta, state.side)
        if joint is None:
            self._gouge(state, f"it does not fit between line {held.line.line} and this line")
            return
        before, begin = joint
        ended = held.piece.trimmed(end=before)
        if ended.goes_back(held.whole, held.begin):
            self._gouge(state, f"nothing is left of line {held.line.line}")
            return
        piece = whole.trimmed(start=begin)
        if piece.goes_back(whole, begin):
            self._gouge(state, "nothing is left of this line")
            return
        self.out += [*_laid_out(held.line, state.plane, ended, held.begin), *held.behind]
        if before != begin:
            corner = Piece(before, begin, centre=path.start, sweep=-state.side * beta)
            self._check_travel(corner)
            arc = self._paced(_around(value, state.plane), state.plane, corner, before)
            self.out += _laid_out(arc, state.plane, corner, before)
        self._hold(value, whole, piece, begin, state)

    def _beside(self, path: Piece, state: Compensation) -> Piece | None:
        whole = path.offset(state.side * state.radius)
        if whole is None:
            assert path.centre is not None
            radius = shown_length(math.dist(path.centre, path.end), self._block.modal.inch)
            self._gouge(state, f"the arc's radius is {radius}")
        return whole

    def _hold(self, value: MotionLine, whole: Piece, piece: Piece, begin: Point, state: Compensation) -> None:
        self._check_travel(piece)
        held = HeldMove(self._paced(value, state.plane, piece, begin), whole, piece, begin)
        self.state = msgspec.structs.replace(state, held=held, place=None, lost=False)

    def _paced(self, line: MotionLine, plane: tuple[int, int], piece: Piece, begin: Point) -> MotionLine:
        """Return the line along another path; a rapid at the speed that its slowest axis allows there."""
        (laid,) = _laid_out(line, plane, piece, begin) or [line]
        assert isinstance(laid, MotionLine)
        group = laid.groups[0]
        assert isinstance(group, FeedGroup)
        if group.requested == NO_TIME:
            pace = straight_speed(self._block.setup, group.curves[0])
            laid = msgspec.structs.replace(laid, groups=(msgspec.structs.replace(group, speed=pace),))
        return laid

    def _gouge(self, state: Compensation, where: str) -> None:
        shown = shown_length(2.0 * state.radius, self._block.modal.inch)
        _refuse(
            self._block,
            f"a cutter of {shown} would cut into the part: {where}",
            "take a smaller cutter, or round the part's corner by more than its radius",
            "MC169",
        )

    def _check_travel(self, piece: Piece) -> None:
        """Report an offset path that leaves an axis's travel (MC201)."""
        assert self.state is not None
        plane = self.state.plane
        path = _curve(plane, piece, piece.start, {}, {})
        low, high = path.bounds()
        for index, least, greatest in zip(plane, low, high, strict=True):
            axis = self._block.setup.axes[index]
            if any((fault.code, fault.axis) == ("MC201", index) for fault in self._block.faults.found):
                continue
            lowest, highest = travel_of(self._block, axis)
            if least < lowest - ROUNDING or greatest > highest + ROUNDING:
                self._block.faults.add(
                    "MC201",
                    f"beside the path the cutter's centre takes axis {index} beyond its travel",
                    (1, len(self._block.parsed.text) + 1),
                    "move the part, or take a smaller cutter",
                    axis=index,
                )


def _joint(before: Piece, after: Piece, corner: Point, beta: float, side: int) -> tuple[Point, Point] | None:
    """Return where the path before a corner ends and where that after it starts; None: they do not meet.

    Args:
        beta: angle by which the path turns away from the cutter [rad].
    """
    apart = math.dist(before.end, after.start)
    if apart <= ONE_PLACE:
        return before.end, before.end
    place = meet(before, after, corner)
    if abs(beta) <= FLAT_CORNER:
        # a tiny corner, also of rounded ends: neither an arc nor a gouge
        near = place is not None and math.dist(place, before.end) <= 2.0 * apart
        found = place if near and place is not None else before.end
        return found, found
    half = TURN / 2.0
    # after the far side of a half circle straight back: the paths intersect, no arc around the end
    back = beta > half - FLAT_CORNER and before.sweep * side < 0.0
    if beta < 0.0 or beta > half + FLAT_CORNER or back:
        return None if place is None else (place, place)
    return before.end, after.start


def _entry_arc(whole: Piece, begin: Point) -> Piece | None:
    """Return the arc from a point of the programmed path to the offset arc's end, tangential (LinuxCNC)."""
    assert whole.centre is not None
    chord = (begin[0] - whole.end[0], begin[1] - whole.end[1])
    inward = (whole.centre[0] - whole.end[0], whole.centre[1] - whole.end[1])
    along = (chord[0] * inward[0] + chord[1] * inward[1]) / math.hypot(*inward)
    if along < 1e-6 * math.hypot(*chord):
        return None
    share = math.hypot(*chord) ** 2 / (2.0 * along) / math.hypot(*inward)
    centre = (whole.end[0] + share * inward[0], whole.end[1] + share * inward[1])
    sign = math.copysign(1.0, whole.sweep)
    start = math.atan2(begin[1] - centre[1], begin[0] - centre[0])
    end = math.atan2(whole.end[1] - centre[1], whole.end[0] - centre[0])
    return Piece(begin, whole.end, centre=centre, sweep=sign * ((sign * (end - start)) % TURN))


def _without(group: RapidGroup, plane: set[int]) -> list[RapidGroup]:
    kept = [(axis, end) for axis, end in zip(group.axes, group.targets, strict=True) if axis not in plane]
    axes, ends = tuple(axis for axis, _ in kept), tuple(end for _, end in kept)
    return [msgspec.structs.replace(group, axes=axes, targets=ends)] if kept else []


def _without_plane(
    value: MotionLine, group: FeedGroup, curve: LineCurve, plane: tuple[int, int]
) -> list[MotionLine]:
    """Return a line without the plane's axes, which do not move in it; empty if nothing is left."""
    kept = [column for column, axis in enumerate(curve.axes) if axis not in plane]
    if not kept:
        return []
    axes = tuple(curve.axes[column] for column in kept)
    start, end = (tuple(each[column] for column in kept) for each in (curve.start, curve.end))
    rest = LineCurve(axes, start, end, curve.length)
    return [msgspec.structs.replace(value, groups=(msgspec.structs.replace(group, curves=(rest,)),))]


def _around(value: MotionLine, plane: tuple[int, int]) -> MotionLine:
    """Return a copy of a line with the plane's axes alone, to follow an arc around a corner."""
    group = value.groups[0]
    assert isinstance(group, FeedGroup)
    curve = LineCurve(plane, (0.0, 0.0), (0.0, 0.0))
    return msgspec.structs.replace(
        value, groups=(msgspec.structs.replace(group, curves=(curve,)),), exact_stop=False
    )


def _laid_out(line: MotionLine, plane: tuple[int, int], piece: Piece, begin: Point) -> list[Canonical]:
    """Return a programmed line along another path in the plane; empty if nothing of it is left."""
    group = line.groups[0]
    assert isinstance(group, FeedGroup)
    curve = group.curves[0]
    assert isinstance(curve, LineCurve | ArcCurve)
    further = {axis: place for axis, place in zip(curve.axes, curve.start, strict=True) if axis not in plane}
    ends = {axis: place for axis, place in zip(curve.axes, curve.end, strict=True) if axis not in plane}
    found = _curve(plane, piece, begin, further, ends)
    if found.length <= ONE_PLACE and further == ends:
        return []
    rapid = group.requested == NO_TIME
    assert group.speed is not None
    requested = NO_TIME if rapid else found.length / group.speed
    changed = msgspec.structs.replace(group, curves=(found,), requested=requested)
    return [msgspec.structs.replace(line, groups=(changed,), feed_length=0.0 if rapid else found.length)]


def _curve(
    plane: tuple[int, int],
    piece: Piece,
    begin: Point,
    starts: dict[int, float],
    ends: dict[int, float],
) -> LineCurve | ArcCurve:
    """Return a path in the plane, extended by further axes, as a curve."""
    axes = (*plane, *starts)
    start, end = (*begin, *starts.values()), (*piece.end, *ends.values())
    if piece.centre is not None:
        radii = math.dist(begin, piece.centre), math.dist(piece.end, piece.centre)
        arc = Arc(piece.centre, piece.sweep, math.fsum(radii) / 2.0, radii[1] - radii[0])
        # F counts X Y Z (D-66), here and below
        return arc.curve(axes, start, end, xyz=True)
    travel = [last - first for axis, first, last in zip(axes, start, end, strict=True) if axis <= 2]
    return LineCurve(axes, start, end, math.hypot(*travel))
