"""Show a modal state as the codes that set it."""

from __future__ import annotations

from mcserver.gcode.semantics.modal import ModalState
from mcserver.machine.work_systems import SYSTEM_NUMBERS


def modal_codes(modal: ModalState) -> list[str]:
    """Return the codes in force, units first, such as ``G21 G90 G94 F600 G64 G54``; a tool as ``T3``."""
    codes = [
        "G20" if modal.inch else "G21",
        "G91" if modal.incremental else "G90",
        "G93" if modal.inverse_time else "G95" if modal.per_turn else "G94",
    ]
    if modal.feed is not None:
        codes.append(f"F{modal.feed.number:g}")
    for code, factor in (("M220", modal.pace), ("M221", modal.flow)):
        if factor != 1.0:
            codes.append(f"{code} S{100.0 * factor:g}")
    if modal.advance is not None:
        codes.append(f"M900 K{modal.advance:g}")
    codes.append("G61" if modal.exact_stop else "G64")
    if modal.plane is not None:
        codes.append(f"G{modal.plane}")
    if modal.diameter:
        codes.append("G7")
    frame = modal.frame
    if frame is not None:
        codes.append({number: name for name, number in SYSTEM_NUMBERS.items()}[frame.system])
        if frame.plane is not None:
            codes.append("G68.2")
        if frame.tip_tool is not None:
            codes.append(frame.tip_code)
        elif frame.tool_length:
            codes.append("G43")
        if frame.tool:
            codes.append(f"T{frame.tool}")
        if frame.surface is not None:
            codes.append("G96")
        elif frame.spindle_rpm:
            codes.append(f"S{frame.spindle_rpm:g}")
    if modal.tool is not None:
        codes.append(f"T{modal.tool}")
    return codes
