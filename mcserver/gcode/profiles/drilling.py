"""Expand canned cycles for holes to rapids, feed moves and taps (D-75, D-89)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import msgspec

from mcserver.gcode.profiles.codes import CYCLE_WORDS, PECKING, SPINDLE, TAPPING
from mcserver.gcode.profiles.cycle_motion import CycleMotion, check_travel, height
from mcserver.gcode.profiles.frame import DrillCycle, Level, Pecks
from mcserver.gcode.profiles.threading import Spindle, find_spindle, read_pass
from mcserver.gcode.semantics.block_state import ASSUMED_FEED, BlockState
from mcserver.gcode.semantics.feed_time import feed_unit, turns_of_feed
from mcserver.gcode.semantics.program_places import ends_of, given_by
from mcserver.gcode.semantics.program_units import length_scale, shown_position
from mcserver.gcode.semantics.travel_limits import ROUNDING
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.motion.canonical import Canonical
from mcserver.motion.thread_cam import stopping_seconds
from mcserver.units import MM, TURN, AxisType

# direction of the spindle as a tap goes in: 1 as by M3
_SENSE: Final[Mapping[str, int]] = MappingProxyType({"G74": -1, "G84": 1})
# the plane's two axes and the drilling axis, by number of the plane's code
_AXES: Final[Mapping[int, tuple[int, int, int]]] = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
_LETTERS: Final = "XYZ"
# height above the drilled depth at which a peck's rapid ends, and to which G73 retracts to break the chip [m]
CLEARANCE = 0.25 * MM
MOST_PECKS = 10_000
# longer than anybody lets a tool rub at the bottom of a hole [s]
LONG_DWELL = 20.0
# smaller than the pitch of any thread; F is the pitch, which some controllers read without G95, too [m]
LEAST_PITCH = 0.05 * MM
MOST_REPEATS = 1_000

_DWELLING: Final = frozenset({"G82", "G89"})
_FEEDING_OUT: Final = frozenset({"G85", "G89"})


class _Hole(msgspec.Struct, frozen=True):
    """Heights of a cycle along its axis [m], as of `CycleMotion`, and the height between holes."""

    axis: int
    clear: float
    bottom: float
    retract: float


def drill(block: BlockState, action: Action) -> list[Canonical]:
    """Return the motion of a line of a canned cycle; empty after a fault, which is reported.

    Args:
        action: a cycle's code with its words, or ``REPEAT`` for a line with words alone.
    """
    if block.usable_axis(_axis(block), action) is None:
        return []
    before = block.frame.cycle if block.drilling else None
    cycle = _cycle(block, action, before)
    if cycle is None:
        return []
    repeats = _repeats(block, action, cycle)
    hole = _hole(block, cycle)
    targets = _targets(block, action, hole.axis)
    speed = _feed(block, action, cycle)
    block.change(motion=None)
    block.frame = msgspec.structs.replace(block.frame, cycle=cycle)
    if targets is None or speed is None or repeats is None or not _sound(block, action, cycle, hole):
        return []
    if repeats == 0 and targets and block.modal.incremental:
        block.faults.add(
            "MC146",
            "controllers differ in whether they go there, where a cycle is only kept for the lines to come",
            action.span,
            "leave the axis words out, or write G90",
        )
    named = msgspec.structs.replace(action, code=cycle.code)
    turning = _SENSE.get(cycle.code)
    spindle = None
    if turning is not None or cycle.code == "G86":
        spindle = find_spindle(block, named, turning)
    pitch = math.inf if turning is None or spindle is None else speed / abs(spindle.turns_s)
    if pitch < LEAST_PITCH:
        block.faults.add(
            "MC173",
            f"{cycle.code} would tap {pitch / MM:.3g} mm a turn: F counts a minute",
            action.span,
            "write G95 where F is the pitch, else F as the pitch times S",
        )
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
            motion.rapid(motion.ends(hole.axis, hole.retract))
        elif turning is None:
            _down(motion, cycle, hole)
            ramp = stopping_seconds(block.setup.axes[spindle.axis], abs(spindle.turns_s))
            motion.turn(spindle.axis, 0.0, ramp)
            motion.rapid(motion.ends(hole.axis, hole.retract))
            motion.turn(spindle.axis, TURN * spindle.turns_s, ramp)
        else:
            _tap(block, named, motion, hole, _depths(cycle, hole), spindle, pitch)
            motion.rapid(motion.ends(hole.axis, hole.retract))
        if block.faults.found:
            return []
    if "P" in action.words and cycle.dwell is not None and cycle.dwell > LONG_DWELL:
        block.faults.add(
            "MC129",
            f"P{action.words['P'].text} waits {cycle.dwell:g} s in each hole",
            action.words["P"].span,
            'if its post writes milliseconds, say so in the machine file: [dialect] dwell = "ms"',
            severity="warning",
        )
    if before is not None:
        _warn_of_kept(block, action, before)
    return motion.lines


def _down(motion: CycleMotion, cycle: DrillCycle, hole: _Hole) -> None:
    """Drill from the clear height to the bottom, and feed out in cycles that do."""
    top = hole.clear
    for depth in _depths(cycle, hole):
        motion.feed(hole.axis, depth)
        if depth <= hole.bottom:
            break
        total = 0.0 if cycle.pecks is None else cycle.pecks.total
        if cycle.code == "G83" or 0.0 < total <= top - depth + ROUNDING:
            motion.rapid(motion.ends(hole.axis, hole.clear))
            top = depth
        motion.rapid(motion.ends(hole.axis, min(hole.clear, depth + CLEARANCE)))
    motion.dwell(cycle.dwell or 0.0)
    if cycle.code in _FEEDING_OUT:
        motion.feed(hole.axis, hole.clear)


def _tap(
    block: BlockState,
    action: Action,
    motion: CycleMotion,
    hole: _Hole,
    depths: list[float],
    spindle: Spindle,
    pitch: float,
) -> None:
    """Tap from the clear height to each depth and back; a stopped spindle turns for the tap only."""
    stands = block.frame.direction == 0
    if stands:
        # the synchronous pass waits for the spindle's speed
        motion.turn(spindle.axis, TURN * spindle.turns_s, 0.0)
    for depth in depths:
        tap = read_pass(block, action, spindle, motion.ends(hole.axis, depth), pitch, taps=True)
        if tap is None:
            return
        motion.lines.append(tap)
    if stands:
        motion.turn(spindle.axis, 0.0, 0.0)


def _depths(cycle: DrillCycle, hole: _Hole) -> list[float]:
    """Return the depth of each peck [m]; the last is the bottom."""
    found: list[float] = []
    pecks, depth = cycle.pecks, hole.clear
    step = math.inf if pecks is None else pecks.first
    while not found or depth > hole.bottom:
        depth -= step
        if depth - hole.bottom <= ROUNDING:
            depth = hole.bottom
        found.append(depth)
        if pecks is not None:
            step = max(pecks.least, step - pecks.less)
    return found


def _cycle(block: BlockState, action: Action, before: DrillCycle | None) -> DrillCycle | None:
    """Return the cycle in force after a line's words; None after a fault (MC113, MC116, MC118)."""
    words = action.words
    if action.code == "REPEAT" and before is None:
        for word in words.values():
            if word.letter in "PQL":
                block.faults.add("MC113", f"{word.letter}{word.text} belongs to no command", word.span)
        return None
    axis = _axis(block)
    deep = next((word for word in action.axes if word.axis == axis), None)
    code = action.code if before is None or action.code != "REPEAT" else before.code
    for word in words.values():
        if word.letter in "PQIJK" and word.letter not in CYCLE_WORDS[code] and word.value != 0.0:
            block.faults.add("MC112", f"{code} does not take {word.letter}", word.span, "take it out")
    bottom, clear = _level(block, deep), _level(block, words.get("R"))
    if before is not None:
        bottom, clear = bottom or _kept(block, before.bottom), clear or _kept(block, before.clear)
    pecks = _pecks(block, action, code)
    dwell = None
    if before is not None:
        same = before.code == code
        pecks = before.pecks if pecks is None and (same or code in PECKING) else pecks
        dwell = before.dwell if same or code in _DWELLING else None
    if "P" in words:
        dwell = words["P"].value * block.setup.machine.dialect.dwell_unit
        if dwell < 0.0:
            block.faults.add("MC116", f"a dwell of {dwell:g} s is negative", words["P"].span)
    missing = [
        f"{letter} ({what})"
        for letter, what, known in (
            (_LETTERS[axis], "the depth", bottom is not None),
            ("R", "the height above the part", clear is not None),
            (
                "Q",
                "the depth of a peck, above 0",
                code not in PECKING or pecks is not None or {"Q", "I"} & words.keys(),
            ),
            ("P", "the dwell at the bottom", code not in _DWELLING or dwell is not None),
        )
        if not known
    ]
    if missing or bottom is None or clear is None:
        block.faults.add("MC118", f"{code} lacks {' and '.join(missing)}", action.span, "add what is missing")
        return None
    initial = height(block, axis, block.commanded.positions) if before is None else before.initial
    return DrillCycle(code, initial, bottom, clear, pecks, dwell)


