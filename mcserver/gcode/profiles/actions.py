"""Carry out what a profile's line says beside the reference's words (D-62 to D-66, D-75)."""

from __future__ import annotations

import math

import msgspec

from mcserver.gcode.profiles.codes import (
    ACTING,
    COMPENSATING,
    DRILLING,
    IO_WORDS,
    PRINTER_STOPS,
    PROBING,
    RETRACTING,
    SPINDLE,
    SPINDLE_SPEEDS,
    SPLINES,
    SYSTEM_NUMBERS,
    TAKES_AXES,
    THREADING,
    TOOL_LENGTHS,
    TRANSFORMING,
)
from mcserver.gcode.profiles.cycle_motion import CycleMotion
from mcserver.gcode.profiles.directions import along, coupled
from mcserver.gcode.profiles.drilling import drill
from mcserver.gcode.profiles.frame import ANGLE, LENGTH_AXIS, Frame, Offsets, tool_table
from mcserver.gcode.profiles.io_codes import read_io, read_mapped
from mcserver.gcode.profiles.nurbs import add_control_point
from mcserver.gcode.profiles.probing import read_probe_move
from mcserver.gcode.profiles.retraction import retract
from mcserver.gcode.profiles.splines import read_spline
from mcserver.gcode.profiles.surface_speed import choose_speed, set_surface_speed, spindle_group
from mcserver.gcode.profiles.threading import orient, read_threads
from mcserver.gcode.profiles.transforming import end_transformation, linear, transform
from mcserver.gcode.semantics.arc_plane import PLANES
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.compensation_state import Compensation
from mcserver.gcode.semantics.modal import apply_setting
from mcserver.gcode.semantics.program_places import ends_of, given_by, stored_end
from mcserver.gcode.semantics.program_units import (
    axis_scale,
    motor_rpm,
    shown_number,
    shown_position,
)
from mcserver.gcode.semantics.rapids import rapid_group
from mcserver.gcode.semantics.tilted_planes import end_plane, face, tilt
from mcserver.gcode.semantics.tip_moves import lead_by_tip
from mcserver.gcode.semantics.travel_limits import ROUNDING
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.machine.dialect_section import Cutter
from mcserver.motion.canonical import (
    Canonical,
    DwellGroup,
    EndLine,
    Group,
    InputLine,
    MotionLine,
    PauseLine,
    WaitMode,
)
from mcserver.motion.thread_cam import stopping_seconds
from mcserver.units import TURN, AxisType

# the greatest number of a tool, as of [[cutter]]
MAX_CUTTER = 99999
# a computed number is a whole one where it differs by less (LinuxCNC)
WHOLE = 0.0001


class Effects(msgspec.Struct):
    """What the actions of a line give to motion.

    Attributes:
        before: values ahead of the line's motion. groups: start together with it. after: behind it.
    """

    before: list[Canonical] = []
    groups: list[Group] = []
    after: list[Canonical] = []


