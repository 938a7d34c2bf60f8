"""Set offsets of work coordinate systems: G10 L2 and L20, G52, G92 (D-62 to D-64)."""

from __future__ import annotations

import math

import msgspec

from mcserver.gcode.profiles.directions import along
from mcserver.gcode.profiles.frame import Offsets
from mcserver.gcode.profiles.transforming import linear
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_places import axis_values
from mcserver.gcode.text.profile_words import Action
from mcserver.machine.work_systems import ANGLE


def refuse_other_offset(block: BlockState, action: Action, other: Offsets, hint: str) -> None:
    """Refuse G52 beside G92: LinuxCNC has one offset for both, Fanuc's controllers two."""
    if any(other.values()) and not block.setup.machine.dialect.fanuc:
        shown = "G52 and G92 are one offset on LinuxCNC's controllers and two on Fanuc's"
        block.faults.add("MC186", shown, action.span, hint)


def set_g92(block: BlockState, action: Action) -> None:
    """Set the offsets of G92 so that positions read as its axis words say (D-63)."""
    refuse_other_offset(block, action, block.frame.local, "write G52 with words of 0 ahead of it")
    offsets = {} if not action.axes else dict(block.frame.g92)
    values = axis_values(block, action)
    if not action.axes and block.setup.machine.dialect.profile == "printer":
        values = dict.fromkeys(sorted(block.setup.leased), 0.0)
    elif not action.axes:
        block.faults.add("MC118", "G92 names no axis", action.span, "add axis words, such as G92 X0")
    without = msgspec.structs.replace(block.frame, g92={}).coordinates(block.commanded.positions)
    extruder = block.setup.machine.dialect.extruder
    for axis, value in values.items():
        offsets[axis] = without[axis] - (value * block.modal.flow if axis == extruder else value)
    block.frame = msgspec.structs.replace(block.frame, g92=offsets, g92_on=True)


def set_system(block: BlockState, action: Action) -> None:
    """Set the origin of a work coordinate system: G10 L2 directly, L20 by what the position is to read."""
    frame = block.frame
    kind = action.words["L"].value
    chosen = action.words.get("P")
    number = frame.system if chosen is None or chosen.value == 0 else int(chosen.value)
    fanuc = block.setup.machine.dialect.fanuc
    if fanuc and kind == 2.0 and chosen is not None and chosen.value == 0.0:
        block.faults.add(
            "MC141",
            "G10 L2 P0 sets the offset of all systems on Fanuc's controllers",
            action.span,
            "write G10 L2 with the number of a system, P1 to P6 for G54 to G59",
        )
        return
    if fanuc and kind == 20.0:
        # the page, mcctl and probing cycles set the zero with it
        block.faults.add(
            "MC199",
            "G10 L20 sets the origin by what the position reads then; on Fanuc's controllers it sets G54.1",
            action.span,
            "for an origin by itself write G10 L2 with the number of a system, P1 to P6 for G54 to G59",
            severity="warning",
        )
    angle = action.words.get("R")
    if kind not in (2.0, 20.0) or (angle is not None and kind == 20.0):
        block.faults.add(
            "MC141",
            "of G10 only L1 (tools of a machining centre), L2 and L20 set something, and L20 no angle R",
            action.span,
            "G10 L2 Pn sets a work coordinate system, R its angle; L1 Pn Z… R… a tool's length and radius",
        )
        return
    if chosen is not None and (chosen.value != int(chosen.value) or not 0 <= chosen.value <= 9):
        block.faults.add(
            "MC143", f"P{chosen.text} is no work coordinate system", chosen.span, "P1 is G54, P9 G59.3"
        )
        return
    if not action.axes and angle is None:
        block.faults.add(
            "MC118", "G10 names no axis", action.span, f"add axis words, such as G10 L20 P{number} X0"
        )
    origin = dict(frame.systems.get(number, {}))
    inner = frame.inner
    if angle is not None and number == frame.system and (inner.get(0) or inner.get(1)):
        block.faults.add(
            "MC174",
            "an offset of G92 or G52 counts, which controllers leave behind when its system is turned",
            angle.span,
            "write G92.1 or G52 X0 Y0 before it, and the offset again behind it",
        )
    elif angle is not None and linear(block, action, (0, 1)):
        # an angle is set, not added, under G91 too (LinuxCNC)
        origin[ANGLE] = math.radians(angle.value)
    values = axis_values(block, action)
    if kind == 2.0 and values and block.modal.incremental and not block.setup.machine.dialect.fanuc:
        block.faults.add(
            "MC186",
            "under G91 G10 L2 sets the origin on LinuxCNC's controllers and adds to it on Fanuc's",
            action.span,
            "write G90 ahead of it",
        )
    if kind == 2.0:
        for axis, value in values.items():
            origin[axis] = value + (origin.get(axis, 0.0) if block.modal.incremental else 0.0)
    else:
        chosen_frame = msgspec.structs.replace(frame, system=number)
        reads = chosen_frame.coordinates(block.commanded.positions)
        by = {axis: reads[axis] - value for axis, value in values.items()}
        for axis, distance in along(chosen_frame.directions, by).items():
            origin[axis] = origin.get(axis, 0.0) + distance
    block.frame = msgspec.structs.replace(frame, systems={**frame.systems, number: origin})
