"""Factors of printers: M220 for the feed, M221 for extrusion (D-141)."""

from __future__ import annotations

import msgspec

from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.text.profile_words import Action

_WORDS = {"M220": "SBR", "M221": "ST"}


def set_factor(block: BlockState, action: Action) -> None:
    """Set the factor of M220 or M221 for the moves after a line; faults are reported."""
    code, words = action.code, action.words
    for letter, word in words.items():
        if letter not in _WORDS[code]:
            taken = " ".join(_WORDS[code])
            block.faults.add("MC113", f"{code} takes no {letter}", word.span, f"it takes {taken}")
    extruder = words.get("T")
    if extruder is not None and extruder.value != 0.0 and code == "M221":
        block.faults.add(
            "MC143",
            f"this printer has no T{extruder.text}: it has one extruder, T0",
            extruder.span,
            "leave T out",
        )
    given = words.get("S")
    if given is not None and given.value <= 0.0:
        block.faults.add("MC116", f"{code} S{given.text} is not above 0", given.span, "give S in per cent")
    if block.faults.found:
        return
    if code == "M221":
        if given is not None:
            _set_flow(block, given.value / 100.0)
        return
    modal = block.modal
    # Marlin's order: store, restore, set (M220.cpp)
    kept = modal.pace if "B" in words else modal.kept_pace
    pace = kept if "R" in words else modal.pace
    block.change(kept_pace=kept, pace=pace if given is None else given.value / 100.0)


def _set_flow(block: BlockState, flow: float) -> None:
    """Set the factor of E, with E's zero moved so that its coordinate stays: only later moves are scaled."""
    extruder, frame = block.setup.machine.dialect.extruder, block.frame
    assert extruder is not None  # without one M221 does not act
    if flow == block.modal.flow:
        return
    pushed = frame.coordinates(block.commanded.positions)[extruder]
    zero = frame.g92.get(extruder, 0.0) + pushed - pushed / block.modal.flow * flow
    block.frame = msgspec.structs.replace(frame, g92={**frame.g92, extruder: zero})
    block.change(flow=flow)
