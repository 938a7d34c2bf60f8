"""Find errors and warnings in a readable machine file before the machine is run."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

from mckinematics.solution_check import check_machine

from mcserver.can.address import Transport, parse_address
from mcserver.errors import ConfigurationError, Diagnostic
from mcserver.machine.axis import Axis, axis_name
from mcserver.machine.drive import CanDrive
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics

# Ratio of a follower's limits to those that its leader needs of it, for it to synchronize within its cycle.
GEAR_SPARE = 1.3
# Ratio of a follower's jerk limit to its leader's above which its error is `CALM_SHARE` of what it is else.
GEAR_CALM = 1.5
CALM_SHARE = 0.2


def find_doubts(machine: Machine) -> list[Diagnostic]:
    """Return warnings about a machine; values that are impossible were refused when the file was read.

    Codes::

        MC020  a limit that one cycle passes
        MC021  a tolerance finer than the encoder
        MC022  a drive on a bus that lacks a part
        MC023  a tolerance wider than the allowed following error
        MC024  feed-forward of a torque that no model gives
        MC094  a gear whose axis has nothing to spare beside its leader, or whose cycle is too long for it
    """
    doubts: list[Diagnostic] = []
    for axis in machine.axes:
        doubts += _doubts_of_limits(axis, machine.cycle_s)
        doubts += _doubts_of_tolerance(axis)
        doubts += _doubts_of_bus(machine, axis)
        doubts += _doubts_of_torque(machine, axis)
        doubts += _doubts_of_gear(machine, axis)
    return doubts


def _doubts_of_gear(machine: Machine, axis: Axis) -> list[Diagnostic]:
    follow = axis.follow
    if follow is None or follow.ratio is None or follow.measured:
        return []
    leader = machine.axes[machine.column_of(follow.leader)]
    ratio = abs(follow.ratio)
    # not velocity: a feed may be below the leader's greatest, but acceleration and jerk limits are reached
    limits = {"max_acceleration": axis.max_acceleration, "max_jerk": axis.max_jerk}
    doubts = []
    short = [key for key, own in limits.items() if own < GEAR_SPARE * ratio * getattr(leader, key)]
    if short:
        doubts.append(
            _warning(
                "MC094",
                axis,
                f"by its gear axis {axis_name(leader.index)} takes too much of its {' and '.join(short)}: it "
                "may fall out of step",
                f"lower them of axis {axis_name(leader.index)}, or raise these: a follower needs "
                f"{GEAR_SPARE:g} times what its leader takes",
            )
        )
    calm = math.isfinite(leader.max_jerk) and axis.max_jerk >= GEAR_CALM * ratio * leader.max_jerk
    step = min(leader.max_jerk * machine.cycle_s, leader.max_acceleration) * machine.cycle_s**2
    beside = ratio * step * (CALM_SHARE if calm else 1.0)
    if beside > follow.tolerance:
        shown = beside / axis.type.si_per_unit
        doubts.append(
            _warning(
                "MC094",
                axis,
                f"at {machine.cycle_hz:g} Hz it may be {shown:.2g} {axis.type.unit} beside its place: "
                "out of tolerance",
                f"a greater cycle_hz, a max_jerk of axis {axis_name(leader.index)} that is lower, and "
                f"{GEAR_CALM:g} times as much of this one, or a wider tolerance",
            )
        )
    return doubts


def _doubts_of_torque(machine: Machine, axis: Axis) -> list[Diagnostic]:
    if not axis.drive.takes_torques or any(axis.index in tool.axes for tool in machine.tools):
        return []
    return [
        _warning(
            "MC024",
            axis,
            "torque_feed_forward sends 0: the axis moves no joint of a tool",
            "name the axis in a [[tool]] of a URDF with inertias, or leave torque_feed_forward out",
        )
    ]


def find_tool_faults(machine: Machine) -> list[Diagnostic]:
    """Return mismatches of the machine's tools, axes and URDF (MC301, MC094).

    Errors: the machine cannot be used, or Pinocchio is not installed. Warnings: some motions of its tools
    will be refused.
    """
    faults = [
        Diagnostic(
            code=finding.code,
            severity=finding.severity,
            message=finding.message,
            hint=finding.hint,
            tool=finding.tool,
            axis=finding.axis,
        )
        for finding in check_machine(machine)
    ]
    if not any(each.severity == "error" for each in faults):
        try:
            build_kinematics(machine)
        except ConfigurationError as error:
            faults.append(Diagnostic(code=error.code, message=error.message, hint=error.hint))
    return faults


def _warning(code: str, axis: Axis, message: str, hint: str) -> Diagnostic:
    return Diagnostic(
        code=code,
        severity="warning",
        message=f"axis {axis_name(axis.index)}: {message}",
        hint=hint,
        axis=axis.index,
    )


def _doubts_of_limits(axis: Axis, cycle_s: float) -> list[Diagnostic]:
    doubts = []
    if axis.max_acceleration * cycle_s > axis.max_velocity:
        doubts.append(
            _warning(
                "MC020",
                axis,
                "max_acceleration reaches max_velocity within one cycle",
                "check the unit: mm/s² or deg/s²",
            )
        )
    if math.isfinite(axis.max_jerk) and axis.max_jerk * cycle_s > axis.max_acceleration:
        doubts.append(
            _warning(
                "MC020",
                axis,
                "max_jerk reaches max_acceleration within one cycle, so it limits nothing",
                "leave max_jerk out, or check the unit: mm/s³ or deg/s³",
            )
        )
    return doubts


def _resolution(axis: Axis) -> float:
    """Return one count of the axis's encoder [m, rad]; 0: continuous."""
    if isinstance(axis.drive, CanDrive) and axis.drive.encoder is not None:
        increments, turns = axis.drive.encoder
        return axis.travel_per_motor_turn * turns / increments
    return axis.drive.encoder_resolution * axis.type.si_per_unit


def _doubts_of_tolerance(axis: Axis) -> list[Diagnostic]:
    resolution = _resolution(axis)
    unit = axis.type.unit
    doubts = []
    if resolution > 2.0 * axis.in_position:
        doubts.append(
            _warning(
                "MC021",
                axis,
                f"in_position ({axis.in_position / axis.type.si_per_unit:g} {unit}) is below half a count "
                f"of the encoder ({resolution / axis.type.si_per_unit:g} {unit}): exact stops may time out",
                "widen in_position to one count of the encoder",
            )
        )
    if axis.in_position > axis.max_following_error:
        doubts.append(
            _warning(
                "MC023",
                axis,
                "in_position is wider than max_following_error",
                "an exact stop should be finer than the error at which the axis faults",
            )
        )
    return doubts


def _doubts_of_bus(machine: Machine, axis: Axis) -> list[Diagnostic]:
    drive = axis.drive
    if not isinstance(drive, CanDrive):
        return []
    doubts = []
    bus = machine.bus_of(axis)
    ethercat = bus.kind == "ethercat"
    if ethercat and importlib.util.find_spec("pysoem") is None:
        what = f"a {drive.kind} drive needs the package pysoem"
        doubts.append(_warning("MC022", axis, what, "pip install 'mcserver[ethercat]'"))
    address = None if ethercat else parse_address(bus.address)
    interfaces = (bus.address, bus.redundant_interface) if address is None else (address.channel,)
    local = address is None or address.transport is Transport.SOCKETCAN
    for interface in interfaces:
        if local and interface and not Path("/sys/class/net", interface).exists():
            doubts.append(
                _warning(
                    "MC022",
                    axis,
                    f"this computer has no interface {interface}",
                    "mcserver doctor tells which it has",
                )
            )
    return doubts
