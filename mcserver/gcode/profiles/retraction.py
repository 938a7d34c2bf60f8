"""Firmware retraction of printers: G10, G11, and their settings by M207 and M208 (D-115)."""

from __future__ import annotations

import msgspec

from mcserver.gcode.profiles.cycle_motion import CycleMotion, check_travel
from mcserver.gcode.profiles.frame import LENGTH_AXIS
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_units import length_scale, path_speed
from mcserver.gcode.text.profile_words import Action
from mcserver.machine.dialect_section import Retraction
from mcserver.motion.canonical import Canonical
from mcserver.units import AxisType

# what the words of M207 and M208 set; Marlin's other words are for a tool change
_SETTINGS = {"M207": {"S": "length", "F": "speed", "Z": "hop"}, "M208": {"S": "extra", "F": "recover_speed"}}
_UNKNOWN = Retraction(length=0.0, speed=0.0, hop=0.0, recover_speed=0.0, extra=0.0)
_CODES = {"RETRACT": "G10", "RECOVER": "G11"}


def retract(block: BlockState, action: Action) -> list[Canonical]:
    """Return the motion of G10 or G11; none for M207 and M208. Faults are reported (MC194).

    The program's positions stay (Marlin's fwretract.cpp): the zeros of E and Z move by the retraction.
    """
    if action.code in _SETTINGS:
        _set(block, action)
        return []
    code = _CODES[action.code]
    others = [word for word in action.words.values() if (word.letter, word.value) != ("S", 0.0)]
    if others:
        # the writer wanted a tool change: no hint to leave the words out
        letters = {word.letter for word in others}
        hint = "a change of the tool is not made here: let the slicer write for one extruder"
        if "L" in letters:
            hint = "zeros are set by G92: let the slicer write it"
        elif letters & {"P", "R"}:
            hint = "temperatures of tools are set by M104 and M109, zeros by G92: let the slicer write these"
        elif letters != {"S"}:
            hint = "moves are for G1: let the slicer write it"
        shown = " ".join(f"{word.letter}{word.text}" for word in others)
        span = (others[0].span[0], others[-1].span[1])
        block.faults.add("MC194", f"{code} is a retraction here, and takes no {shown}", span, hint)
        return []
    # a second G10, or a G11 without G10, does nothing
    if (action.code == "RETRACT") == (block.frame.retracted is not None):
        return []
    extruder = block.setup.machine.dialect.letters["E"]
    settings = block.frame.retraction or block.setup.machine.dialect.retraction or _UNKNOWN
    if not (settings.speed and settings.recover_speed):
        block.faults.add(
            "MC194",
            f"{code}: length and speed of the retraction are not known",
            action.span,
            "add [dialect.retraction] with length_mm and speed to the machine file, "
            "or write M207 S… F… and M208 F… before it",
        )
    hops = bool(settings.hop) if action.code == "RETRACT" else LENGTH_AXIS in (block.frame.retracted or {})
    for axis in (extruder, LENGTH_AXIS) if hops else (extruder,):
        found = block.usable_axis(axis, action)
        if found is not None and (found.type is not AxisType.LINEAR or found.profiled):
            block.faults.add(
                "MC194",
                f"{code}: axis {axis} is rotary, or its drive follows no path",
                action.span,
                "let the slicer write retractions as moves of E",
                axis=axis,
            )
    if block.faults.found:
        return []
    motion = CycleMotion(block, exact_stop=False)
    if action.code == "RETRACT":
        offsets = {extruder: -settings.length, **({LENGTH_AXIS: settings.hop} if hops else {})}
        _move(block, motion, action, extruder, -settings.length, settings.speed)
        if hops:
            _move(block, motion, action, LENGTH_AXIS, settings.hop)
        block.frame = msgspec.structs.replace(block.frame, retracted=offsets)
        return motion.lines
    frame = block.frame
    offsets = dict(frame.retracted or {})
    if hops:
        _move(block, motion, action, LENGTH_AXIS, -offsets[LENGTH_AXIS])
    _move(block, motion, action, extruder, settings.extra - offsets[extruder], settings.recover_speed)
    # the extra length is not part of the program's E
    g92 = {**frame.g92, extruder: frame.g92.get(extruder, 0.0) + settings.extra}
    block.frame = msgspec.structs.replace(frame, retracted=None, g92=g92)
    return motion.lines


def _move(
    block: BlockState,
    motion: CycleMotion,
    action: Action,
    axis: int,
    distance: float,
    speed: float | None = None,
) -> None:
    """Move an axis within its travel [m, m/s]; without a speed at its greatest."""
    end = motion.at(axis) + distance
    check_travel(block, axis, end, action)
    motion.feed(axis, end, block.setup.axes[axis].max_velocity if speed is None else speed)


def _set(block: BlockState, action: Action) -> None:
    """Set what the words of M207 or M208 give; the rest stays."""
    names = _SETTINGS[action.code]
    inch = block.modal.inch
    found: dict[str, float] = {}
    for letter, word in action.words.items():
        if letter not in names:
            block.faults.add(
                "MC113",
                f"{action.code} takes no {letter}: tools are not changed by retractions here",
                word.span,
                f"it takes {' '.join(names)}",
            )
        elif word.value < 0.0 and names[letter] != "extra":
            block.faults.add("MC116", f"{letter}{word.text} is below 0", word.span, "give 0 or more")
        elif letter == "F" and word.value == 0.0:
            block.faults.add("MC116", "F0 is no speed", word.span, "give F in mm/min")
        else:
            scale = path_speed(1.0, inch) if letter == "F" else length_scale(inch)
            found[names[letter]] = word.value * scale
    before = block.frame.retraction or block.setup.machine.dialect.retraction or _UNKNOWN
    changed = msgspec.structs.replace(before, **found)
    if not changed.recover_speed:
        # until M208 sets it, the recover speed is the retraction's
        changed = msgspec.structs.replace(changed, recover_speed=changed.speed)
    block.frame = msgspec.structs.replace(block.frame, retraction=changed)
