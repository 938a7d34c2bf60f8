"""Compute ends of axis words: zero, increments, rotation, scaling, polar coordinates (D-62, D-94 to D-96)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import msgspec

from mcserver.gcode.profiles.directions import cosine_and_sine
from mcserver.gcode.profiles.transformation import Transformation
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_units import axis_scale, length_scale
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.gcode.text.words import INCREMENTAL_LETTERS, Word
from mcserver.machine.sections import Rollover
from mcserver.units import TURN

# rounding error of an axis that stays, after rotating there and back [m]
_SAME_PLACE = 1e-12
# distance from the origin below which a point has no angle [m]
_ORIGIN = 1e-9
# an axis this close to the angle does not turn, and to half a turn has two equal ways [rad]
_EQUAL = 1e-9


class WordValue(NamedTuple):
    """The number of an axis word, with its units and distance mode."""

    value: float
    inch: bool
    incremental: bool


def given_by(block: BlockState, words: Mapping[int, ProfileWord]) -> dict[int, WordValue]:
    """Return an action's words by axis, with the modes in force."""
    modal = block.modal
    return {
        axis: WordValue(word.value, modal.inch, modal.incremental or word.letter in INCREMENTAL_LETTERS)
        for axis, word in words.items()
    }


def absolute_end(block: BlockState, axis: int, written: float) -> float:
    """Return the end of an axis by an absolute word, in the zero in force [m or rad]."""
    shift, rollover = block.modal.shift, _rollover(block, axis)
    if rollover is None:
        # keep -0
        return written if shift is None else written + shift.get(axis, 0.0)
    zero = 0.0 if shift is None else shift.get(axis, 0.0)
    return rolled_over(rollover, written, zero, block.commanded.positions[axis])


def stored_end(block: BlockState, axis: int, stored: float) -> float:
    """Return the end of an axis at a stored machine position; whole turns are not undone [m or rad]."""
    if _rollover(block, axis) is not None:
        return rolled_over("shortest", stored, 0.0, block.commanded.positions[axis])
    return stored


def rolled_over(rollover: Rollover, written: float, zero: float, start: float) -> float:
    """Return the position for an absolute word [rad].

    Fanuc's rotary axis roll-over turns the shorter way, for half a turn forwards. Its rotary axis control,
    and LinuxCNC's wrapped rotary axis, take the sign as direction: C-90 turns backwards to 90 degrees.

    Args:
        written: of the word. zero: of the program, as an axis position. start: the axis's position [rad].
    """
    signed = rollover == "sign"
    end = zero + (abs(written) if signed else written)
    way = math.remainder(end - start, TURN)
    if abs(way) <= _EQUAL:
        return start
    if signed:
        backwards = math.copysign(1.0, written) < 0.0
        turns = -1 if backwards and way > 0.0 else int(not backwards and way < 0.0)
    else:
        turns = int(way <= _EQUAL - TURN / 2.0)
    # add whole turns to the word, so that the angle is exactly the written one
    return end + TURN * (round((start + way - end) / TURN) + turns)


def axis_values(block: BlockState, action: Action) -> dict[int, float]:
    """Return an action's axis words by axis [m or rad], without faulty ones, which are reported."""
    found: dict[int, float] = {}
    for word in action.axes:
        axis = block.setup.axes.get(word.axis)
        if axis is None:
            block.refuse_missing_axis(word.axis, word)
        elif word.axis in found:
            block.refuse_twice(word)
        else:
            found[word.axis] = word.value * axis_scale(axis.type, block.modal.inch)
    return found


def _rollover(block: BlockState, axis: int) -> Rollover | None:
    return block.setup.axes[axis].rollover if block.modal.rollover else None


