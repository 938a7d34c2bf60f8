"""Convert the words of G02 and G03 to an arc in its plane, with the faults of D-22; for axes and tools."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec

from mcserver.gcode.profiles.transformation import Transformation
from mcserver.gcode.semantics.arc_geometry import (
    Arc,
    ChordTooLong,
    Point,
    RadiusMismatch,
    SamePoint,
    ZeroRadius,
    arc_by_centre,
    arc_by_radius,
)
from mcserver.gcode.semantics.arc_plane import OFFSET_LETTERS, PLANES, NoPlane, choose_plane
from mcserver.gcode.semantics.axis_words import Words
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_units import length_scale, shown_length, shown_number
from mcserver.gcode.text.syntax import Command


def find_plane(block: BlockState, command: Command, words: Words) -> tuple[int, int] | None:
    """Return the two coordinates of the arc's plane; None after a reported fault."""
    if words.radius is not None and words.offsets:
        block.faults.add(
            "MC130",
            "R and I J K stand together: the centre would be given twice",
            block.span(words.radius.word),
            "keep R, or the offsets",
        )
        return None
    if words.radius is None and not words.offsets:
        block.faults.add(
            "MC130",
            "the arc has neither R nor I J K",
            block.span(command),
            "give the radius by R or the centre by I J K",
        )
        return None
    endpoint = frozenset(entry.word.axis for entry in words.axes if 0 <= entry.word.axis <= 2)
    try:
        plane = choose_plane(block.modal.plane, frozenset(words.offsets), endpoint)
    except NoPlane as fault:
        block.faults.add("MC132", fault.message, block.span(command), fault.hint)
        return None
    # RS-274 posts write I, J and K in every plane: a 0 does not count
    idle = block.setup.machine.dialect.profile != "reference"
    outside = [
        offset
        for coordinate, offset in words.offsets.items()
        if coordinate not in PLANES[plane] and not (idle and offset.word.value == 0.0)
    ]
    for offset in outside:
        names = " and ".join(OFFSET_LETTERS[coordinate] for coordinate in sorted(PLANES[plane]))
        block.faults.add(
            "MC131",
            f"{offset.word.shown} lies outside the plane G{plane} of the arc",
            block.span(offset.word),
            f"the offsets of G{plane} are {names}",
        )
    return None if outside else PLANES[plane]


def read_turns(block: BlockState, words: Words) -> int | None:
    """Return P as a count, 1 by default; None after a fault: P is fractional or below 1."""
    word = words.turns
    if word is None:
        return 1
    if word.value != word.value:
        return None
    if word.value < 1.0 or word.value != int(word.value):
        block.faults.add(
            "MC136",
            f"{word.shown} is not a number of turns: it is whole and at least 1",
            block.span(word),
            "P1 is the plain arc; each further P is one more full turn",
        )
        return None
    return int(word.value)


