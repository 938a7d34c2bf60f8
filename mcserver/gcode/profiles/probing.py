"""Read G38.2 to G38.5: straight moves that end when the probe's input changes (D-74)."""

from __future__ import annotations

import math

from mcserver.gcode.profiles.cycle_motion import check_travel
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.feed_time import turns_of_feed
from mcserver.gcode.semantics.program_places import ends_of, given_by
from mcserver.gcode.semantics.travel_limits import ROUNDING
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.motion.canonical import ProbeKind, ProbeLine
from mcserver.units import AxisType


def read_probe_move(block: BlockState, action: Action) -> ProbeLine | None:
    """Return the probing move of a line; None after a fault (MC118, MC121, MC128, MC138, MC155, MC201)."""
    modal = block.modal
    targets = straight_targets(block, action, "MC155")
    # afterwards bare axis words repeat neither the probing move nor an earlier motion code
    block.end_motion_code()
    if targets is None:
        return None
    if modal.feed is None or modal.inverse_time:
        what = f"{action.code} has no speed: " + (
            "G93 is in force" if modal.inverse_time else "no F is in force"
        )
        block.faults.add("MC155" if modal.inverse_time else "MC121", what, action.span, "write G94 and F")
        return None
    turns = turns_of_feed(block, action)
    if turns is None:
        return None
    starts = {axis: block.commanded.start(axis) for axis in targets}
    length = math.hypot(*(end - starts[axis] for axis, end in targets.items()))
    if length <= ROUNDING and not block.commanded.guessed.intersection(targets):
        block.faults.add(
            "MC155", f"{action.code} goes nowhere", action.span, "give a target beyond the surface"
        )
        return None
    for axis, end in targets.items():
        block.end_at(axis, end)
    # the end is only known after the move
    block.commanded.invalidate(targets)
    speed = turns * modal.feed.speed
    return ProbeLine(
        line=block.parsed.number,
        kind=ProbeKind(int(action.code[-1])),
        axes=tuple(targets),
        targets=tuple(targets.values()),
        speed=speed,
        requested=length / speed,
        length=length,
    )


def straight_targets(block: BlockState, action: Action, rotary: str) -> dict[int, float] | None:
    """Return the targets of the linear axes in a straight move [m]; None after a fault.

    Args:
        rotary: code of the fault for a rotary axis.
    """
    named: dict[int, ProfileWord] = {}
    if not action.axes:
        block.faults.add("MC118", f"{action.code} names no axis", action.span, "add axis words, such as Z-10")
        return None
    for word in action.axes:
        if block.usable_axis(word.axis, action) is None:
            return None
        axis = block.setup.axes[word.axis]
        if axis.type is not AxisType.LINEAR:
            block.faults.add(
                rotary, f"axis {word.axis} is rotary: {action.code} is a straight line", word.span, ""
            )
            return None
        if axis.profiled:
            what = f"axis {word.axis} follows no path: its drive goes to points on profiles of its own"
            block.faults.add("MC138", what, word.span, "use axes whose drives have csp or ip")
            return None
        if word.axis in named:
            block.refuse_twice(word)
            return None
        named[word.axis] = word
    found = ends_of(block, given_by(block, named), action)
    for index, end in (found or {}).items():
        check_travel(block, index, end, named.get(index, action), action.code)
    return found