def act_before(block: BlockState, actions: tuple[Action, ...], effects: Effects) -> None:
    """Carry out what comes ahead of a line's settings and motion."""
    began = block.frame
    spindle = False
    # which speed S gives is known before S is read
    for action in actions:
        if action.code in SPINDLE_SPEEDS:
            choose_speed(block, action, stops=any(each.code == "M5" for each in actions))
            spindle = True
    for action in actions:
        code = action.code
        frame = block.frame
        if code in TAKES_AXES:
            continue
        if code == "S":
            spindle = True
            speed = _value(block, action, "S", least=0.0)
            if frame.surface is not None:
                if speed > 0.0:
                    set_surface_speed(block, frame.surface, speed)
                else:
                    block.faults.add(
                        "MC203", "a surface speed of 0 turns no spindle", action.span, "write M5"
                    )
                continue
            block.frame = msgspec.structs.replace(frame, spindle_rpm=speed)
            _follow_speed(block, action, actions, effects)
        elif code in SPINDLE:
            spindle = True
            _refuse_unmapped(block, action)
            block.frame = msgspec.structs.replace(frame, direction={"M3": 1, "M4": -1, "M5": 0}[code])
            _set_mapped(block, action, block.frame.spindle_rpm, effects)
        elif code in IO_WORDS:
            done = read_io(block, action)
            if done is not None:
                effects.before.append(done)
        elif code in block.setup.machine.dialect.mapped:
            word = action.words.get("S", action.words.get("R"))
            _set_mapped(block, action, None if word is None else word.value, effects)
        elif code == "T":
            _choose_tool(block, action.words["T"])
        elif code in ("M6", "M61"):
            _change_tool(block, action, effects)
        elif code in PRINTER_STOPS:
            notice = PRINTER_STOPS[code]
            effects.before.append(
                PauseLine(block.parsed.number, notice) if notice else EndLine(block.parsed.number)
            )
        elif code == "G4":
            _dwell(block, action, effects)
        elif code in SYSTEM_NUMBERS:
            block.frame = msgspec.structs.replace(frame, system=SYSTEM_NUMBERS[code])
        elif code in TOOL_LENGTHS:
            _tool_length(block, action)
        elif code in ("M82", "M83"):
            letters = block.setup.machine.dialect.letters if code == "M83" else {}
            block.change(relative=tuple(axis for letter, axis in letters.items() if letter not in "UVW"))
        elif code in ("G90.1", "G91.1"):
            block.change(absolute_centres=code == "G90.1")
        elif code in ("G7", "G8"):
            block.change(diameter=code == "G7")
        elif code == "G95":
            block.modal = apply_setting(95, block.modal)
        elif code == "G40":
            _switch_off(block)
        elif code in COMPENSATING:
            _switch_on(block, action)
        elif code in ("G98", "G99"):
            block.frame = msgspec.structs.replace(frame, to_initial=code == "G98")
        elif code in TRANSFORMING:
            end_transformation(block, action, frozenset(each.code for each in actions))
            if code == "G69":
                end_plane(block)
        elif code == "G80":
            # no motion code is in force behind it, nor is a cycle
            block.end_motion_code()
        elif code in ("G92.1", "G92.2", "G92.3"):
            _one_offset(block, action, frame.local, "write G52 with words of 0 ahead of it")
            kept: Offsets = {} if code == "G92.1" else frame.g92
            block.frame = msgspec.structs.replace(frame, g92=kept, g92_on=code != "G92.2")
    if spindle:
        _turn_spindle(block, began, actions, effects)


def act_after(block: BlockState, actions: tuple[Action, ...], effects: Effects) -> None:
    """Carry out the codes with axis words of their own, behind the line's settings."""
    for action in actions:
        if action.code == "G92":
            _set_g92(block, action)
        elif action.code == "G52":
            _one_offset(block, action, block.frame.g92, "write G92.1 ahead of it")
            local = dict(block.frame.local)
            for axis, value in _axis_values(block, action):
                local[axis] = value
            block.frame = msgspec.structs.replace(block.frame, local=local)
        elif action.code == "G10":
            _set_system(block, action)
        elif action.code == "G43.1":
            _set_tool_length(block, action)
        elif action.code in ("G28.1", "G30.1"):
            stored = {**block.frame.stored, int(action.code[1:3]): dict(block.commanded.positions)}
            block.frame = msgspec.structs.replace(block.frame, stored=stored)
        elif action.code in ("G28", "G30"):
            _go_home(block, action, effects)
        elif action.code in DRILLING or action.code == "REPEAT":
            effects.after += drill(block, action)
        elif action.code in TRANSFORMING:
            transform(block, action)
        elif action.code in RETRACTING.values():
            effects.after += retract(block, action)
        elif action.code == "G68.2":
            tilt(block, action)
        elif action.code == "G53.1":
            _rapid(block, action, face(block, action), effects)
        elif action.code in THREADING:
            effects.after += read_threads(block, action)
        elif action.code == "M19":
            effects.after += orient(block, action)
        elif action.code == "G5.2":
            add_control_point(block, action)
        elif action.code in SPLINES:
            curve = read_spline(block, action)
            effects.after += [] if curve is None else [curve]
        elif action.code in PROBING:
            probe = read_probe_move(block, action)
            if probe is not None:
                effects.after.append(probe)


