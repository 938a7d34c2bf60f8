"""Codes of what can go wrong while running; docs/executor.md has a remedy for each."""

from __future__ import annotations

import enum

from mcserver.drives.bus import DriveFault


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


# Codes that are told and stop no program.
WARNINGS = frozenset({FaultCode.NO_REALTIME, FaultCode.SPEED_AT_LIMIT})


_OF_DRIVE = {
    DriveFault.OVER_TEMPERATURE: FaultCode.OVER_TEMPERATURE,
    DriveFault.OVER_CURRENT: FaultCode.OVER_CURRENT,
    DriveFault.VOLTAGE: FaultCode.VOLTAGE,
    DriveFault.ENCODER: FaultCode.ENCODER,
    DriveFault.FOLLOWING: FaultCode.FOLLOWING_ERROR,
    DriveFault.COMMUNICATION: FaultCode.DRIVE_SILENT,
}


def code_of_drive_fault(fault: int) -> FaultCode:
    """The code that reports a value of `DriveFault`."""
    try:
        return _OF_DRIVE.get(DriveFault(fault), FaultCode.DRIVE_FAULT)
    except ValueError:
        return FaultCode.DRIVE_FAULT


def remedy_of(code: int, axis: int) -> tuple[str, str]:
    """A sentence and a hint for a FAULT event, from its code and axis number."""
    message, hint = _TEXT.get(code, ("the executor reports a fault", "see docs/executor.md"))
    return message.format(axis=axis), hint.format(axis=axis)


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
    FaultCode.FOLLOWING_ERROR: ("the following error of axis {axis} is above its limit", _RESET_HINT),
    FaultCode.SLOT_REFUSED: (
        "a program was refused: its slot is busy, or another program has one of its axes",
        "wait for the other program to end",
    ),
    FaultCode.SETPOINT_JUMP: (
        "a jump of the setpoint of axis {axis} was refused",
        "this is a mistake of the planner: report it with the program",
    ),
    FaultCode.DRIVE_FAULT: ("the drive of axis {axis} reports a fault", _RESET_HINT),
    FaultCode.DRIVE_SILENT: (
        "the drive of axis {axis} does not answer",
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
    FaultCode.NO_TRAJECTORY: (
        "no motion of axis {axis} to its target keeps its limits",
        "this is a mistake of the executor: report it with the program",
    ),
}
