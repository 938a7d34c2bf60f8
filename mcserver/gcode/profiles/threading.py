"""Read G33, G33.1 and M19 (D-89), and expand G76, LinuxCNC's threading cycle, into passes (D-90)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from mcserver.gcode.profiles.cycle_motion import CycleMotion, check_travel
from mcserver.gcode.profiles.probing import straight_targets
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_units import length_scale, motor_speed
from mcserver.gcode.semantics.travel_limits import ROUNDING
from mcserver.gcode.text.profile_words import Action
from mcserver.machine.axis import Axis
from mcserver.motion.canonical import Canonical, MotionLine, RapidGroup, ThreadLine
from mcserver.motion.thread_cam import MOST_SPEED, least_tapping, plan_cam, stopping_turns
from mcserver.units import DEGREE, MM, TURN, AxisType

X, Z = 0, 2
MOST_PASSES = 1000


class Spindle(msgspec.Struct, frozen=True):
    """The commanded spindle: its axis and speed, negative under M4 [1/s]."""

    axis: int
    turns_s: float


def read_threads(block: BlockState, action: Action) -> list[Canonical]:
    """Return the motion of G33 or G76; empty after a fault, which is reported."""
    # afterwards bare axis words repeat neither the pass nor an earlier motion code
    block.end_motion_code()
    if action.code == "G76" and block.modal.plane != 18 and "Q" in action.words and "J" not in action.words:
        block.faults.add(
            "MC141",
            "G76: fine boring is not done here",
            action.span,
            "let the post write the moves out: G1 to the depth, M19 R0, a move off the wall, G0 out, M3",
        )
        return []
    spindle = find_spindle(block, action)
    if spindle is None:
        return []
    if action.code == "G76":
        return _cycle(block, action, spindle)
    pitch = _words(block, action, "K", "the way a turn", "IJR").get("K")
    targets = straight_targets(block, action, "MC177")
    if targets is None or pitch is None:
        return []
    found = read_pass(block, action, spindle, targets, pitch, taps=action.code == "G33.1")
    return [] if found is None else [found]


def orient(block: BlockState, action: Action) -> list[Canonical]:
    """Return the motion of M19: the spindle turns from rest to the angle R; faults are reported (MC116)."""
    axis = _endless_spindle(block, action)
    if axis is None:
        return []
    if "S" in action.words:
        block.faults.add(
            "MC112",
            "S beside M19 is the angle on some controllers, and the speed on others",
            action.words["S"].span,
            "write the angle as R, and S in a line of its own",
        )
        return []
    angle, way = (action.words[letter].value if letter in action.words else 0.0 for letter in "RP")
    if way not in (0.0, 1.0, 2.0):
        block.faults.add(
            "MC116",
            f"P{action.words['P'].text} of M19 is no way to turn",
            action.words["P"].span,
            "0 is the shorter way, 1 clockwise (as M3), 2 the other way",
        )
        return []
    start = block.commanded.positions[axis.index]
    ahead = (angle * DEGREE - start) % TURN
    if way == 2.0 or (way == 0.0 and ahead > 0.5 * TURN):
        ahead -= TURN
    block.frame = msgspec.structs.replace(block.frame, direction=0)
    block.end_at(axis.index, start + ahead)
    group = RapidGroup((axis.index,), (start + ahead,), wait=True)
    return [MotionLine(block.parsed.number, (group,), exact_stop=True)]


def find_spindle(block: BlockState, action: Action, direction: int | None = None) -> Spindle | None:
    """Return the spindle to synchronize to; None after a fault (MC177, MC178).

    Args:
        direction: which it is about to turn in; None: its present one.
    """
    axis = _endless_spindle(block, action)
    if axis is None:
        return None
    frame = block.frame
    if frame.surface is not None:
        block.faults.add(
            "MC203",
            f"{action.code} needs a spindle that turns evenly; here the radius leads it (G96)",
            action.span,
            "write G97 and S in turns a minute before it",
        )
        return None
    rpm = frame.spindle_rpm * (frame.direction if direction is None else direction)
    turns_s = motor_speed(rpm, axis.travel_per_motor_turn) / TURN
    if turns_s == 0.0:
        block.faults.add(
            "MC178",
            f"{action.code} needs the spindle, which does not turn here",
            action.span,
            "write S with its speed and M3 or M4 before it",
        )
        return None
    return Spindle(axis.index, turns_s)


def _endless_spindle(block: BlockState, action: Action) -> Axis | None:
    """Return the spindle's axis if its travel is endless; None after a fault (MC177)."""
    index = block.setup.machine.dialect.spindle
    if index is None:
        block.faults.add(
            "MC177",
            f"{action.code} needs a spindle that is an axis, and the machine file names none",
            action.span,
            "name the spindle's axis, which has a drive with an encoder: [dialect] spindle_axis = 6",
        )
        return None
    axis = block.usable_axis(index, action)
    if axis is None:
        return None
    endless = math.isinf(axis.min_position) and math.isinf(axis.max_position)
    if axis.type is not AxisType.ROTARY or axis.profiled or not endless:
        block.faults.add(
            "MC177",
            f"{action.code} needs a spindle that turns on and on, and axis {index} does not",
            action.span,
            'make it "rotary", without min_position and max_position, on a drive that follows speeds',
            axis=index,
        )
        return None
    return axis


