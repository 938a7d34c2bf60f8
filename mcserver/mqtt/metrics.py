"""What is published of a machine: named values, the same in plain topics and in Sparkplug."""

from __future__ import annotations

from mcclient import MachineStatus

from mcserver.web.formatting import axis_name, current_program

Value = float | int | str


def metrics_of(status: MachineStatus) -> dict[str, Value]:
    """Return the values of a state by name; positions in mm and deg, and per second."""
    program = current_program(status)
    fault = status.faults[0] if status.faults else None
    found: dict[str, Value] = {
        "state": status.state.value,
        "override": status.override,
        "late_cycles": status.late_cycles,
        "faults": len(status.faults),
        "fault/code": "" if fault is None else fault.code,
        "fault/message": "" if fault is None else fault.message,
        "program/id": "" if program is None else program.program,
        "program/name": "" if program is None else program.name,
        "program/state": "" if program is None else program.state.value,
        "program/line": 0 if program is None else program.line,
        "program/done": 0 if program is None else program.done,
        "program/progress": 0.0 if program is None else round(program.progress, 4),
    }
    axes = status.axes
    for row, index in enumerate(axes.index):
        name = f"axes/{axis_name(index).strip('[]')}"
        found[f"{name}/position"] = round(axes.position[row], 4)
        found[f"{name}/setpoint"] = round(axes.setpoint[row], 4)
        found[f"{name}/velocity"] = round(axes.velocity[row], 3)
        found[f"{name}/state"] = axes.state[row].value
    return found
