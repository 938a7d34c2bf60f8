"""Expand canned drilling cycles into rapids and feed moves (D-75)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from mcserver.gcode.profiles.codes import TAPPING
from mcserver.gcode.profiles.cycle_motion import CycleMotion, check_travel, height
from mcserver.gcode.profiles.frame import DrillCycle, Level
from mcserver.gcode.profiles.threading import find_spindle, read_pass
from mcserver.gcode.semantics.block_state import ASSUMED_FEED, BlockState
from mcserver.gcode.semantics.program_places import ends_of, given_by
from mcserver.gcode.semantics.program_units import length_scale, shown_position
from mcserver.gcode.semantics.travel_limits import ROUNDING
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.motion.canonical import Canonical
from mcserver.units import MM, AxisType

# the plane's two axes and the axis that drills, by the number of the plane's code
_AXES: Final[Mapping[int, tuple[int, int, int]]] = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
_LETTERS: Final = "XYZ"
# how far a peck ends its rapid above the depth that is drilled already, and G73 goes up to break the chip [m]
CLEARANCE = 0.25 * MM
MOST_PECKS = 10_000
MOST_REPEATS = 1_000

_PECKING: Final = frozenset({"G73", "G83"})
_DWELLING: Final = frozenset({"G82", "G89"})
_FEEDING_OUT: Final = frozenset({"G85", "G89"})


class _Hole(msgspec.Struct, frozen=True):
    """Heights of a cycle along its axis [m], as of `CycleMotion`, and where the tool goes between holes."""

    axis: int
    clear: float
    bottom: float
    retract: float


def drill(block: BlockState, action: Action) -> list[Canonical]:
    """Return the motion of a line of a canned cycle; faults are reported and nothing is returned.

    Args:
        action: a cycle's code with its words, or ``REPEAT`` for a line with words only.
    """
    if block.usable_axis(_axis(block), action) is None:
        return []
    before = block.frame.cycle if block.drilling else None
    cycle = _cycle(block, action, before)
    repeats = _repeats(block, action)
    if cycle is None or repeats is None:
        return []
    hole = _hole(block, cycle)
    targets = _targets(block, action, hole.axis)
    speed = _feed(block, action)
    block.change(motion=None)
    block.frame = msgspec.structs.replace(block.frame, cycle=cycle)
    if targets is None or speed is None or not _sound(block, action, cycle, hole):
        return []
    named = msgspec.structs.replace(action, code=cycle.code)
    spindle = find_spindle(block, named) if cycle.code in TAPPING else None
    if block.faults.found:
        return []
    motion = CycleMotion(block, speed)
    for _ in range(repeats):
        if motion.at(hole.axis) < hole.clear - ROUNDING:
            motion.rapid(motion.ends(hole.axis, hole.clear))
        motion.rapid(_ends(block, action, targets))
        motion.rapid(motion.ends(hole.axis, hole.clear))
        _check_heights(block, action, motion, hole)
        if spindle is None:
            _down(motion, cycle, hole)
        else:
            pitch = speed / abs(spindle.turns_s)
            tap = read_pass(block, named, spindle, motion.ends(hole.axis, hole.bottom), pitch, taps=True)
            motion.lines += [] if tap is None else [tap]
        motion.rapid(motion.ends(hole.axis, hole.retract))
        if block.faults.found:
            return []
    return motion.lines


def _down(motion: CycleMotion, cycle: DrillCycle, hole: _Hole) -> None:
    """Drill from the clear height to the bottom, and out as far as the cycle feeds out."""
    if cycle.code in _PECKING:
        depth = hole.clear
        while depth - hole.bottom > ROUNDING:
            depth = max(hole.bottom, depth - cycle.peck)
            motion.feed(hole.axis, depth)
            if depth - hole.bottom <= ROUNDING:
                break
            if cycle.code == "G83":
                motion.rapid(motion.ends(hole.axis, hole.clear))
            motion.rapid(motion.ends(hole.axis, min(hole.clear, depth + CLEARANCE)))
    else:
        motion.feed(hole.axis, hole.bottom)
    if cycle.code in _DWELLING:
        motion.dwell(cycle.dwell or 0.0)
    if cycle.code in _FEEDING_OUT:
        motion.feed(hole.axis, hole.clear)


def _cycle(block: BlockState, action: Action, before: DrillCycle | None) -> DrillCycle | None:
    """Return the cycle that a line's words leave in force; None after a fault (MC113, MC116, MC118)."""
    words, modal = action.words, block.modal
    if action.code == "REPEAT" and before is None:
        for word in words.values():
            if word.letter in "PQL":
                block.faults.add("MC113", f"{word.letter}{word.text} belongs to no command", word.span)
        return None
    for word in words.values():
        if word.letter in "IJK":
            block.faults.add("MC112", f"a canned cycle does not take {word.letter}", word.span, "take it out")
    axis = _axis(block)
    scale = length_scale(modal.inch)
    deep = next((word for word in action.axes if word.axis == axis), None)
    code = action.code if before is None or action.code != "REPEAT" else before.code
    bottom = _level(block, deep) or (None if before is None else before.bottom)
    clear = _level(block, words.get("R")) or (None if before is None else before.clear)
    peck = words["Q"].value * scale if "Q" in words else (0.0 if before is None else before.peck)
    dwell = None if before is None else before.dwell
    if "P" in words:
        dwell = words["P"].value * block.setup.machine.dialect.dwell_unit
        if dwell < 0.0:
            block.faults.add("MC116", f"a dwell of {dwell:g} s is negative", words["P"].span)
    missing = [
        f"{letter} ({what})"
        for letter, what, known in (
            (_LETTERS[axis], "the depth", bottom is not None),
            ("R", "the height above the part", clear is not None),
            ("Q", "the depth of a peck, above 0", code not in _PECKING or peck > 0.0),
            ("P", "the dwell at the bottom", code not in _DWELLING or dwell is not None),
        )
        if not known
    ]
    if missing or bottom is None or clear is None:
        block.faults.add("MC118", f"{code} lacks {' and '.join(missing)}", action.span, "add what is missing")
        return None
    initial = height(block, axis, block.commanded.positions) if before is None else before.initial
    return DrillCycle(code, initial, bottom, clear, peck, dwell)


