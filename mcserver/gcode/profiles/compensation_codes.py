"""Begin and end cutter compensation: G40, G41, G42, G41.1, G42.1 (D-85)."""

from __future__ import annotations

import msgspec

from mcserver.gcode.profiles.codes import COMPENSATING
from mcserver.gcode.profiles.frame import tool_table
from mcserver.gcode.profiles.tool_codes import refuse_unknown_tool, tool_number
from mcserver.gcode.semantics.arc_plane import PLANES
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.compensation_state import Compensation
from mcserver.gcode.semantics.program_units import axis_scale
from mcserver.gcode.text.profile_words import Action
from mcserver.units import AxisType


def begin_compensation(block: BlockState, action: Action) -> None:
    """Begin cutter compensation, with the diameter of a tool of the table or of the word D (D-85)."""
    plane = PLANES[block.modal.plane or 17]
    before = block.compensation
    if before is not None and (before.side or before.held is not None):
        block.faults.add(
            "MC170",
            f"cutter compensation is on since line {before.line}",
            action.span,
            "write G40 and a straight move first",
        )
        return
    if not block.transformation.in_plane(plane):
        block.faults.add(
            "MC185",
            f"cutter compensation in a plane that is skew to the axes does not go together with "
            f"{block.transformation.names}",
            action.span,
            "let the CAM compute the tool's own path",
        )
        return
    profiled = [axis for axis in plane if axis not in block.setup.axes or block.setup.axes[axis].profiled]
    if profiled:
        block.faults.add("MC138", f"axis {profiled[0]} follows no path", action.span, "", axis=profiled[0])
        return
    diameter = _diameter(block, action)
    mirrored = block.transformation.mirrors(plane) != block.transformation.reverses(plane)
    if diameter is not None:
        place = None if before is None else before.place
        block.compensation = Compensation(
            -COMPENSATING[action.code] if mirrored else COMPENSATING[action.code],
            diameter / 2.0,
            plane,
            block.parsed.number,
            place,
        )


def end_compensation(block: BlockState) -> None:
    """End cutter compensation: the next move in the plane is the lead-out."""
    before = block.compensation
    if before is not None:
        on_path = before.held is None and before.place is None
        block.compensation = None if on_path else msgspec.structs.replace(before, side=0)


def _diameter(block: BlockState, action: Action) -> float | None:
    """Return a cutter's diameter [m], or report why there is none."""
    word = action.words.get("D")
    if action.code.endswith(".1"):
        if word is None or word.value <= 0.0:
            block.faults.add(
                "MC118", f"{action.code} needs D, the cutter's diameter", action.span, "such as D6"
            )
            return None
        return word.value * axis_scale(AxisType.LINEAR, block.modal.inch)
    number = tool_number(block, word)
    if number is None:
        return None
    cutter = tool_table(block.setup.machine, block.frame).get(number)
    if cutter is None:
        refuse_unknown_tool(block, number, action if word is None else word)
    elif cutter.diameter <= 0.0:
        block.faults.add(
            "MC143",
            f"the tool table has no diameter of tool {number}",
            action.span if word is None else word.span,
            f"send G10 L1 P{number} R… with its radius, or add diameter_mm to its [[cutter]]",
        )
    else:
        return cutter.diameter
    return None
