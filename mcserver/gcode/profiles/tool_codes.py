"""Read tool codes: T, M6 and M61, tool lengths, and the tool table by G10 L1 (D-65)."""

from __future__ import annotations

import msgspec

from mcserver.gcode.profiles.codes import TIP_CONTROL
from mcserver.gcode.profiles.frame import LENGTH_AXIS, tool_table
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_places import axis_values
from mcserver.gcode.semantics.program_units import axis_scale
from mcserver.gcode.semantics.tip_moves import lead_by_tip
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.machine.dialect_section import Cutter
from mcserver.motion.canonical import Canonical, PauseLine
from mcserver.units import AxisType

# greatest tool number, as for [[cutter]]
MAX_CUTTER = 99999
# a computed number this close to a whole one is whole (LinuxCNC)
WHOLE = 0.0001


def set_cutter(block: BlockState, action: Action) -> None:
    """Set a line of the tool table: P number, Z length, R radius; omitted values stay."""
    chosen, radius = action.words.get("P"), action.words.get("R")
    if chosen is None or chosen.value != int(chosen.value) or not 1 <= chosen.value <= MAX_CUTTER:
        place = action.span if chosen is None else chosen.span
        block.faults.add(
            "MC143", f"G10 L1 needs the number of a tool, 1 to {MAX_CUTTER}", place, "such as G10 L1 P3 Z75.2"
        )
        return
    lengths = axis_values(block, action)
    if radius is not None and not lengths and block.setup.machine.dialect.fanuc:
        block.faults.add(
            "MC141",
            "R alone is a length beside G10 L1 on Fanuc's controllers, and a radius on LinuxCNC's",
            radius.span,
            "write Z for the length, and Z and R for both",
        )
        return
    if lengths.keys() - {LENGTH_AXIS} or not (lengths or radius is not None):
        block.faults.add(
            "MC118", "G10 L1 takes Z, a length, and R, a radius", action.span, "such as G10 L1 P3 Z75.2 R3"
        )
        return
    if radius is not None and radius.value < 0.0:
        block.faults.add("MC116", f"R{radius.text} is below 0", radius.span, "give the tool's radius")
        return
    number = int(chosen.value)
    table = tool_table(block.setup.machine, block.frame)
    cutter = table.get(number)
    if cutter is None and not lengths:
        refuse_unknown_tool(block, number, chosen)
        return
    length = lengths.get(LENGTH_AXIS, 0.0 if cutter is None else cutter.length)
    diameter = 0.0 if cutter is None else cutter.diameter
    if radius is not None:
        diameter = 2.0 * radius.value * axis_scale(AxisType.LINEAR, block.modal.inch)
    bodies = block.setup.machine.clearance
    if bodies is not None and bodies.follows_cutter and not (length > 0.0 and diameter > 0.0):
        block.faults.add(
            "MC143",
            f"the cutter is a body of this machine, and tool {number} would have no size",
            action.span,
            f"give its length and its radius, such as G10 L1 P{number} Z75.2 R3",
        )
        return
    changed = {**block.frame.cutters, number: Cutter(length, diameter)}
    block.frame = msgspec.structs.replace(block.frame, cutters=changed)


def choose_length(block: BlockState, action: Action) -> None:
    """Set the length of a tool of the table (G43, G43.4, G43.5), or none (G49)."""
    frame = block.frame
    if action.code == "G49":
        block.frame = msgspec.structs.replace(frame, tool_length=0.0, tip_tool=None, by_direction=False)
        return
    cutters = tool_table(block.setup.machine, block.frame)
    word = action.words.get("H")
    number = tool_number(block, word)
    if number and number not in cutters:
        refuse_unknown_tool(block, number, action if word is None else word)
    length = cutters[number].length if number is not None and number in cutters else 0.0
    block.frame = msgspec.structs.replace(frame, tool_length=length, tip_tool=None, by_direction=False)
    if action.code in TIP_CONTROL:
        lead_by_tip(block, action)


def set_length(block: BlockState, action: Action) -> None:
    """Set the tool length along Z that the line gives (G43.1)."""
    values = axis_values(block, action)
    if values.keys() != {LENGTH_AXIS}:
        block.faults.add(
            "MC118", "G43.1 takes a length along Z, and no other", action.span, "such as G43.1 Z75.2"
        )
        return
    length = values[LENGTH_AXIS]
    block.frame = msgspec.structs.replace(block.frame, tool_length=length, tip_tool=None, by_direction=False)


def choose_tool(block: BlockState, word: ProfileWord) -> None:
    """Select the tool of a word as the next to be fitted."""
    number = tool_number(block, word)
    if number is None:
        return
    cutters = tool_table(block.setup.machine, block.frame)
    if cutters and number and number not in cutters:
        refuse_unknown_tool(block, number, word)
    block.frame = msgspec.structs.replace(block.frame, tool=number)


def change_tool(block: BlockState, action: Action) -> list[Canonical]:
    """Pause for a manual change if the tool differs from the last one; with "ask" at the first tool too.

    A tool whose life is used up pauses too: a fresh one has to be fitted. M61 Q says which tool is fitted.
    """
    rule = block.setup.machine.dialect.tool_change
    if action.code == "M61":
        if "Q" not in action.words:
            block.faults.add("MC118", "M61 does not say which tool is fitted", action.span, "such as M61 Q2")
            return []
        choose_tool(block, action.words["Q"])
        if block.frame.tool not in block.frame.worn:
            rule = "ignore"
    frame = block.frame
    known = frame.changed is not None or rule == "ask" or frame.tool in frame.worn
    block.frame = msgspec.structs.replace(frame, changed=frame.tool)
    if not known or frame.changed == frame.tool or rule == "ignore":
        return []
    tool = f"fit tool {frame.tool}" if frame.tool else "take the tool out"
    return [PauseLine(block.parsed.number, f"{tool}, then resume", frame.tool)]


def tool_number(block: BlockState, word: ProfileWord | None) -> int | None:
    """Return a word's tool number, or without a word the fitted tool's; None after a fault."""
    if word is None:
        return block.frame.fitted
    number = round(word.value)
    if number < 0 or abs(word.value - number) > WHOLE:
        shown = f"{word.letter}{word.text} is no number of a tool"
        block.faults.add("MC116", shown, word.span, f"such as {word.letter}1")
        return None
    return number


def refuse_unknown_tool(block: BlockState, number: int, word: ProfileWord | Action) -> None:
    """Report a tool that is not in the tool table."""
    table = sorted(tool_table(block.setup.machine, block.frame))
    known = ", ".join(map(str, table[:20])) or "none"
    block.faults.add(
        "MC143",
        f"the tool table has no tool {number}: its length is not known",
        word.span,
        f"send G10 L1 P{number} Z… with its length, or add [[cutter]] with number = {number} to the machine "
        f"file; there are {known}{', …' * (len(table) > 20)}",
    )