def _words(block: BlockState, action: Action, letter: str, what: str, refused: str) -> dict[str, float]:
    """Return words as lengths [m]; ``letter`` is required and above 0, ``refused`` letters are reported."""
    for word in action.words.values():
        if word.letter in refused:
            block.faults.add("MC112", f"{action.code} does not take {word.letter}", word.span, "take it out")
    scale = length_scale(block.modal.inch)
    found = {word.letter: word.value * scale for word in action.words.values()}
    if not found.get(letter, 0.0) > 0.0:
        place = action.words[letter].span if letter in action.words else action.span
        block.faults.add(
            "MC118", f"{action.code} lacks {letter}, {what}, above 0", place, f"such as {letter}1.5"
        )
        return {}
    return found


def read_pass(
    block: BlockState,
    action: Action,
    spindle: Spindle,
    targets: Mapping[int, float],
    pitch: float,
    *,
    taps: bool = False,
) -> ThreadLine | None:
    """Return one pass to ``targets`` [m], the end of the block; None after a fault (MC179, MC180)."""
    starts = {axis: block.commanded.start(axis) for axis in targets}
    known = not block.commanded.guessed.intersection(targets)
    travel = [end - starts[axis] for axis, end in targets.items()]
    length = math.hypot(*travel)
    if length <= ROUNDING and known:
        block.faults.add(
            "MC180", f"{action.code} goes nowhere", action.span, "give a target along the thread"
        )
        return None
    if known:
        turning = block.setup.axes[spindle.axis]
        axes = [block.setup.axes[axis] for axis in targets]
        cam = plan_cam(axes, travel, pitch, abs(spindle.turns_s), taps=taps)
        stopping = pitch * stopping_turns(turning, abs(spindle.turns_s))
        if cam.speed > cam.greatest_speed:
            share = cam.greatest_speed / cam.speed
            block.faults.add(
                "MC179",
                f"{action.code} would go at {cam.speed / MOST_SPEED / MM:.4g} mm/s, and the axes may at "
                f"{cam.greatest_speed / MM:.4g} mm/s, a tenth left for a spindle faster than its S",
                action.span,
                f"write S{math.floor(block.frame.spindle_rpm * share):g} at the most",
            )
            return None
        if taps and not cam.follows(turning.max_acceleration / TURN * pitch):
            block.faults.add(
                "MC179",
                f"{action.code} reverses the spindle faster than the axes can follow",
                action.span,
                f"give axis {spindle.axis} a lower max_acceleration",
            )
            return None
        if taps and length < least_tapping(cam, stopping):
            block.faults.add(
                "MC180",
                f"{action.code} needs {least_tapping(cam, stopping) / MM:.4g} mm: {cam.ramp_length / MM:.4g} "
                f"until the axes have the spindle's speed, and {stopping / MM:.4g} until it stands again",
                action.span,
                "begin further off, or write a lower S",
            )
            return None
        if not taps and length < 2.0 * cam.ramp_length:
            block.faults.add(
                "MC180",
                f"a pass of {length / MM:.4g} mm is shorter than its run-in and run-out of "
                f"{cam.ramp_length / MM:.4g} mm each, on which the axes come to the spindle's speed",
                action.span,
                "begin further off and end in a groove, or write a lower S",
            )
            return None
    for axis, end in targets.items():
        block.end_at(axis, starts[axis] if taps else end)
    return ThreadLine(
        block.parsed.number,
        tuple(targets),
        tuple(targets.values()),
        length,
        pitch,
        spindle.axis,
        spindle.turns_s,
        taps,
    )


