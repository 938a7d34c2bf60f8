"""Codes of faults at run time; docs/executor.md has a remedy for each."""

from __future__ import annotations

import enum
from collections.abc import Sequence

from mcserver.drives.bus import DriveFault
from mcserver.drives.cia402.emergency_codes import emergency_text
from mcserver.drives.servosila.codec import fault_bits_text


class FaultCode(enum.IntEnum):
    """Numbers behind ``MC`` in FAULT events."""

    EMERGENCY_STOP = 400
    NOT_ENERGIZED = 401
    EXACT_STOP_TIMEOUT = 402
    AXIS_BUSY = 403
    SOFT_LIMIT = 404
    NO_ENERGIZE = 405
    NO_RESET = 406
    FOLLOWING_ERROR = 407
    SLOT_REFUSED = 408
    SETPOINT_JUMP = 409
    DRIVE_FAULT = 410
    DRIVE_SILENT = 411
    AXIS_LATCHED = 412
    SERVER_LOST = 413
    NO_REALTIME = 414
    OVER_TEMPERATURE = 415
    OVER_CURRENT = 416
    VOLTAGE = 417
    ENCODER = 418
    AXIS_NOT_LEASED = 419
    DRIVE_STATE_LOST = 420
    NO_TRAJECTORY = 421
    # 422 is the server's: the executor's process did not come up
    SPEED_AT_LIMIT = 423
    # 424 is a CAN bus's: it cannot be opened
    EMERGENCY_MESSAGE = 425
    DRIVE_REBOOTED = 426
    NOT_OPERATIONAL = 427
    HEARTBEAT_LOST = 428
    BUS_DOWN = 429
    MODE_REFUSED = 430
    MODE_NOT_CONFIGURED = 431
    DRIVE_MESSAGE = 432
    BUS_BACK = 433
    POSITION_LOST = 434
    NOT_OFF = 435
    HOMING_FAILED = 437
    SETPOINT_REFUSED = 438
    FOLLOWS_NO_PATH = 439
    INPUT_TIMEOUT = 440
    INTERLOCK_HOLD = 441
    INTERLOCK_STOP = 442
    IO_LOST = 444
    INTERLOCK_FREE = 447
    RUNAWAY = 448
    ZONE_HOLD = 449
    NOT_HOMED = 450
    SWITCH_NOT_FOUND = 451
    SWITCH_STUCK = 452
    INDEX_NOT_FOUND = 453
    STOP_NOT_FOUND = 454
    NO_HOMING = 455
    NO_CONTACT = 456
    PROBE_CLOSED = 457
    REFERENCE_MOVING = 458
    CYCLE_STALLED = 459
    ENVELOPE_POSITION = 460
    ENVELOPE_SPEED = 461
    ENVELOPE_TIP = 462
    ENVELOPE_TIME = 463
    ENVELOPE_COMMAND = 464
    TARGETS_LOST = 465
    SPINDLE_SPEED = 466
    THREAD_ERROR = 467
    SKEW = 468
    PAIR_MODE = 469
    BESIDE_CAM = 471
    OUT_OF_STEP = 472
    LEADER_LOST = 473
    COUPLED = 474
    WINDOW_LEFT = 475
    BED_TOO_FAR = 476
    BED_TOO_STEEP = 477
    TOOL_BEYOND = 478


class BarrierFault(Exception):
    """An entry cannot be done, or its barrier not be passed: the program is at fault."""

    def __init__(self, code: FaultCode, column: int, values: tuple[float, ...] = ()) -> None:
        super().__init__(code.name)
        self.code = code
        self.column = column
        self.values = values


# Codes that are reported and stop no program.
WARNINGS = frozenset(
    {
        FaultCode.NO_REALTIME,
        FaultCode.SPEED_AT_LIMIT,
        FaultCode.DRIVE_MESSAGE,
        FaultCode.BUS_BACK,
        FaultCode.INTERLOCK_HOLD,
        FaultCode.INTERLOCK_FREE,
        FaultCode.ZONE_HOLD,
        FaultCode.TARGETS_LOST,
    }
)