def act_at_end(block: BlockState) -> list[Canonical]:
    """Return what M2 and M30 do to outputs: M5 and M9, where the machine file maps them (D-73)."""
    whole = (1, len(block.parsed.text) + 1)
    return [each for code in ("M5", "M9") for each in read_mapped(block, code, Action(code, whole, {}), 0.0)]


def _refuse_unmapped(block: BlockState, action: Action) -> None:
    """Refuse a code of a spindle that outputs switch by others: it would go on as it was."""
    dialect = block.setup.machine.dialect
    mapped = sorted(SPINDLE & dialect.outputs.keys())
    if mapped and dialect.spindle is None and action.code not in mapped:
        block.faults.add(
            "MC141",
            f"{action.code} switches no output here, {' and '.join(mapped)} do{'es' * (len(mapped) == 1)}",
            action.span,
            f"give it one in the machine file, under [dialect.outputs]: {action.code} = {{ ... }}",
        )


def _set_mapped(block: BlockState, action: Action, speed: float | None, effects: Effects) -> None:
    effects.before += read_mapped(block, action.code, action, speed)
    wait = block.setup.machine.dialect.waits.get(action.code)
    if wait is not None:
        number = block.parsed.number
        # what the input says right away may still be of the value before
        if wait.settle > 0.0:
            effects.before.append(MotionLine(number, (DwellGroup(wait.settle),)))
        effects.before.append(InputLine(number, wait.column, WaitMode.HIGH, wait.timeout))


def _follow_speed(block: BlockState, action: Action, actions: tuple[Action, ...], effects: Effects) -> None:
    """Let outputs that follow S do so while the spindle turns; a line with M3 to M5 does it there."""
    frame = block.frame
    if frame.direction == 0 or any(each.code in SPINDLE for each in actions):
        return
    code = "M3" if frame.direction > 0 else "M4"
    effects.before += read_mapped(block, code, action, frame.spindle_rpm, only_speed=True)


def _value(block: BlockState, action: Action, letter: str, least: float = -math.inf) -> float:
    word = action.words[letter]
    if word.value < least:
        block.faults.add("MC116", f"{letter}{word.text} is below {least:g}", word.span, "")
        return least
    return word.value


def _axis_values(block: BlockState, action: Action) -> list[tuple[int, float]]:
    """Return the action's axis words in SI; a faulty one is reported and left out."""
    found: dict[int, float] = {}
    for word in action.axes:
        axis = block.setup.axes.get(word.axis)
        if axis is None:
            block.faults.add("MC108", f"the machine has no axis {word.axis}", word.span, "", axis=word.axis)
        elif word.axis in found:
            block.faults.add(
                "MC111", f"{word.letter} stands twice in one command", word.span, "keep one of them"
            )
        else:
            found[word.axis] = word.value * axis_scale(axis.type, block.modal.inch)
    return list(found.items())


def _one_offset(block: BlockState, action: Action, other: Offsets, hint: str) -> None:
    """Refuse G52 beside G92: LinuxCNC has one offset for both, Fanuc's controllers have two."""
    if any(other.values()) and block.setup.machine.dialect.macros != "fanuc":
        shown = "G52 and G92 are one offset on LinuxCNC's controllers and two on Fanuc's"
        block.faults.add("MC186", shown, action.span, hint)