def find_arc(
    block: BlockState,
    command: Command,
    words: Words,
    plane: tuple[int, int],
    start: Sequence[float] | Mapping[int, float],
    end: Sequence[float] | Mapping[int, float],
    zero: Mapping[int, float],
) -> Arc | None:
    """Compute the arc in ``plane``; None after a fault.

    Args:
        start, end: positions by coordinate 0 1 2 [m]. zero: of the program in these coordinates [m].
    """
    bent = _transformed(block, command, words, plane)
    if bent is None:
        return None
    clockwise = (command_number(block, command) == 2) != bent.mirrors(plane)
    turns = read_turns(block, words)
    if turns is None:
        return None
    first, second = plane
    begin = (start[first], start[second])
    finish = (end[first], end[second])
    inch = block.modal.inch
    if words.radius is not None:
        word = words.radius.word
        if word.value != word.value:
            return None
        factor = abs(bent.factors(plane)[0])
        radius = word.value * length_scale(words.radius.inch) * factor
        try:
            return _noticed(
                block,
                command,
                arc_by_radius(begin, finish, radius, clockwise, turns, block.arc_tolerance),
                begin,
                finish,
            )
        except ZeroRadius:
            block.faults.add("MC135", f"{word.shown} is a radius of zero", block.span(word))
        except SamePoint:
            block.faults.add(
                "MC134",
                "the arc ends where it starts, so R does not say where its centre lies",
                block.span(word),
                "for a full circle give the centre by I J K",
            )
        except ChordTooLong as fault:
            scale = length_scale(words.radius.inch) * factor
            # round up, so that the radius in the hint is long enough
            least = math.ceil(fault.chord / 2.0 / scale * 1000.0 - 1e-6) / 1000.0
            shown = shown_number(least)
            sign = "-" if radius < 0.0 else ""
            block.faults.add(
                "MC104",
                f"the chord is {shown_length(fault.chord, inch)}, so R must be at least "
                f"{shown_length(least * scale, inch)}",
                block.span(word),
                f"use R{sign}{shown}, or give the centre with {_letters(plane)}",
            )
        return None
    if block.modal.absolute_centres and not words.offsets.keys() >= set(plane):
        block.faults.add(
            "MC130",
            f"under G90.1 the centre is a position: it needs {_letters(plane)}",
            block.span(command),
            "give both, or write G91.1",
        )
        return None
    across = [0.0, 0.0]
    for coordinate, offset in words.offsets.items():
        if offset.word.value != offset.word.value:
            return None
        if coordinate in plane:
            across[plane.index(coordinate)] = offset.word.value * length_scale(offset.inch)
    ahead = bent.vector(plane, *across)
    centre = (begin[0] + ahead[0], begin[1] + ahead[1])
    if block.modal.absolute_centres:
        centre = _from_zero(bent, plane, zero, ahead)
    try:
        shape = arc_by_centre(begin, finish, centre, clockwise, turns, block.arc_tolerance)
        return _noticed(block, command, shape, begin, finish)
    except ZeroRadius:
        offsets = list(words.offsets.values())
        block.faults.add(
            "MC135",
            "the centre lies on the start or the end of the arc",
            block.parsed.span(offsets[0].word.index, max(offset.word.index for offset in offsets)),
            _meaning(block),
        )
    except RadiusMismatch as fault:
        allowed = block.arc_tolerance.at(fault.start_radius)
        # only the profile cnc has G90.1
        positions = block.setup.machine.dialect.profile == "cnc"
        other = _from_zero(bent, plane, zero, ahead) if positions else centre
        radius = math.dist(other, begin)
        fits = abs(radius - math.dist(other, finish)) <= block.arc_tolerance.at(radius)
        block.faults.add(
            "MC133",
            f"the start lies {shown_length(fault.start_radius, inch)} from the centre and the end "
            f"{shown_length(fault.end_radius, inch)}; they may differ by {shown_length(allowed, inch)}",
            block.span(command),
            f"{_meaning(block)}; "
            + ("as positions they fit: is G90.1 missing?" if fits else "check them and the endpoint"),
        )
    return None


def _meaning(block: BlockState) -> str:
    """Return what I J K of an arc are."""
    if block.modal.absolute_centres:
        return "under G90.1 I J K are the centre's position"
    return "I J K are increments from the start point, absolute mode or not"


def _from_zero(
    bent: Transformation, plane: tuple[int, int], zero: Mapping[int, float], ahead: Sequence[float]
) -> Point:
    """Return the place that lies ``ahead`` of the program's zero [m]."""
    origin = msgspec.structs.replace(bent, directions=None).applied(dict.fromkeys(plane, 0.0))
    first, second = (
        zero.get(axis, 0.0) + origin[axis] + each for axis, each in zip(plane, ahead, strict=True)
    )
    return first, second


def _transformed(
    block: BlockState, command: Command, words: Words, plane: tuple[int, int]
) -> Transformation | None:
    """Return the transformation of an arc; None after a fault: it would be no arc, or an ambiguous one."""
    found = block.transformation
    what = hint = ""
    if not found.keeps_circles(plane):
        what = f"the factors of {found.names} would make an ellipse of this arc"
        hint = "give both axes of the plane one factor, or let the CAM scale the part"
    elif found.polar is not None and words.offsets and not found.polar.of_line:
        what, hint = "an arc under G16 has R, not I J K", "give the radius by R"
    if what:
        block.faults.add("MC188", what, block.span(command), hint)
        return None
    return found


def _noticed(block: BlockState, command: Command, shape: Arc, start: Point, end: Point) -> Arc:
    """Warn of an arc that is nearly closed but ends elsewhere (D-22)."""
    if shape.nearly_closed(start, end):
        apart = math.hypot(end[0] - start[0], end[1] - start[1])
        block.faults.add(
            "MC139",
            f"the arc goes {math.degrees(abs(shape.sweep)):.3f}° round, between points that lie "
            f"{shown_length(apart, block.modal.inch)} apart",
            block.span(command),
            "is G03 meant where G02 stands, or the other way round? A short arc with a rounded end looks so",
            severity="warning",
        )
    return shape


def command_number(block: BlockState, command: Command) -> int:
    """Return 0-3: the command's own code, or the one that it repeats (D-03)."""
    if command.spec is not None:
        return command.spec.number
    return 0 if block.modal.motion is None else block.modal.motion


def _letters(plane: tuple[int, int]) -> str:
    return " and ".join(OFFSET_LETTERS[coordinate] for coordinate in sorted(plane))
