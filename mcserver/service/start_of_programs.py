"""Initial state of a program that begins now, from the executor's newest cycle and from stored data."""

from __future__ import annotations

from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.modal import ModalState
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.machine.machine_file import Machine
from mcserver.planning.start_state import StartState
from mcserver.service.executor_port import Snapshot

ENERGIZED = frozenset({"standstill", "moving", "speed", "torque", "stopping"})
SETTLED = frozenset({"off", "standstill", "released", "fault"})


def start_state(
    machine: Machine,
    cycle: Snapshot,
    frame: Frame | None,
    modal: ModalState | None = None,
    switches: Switches = AS_WRITTEN,
    tool: int = 0,
) -> StartState:
    """Return the state of a machine in a cycle.

    Args:
        frame: stored work offsets; None: none. modal: of a program that starts in its middle.
        switches: of its operator. tool: in the spindle, as in `StartState`.
    """
    axes = [axis.index for axis in machine.axes]
    states = dict(zip(axes, cycle.states, strict=True))
    energized = frozenset(axis for axis, state in states.items() if state in ENERGIZED)
    # a spindle stopped by M5 stays in its speed mode
    turning = dict(zip(axes, cycle.turning or [True] * len(axes), strict=True))
    settled = {axis for axis, state in states.items() if state in SETTLED}
    settled |= {axis for axis, state in states.items() if state == "speed" and not turning[axis]}
    setpoint = dict(zip(axes, cycle.setpoint, strict=True))
    actual = dict(zip(axes, cycle.position, strict=True))
    return StartState(
        positions={axis: (setpoint if axis in energized else actual)[axis] for axis in axes},
        energized=energized,
        unsettled=frozenset(axes) - settled,
        # without information every axis counts as homed
        homed=frozenset(
            axis for axis, homed in zip(axes, cycle.homed or [True] * len(axes), strict=True) if homed
        ),
        frame=frame,
        modal=modal,
        inputs=tuple(cycle.inputs),
        outputs=tuple(cycle.outputs),
        switches=switches,
        tool=tool,
    )


def turning_and_pushing(machine: Machine, cycle: Snapshot) -> dict[int, float]:
    """Return by number the speeds of axes in speed mode and the torques of those in torque mode [rad/s, m/s;
    N·m].
    """
    found = {}
    for column, axis in enumerate(machine.axes):
        values = {"speed": cycle.velocity, "torque": cycle.torque}.get(cycle.states[column])
        if values is not None:
            found[axis.index] = values[column]
    return found