_OF_DRIVE = {
    DriveFault.OVER_TEMPERATURE: FaultCode.OVER_TEMPERATURE,
    DriveFault.OVER_CURRENT: FaultCode.OVER_CURRENT,
    DriveFault.VOLTAGE: FaultCode.VOLTAGE,
    DriveFault.ENCODER: FaultCode.ENCODER,
    DriveFault.FOLLOWING: FaultCode.FOLLOWING_ERROR,
    DriveFault.COMMUNICATION: FaultCode.DRIVE_SILENT,
    DriveFault.EMERGENCY: FaultCode.EMERGENCY_MESSAGE,
    DriveFault.REBOOTED: FaultCode.DRIVE_REBOOTED,
    DriveFault.NOT_OPERATIONAL: FaultCode.NOT_OPERATIONAL,
    DriveFault.HEARTBEAT: FaultCode.HEARTBEAT_LOST,
    DriveFault.BUS_DOWN: FaultCode.BUS_DOWN,
    DriveFault.MODE: FaultCode.MODE_REFUSED,
    DriveFault.NOT_CONFIGURED: FaultCode.MODE_NOT_CONFIGURED,
    DriveFault.POSITION_LOST: FaultCode.POSITION_LOST,
    DriveFault.HOMING_FAILED: FaultCode.HOMING_FAILED,
    DriveFault.SETPOINT: FaultCode.SETPOINT_REFUSED,
    DriveFault.RUNAWAY: FaultCode.RUNAWAY,
}


def code_of_drive_fault(fault: int) -> FaultCode:
    """Return the code that reports a value of `DriveFault`."""
    try:
        return _OF_DRIVE.get(DriveFault(fault), FaultCode.DRIVE_FAULT)
    except ValueError:
        return FaultCode.DRIVE_FAULT


def remedy_of(
    code: int,
    axis: int | str,
    values: Sequence[float] = (),
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
) -> tuple[str, str]:
    """Return a sentence and a hint for a FAULT event, from its code, axis number and values.

    Args:
        axis: its number, or a placeholder. inputs, outputs: names of the machine's.
    """
    message, hint = _TEXT.get(code, ("the executor reports a fault", "see docs/executor.md"))
    detail = int(values[1]) if len(values) > 1 and code in _DETAILED else 0
    name = "an input"
    if code in _OF_CHANNELS and values and 0 <= int(values[0]) < len(inputs) + len(outputs):
        column = int(values[0])
        kind = "input" if column < len(inputs) else "output"
        name = f'the {kind} "{[*inputs, *outputs][column]}"'
    seconds = values[0] if values else 0.0
    text = message.format(axis=axis, detail=_detail_text(code, detail), input=name, seconds=seconds)
    return text, hint.format(axis=axis, input=name)


# Faults whose first value is the column of an input or, counted after the inputs, of an output.
_OF_CHANNELS = frozenset(
    {
        FaultCode.INPUT_TIMEOUT,
        FaultCode.INTERLOCK_HOLD,
        FaultCode.INTERLOCK_STOP,
        FaultCode.INTERLOCK_FREE,
        FaultCode.ZONE_HOLD,
        FaultCode.IO_LOST,
    }
)


# Faults whose second value is an error code of the drive or of a standard.
_DETAILED = frozenset(
    {
        FaultCode.DRIVE_FAULT,
        FaultCode.DRIVE_SILENT,
        FaultCode.EMERGENCY_MESSAGE,
        FaultCode.DRIVE_MESSAGE,
        FaultCode.NOT_OPERATIONAL,
        FaultCode.SETPOINT_REFUSED,
        FaultCode.ENVELOPE_TIP,
    }
)


# by `mcserver.drives.cia402.profile_position.Refusal`
_REFUSALS = {
    1: "it was not acknowledged (bit 12 of the statusword)",
    2: "the acknowledgement of the one before was not taken back (bit 12 of the statusword)",
    3: "the target does not fit 32 bits",
}


def _detail_text(code: int, detail: int) -> str:
    if code == FaultCode.ENVELOPE_TIP:
        return str(detail)
    if code in (FaultCode.EMERGENCY_MESSAGE, FaultCode.DRIVE_MESSAGE):
        return f"{detail:04X}h, {emergency_text(detail)}"
    if code == FaultCode.NOT_OPERATIONAL:
        return {0x04: "stopped", 0x7F: "pre-operational"}.get(detail, f"{detail:02X}h")
    if code == FaultCode.SETPOINT_REFUSED:
        return _REFUSALS.get(detail, "refused")
    if code == FaultCode.DRIVE_SILENT:
        if detail < 0:
            return f": its process data come with {-detail - 1} bytes, which is not what was mapped"
        return f" for {detail} cycles" if detail else ""
    return f" (fault bits {fault_bits_text(detail)})" if detail else ""