def _level(block: BlockState, word: ProfileWord | None) -> Level | None:
    if word is None:
        return None
    return Level(word.value * length_scale(block.modal.inch), block.modal.incremental)


def _axis(block: BlockState) -> int:
    """Return the axis that drills: the normal of the plane in force."""
    return _AXES[block.modal.plane or 17][2]


def _hole(block: BlockState, cycle: DrillCycle) -> _Hole:
    """Return the heights of a cycle: increments count from where it began, and from R (RS-274)."""
    axis = _axis(block)
    zero = height(block, axis, block.modal.shift or {})
    clear = cycle.clear.value + (cycle.initial if cycle.clear.incremental else zero)
    bottom = cycle.bottom.value + (clear if cycle.bottom.incremental else zero)
    retract = max(clear, cycle.initial) if block.frame.to_initial else clear
    return _Hole(axis, clear, bottom, retract)


def _repeats(block: BlockState, action: Action) -> int | None:
    word = action.words.get("L")
    if word is None:
        return 1
    if word.value != int(word.value) or not 1 <= word.value <= MOST_REPEATS:
        block.faults.add(
            "MC116",
            f"L{word.text} is no number of repetitions",
            word.span,
            f"give a whole number, 1 to {MOST_REPEATS}",
        )
        return None
    return int(word.value)


def _targets(block: BlockState, action: Action, normal: int) -> dict[int, ProfileWord] | None:
    """Return the words that say where the hole is, by axis; None after a fault (MC108, MC111, MC146)."""
    found: dict[int, ProfileWord] = {}
    seen: set[int] = set()
    for word in action.axes:
        if block.usable_axis(word.axis, action) is None:
            return None
        if word.axis in seen:
            block.faults.add(
                "MC111", f"{word.letter} stands twice in one command", word.span, "keep one of them"
            )
            return None
        seen.add(word.axis)
        if word.axis > 2 or block.setup.axes[word.axis].type is not AxisType.LINEAR:
            block.faults.add(
                "MC146",
                f"axis {word.axis} takes no part in a canned cycle, which moves X Y Z",
                word.span,
                "move it by G0 on the line before",
            )
            return None
        if word.axis != normal:
            found[word.axis] = word
    return found


