"""Execute the actions of a profile's line: what it has besides words of the reference (D-60, D-61)."""

from __future__ import annotations

import math

import msgspec

from mcserver.gcode.profiles.advance_codes import set_advance
from mcserver.gcode.profiles.bed_mesh_codes import set_bed_mesh
from mcserver.gcode.profiles.codes import (
    ACTING,
    ADVANCE,
    BED_MESH,
    COMPENSATING,
    DRILLING,
    FACTORS,
    IO_WORDS,
    PRINTER_STOPS,
    PROBING,
    RETRACTING,
    SPINDLE,
    SPINDLE_SPEEDS,
    SPLINES,
    TAKES_AXES,
    THREADING,
    TOOL_LENGTHS,
    TRANSFORMING,
)
from mcserver.gcode.profiles.compensation_codes import begin_compensation, end_compensation
from mcserver.gcode.profiles.cycle_motion import CycleMotion, check_travel
from mcserver.gcode.profiles.directions import coupled
from mcserver.gcode.profiles.drilling import drill
from mcserver.gcode.profiles.factors import set_factor
from mcserver.gcode.profiles.frame import LENGTH_AXIS, Frame, Offsets
from mcserver.gcode.profiles.io_codes import read_io, read_mapped
from mcserver.gcode.profiles.nurbs import add_control_point
from mcserver.gcode.profiles.offset_codes import refuse_other_offset, set_g92, set_system
from mcserver.gcode.profiles.probing import read_probe_move
from mcserver.gcode.profiles.retraction import retract
from mcserver.gcode.profiles.splines import read_spline
from mcserver.gcode.profiles.surface_speed import choose_speed, set_surface_speed, spindle_group
from mcserver.gcode.profiles.threading import orient, read_threads
from mcserver.gcode.profiles.tool_codes import change_tool, choose_length, choose_tool, set_cutter, set_length
from mcserver.gcode.profiles.transforming import end_transformation, transform
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.modal import apply_setting
from mcserver.gcode.semantics.program_places import axis_values, ends_of, given_by, stored_end
from mcserver.gcode.semantics.rapids import rapid_group
from mcserver.gcode.semantics.tilted_planes import end_plane, face, tilt
from mcserver.gcode.semantics.travel_limits import ROUNDING, check_speed
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.machine.work_systems import SYSTEM_NUMBERS
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
from mcserver.units import TURN


class Effects(msgspec.Struct):
    """Values that the actions of a line add to its motion.

    Attributes:
        before: ahead of the line's motion. groups: start together with it. after: after it.
    """

    before: list[Canonical] = []
    groups: list[Group] = []
    after: list[Canonical] = []


def act_before(block: BlockState, actions: tuple[Action, ...], effects: Effects) -> None:
    """Execute actions that precede the line's settings and motion."""
    began = block.frame
    spindle = False
    # G96 and G97 first: they decide how S is read
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
            choose_tool(block, action.words["T"])
        elif code in ("M6", "M61"):
            effects.before += change_tool(block, action)
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
            choose_length(block, action)
        elif code in ("M82", "M83"):
            letters = block.setup.machine.dialect.letters if code == "M83" else {}
            block.change(relative=tuple(axis for letter, axis in letters.items() if letter not in "UVW"))
        elif code in FACTORS:
            set_factor(block, action)
        elif code in ADVANCE:
            set_advance(block, action)
        elif code in ("G90.1", "G91.1"):
            block.change(absolute_centres=code == "G90.1")
        elif code in ("G7", "G8"):
            block.change(diameter=code == "G7")
        elif code == "G95":
            block.modal = apply_setting(95, block.modal)
        elif code == "G40":
            end_compensation(block)
        elif code in COMPENSATING:
            begin_compensation(block, action)
        elif code in ("G98", "G99"):
            block.frame = msgspec.structs.replace(frame, to_initial=code == "G98")
        elif code in TRANSFORMING:
            end_transformation(block, action, frozenset(each.code for each in actions))
            if code == "G69":
                end_plane(block)
        elif code == "G80":
            # afterwards no motion code or cycle is in force
            block.end_motion_code()
        elif code in ("G92.1", "G92.2", "G92.3"):
            refuse_other_offset(block, action, frame.local, "write G52 with words of 0 ahead of it")
            kept: Offsets = {} if code == "G92.1" else frame.g92
            block.frame = msgspec.structs.replace(frame, g92=kept, g92_on=code != "G92.2")
    if spindle:
        _turn_spindle(block, began, actions, effects)