def _set_g92(block: BlockState, action: Action) -> None:
    _one_offset(block, action, block.frame.local, "write G52 with words of 0 ahead of it")
    offsets = {} if not action.axes else dict(block.frame.g92)
    values = _axis_values(block, action)
    if not action.axes and block.setup.machine.dialect.profile == "printer":
        values = [(axis, 0.0) for axis in sorted(block.setup.leased)]
    elif not action.axes:
        block.faults.add("MC118", "G92 names no axis", action.span, "add axis words, such as G92 X0")
    without = msgspec.structs.replace(block.frame, g92={}).coordinates(block.commanded.positions)
    for axis, value in values:
        offsets[axis] = without[axis] - value
    block.frame = msgspec.structs.replace(block.frame, g92=offsets, g92_on=True)


def _set_system(block: BlockState, action: Action) -> None:
    """Set the origin of a work coordinate system: G10 L2 by itself, L20 by what the position reads then."""
    frame = block.frame
    kind = action.words["L"].value
    if kind == 1.0 and "G43" in ACTING[block.setup.machine.dialect.profile]:
        _set_cutter(block, action)
        return
    chosen = action.words.get("P")
    number = frame.system if chosen is None or chosen.value == 0 else int(chosen.value)
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
        # an angle is none to add to, under G91 neither (LinuxCNC)
        origin[ANGLE] = math.radians(angle.value)
    values = dict(_axis_values(block, action))
    if kind == 2.0 and values and block.modal.incremental and block.setup.machine.dialect.macros != "fanuc":
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


def _set_cutter(block: BlockState, action: Action) -> None:
    """Set a line of the tool table: P its number, Z its length, R its radius; what is left out stays."""
    chosen, radius = action.words.get("P"), action.words.get("R")
    if chosen is None or chosen.value != int(chosen.value) or not 1 <= chosen.value <= MAX_CUTTER:
        place = action.span if chosen is None else chosen.span
        block.faults.add(
            "MC143", f"G10 L1 needs the number of a tool, 1 to {MAX_CUTTER}", place, "such as G10 L1 P3 Z75.2"
        )
        return
    lengths = dict(_axis_values(block, action))
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
        _unknown_tool(block, number, chosen)
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


def _tool_length(block: BlockState, action: Action) -> None:
    frame = block.frame
    if action.code == "G49":
        block.frame = msgspec.structs.replace(frame, tool_length=0.0, tip_tool=None)
        return
    cutters = tool_table(block.setup.machine, block.frame)
    word = action.words.get("H")
    number = _tool_number(block, word)
    if number and number not in cutters:
        _unknown_tool(block, number, action if word is None else word)
    length = cutters[number].length if number is not None and number in cutters else 0.0
    block.frame = msgspec.structs.replace(frame, tool_length=length, tip_tool=None)
    if action.code == "G43.4":
        lead_by_tip(block, action)


def _set_tool_length(block: BlockState, action: Action) -> None:
    """Take the tool's length from the line itself (G43.1), a length along Z alone."""
    values = dict(_axis_values(block, action))
    if values.keys() != {LENGTH_AXIS}:
        block.faults.add(
            "MC118", "G43.1 takes a length along Z, and no other", action.span, "such as G43.1 Z75.2"
        )
        return
    length = values[LENGTH_AXIS]
    block.frame = msgspec.structs.replace(block.frame, tool_length=length, tip_tool=None)


def _choose_tool(block: BlockState, word: ProfileWord) -> None:
    number = _tool_number(block, word)
    if number is None:
        return
    cutters = tool_table(block.setup.machine, block.frame)
    if cutters and number and number not in cutters:
        _unknown_tool(block, number, word)
    block.frame = msgspec.structs.replace(block.frame, tool=number)


def _tool_number(block: BlockState, word: ProfileWord | None) -> int | None:
    """Return the number of a tool that a word gives, without one of the fitted tool; None after a fault."""
    if word is None:
        return block.frame.fitted
    number = round(word.value)
    if number < 0 or abs(word.value - number) > WHOLE:
        shown = f"{word.letter}{word.text} is no number of a tool"
        block.faults.add("MC116", shown, word.span, f"such as {word.letter}1")
        return None
    return number