def ends_of(
    block: BlockState, given: Mapping[int, WordValue], source: Word | Action
) -> dict[int, float] | None:
    """Return the ends of a move's words [m or rad]: named axes first, then those moved by a rotation.

    None after MC186 or MC188; the axes then count as at their programmed ends.
    """
    modal, at = block.modal, block.commanded.positions
    found, shift = modal.transformation, modal.shift
    extruder = None if modal.flow == 1.0 else block.setup.machine.dialect.extruder
    ends: dict[int, float] = {}
    for axis, each in given.items():
        ends[axis] = each.value * axis_scale(block.setup.axes[axis].type, each.inch)
        if axis == extruder:
            ends[axis] *= modal.flow
        if each.incremental:
            ends[axis] += at[axis]
        else:
            ends[axis] = absolute_end(block, axis, ends[axis])
    if found is None:
        return ends
    zero = shift or {}
    settled = _settled(block, found, given, source)
    own = found.coupled(frozenset(given)) & (found.axes | found.unsettled)
    if settled is None or not own:
        return ends if settled is not None else None
    block.transformation = settled
    inside = found.axes & own
    if not inside:
        return ends
    words = {axis: each for axis, each in given.items() if axis in inside}
    places = found.undone({axis: at[axis] - zero.get(axis, 0.0) for axis in inside})
    polar = found.polar
    if polar is not None and inside.intersection(polar.plane):
        reached = _polar(block, found, words, source)
        if reached is None:
            return None
        places.update(reached)
        words = {axis: each for axis, each in words.items() if axis not in polar.plane}
    for axis, each in words.items():
        places[axis] = each.value * length_scale(each.inch) + (places[axis] if each.incremental else 0.0)
    for axis, place in found.applied(places).items():
        end = place + zero.get(axis, 0.0)
        ends[axis] = at[axis] if abs(end - at[axis]) < _SAME_PLACE else end
    return ends


def _settled(
    block: BlockState, found: Transformation, given: Mapping[int, WordValue], source: Word | Action
) -> Transformation | None:
    """Return the transformation after the words; None after a fault: controllers would differ in the end."""
    needed = found.coupled(frozenset(given))
    absolute = {axis for axis, each in given.items() if not each.incremental}
    open_axes = needed & found.unsettled - absolute
    if open_axes:
        missing = " and ".join("XYZ"[axis] for axis in sorted(needed & found.unsettled))
        block.faults.add(
            "MC186",
            "controllers differ in where this goes: the first move behind G68, G69, G51, G50, G16 or G53 "
            "has to say where it ends",
            block.span(source),
            f"write {missing} under G90",
        )
        return None
    return msgspec.structs.replace(found, unsettled=found.unsettled - needed)


def _polar(
    block: BlockState, found: Transformation, words: Mapping[int, WordValue], source: Word | Action
) -> dict[int, float] | None:
    """Return the coordinates of radius and angle [m], which are stored for words that omit one."""
    polar = found.polar
    assert polar is not None
    first, second = polar.plane
    radius, degrees = polar.radius, polar.degrees
    counts_on = second not in words or any(word.incremental for word in words.values())
    if polar.of_line and counts_on and radius is not None and radius <= _ORIGIN:
        block.faults.add(
            "MC188",
            "the axes are at the origin, where no angle is known",
            block.span(source),
            "write @ and ^ under G90",
        )
        return None
    if first in words:
        word = words[first]
        radius = word.value * length_scale(word.inch)
        if polar.of_line:
            radius += (polar.radius or 0.0) if word.incremental else 0.0
        elif word.incremental or radius < 0.0:
            block.faults.add(
                "MC188",
                f"{'XYZ'[first]} is the radius under G16: it is above 0, and no increment",
                block.span(source),
                "write it under G90",
            )
            return None
    if second in words:
        word = words[second]
        degrees = word.value + (degrees or 0.0 if word.incremental else 0.0)
    if radius is None or degrees is None:
        # both were missing, and are set after the fault of an earlier line
        return None
    kept = msgspec.structs.replace(polar, radius=radius, degrees=degrees)
    block.transformation = msgspec.structs.replace(block.transformation, polar=kept)
    cosine, sine = cosine_and_sine(degrees)
    return {first: radius * cosine, second: radius * sine}