_RESET_HINT = "find the cause, then clear the latch with G1000 P{axis} and energize with G1010 P{axis}"
_TEXT: dict[int, tuple[str, str]] = {
    FaultCode.EMERGENCY_STOP: (
        "the emergency stop is latched",
        "clear it with a reset, then energize with G1010",
    ),
    FaultCode.NOT_ENERGIZED: (
        "axis {axis} is not energized",
        "energize it with G1010 P{axis} before this line",
    ),
    FaultCode.EXACT_STOP_TIMEOUT: (
        "axis {axis} did not reach its target within the exact-stop time-out",
        "look for friction or a blocked axis, or widen in_position or exact_stop_timeout_s",
    ),
    FaultCode.AXIS_BUSY: (
        "axis {axis} is still in motion of its own as a coordinated motion begins",
        "this is a mistake of the planner: report it with the program",
    ),
    FaultCode.SOFT_LIMIT: (
        "axis {axis} would leave min_position … max_position",
        "keep the motion inside the axis's travel, or correct the limits in the machine file",
    ),
    FaultCode.NO_ENERGIZE: (
        "the drive of axis {axis} does not energize",
        "look at the drive's supply and enable input",
    ),
    FaultCode.NO_RESET: (
        "the drive of axis {axis} does not come to rest or clear its fault",
        "remove the cause of the fault at the drive, then reset again with G1000 P{axis}",
    ),
    FaultCode.NOT_OFF: (
        "the drive of axis {axis} goes on holding it although it was commanded to let go",
        "cut the drive's power, look at its enable input; then G1000 P{axis}",
    ),
    FaultCode.FOLLOWING_ERROR: ("the following error of axis {axis} is above its limit", _RESET_HINT),
    FaultCode.SLOT_REFUSED: (
        "a program was refused: its slot is busy, or another program has one of its axes",
        "wait for the other program to end",
    ),
    FaultCode.SETPOINT_JUMP: (
        "a jump of the setpoint of axis {axis} was refused",
        "this is a mistake of the planner: report it with the program",
    ),
    FaultCode.DRIVE_FAULT: ("the drive of axis {axis} reports a fault{detail}", _RESET_HINT),
    FaultCode.DRIVE_SILENT: (
        "the drive of axis {axis} does not answer{detail}",
        "check its cable and supply; " + _RESET_HINT,
    ),
    FaultCode.AXIS_LATCHED: ("axis {axis} is latched in a fault", "clear it with G1000 P{axis} first"),
    FaultCode.SERVER_LOST: ("the server's heartbeat stopped; motion was stopped", "restart the server"),
    FaultCode.NO_REALTIME: (
        "the executor runs without realtime priority",
        "give the service the right to SCHED_FIFO and locked memory; see mcserver doctor",
    ),
    FaultCode.OVER_TEMPERATURE: ("the drive of axis {axis} is too hot", "let it cool down; " + _RESET_HINT),
    FaultCode.OVER_CURRENT: ("the drive of axis {axis} reports too much current", _RESET_HINT),
    FaultCode.VOLTAGE: ("the drive of axis {axis} reports a wrong supply voltage", _RESET_HINT),
    FaultCode.ENCODER: ("the drive of axis {axis} reports a fault of its encoder", _RESET_HINT),
    FaultCode.AXIS_NOT_LEASED: (
        "axis {axis} does not belong to this program",
        "open the program with that axis",
    ),
    FaultCode.DRIVE_STATE_LOST: ("the drive of axis {axis} de-energized by itself", _RESET_HINT),
    FaultCode.SPEED_AT_LIMIT: (
        "axis {axis} was stopped on the end of its travel, and its speed command ended",
        "leave min_position and max_position out of the machine file for an axis that turns on and on",
    ),
    FaultCode.EMERGENCY_MESSAGE: (
        "the drive of axis {axis} sent the emergency message {detail}",
        "look the code up in the drive's manual; " + _RESET_HINT,
    ),
    FaultCode.DRIVE_REBOOTED: (
        "the drive of axis {axis} has started anew: it lost its power, its watchdog acted, or it was reset",
        "check its supply; once it is operational again " + _RESET_HINT,
    ),
    FaultCode.NOT_OPERATIONAL: (
        "the node of axis {axis} has left the state operational (NMT: {detail})",
        "another master may have stopped it, or the drive by itself; boot it again, then " + _RESET_HINT,
    ),
    FaultCode.HEARTBEAT_LOST: (
        "the heartbeat of the drive of axis {axis} has stopped",
        "check heartbeat_ms in the machine file and the drive's load; " + _RESET_HINT,
    ),
    FaultCode.BUS_DOWN: (
        "the bus of axis {axis} is away: interface or cable down, bus off, connection lost, no room to send",
        "check wiring, terminators and the interface (mcserver doctor); " + _RESET_HINT,
    ),
    FaultCode.MODE_REFUSED: (
        "the drive of axis {axis} does not show the commanded mode of operation",
        "see which modes it has (6502h); " + _RESET_HINT,
    ),
    FaultCode.MODE_NOT_CONFIGURED: (
        "the machine file lacks what axis {axis} needs for this command",
        "G1040 needs rated_torque (cia402) or codes.torque (servosila); "
        'G1030 needs pole_pairs or codes.rpm (servosila); drives with mode = "pp" have neither',
    ),
    FaultCode.DRIVE_MESSAGE: (
        "the drive of axis {axis} sent the emergency message {detail}",
        "nothing was stopped by it; look the code up in the drive's manual",
    ),
    FaultCode.BUS_BACK: (
        "the bus of axis {axis} and those beside it is there again",
        "its axes are latched: G1000, then G1010",
    ),
    FaultCode.POSITION_LOST: (
        "the encoder of axis {axis} jumped further than the axis can go: its position is not known any more",
        "bring the axis to a known place; " + _RESET_HINT,
    ),
    FaultCode.HOMING_FAILED: (
        "the drive of axis {axis} has not found its home position",
        "look at its switches and its homing method (6098h); " + _RESET_HINT,
    ),
    FaultCode.SETPOINT_REFUSED: (
        "the drive of axis {axis} did not take a set-point of profile position: {detail}",
        "look at its limits (607Dh) and its state in the maker's tool; " + _RESET_HINT,
    ),
    FaultCode.RUNAWAY: (
        "axis {axis} accelerated against the torque that was to hold it",
        "compare the signs of torque and position (invert, 607Eh, the motor's phases and its encoder), "
        "the load and max_torque; " + _RESET_HINT,
    ),
    FaultCode.FOLLOWS_NO_PATH: (
        'axis {axis} goes to points on its drive\'s own profiles (mode = "pp") and follows no path',
        "move it by G00 or G1020, or use a drive with csp or ip",
    ),
    FaultCode.INPUT_TIMEOUT: (
        "{input} did not become what the line waits for in time",
        "look at the sensor and its wiring, or give M66 a longer Q, or [dialect.waits] a longer for_s",
    ),
    FaultCode.INTERLOCK_HOLD: (
        "{input} holds all programs",
        "once it is as it should be, resume the programs",
    ),
    FaultCode.INTERLOCK_FREE: (
        "{input} holds the programs no longer",
        "they go on when they are resumed",
    ),
    FaultCode.ZONE_HOLD: (
        "{input} has switched on a zone that the program is about to come into",
        "once the zone is off, resume the program",
    ),
    FaultCode.INTERLOCK_STOP: (
        "{input} has stopped the machine like an emergency stop",
        "once it is as it should be, reset the machine, then energize with G1010",
    ),
    FaultCode.IO_LOST: (
        "the node of {input} is silent: its values are not known",
        "check its supply and cable; once it answers, start the program again",
    ),
    FaultCode.ENVELOPE_POSITION: (
        "axis {axis} would leave the extents that were approved for this run",
        "look at what has changed, simulate again, and ask for another approval",
    ),
    FaultCode.ENVELOPE_SPEED: (
        "axis {axis} would be faster than was approved for this run",
        "look at what has changed, simulate again, and ask for another approval",
    ),
    FaultCode.ENVELOPE_TIP: (
        "the tip of tool {detail} would leave the extents, or be faster, than was approved for this run",
        "look at what has changed, simulate again, and ask for another approval",
    ),
    FaultCode.ENVELOPE_TIME: (
        "the run takes longer than was approved, holds and pauses left out",
        "look at what it waits for, and ask for another approval",
    ),
    FaultCode.ENVELOPE_COMMAND: (
        "an approved run may not command axis {axis} like this (a torque, homing, a speed not shown)",
        "let an operator run it, or leave the command out and ask for another approval",
    ),
    FaultCode.NOT_HOMED: (
        "axis {axis} is not homed",
        "home it: mcctl home --all; with method manual or absolute say where it is: "
        "mcctl reference {axis} POSITION",
    ),
    FaultCode.SWITCH_NOT_FOUND: (
        "the home switch of axis {axis} did not come on the way to it",
        "look at direction, travel and invert in [axis.homing], and at the switch and its wiring",
    ),
    FaultCode.SWITCH_STUCK: (
        "the home switch of axis {axis} stays active where it should let go",
        "it is stuck, wired the other way round (invert), or longer than release_travel or back_off",
    ),
    FaultCode.INDEX_NOT_FOUND: (
        "the encoder of axis {axis} showed no index on the way",
        "look at the index signal; travel in [axis.homing] has to hold a turn of the motor",
    ),
    FaultCode.STOP_NOT_FOUND: (
        "axis {axis} met no hard stop: its torque stayed below that of [axis.homing]",
        "look at direction and travel, or give a smaller torque",
    ),
    FaultCode.NO_HOMING: (
        "axis {axis} has no homing of its own",
        "say where it is: mcctl reference {axis} POSITION",
    ),
    FaultCode.NO_CONTACT: (
        "the probing move ended and the probe did not change",
        "give a target beyond the surface, or use G38.3 or G38.5, which go on without contact",
    ),
    FaultCode.PROBE_CLOSED: (
        "the probe is in contact before a move towards contact, or not before one that is to leave it",
        "move the probe off first, look at its wiring, or set invert in [probe]",
    ),
    FaultCode.REFERENCE_MOVING: (
        "axis {axis} moves while its position was to be given",
        "let it come to rest, then give the reference again",
    ),
    FaultCode.CYCLE_STALLED: (
        "the cycle stalled: drives got no setpoint for {seconds:.3f} s, and motion was ended where it was",
        "see where the axes stand before going on; find what held the computer up (mcserver doctor); "
        "setpoint_timeout_s in the machine file is what the drives bridge",
    ),
    FaultCode.TARGETS_LOST: (
        "no targets came for {seconds:.3f} s, and the axes were stopped",
        "servo mode goes on by opening it anew; see what keeps the client or the network, or let targets "
        "count for longer",
    ),
    FaultCode.SPINDLE_SPEED: (
        "the spindle, axis {axis}, does not turn at its S: a thread was not begun within 10 s, or left",
        "look at the spindle's drive and load; a thread that was left is begun again at its first pass",
    ),
    FaultCode.THREAD_ERROR: (
        "the axes could not follow the spindle, axis {axis}, within thread_tolerance_mm",
        "its speed changes too fast, or is above 110 % of S: cut less deep, or look at the spindle's drive",
    ),
    FaultCode.SKEW: (
        "the two drives of axis {axis} are further apart than max_skew of its gantry",
        "see what holds one side back; sides that stay apart are switched off, squared by hand and homed",
    ),
    FaultCode.PAIR_MODE: (
        "axis {axis} is one of a gantry pair, which follows positions alone",
        "leave speeds (G1030) and torques (G1040) to other axes",
    ),
    FaultCode.BESIDE_CAM: (
        "axis {axis} does not stand where its cam has it, so it cannot be coupled",
        "bring it there by G00 before G1060; a leader that moves has to be where the cam stands",
    ),
    FaultCode.OUT_OF_STEP: (
        "axis {axis} is further from where its leader has it, or the tool that it moves, than the tolerance "
        "of its follow",
        "a slower leader, a lower ratio or a smoother cam, more max_acceleration or max_jerk, or a wider "
        "tolerance; near the end of a tool's reach a joint is too slow for it: work away from there",
    ),
    FaultCode.LEADER_LOST: (
        "axis {axis}, which another one follows, is off, at fault or silent",
        "see to its drive, then G1000, G1010, and couple again; G1061 comes before G1001",
    ),
    FaultCode.COUPLED: (
        "axis {axis} follows another one: nothing else moves it",
        "uncouple it before: G1061",
    ),
    FaultCode.WINDOW_LEFT: (
        "what axis {axis} follows, or the tool that it moves, has come to the end of the window of its "
        "follow",
        "end with G1061 before; a slower leader, a quicker program or a wider window",
    ),
    FaultCode.BED_TOO_FAR: (
        "the bed is further off than greatest in the machine file; the mesh of axis {axis} stays as it was",
        "clean the nozzle, home the axis, level it, look at the probe and `at`, or give a larger greatest",
    ),
    FaultCode.BED_TOO_STEEP: (
        "the bed changes faster than reserve of axis {axis} lets it follow; its mesh stays as it was",
        "level the bed, raise reserve, lower the limits of the axes over it, or put the points further apart",
    ),
    FaultCode.TOOL_BEYOND: (
        "the tool that axis {axis} moves cannot go along with what it follows: a joint's travel, its reach "
        "or a singular position is in the way",
        "work further from there, or give its follow a narrower window",
    ),
    FaultCode.NO_TRAJECTORY: (
        "no motion of axis {axis} to its target keeps its limits",
        "this is a mistake of the executor: report it with the program",
    ),
}