def _unknown_tool(block: BlockState, number: int, word: ProfileWord | Action) -> None:
    known = ", ".join(str(each) for each in sorted(tool_table(block.setup.machine, block.frame))) or "none"
    block.faults.add(
        "MC143",
        f"the tool table has no tool {number}: its length is not known",
        word.span,
        f"send G10 L1 P{number} Z… with its length, or add [[cutter]] with number = {number} to the machine "
        f"file; there are {known}",
    )


def _switch_on(block: BlockState, action: Action) -> None:
    """Begin cutter compensation, by the diameter of a tool of the table or by that in D (D-85)."""
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
    number = _tool_number(block, word)
    if number is None:
        return None
    cutter = tool_table(block.setup.machine, block.frame).get(number)
    if cutter is None:
        _unknown_tool(block, number, action if word is None else word)
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


def _switch_off(block: BlockState) -> None:
    """End cutter compensation: the next move in the plane leads out."""
    before = block.compensation
    if before is not None:
        on_path = before.held is None and before.place is None
        block.compensation = None if on_path else msgspec.structs.replace(before, side=0)


def _change_tool(block: BlockState, action: Action, effects: Effects) -> None:
    """Pause for a change by hand if the tool differs from the one before; "ask" pauses at the first too.

    So does one whose life is used up: it is not taken to be a fresh one that stands there. M61 Q says which
    tool stands there.
    """
    rule = block.setup.machine.dialect.tool_change
    if action.code == "M61":
        if "Q" not in action.words:
            block.faults.add("MC118", "M61 does not say which tool is fitted", action.span, "such as M61 Q2")
            return
        _choose_tool(block, action.words["Q"])
        if block.frame.tool not in block.frame.worn:
            rule = "ignore"
    frame = block.frame
    known = frame.changed is not None or rule == "ask" or frame.tool in frame.worn
    if known and frame.changed != frame.tool and rule != "ignore":
        tool = f"fit tool {frame.tool}" if frame.tool else "take the tool out"
        effects.before.append(PauseLine(block.parsed.number, f"{tool}, then resume", frame.tool))
    block.frame = msgspec.structs.replace(frame, changed=frame.tool)


def _dwell(block: BlockState, action: Action, effects: Effects) -> None:
    number = block.parsed.number
    words = action.words
    seconds: float | None = None
    word: ProfileWord | None = None
    # S is seconds for printers; elsewhere it is the spindle's
    printer = block.setup.machine.dialect.profile == "printer"
    if (printer and "S" in words) or "X" in words:
        word = words["S"] if printer and "S" in words else words["X"]
        seconds = word.value
    elif "P" in words:
        word = words["P"]
        seconds = word.value * block.setup.machine.dialect.dwell_unit
    if seconds is None or word is None:
        if block.setup.machine.dialect.profile != "printer":
            block.faults.add(
                "MC118", "G4 does not say how long", action.span, "give seconds, such as G4 P2.5"
            )
    elif seconds < 0.0:
        block.faults.add("MC116", f"a dwell of {seconds:g} s is negative", word.span, "give 0 s or more")
    elif seconds > 0.0:
        effects.before.append(MotionLine(number, (DwellGroup(seconds),)))


def _turn_spindle(block: BlockState, began: Frame, actions: tuple[Action, ...], effects: Effects) -> None:
    index = block.setup.machine.dialect.spindle
    frame = block.frame
    if index is None:
        return
    place = next(action for action in actions if action.code in {"S", *SPINDLE, *SPINDLE_SPEEDS})
    # nobody is to take a spindle for turning or standing that this program does not reach
    axis = block.usable_axis(index, place)
    if axis is None:
        return
    group = spindle_group(block, frame, axis)
    (speed,) = group.velocities
    if abs(speed) > axis.max_velocity * (1.0 + 1e-9):
        most = motor_rpm(axis.max_velocity, axis.travel_per_motor_turn)
        block.faults.add(
            "MC202",
            f"S{frame.spindle_rpm:g} drives the spindle, axis {index}, beyond its max_velocity",
            place.span,
            f"its motor may turn at {shown_number(most)} RPM at most",
            axis=index,
        )
    block.commanded.invalidate((index,))
    starts = {action.code for action in actions} & {"M3", "M4"} - block.setup.machine.dialect.waits.keys()
    (before,) = spindle_group(block, began, axis).velocities
    if starts and speed != before:
        # no tool is to cut before its spindle has its speed; nothing but its acceleration says when that is
        motion = CycleMotion(block)
        motion.turn(index, speed, stopping_seconds(axis, abs(speed - before) / TURN), group.surface)
        effects.before[:0] = motion.lines
        return
    if any(isinstance(value, MotionLine | InputLine) for value in effects.before):
        # a dwell or a wait behind M3 lets the spindle come to speed
        effects.before.insert(0, MotionLine(block.parsed.number, (group,)))
    else:
        effects.groups.append(group)


