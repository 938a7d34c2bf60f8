"""An axis of a machine in SI, and how it is read from its ``[[axis]]``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import msgspec

from mcserver.machine.advance_section import PressureAdvance
from mcserver.machine.compensation_section import Compensation, read_compensation
from mcserver.machine.coupled_errors import Limits
from mcserver.machine.dialect_section import Dialect
from mcserver.machine.drive import Drive
from mcserver.machine.families import AnyDrive
from mcserver.machine.follow_section import Follow, Superimposed
from mcserver.machine.gantry_section import Gantry
from mcserver.machine.homing_section import AxisLimits, Homing, read_homing
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.sections import AxisSection, Rollover
from mcserver.machine.shaper_section import Shaper
from mcserver.machine.toml_positions import Path as TomlPath
from mcserver.machine.tool_section import Tool
from mcserver.units import MM, TURN, AxisType


class Axis(msgspec.Struct, frozen=True):
    """One axis in SI: m or rad, and seconds. Infinite where not limited.

    ``drive`` keeps the drive's section in mm and deg, with what follows from other keys filled in;
    ``initial_position`` is its SI value.
    ``travel_per_motor_turn`` is m or rad of the axis for one turn of the motor (G1030).
    ``homing``: how it finds its reference; None: its encoder's reading is its position.
    ``max_torque``: of its joint [N·m, N]; None: the URDF's effort.
    ``shaper``: of its setpoints; None: they are not shaped. ``tool_shapers``: instead, by tool.
    ``gantry``: it is the second drive of another axis; None: programs move it.
    ``follow``: the gear or cam by which it follows another axis once it is coupled; None: it cannot.
    ``reserved``: what of the file's limits is kept from programs, since it, or a tool that it moves, may
    follow another axis besides; None: nothing.
    ``compensation``: of its mechanics; with it, limits are what is left of the file's for programs.
    ``rollover``: how absolute words of ``cnc`` turn it within one turn (D-139); None: as written.
    ``pressure_advance``: of a printer's E; with it, limits are what is left of the file's for programs.
    """

    index: int
    type: AxisType
    max_velocity: float
    max_acceleration: float
    max_jerk: float
    min_position: float
    max_position: float
    in_position: float
    max_following_error: float
    travel_per_motor_turn: float
    initial_position: float
    drive: AnyDrive
    homing: Homing | None = None
    max_torque: float | None = math.inf
    shaper: Shaper | None = None
    tool_shapers: Mapping[int, Shaper] = {}
    compensation: Compensation | None = None
    gantry: Gantry | None = None
    follow: Follow | None = None
    reserved: Limits | None = None
    rollover: Rollover | None = None
    pressure_advance: PressureAdvance | None = None

    @property
    def limits(self) -> Limits:
        """What programs may use."""
        return Limits(self.max_velocity, self.max_acceleration, self.max_jerk)

    @property
    def profiled(self) -> bool:
        """Return True if its drive makes the profiles itself: it goes to points, and follows no path."""
        return self.drive.profiled

    @property
    def superimposed(self) -> Superimposed | None:
        """What it does for one that it follows besides what programs order; None: it does not."""
        return None if self.follow is None else self.follow.superimposed


def axis_name(index: int) -> str:
    """Return the word that names an axis: X Y Z A B C, then [6], [7], … (D-02)."""
    return "XYZABC"[index] if index < 6 else f"[{index}]"


def read_axes(
    sections: list[AxisSection | None] | None, cycle_s: float, folder: Path | None, mistakes: Mistakes
) -> tuple[dict[int, Axis], list[tuple[TomlPath, int, Drive]]]:
    """Return the axes by number, and of each drive the path of its section and its axis's number."""
    axes: dict[int, Axis] = {}
    drives: list[tuple[TomlPath, int, Drive]] = []
    if sections == []:
        mistakes.add(("axis",), "the machine has no axis", "add an [[axis]] section")
    for position, axis in enumerate(sections or ()):
        if axis is None:
            continue
        path: TomlPath = ("axis", position)
        if axis.index in axes:
            mistakes.add(
                (*path, "index"), f"axis {axis.index} is there twice", "give each axis a number of its own"
            )
        axes[axis.index] = _axis_to_si(axis, path, cycle_s, folder, mistakes)
        drives.append(((*path, "drive"), axis.index, axes[axis.index].drive))
    return axes, drives