def _pecks(block: BlockState, action: Action, code: str) -> Pecks | None:
    """Return the pecks that a line's words give by Q, or by Haas's I, J and K; None without any.

    I is the depth of the first peck, each further one is less by J, and at least K; K beside Q of G73 is the
    depth after which the hole is cleared. Faults are reported (MC112, MC116, MC118).
    """
    found = {letter: word for letter, word in action.words.items() if letter in "QIJK" and word.value != 0.0}
    if code not in PECKING:
        found = {letter: word for letter, word in found.items() if letter == "Q" and code in TAPPING}
    scale = length_scale(block.modal.inch)
    for letter, word in found.items():
        if word.value < 0.0:
            block.faults.add("MC116", f"{letter} of {code} is a depth, above 0", word.span)
            return None
    q, first, less, least = (found[letter].value * scale if letter in found else 0.0 for letter in "QIJK")
    if first and least and not q:
        return Pecks(first, less, min(first, least))
    if q and not (first or less) and (not least or code == "G73"):
        if least and block.modal.incremental:
            what = "K of G73 is a number of holes on some controllers, and a depth on others"
            block.faults.add("MC112", what, found["K"].span, "write L for the number of holes, or G90")
        return Pecks(q, 0.0, q, least)
    if found:
        block.faults.add(
            "MC112",
            f"{code} does not take {' and '.join(found)} together",
            next(iter(found.values())).span,
            "write Q for pecks of one depth; or I, the first, J, how much less each is, and K, the least one",
        )
    return None