def _go_home(block: BlockState, action: Action, effects: Effects) -> None:
    """Go by rapids to the point that the words give, then to the stored position of these axes."""
    modal = block.modal
    named = _axis_values(block, action)
    home = block.frame.stored.get(int(action.code[1:3]), {})
    transformation = block.transformation
    uncertain = transformation.changed | (transformation.unsettled if modal.incremental else frozenset())
    going = {axis for axis, value in named if value or not modal.incremental}
    through = {axis: block.commanded.positions[axis] for axis, _ in named}
    together = coupled(transformation.directions, frozenset(through))
    if not together <= through.keys():
        block.faults.add(
            "MC186",
            f"controllers differ in where {action.code} of one axis of a turned plane ends",
            action.span,
            f"name {' and '.join('XYZ'[axis] for axis in sorted(together & {0, 1, 2}))}, or go by G53 G0",
        )
    elif not transformation.coupled(uncertain).intersection(going):
        words = {word.axis: word for word in action.axes if word.axis in going}
        block.transformation = msgspec.structs.replace(transformation, unsettled=frozenset())
        through |= ends_of(block, given_by(block, words), action) or {}
    else:
        block.faults.add(
            "MC186",
            f"controllers differ in where {action.code} goes through here",
            action.span,
            f"write G91 {action.code} with words of 0, which goes straight to the stored position",
        )
    axes = [axis for axis, _ in named] or sorted(block.setup.machine.dialect.homed & block.setup.leased)
    # a printer's words name axes and no point on the way
    if block.setup.machine.dialect.profile != "printer":
        _rapid(block, action, through, effects)
    _rapid(block, action, {axis: stored_end(block, axis, home.get(axis, 0.0)) for axis in axes}, effects)
    block.transformation = transformation.without(axes)
    retracted = block.frame.retracted
    if retracted is not None and LENGTH_AXIS in axes:
        # a Z that is homed is lifted no longer (Marlin)
        kept = {axis: offset for axis, offset in retracted.items() if axis != LENGTH_AXIS}
        block.frame = msgspec.structs.replace(block.frame, retracted=kept)


def _rapid(block: BlockState, action: Action, targets: dict[int, float], effects: Effects) -> None:
    positions = block.commanded.positions
    targets = {axis: end for axis, end in targets.items() if abs(end - positions[axis]) > ROUNDING}
    starts = {index: block.commanded.start(index) for index in targets}
    for index, end in targets.items():
        axis = block.setup.axes[index]
        if not axis.min_position - ROUNDING <= end <= axis.max_position + ROUNDING:
            shown = shown_position(end, axis.type, block.modal.inch)
            block.faults.add(
                "MC201",
                f"{action.code} takes axis {index} to {shown}, beyond its travel",
                action.span,
                "stay within the axis's travel" if axis.type is AxisType.LINEAR else "",
                axis=index,
            )
        if block.usable_axis(index, action) is None:
            return
        block.end_at(index, end)
    if targets:
        group = rapid_group(block.setup, block.modal, starts, targets)
        effects.after.append(MotionLine(block.parsed.number, (group,), exact_stop=True))
