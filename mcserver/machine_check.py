"""What does not fit or is doubtful in a machine file that can be read: found before the machine is run."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

from kinematics.check import check_machine
from mcserver.config import Axis, Machine
from mcserver.errors import Diagnostic

BUS_DRIVES = ("cia402", "servosila")
AXIS_NAMES = "XYZABC"


def axis_name(index: int) -> str:
    """The word that names an axis: X Y Z A B C, then [6], [7], …"""
    return AXIS_NAMES[index] if index < len(AXIS_NAMES) else f"[{index}]"


def find_doubts(machine: Machine) -> list[Diagnostic]:
    """Warnings about a machine; what cannot be meant at all is refused when the file is read.

    Codes::

        MC020  a limit that one cycle passes
        MC021  a tolerance finer than the encoder
        MC022  a drive on a bus that lacks a part
        MC023  a tolerance wider than the allowed following error
    """
    doubts: list[Diagnostic] = []
    for axis in machine.axes:
        doubts += _doubts_of_limits(axis, machine.cycle_s)
        doubts += _doubts_of_tolerance(axis)
        doubts += _doubts_of_bus(axis)
    return doubts


def find_tool_faults(machine: Machine) -> list[Diagnostic]:
    """Everything that does not fit between the machine's tools, its axes and its URDF (MC301).

    Errors: the machine cannot be used, or Pinocchio is not installed. Warnings: some motions of its tools
    will be refused.
    """
    return [
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


def _doubts_of_tolerance(axis: Axis) -> list[Diagnostic]:
    resolution = axis.drive.encoder_resolution * axis.type.si_per_unit
    unit = axis.type.unit
    doubts = []
    if resolution > 2.0 * axis.in_position:
        doubts.append(
            _warning(
                "MC021",
                axis,
                f"in_position ({axis.in_position / axis.type.si_per_unit:g} {unit}) is below half a count "
                f"of the encoder ({axis.drive.encoder_resolution:g} {unit}): exact stops may time out",
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


def _doubts_of_bus(axis: Axis) -> list[Diagnostic]:
    drive = axis.drive
    if drive.kind not in BUS_DRIVES:
        return []
    doubts = []
    for module in ("canopen", "can"):
        if importlib.util.find_spec(module) is None:
            doubts.append(
                _warning(
                    "MC022",
                    axis,
                    f"a {drive.kind} drive needs the package {module}",
                    "pip install 'mcserver[can]'",
                )
            )
    if not drive.bus:
        doubts.append(_warning("MC022", axis, "the drive names no bus", 'give bus = "can0" in [axis.drive]'))
    elif ":" not in drive.bus and not Path("/sys/class/net", drive.bus).exists():
        doubts.append(
            _warning(
                "MC022",
                axis,
                f"this computer has no interface {drive.bus}",
                "mcserver doctor tells which it has",
            )
        )
    if not 1 <= drive.node <= 127:
        doubts.append(
            _warning("MC022", axis, f"node {drive.node} is outside 1 … 127", "give node in [axis.drive]")
        )
    if drive.eds and not Path(drive.eds).is_file():
        doubts.append(_warning("MC022", axis, f"there is no EDS file {drive.eds}", "check the path"))
    return doubts