def _level(block: BlockState, word: ProfileWord | None) -> Level | None:
    if word is None:
        return None
    return Level(word.value * length_scale(block.modal.inch), block.modal.incremental)


def _kept(block: BlockState, level: Level) -> Level:
    """Return a height of an earlier line as now read: Fanuc keeps the height, LinuxCNC the number."""
    return level if block.setup.machine.dialect.fanuc else Level(level.value, block.modal.incremental)


def _warn_of_kept(block: BlockState, action: Action, before: DrillCycle) -> None:
    """Warn of heights whose meaning has changed since the line that gave them (MC199)."""
    given = {word.letter for word in action.axes} | action.words.keys()
    levels = {_LETTERS[_axis(block)]: before.bottom, "R": before.clear}
    scale = length_scale(block.modal.inch)
    other = [
        f"{letter}{level.value / scale:.6g}"
        for letter, level in levels.items()
        if letter not in given and _kept(block, level) != level
    ]
    if not other:
        return
    then, now, meaning = (
        ("G90", "G91", "increments") if block.modal.incremental else ("G91", "G90", "positions")
    )
    block.faults.add(
        "MC199",
        f"the cycle has {' and '.join(other)} of {then}, which {now} reads as {meaning}",
        action.span,
        'write them again; Fanuc\'s controllers keep the heights: [dialect] macros = "fanuc"',
        severity="warning",
    )


