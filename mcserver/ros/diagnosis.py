"""What ``/diagnostics`` says of a machine and its axes."""

from __future__ import annotations

from typing import Any

from mcclient.types import AxisState, MachineState, MachineStatus

from mcserver.ros.interfaces import interfaces
from mcserver.ros.joints import Joint
from mcserver.ros.servo_topics import ServoSaid

KIND = "diagnostic_msgs/msg/DiagnosticArray"
OK, WARN, ERROR = 0, 1, 2


def diagnosis(
    machine: str, status: MachineStatus, joints: tuple[Joint, ...], servo: ServoSaid, stamp: Any
) -> Any:
    """Return the message: one status of the machine, one of servo mode, one for each axis."""
    faults = {fault.axis: fault for fault in reversed(status.faults)}
    level = OK if status.state is MachineState.READY else ERROR
    said = "; ".join(f"{fault.code}: {fault.message}" for fault in status.faults) or str(status.state.value)
    values = {
        "state": status.state.value,
        "override": f"{status.override:g}",
        "late_cycles": status.late_cycles,
        "programs": len(status.programs),
        "instance": status.instance,
    }
    found = [_status(f"mcserver: {machine}", machine, level, said, values)]
    said = servo.why or ("commands are followed" if servo.follows else "no commands")
    level = WARN if servo.why else OK
    found.append(_status(f"mcserver: {machine}: servo mode", machine, level, said, servo.values))
    axes = status.axes
    for row, index in enumerate(axes.index):
        joint = joints[row].name if row < len(joints) else f"axis_{index}"
        homed = row >= len(axes.homed) or axes.homed[row]
        fault = faults.get(index)
        broken = fault is not None or axes.state[row] is AxisState.FAULT
        level = ERROR if broken else OK if homed else WARN
        said = f"{fault.code}: {fault.message}" if fault else axes.state[row].value if homed else "not homed"
        values = {"axis": index, "state": axes.state[row].value, "homed": homed}
        found.append(_status(f"mcserver: {machine}: {joint}", machine, level, said, values))
    make = interfaces().make
    return make(KIND, header=make("std_msgs/msg/Header", stamp=stamp), status=found)


def _status(name: str, hardware: str, level: int, message: str, values: dict[str, Any]) -> Any:
    make = interfaces().make
    pairs = [make("diagnostic_msgs/msg/KeyValue", key=key, value=str(value)) for key, value in values.items()]
    return make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=level,
        name=name,
        hardware_id=hardware,
        message=message,
        values=pairs,
    )