def _cycle(block: BlockState, action: Action, spindle: Spindle) -> list[Canonical]:
    """Return the passes of G76 along Z, each at its X and back to the start of the cycle.

    The depths are as in LinuxCNC's documentation: J·n^(1/R) for the n-th, K for the last, which H spring
    passes repeat; Q turns the infeed so that one flank cuts, and the last pass ends at Z.
    """
    words = _words(block, action, "P", "the pitch", "")
    numbers = {letter: word.value for letter, word in action.words.items()}
    targets = straight_targets(block, action, "MC177")
    if not words or targets is None:
        return []
    if targets.keys() != {Z}:
        block.faults.add("MC118", "G76 takes Z of the axes, the thread's end", action.span, "such as Z-20")
        return []
    for letter, what in (
        ("I", "the offset of the crest"),
        ("J", "the depth of the first pass"),
        ("K", "the depth"),
    ):
        if letter not in words:
            block.faults.add("MC118", f"G76 lacks {letter}, {what}", action.span, "add it, as a radius")
            return []
    springs, degression, angle = (
        numbers.get(letter, value) for letter, value in (("H", 0.0), ("R", 1.0), ("Q", 0.0))
    )
    first, depth = words["J"], words["K"]
    for letter, sound, meant in (
        ("I", words["I"] != 0.0, "below 0 for an external thread, above for an internal one"),
        ("J", first > 0.0, "above 0"),
        ("K", first <= depth, "not below J"),
        ("R", degression >= 1.0, "1 or more"),
        ("Q", 0.0 <= angle <= 80.0, "0 to 80 degrees"),
        ("H", springs == int(springs) and 0 <= springs <= MOST_PASSES, "a whole number"),
        ("L", numbers.get("L", 0.0) == 0.0, "0: tapers at the ends are not cut here"),
    ):
        if not sound:
            block.faults.add("MC116", f"{letter} of G76 is {meant}", action.words[letter].span)
    if block.modal.plane != 18:
        block.faults.add("MC180", "G76 is a cycle of the plane X Z", action.span, "write G18 before it")
    depths: list[float] = []
    while not block.faults.found and len(depths) <= MOST_PASSES:
        reached = first * (len(depths) + 1) ** (1.0 / degression)
        if reached >= depth - ROUNDING:
            break
        depths.append(reached)
    depths += [depth] * (int(springs) + 1)
    if len(depths) > MOST_PASSES:
        block.faults.add("MC180", f"G76 takes more than {MOST_PASSES} passes", action.span, "give a larger J")
    if block.faults.found or block.usable_axis(X, action) is None:
        return []
    motion = CycleMotion(block)
    drive, start = motion.at(X), motion.at(Z)
    along, flank = math.copysign(1.0, targets[Z] - start), math.tan(math.radians(angle))
    for reached in depths:
        into = math.copysign(abs(words["I"]) + reached, words["I"])
        shift = along * reached * flank
        check_travel(block, X, drive + into, action)
        motion.rapid({Z: start + shift})
        motion.rapid({X: drive + into})
        end = targets[Z] + shift - along * depth * flank
        line = None if block.faults.found else read_pass(block, action, spindle, {Z: end}, words["P"])
        if line is None:
            return []
        motion.lines.append(line)
        motion.rapid({X: drive})
        motion.rapid({Z: start + shift})
    motion.rapid({Z: start})
    return motion.lines