def _axis(block: BlockState) -> int:
    """Return the drilling axis: the normal of the plane in force."""
    return _AXES[block.modal.plane or 17][2]


def _hole(block: BlockState, cycle: DrillCycle) -> _Hole:
    """Return the heights of a cycle: increments count from its start, and from R (RS-274)."""
    axis = _axis(block)
    zero = height(block, axis, block.modal.shift or {})
    clear = cycle.clear.value + (cycle.initial if cycle.clear.incremental else zero)
    bottom = cycle.bottom.value + (clear if cycle.bottom.incremental else zero)
    retract = max(clear, cycle.initial) if block.frame.to_initial else clear
    return _Hole(axis, clear, bottom, retract)


def _repeats(block: BlockState, action: Action, cycle: DrillCycle) -> int | None:
    """Return how often a line drills: L, or K if that is no depth; 0: it only sets the cycle (MC116)."""
    words = [
        word
        for letter, word in action.words.items()
        if letter == "L" or (letter == "K" and (cycle.code not in PECKING or word.value == 0.0))
    ]
    if not words:
        return 1
    word = words[-1]
    if len(words) > 1 or word.value != int(word.value) or not 0 <= word.value <= MOST_REPEATS:
        block.faults.add(
            "MC116",
            f"{' '.join(each.letter + each.text for each in words)} is no number of repetitions",
            word.span,
            f"give one whole number, 0 to {MOST_REPEATS}",
        )
        return None
    return int(word.value)


def _targets(block: BlockState, action: Action, normal: int) -> dict[int, ProfileWord] | None:
    """Return the words that locate the hole, by axis; None after a fault (MC108, MC111, MC146)."""
    found: dict[int, ProfileWord] = {}
    seen: set[int] = set()
    for word in action.axes:
        if block.usable_axis(word.axis, action) is None:
            return None
        if word.axis in seen:
            block.refuse_twice(word)
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
    """Return the ends of axes that words give [m]; a target beyond the travel is reported (MC201)."""
    found = ends_of(block, given_by(block, targets), action) or {}
    for axis, end in found.items():
        if block.usable_axis(axis, action) is not None:
            check_travel(block, axis, end, targets.get(axis, action))
    return found


def _feed(block: BlockState, action: Action, cycle: DrillCycle) -> float | None:
    """Return the speed of drilling [m/s]; None after a fault (MC121, MC128, MC146)."""
    modal = block.modal
    if modal.inverse_time:
        block.faults.add("MC146", "a canned cycle has no duration: G93 is in force", action.span, "write G94")
        return None
    if modal.feed is None:
        block.faults.add(
            "MC121",
            "the cycle has no feed rate: no F is in force",
            action.span,
            f"give F in {feed_unit(block)}",
        )
        block.change(feed=ASSUMED_FEED)
        return None
    turns = turns_of_feed(block, action, starts=cycle.code in TAPPING)
    return None if turns is None else turns * modal.feed.speed


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
    if cycle.pecks is not None and (hole.clear - hole.bottom) / cycle.pecks.least > MOST_PECKS:
        block.faults.add(
            "MC146", f"{cycle.code} takes more than {MOST_PECKS} pecks", action.span, "give larger ones"
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
    if cycle.code in TAPPING and cycle.dwell:
        block.faults.add(
            "MC146",
            f"{cycle.code} does not dwell: the spindle is reversed at the bottom at once",
            action.span,
            "leave P out",
        )
        return False
    # a start of the spindle here would leave out the outputs that its M3 or M4 sets
    starts = block.frame.direction == 0 and not SPINDLE & block.setup.machine.dialect.mapped
    if cycle.code in TAPPING and block.frame.direction != _SENSE[cycle.code] and not starts:
        turning = "M3" if cycle.code == "G84" else "M4"
        block.faults.add(
            "MC178", f"{cycle.code} taps with the spindle on {turning}", action.span, f"write S and {turning}"
        )
        return False
    return not block.faults.found


def _check_heights(block: BlockState, action: Action, motion: CycleMotion, hole: _Hole) -> None:
    """Report heights above and in a hole beyond the travel of an axis (MC201)."""
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