def _ends(block: BlockState, action: Action, targets: Mapping[int, ProfileWord]) -> dict[int, float]:
    """Return where words take axes [m]; a target beyond the travel is reported (MC201)."""
    found = ends_of(block, given_by(block, targets), action) or {}
    for axis, end in found.items():
        if block.usable_axis(axis, action) is not None:
            check_travel(block, axis, end, targets.get(axis, action))
    return found


def _feed(block: BlockState, action: Action) -> float | None:
    """Return the speed of drilling [m/s]; None after a fault (MC121, MC146)."""
    modal = block.modal
    if modal.inverse_time:
        block.faults.add("MC146", "a canned cycle has no duration: G93 is in force", action.span, "write G94")
        return None
    if modal.feed is None:
        unit = "in/min" if modal.inch else "mm/min"
        block.faults.add(
            "MC121", "the cycle has no feed rate: no F is in force", action.span, f"give F in {unit}"
        )
        block.change(feed=ASSUMED_FEED)
        return None
    return modal.feed.speed


def _sound(block: BlockState, action: Action, cycle: DrillCycle, hole: _Hole) -> bool:
    """Check the heights of a cycle; faults are reported (MC146, MC201)."""
    if hole.bottom > hole.clear + ROUNDING:
        kind = block.setup.axes[hole.axis].type
        depth, clear = (shown_position(each, kind, block.modal.inch) for each in (hole.bottom, hole.clear))
        block.faults.add(
            "MC146",
            f"{cycle.code} drills upwards: its depth of {depth} lies above R at {clear}",
            action.span,
            f"give R a height above the part and {_LETTERS[hole.axis]} the depth; under G91 R counts from "
            "where the cycle begins, and the depth from R",
        )
        return False
    if cycle.code in _PECKING and math.ceil((hole.clear - hole.bottom) / cycle.peck) > MOST_PECKS:
        block.faults.add(
            "MC146", f"{cycle.code} takes more than {MOST_PECKS} pecks", action.span, "give a larger Q"
        )
        return False
    if hole.axis in block.transformation.changed:
        block.faults.add(
            "MC185",
            f"a canned cycle along a scaled axis does not go together with {block.transformation.names}",
            action.span,
            f"end that by {block.transformation.enders} first, or scale X and Y alone",
        )
        return False
    asked = [word for letter, word in action.words.items() if letter in "PQ" and word.value != 0.0]
    if cycle.code in TAPPING and asked:
        block.faults.add(
            "MC146",
            f"{cycle.code} neither pecks nor dwells: the spindle is reversed at the bottom at once",
            asked[0].span,
            "leave it out",
        )
        return False
    if cycle.code in TAPPING and block.frame.direction != (1 if cycle.code == "G84" else -1):
        turning = "M3" if cycle.code == "G84" else "M4"
        block.faults.add(
            "MC178", f"{cycle.code} taps with the spindle on {turning}", action.span, f"write S and {turning}"
        )
        return False
    return not block.faults.found


def _check_heights(block: BlockState, action: Action, motion: CycleMotion, hole: _Hole) -> None:
    """Report heights above and in a hole that are beyond the travel of an axis (MC201)."""
    reported: set[int] = set()
    for level in (hole.clear, hole.bottom, hole.retract):
        for axis, end in motion.ends(hole.axis, level).items():
            if axis not in reported and check_travel(block, axis, end, action):
                reported.add(axis)


def repeat_action(words: Sequence[ProfileWord]) -> Action:
    """Return the words of a line that repeats the cycle in force."""
    first, last = words[0].span, words[-1].span
    axes = tuple(word for word in words if word.axis >= 0)
    return Action("REPEAT", (first[0], last[1]), {word.letter: word for word in words if word.axis < 0}, axes)