def _axis_to_si(
    axis: AxisSection, path: TomlPath, cycle_s: float, folder: Path | None, mistakes: Mistakes
) -> Axis:
    axis_type = AxisType(axis.type)
    scale = axis_type.si_per_unit
    low = -math.inf if axis.min_position is None else axis.min_position * scale
    high = math.inf if axis.max_position is None else axis.max_position * scale
    start = axis.drive.initial_position * scale
    if not low < high:
        mistakes.add((*path, "min_position"), "is not below max_position", "exchange the two")
    elif not low <= start <= high:
        mistakes.add(
            (*path, "drive", "initial_position"),
            f"{axis.drive.initial_position} is outside the axis's travel",
            "put it between min_position and max_position",
        )

    def refuse(key: str, what: str, hint: str) -> None:
        mistakes.add((*path, "drive", key), what, hint)

    drive, per_turn = axis.drive.complete(axis, cycle_s, refuse)
    if folder is not None:
        drive = drive.beside(folder)
    reach = AxisLimits(low / scale, high / scale, axis.max_velocity, drive)
    limits = Limits(
        axis.max_velocity * scale,
        axis.max_acceleration * scale,
        math.inf if axis.max_jerk is None else axis.max_jerk * scale,
    )
    compensation = read_compensation(axis.compensation, limits, scale, (*path, "compensation"), mistakes)
    if compensation is not None:
        limits = limits.scaled(1.0 - compensation.reserve)
        if drive.profiled:
            what = "its drive makes the profiles itself"
            mistakes.add((*path, "compensation"), what, 'use csp or ip there: mode = "pp" goes to points')
    if axis.rollover is not None and (axis_type is AxisType.LINEAR or low > -math.inf or high < math.inf):
        what = "is for rotary axes that turn without end"
        mistakes.add((*path, "rollover"), what, "leave it out, or min_position and max_position")
    homing = read_homing(axis.homing, reach, scale, (*path, "homing"), mistakes)
    default_turn = 10.0 * MM if axis_type is AxisType.LINEAR else TURN
    return Axis(
        index=axis.index,
        type=axis_type,
        max_velocity=limits.velocity,
        max_acceleration=limits.acceleration,
        max_jerk=limits.jerk,
        min_position=low,
        max_position=high,
        in_position=axis.in_position * scale,
        max_following_error=math.inf
        if axis.max_following_error is None
        else axis.max_following_error * scale,
        travel_per_motor_turn=default_turn if per_turn is None else per_turn * scale,
        initial_position=start,
        drive=drive,
        homing=homing,
        max_torque=_torque_of(axis),
        shaper=axis.shaper,
        tool_shapers={int(tool): each for tool, each in axis.tool_shapers.items()},
        compensation=compensation,
        rollover=axis.rollover,
        gantry=None if axis.gantry is None else Gantry(axis.gantry.leader, axis.gantry.max_skew * scale),
    )


def _torque_of(axis: AxisSection) -> float | None:
    """Return the greatest torque of an axis [N·m, N], infinite without one; None: its joint's effort."""
    if axis.max_torque is None:
        return math.inf
    return None if isinstance(axis.max_torque, str) else axis.max_torque


def reserving(axis: Axis, follow: Follow) -> Axis:
    """Return an axis of whose limits programs get what is left beside what it follows."""
    if follow.superimposed is None:
        return axis
    reserved = axis.limits.scaled(follow.superimposed.reserve)
    velocity, acceleration, jerk = (
        most - each if math.isfinite(most) else most for most, each in zip(axis.limits, reserved, strict=True)
    )
    return msgspec.structs.replace(
        axis, max_velocity=velocity, max_acceleration=acceleration, max_jerk=jerk, reserved=reserved
    )


def home_switches(sections: list[AxisSection | None] | None) -> dict[TomlPath, int]:
    """Return the numbers of the inputs that are home switches, by the path of the key."""
    return {
        ("axis", position, "homing", "input"): each.homing.input
        for position, each in enumerate(sections or ())
        if each is not None and each.homing is not None and each.homing.input is not None
    }


def check_rollover(sections: list[AxisSection | None] | None, dialect: Dialect, mistakes: Mistakes) -> None:
    """Refuse ``rollover`` where programs do not know it."""
    for position, each in enumerate(sections or ()):
        if each is not None and each.rollover is not None and dialect.profile != "cnc":
            what = f"programs of the profile {dialect.profile} turn axes as written"
            hint = 'use [dialect] profile = "cnc", or leave it out'
            mistakes.add(("axis", position, "rollover"), what, hint)


def check_torques(axes: list[AxisSection], tools: tuple[Tool, ...], mistakes: Mistakes) -> None:
    """Note limits of torques that no URDF gives."""
    moved = {index for tool in tools for index in tool.axes}
    for position, axis in enumerate(axes):
        if axis.max_torque is not None and axis.index not in moved:
            mistakes.add(
                ("axis", position, "max_torque"),
                "the axis moves no joint of a tool, so its torque is not known",
                "name the axis in a [[tool]] of the URDF, or leave max_torque out",
            )