def act_after(block: BlockState, actions: tuple[Action, ...], effects: Effects) -> None:
    """Execute codes with axis words of their own, after the line's settings."""
    for action in actions:
        if action.code == "G92":
            set_g92(block, action)
        elif action.code == "G52":
            refuse_other_offset(block, action, block.frame.g92, "write G92.1 ahead of it")
            local = {**block.frame.local, **axis_values(block, action)}
            block.frame = msgspec.structs.replace(block.frame, local=local)
        elif action.code == "G10":
            of_tool = action.words["L"].value == 1.0 and "G43" in ACTING[block.setup.machine.dialect.profile]
            (set_cutter if of_tool else set_system)(block, action)
        elif action.code == "G43.1":
            set_length(block, action)
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
        elif action.code in BED_MESH:
            effects.after += set_bed_mesh(block, action)
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
    """Return the output changes of M2 and M30: M5 and M9, if the machine file maps them (D-73)."""
    whole = (1, len(block.parsed.text) + 1)
    return [each for code in ("M5", "M9") for each in read_mapped(block, code, Action(code, whole, {}), 0.0)]


def _refuse_unmapped(block: BlockState, action: Action) -> None:
    """Refuse a spindle code without outputs beside mapped ones: the spindle would continue as it was."""
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
        # otherwise the input may still show the value from before
        if wait.settle > 0.0:
            effects.before.append(MotionLine(number, (DwellGroup(wait.settle),)))
        effects.before.append(InputLine(number, wait.column, WaitMode.HIGH, wait.timeout))


def _follow_speed(block: BlockState, action: Action, actions: tuple[Action, ...], effects: Effects) -> None:
    """Set outputs that follow S while the spindle turns; on a line with M3 to M5 that code sets them."""
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


def _dwell(block: BlockState, action: Action, effects: Effects) -> None:
    number = block.parsed.number
    words = action.words
    seconds: float | None = None
    word: ProfileWord | None = None
    # S is seconds for printers; in other profiles it is the spindle's
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
    # refuse a spindle that the program may not use: it must not be believed to turn or stand
    axis = block.usable_axis(index, place)
    if axis is None:
        return
    group = spindle_group(block, frame, axis)
    (speed,) = group.velocities
    what = f"S{frame.spindle_rpm:g} drives the spindle, axis {index},"
    check_speed(block, axis, speed, what, place)
    block.commanded.invalidate((index,))
    starts = {action.code for action in actions} & {"M3", "M4"} - block.setup.machine.dialect.waits.keys()
    (before,) = spindle_group(block, began, axis).velocities
    if starts and speed != before:
        # wait until the spindle has its speed before a tool cuts; only its acceleration tells how long
        motion = CycleMotion(block)
        motion.turn(index, speed, stopping_seconds(axis, abs(speed - before) / TURN), group.surface)
        effects.before[:0] = motion.lines
        return
    if any(isinstance(value, MotionLine | InputLine) for value in effects.before):
        # a dwell or wait after M3 lets the spindle come to speed
        effects.before.insert(0, MotionLine(block.parsed.number, (group,)))
    else:
        effects.groups.append(group)


def _go_home(block: BlockState, action: Action, effects: Effects) -> None:
    """Move by rapids to the point that the words give, then to the stored position of these axes."""
    modal = block.modal
    named = axis_values(block, action)
    home = block.frame.stored.get(int(action.code[1:3]), {})
    transformation = block.transformation
    uncertain = transformation.changed | (transformation.unsettled if modal.incremental else frozenset())
    going = {axis for axis, value in named.items() if value or not modal.incremental}
    through = {axis: block.commanded.positions[axis] for axis in named}
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
    axes = list(named) or sorted(block.setup.machine.dialect.homed & block.setup.leased)
    # a printer's words only name axes
    if block.setup.machine.dialect.profile != "printer":
        _rapid(block, action, through, effects)
    _rapid(block, action, {axis: stored_end(block, axis, home.get(axis, 0.0)) for axis in axes}, effects)
    block.transformation = transformation.without(axes)
    if LENGTH_AXIS in axes:
        # homing Z ends its lift (Marlin)
        block.frame = block.frame.unlifted


def _rapid(block: BlockState, action: Action, targets: dict[int, float], effects: Effects) -> None:
    positions = block.commanded.positions
    targets = {axis: end for axis, end in targets.items() if abs(end - positions[axis]) > ROUNDING}
    starts = {index: block.commanded.start(index) for index in targets}
    for index, end in targets.items():
        check_travel(block, index, end, action, action.code)
        if block.usable_axis(index, action) is None:
            return
        block.end_at(index, end)
    if targets:
        group = rapid_group(block.setup, block.modal, starts, targets)
        effects.after.append(MotionLine(block.parsed.number, (group,), exact_stop=True))
