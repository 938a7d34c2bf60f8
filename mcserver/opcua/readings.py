"""What a state of a machine is in the terms of OPC 40501-1: values by the names of their variables."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from mcclient import AxisInfo, MachineStatus
from mcclient.broken_off import is_by_hand, is_typed
from mcclient.types import AxesStatus, ProgramStatus

from mcserver.opcua.nodesets import State
from mcserver.terminal import visible
from mcserver.web.formatting import axis_name, current_program, is_live

EMERGENCY_STOP = "EMERGENCY_STOP"
# OPC 40501-1: ChannelState, ChannelMode, MachineOperationMode
ACTIVE, INTERRUPTED, RESET = 0, 1, 2
AUTOMATIC, MANUAL_DATA, JOG = 0, 1, 2
MANUAL_OPERATION, AUTOMATIC_OPERATION = 0, 1
# of a program that has not ended; every other end is Aborted
PROGRAM_STATES = {
    "queued": "Initializing",
    "running": "Running",
    "ending": "Running",
    "held": "Interrupted",
    "paused": "Interrupted",
    "finished": "Ended",
}
CHANNEL_STATES = {"Running": ACTIVE, "Interrupted": INTERRUPTED}

# of the newest programs, and of those that ended a moment ago
MOST_JOBS = 20
# what turns less than this stands [deg/s, mm/s]
STANDS = 0.01
AXIS_VALUES = ("ActualPosition", "CommandedPosition", "ActualVelocity", "State")
SPINDLE = "Monitoring.Spindle"
SPINDLE_VALUES = ("IsRotating", "IsUsedAsAxis")

Value = bool | int | float | str | State


class Alert(NamedTuple):
    """A fault that lasts; ``key``: which one it is."""

    key: str
    code: str
    message: str


def readings_of(
    status: MachineStatus | None, program_states: dict[str, State], item_states: dict[str, State]
) -> dict[str, Value | None]:
    """Return the value of every variable by its path below the machine; None: it is not known.

    Args:
        status: None: the machine does not answer.
    """
    program = current_program(status)
    state = _program_state(program)
    live = is_live(program)
    channel = CHANNEL_STATES.get(state, RESET) if live else RESET
    by_hand = live and program is not None and is_by_hand(program.name)
    found: dict[str, Value | None] = {
        "Monitoring.MachineTool.OperationMode": MANUAL_OPERATION if by_hand else AUTOMATIC_OPERATION,
        "Monitoring.Channel.ChannelMode": _mode(program) if by_hand else AUTOMATIC,
        "Monitoring.Channel.ChannelState": channel,
        "Production.ActiveProgram.Name": "" if program is None else visible(program.name or program.program),
        "Production.ActiveProgram.NumberInList": 0,
        "Production.ActiveProgram.JobIdentifier": ""
        if program is None or is_by_hand(program.name)
        else program.program,
        "Production.ActiveProgram.State.CurrentState": program_states[state],
    }
    for place in ("MachineTool", "Channel"):
        found[f"Monitoring.{place}.FeedOverride"] = None if status is None else status.override
    if status is None:
        found = dict.fromkeys(found, None)
    item = _item_state(status, channel)
    return found | {"Monitoring.MachineTool.MachineryItemState.CurrentState": item_states[item]}


def jobs_of(status: MachineStatus) -> list[ProgramStatus]:
    """Return the programs that are production jobs, the oldest first: none that a hand moves axes by."""
    jobs = [each for each in status.programs if not is_by_hand(each.name)]
    return sorted(jobs, key=lambda each: each.opened_at)[-MOST_JOBS:]


def job_readings(job: ProgramStatus, number: int, states: dict[str, State]) -> dict[str, Value]:
    """Return the values of a job by their paths below its node.

    Args:
        number: its place in the list, from 0.
    """
    return {
        "Identifier": job.program,
        "NumberInList": number,
        "ProductionPrograms.Program.Name": visible(job.name or job.program),
        "ProductionPrograms.Program.NumberInList": 0,
        "RunsCompleted": int(job.state == "finished"),
        "RunsPlanned": 1,
        "RunsPlanned.IsValid": True,
        "State.CurrentState": states[_program_state(job)],
    }


def axis_readings(axes: Iterable[AxisInfo], status: MachineStatus | None) -> dict[str, Value | None]:
    """Return the values of axes and of the spindle by their paths below the machine.

    Args:
        status: None: the machine does not answer.
    """
    columns = None if status is None else status.axes
    found: dict[str, Value | None] = {}
    for axis in axes:
        paths = [f"{axis_path(axis)}.{name}" for name in AXIS_VALUES]
        paths += [f"{SPINDLE}.{name}" for name in SPINDLE_VALUES] if axis.spindle else []
        values = None if columns is None else _axis_values(columns, axis)
        found |= dict.fromkeys(paths, None) if values is None else dict(zip(paths, values, strict=True))
    return found


def _axis_values(columns: AxesStatus, axis: AxisInfo) -> list[Value] | None:
    if axis.index not in columns.index:
        return None
    row = columns.index.index(axis.index)
    if columns.silent and columns.silent[row]:
        # its drive does not answer: what is there is old
        return None
    velocity, state = columns.velocity[row], columns.state[row]
    values: list[Value] = [columns.position[row], columns.setpoint[row], velocity, state.value]
    return [*values, abs(velocity) > STANDS, state != "speed"] if axis.spindle else values


def axis_path(axis: AxisInfo) -> str:
    """Return the path of an axis below the machine."""
    return f"Monitoring.Axes.{axis_name(axis.index).strip('[]')}"


def alerts_of(status: MachineStatus) -> list[Alert]:
    """Return the emergency stop, latched faults, and the fault that the newest program ended with."""
    found: dict[str, Alert] = {}
    if status.state == "estop":
        found[EMERGENCY_STOP] = Alert(EMERGENCY_STOP, EMERGENCY_STOP, "emergency stop until the reset")
    program = current_program(status)
    ended = [] if program is None or program.fault is None else [program.fault]
    for fault in (*status.faults, *ended):
        key = fault.code if fault.axis is None else f"{fault.code}.{fault.axis}"
        found.setdefault(key, Alert(key, fault.code, visible(fault.message)))
    return list(found.values())


def gone(before: Iterable[Alert], now: Iterable[Alert]) -> list[Alert]:
    """Return those of ``before`` that are over."""
    keys = {each.key for each in now}
    return [each for each in before if each.key not in keys]


def _program_state(program: ProgramStatus | None) -> str:
    return "Initializing" if program is None else PROGRAM_STATES.get(program.state.value, "Aborted")


def _mode(program: ProgramStatus | None) -> int:
    return MANUAL_DATA if program is not None and is_typed(program.name) else JOG


def _item_state(status: MachineStatus | None, channel: int) -> str:
    if status is None:
        return "NotAvailable"
    if status.state != "ready":
        return "OutOfService"
    return "Executing" if channel == ACTIVE else "NotExecuting"
