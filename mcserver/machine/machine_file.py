"""The machine file: TOML in mm and degrees outside, SI inside.

Unknown keys and values that do not fit are errors that give the path and the nearest known key.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Literal

import msgspec

from mcserver.drives.bus_load import refuse_overload
from mcserver.errors import ConfigurationError
from mcserver.machine.drive_section import (
    CAN_KINDS,
    BusFile,
    CanBusConfig,
    DriveFile,
    Refusal,
    check_travel,
    complete_drive,
    read_buses,
)
from mcserver.machine.tool_section import Tool as Tool
from mcserver.machine.tool_section import ToolFile, read_tools
from mcserver.units import DEGREE, MM, TURN, AxisType

MAX_AXES = 64
BUILT_IN = ("cartesian", "robot-dog", "arm6")


class AxisFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """``[[axis]]`` as written: mm or deg, and seconds."""

    index: int
    type: Literal["linear", "rotary"]
    max_velocity: float
    max_acceleration: float
    max_jerk: float | None = None
    min_position: float | None = None
    max_position: float | None = None
    in_position: float = 0.01
    max_following_error: float | None = None
    units_per_motor_rev: float | None = None
    drive: DriveFile = DriveFile()


class MachineSection(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """``[machine]``."""

    name: str
    cycle_hz: float = 1000.0


class MotionSection(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """``[motion]``."""

    path_tolerance_mm: float = 0.0
    exact_stop_timeout_s: float = 5.0
    exact_stop_cycles: int = 3
    tool_tolerance_mm: float = 0.01
    tool_tolerance_deg: float = 0.01


class KinematicsSection(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """``[kinematics]``."""

    urdf: str


class MachineFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A whole machine file."""

    machine: MachineSection
    axis: list[AxisFile]
    motion: MotionSection = MotionSection()
    kinematics: KinematicsSection | None = None
    tool: list[ToolFile] = []
    bus: list[BusFile] = []


class Axis(msgspec.Struct, frozen=True):
    """One axis in SI: m or rad, and seconds. Infinite where not limited.

    ``drive`` keeps the drive's section in mm and deg, with what follows from other keys filled in;
    ``initial_position`` is its SI value.
    ``travel_per_motor_turn`` is m or rad of the axis for one turn of the motor (G1030).
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
    drive: DriveFile


class Machine(msgspec.Struct, frozen=True):
    """A machine in SI.

    Attributes:
        axes: sorted by index; indices need not be contiguous.
        path_tolerance: how far G64 may round a corner [m].
        exact_stop_timeout: [s]. exact_stop_cycles: cycles that the encoder has to stay in tolerance.
        tool_tolerance [m], tool_tolerance_angle [rad]: D-54.
        urdf: absolute path or a built-in name, None without kinematics.
        buses: CAN buses, those of ``[[bus]]`` first.
    """

    name: str
    cycle_hz: float
    axes: tuple[Axis, ...]
    path_tolerance: float
    exact_stop_timeout: float
    exact_stop_cycles: int
    tool_tolerance: float
    tool_tolerance_angle: float
    urdf: str | None
    tools: tuple[Tool, ...]
    buses: tuple[CanBusConfig, ...] = ()

    @property
    def cycle_s(self) -> float:
        return 1.0 / self.cycle_hz

    def axis(self, index: int) -> Axis | None:
        """The axis of that number, or None."""
        for axis in self.axes:
            if axis.index == index:
                return axis
        return None

    def bus_of(self, axis: Axis) -> CanBusConfig:
        """The bus of a drive on CAN.

        Raises:
            KeyError: the axis's drive is on none.
        """
        if axis.drive.kind in CAN_KINDS:
            for bus in self.buses:
                if bus.name == axis.drive.bus:
                    return bus
        raise KeyError(axis.drive.bus)

    def slot(self, index: int) -> int:
        """Column of axis ``index`` in arrays over this machine's axes."""
        for column, axis in enumerate(self.axes):
            if axis.index == index:
                return column
        raise KeyError(index)


def load_machine(name_or_path: str) -> Machine:
    """The machine of a built-in name or of a TOML file.

    Raises:
        ConfigurationError: MC001 no such file, MC002 not TOML, MC003 a key or value that does not fit,
            MC004 values that contradict each other, MC007 buses that the cycle does not fit, MC009 a bus's
            address.
    """
    if name_or_path in BUILT_IN:
        text = resources.files("mcserver.machine.builtin").joinpath(f"{name_or_path}.toml").read_text("utf-8")
        return parse_machine(text, source=f"built-in {name_or_path}", folder=None)
    path = Path(name_or_path)
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            "MC001",
            f"the machine file {name_or_path!r} cannot be read: {error}",
            f"give a TOML file or one of {', '.join(BUILT_IN)}",
        ) from error
    return parse_machine(text, source=str(path), folder=path.resolve().parent)


def parse_machine(text: str, *, source: str = "machine file", folder: Path | None = None) -> Machine:
    """The machine that a TOML text describes; ``folder`` is what a relative URDF path starts from.

    Raises:
        ConfigurationError: as `load_machine`.
    """
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(
            "MC002", f"{source} is not TOML: {error}", "mend the syntax there"
        ) from error
    try:
        file = msgspec.convert(raw, MachineFile)
    except msgspec.ValidationError as error:
        raise ConfigurationError("MC003", f"{source}: {error}", _nearest_key(str(error))) from error
    return _to_si(file, source, folder)


def _nearest_key(message: str) -> str:
    unknown = re.search(r"unknown field `([^`]*)`(?: - at `\$?\.?([^`]*)`)?", message)
    if unknown is None:
        return "compare the value with the documented machine file"
    section = re.sub(r"\[\d+\]", "[...]", unknown.group(2) or "")
    structs: tuple[tuple[str, type[msgspec.Struct]], ...] = (
        ("axis[...].drive", DriveFile),
        ("axis", AxisFile),
        ("machine", MachineSection),
        ("motion", MotionSection),
        ("kinematics", KinematicsSection),
        ("tool", ToolFile),
        ("bus", BusFile),
    )
    known = MachineFile.__struct_fields__
    for prefix, struct in structs:
        if section.startswith(prefix):
            known = struct.__struct_fields__
            break
    near = difflib.get_close_matches(unknown.group(1), known, n=1, cutoff=0.5)
    if near:
        return f"did you mean {near[0]!r}?"
    return f"known keys here: {', '.join(known)}"


def _to_si(file: MachineFile, source: str, folder: Path | None) -> Machine:
    def bad(where: str, what: str, hint: str) -> ConfigurationError:
        return ConfigurationError("MC004", f"{source}: {where}: {what}", hint)

    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}", file.machine.name):
        raise bad(
            "machine.name",
            f"{file.machine.name!r} cannot be part of a key",
            "use letters, digits, '-', '_', '.'",
        )
    if not 10.0 <= file.machine.cycle_hz <= 10000.0:
        raise bad("machine.cycle_hz", f"{file.machine.cycle_hz} is outside 10 … 10000", "1000 is usual")
    if not file.axis:
        raise bad("axis", "the machine has no axis", "add an [[axis]] section")
    axes: dict[int, Axis] = {}
    for position, axis in enumerate(file.axis):
        where = f"axis[{position}]"
        if not 0 <= axis.index < MAX_AXES:
            raise bad(
                f"{where}.index", f"{axis.index} is outside 0 … {MAX_AXES - 1}", "number axes from 0 to 63"
            )
        if axis.index in axes:
            raise bad(
                f"{where}.index", f"axis {axis.index} is there twice", "give each axis a number of its own"
            )
        axes[axis.index] = _axis_to_si(axis, where, 1.0 / file.machine.cycle_hz, folder, bad)
    buses = read_buses(file.bus, (axis.drive for axis in file.axis), bad)
    _check_nodes(axes.values(), bad)
    motion = file.motion
    if not (math.isfinite(motion.path_tolerance_mm) and motion.path_tolerance_mm >= 0.0):
        raise bad("motion.path_tolerance_mm", "must be 0 or more", "0 keeps the exact path")
    for name in ("exact_stop_timeout_s", "tool_tolerance_mm", "tool_tolerance_deg", "exact_stop_cycles"):
        value = getattr(motion, name)
        if not (math.isfinite(value) and value > 0):
            raise bad(f"motion.{name}", f"{value} is not above 0", "give a positive number")
    tools = read_tools(file.tool, axes, bad)
    urdf = None
    if file.kinematics is not None:
        written = file.kinematics.urdf
        urdf = written if folder is None or Path(written).is_absolute() else str(folder / written)
    elif tools:
        raise bad("tool", "tools need a [kinematics] section", "name the URDF there")
    machine = Machine(
        name=file.machine.name,
        cycle_hz=file.machine.cycle_hz,
        axes=tuple(axes[index] for index in sorted(axes)),
        path_tolerance=motion.path_tolerance_mm * MM,
        exact_stop_timeout=motion.exact_stop_timeout_s,
        exact_stop_cycles=motion.exact_stop_cycles,
        tool_tolerance=motion.tool_tolerance_mm * MM,
        tool_tolerance_angle=motion.tool_tolerance_deg * DEGREE,
        urdf=urdf,
        tools=tools,
        buses=tuple(buses),
    )
    refuse_overload(machine, source)
    return machine


def _check_nodes(axes: Iterable[Axis], bad: Refusal) -> None:
    taken: dict[tuple[str, int], int] = {}
    for axis in axes:
        if axis.drive.kind not in CAN_KINDS:
            continue
        key = (axis.drive.bus, axis.drive.node)
        if key in taken:
            raise bad(
                "axis.drive.node",
                f"axes {taken[key]} and {axis.index} both have node {key[1]} on bus {key[0]}",
                "give each drive of a bus a node number of its own",
            )
        taken[key] = axis.index


def _axis_to_si(axis: AxisFile, where: str, cycle_s: float, folder: Path | None, bad: Refusal) -> Axis:
    axis_type = AxisType(axis.type)
    scale = axis_type.si_per_unit
    for name in (
        "max_velocity",
        "max_acceleration",
        "max_jerk",
        "in_position",
        "max_following_error",
        "units_per_motor_rev",
    ):
        value = getattr(axis, name)
        if value is not None and not (value > 0.0 and math.isfinite(value)):
            raise bad(
                f"{where}.{name}", f"{value} is not above 0", "leave the key out where there is no limit"
            )
    low = -math.inf if axis.min_position is None else axis.min_position * scale
    high = math.inf if axis.max_position is None else axis.max_position * scale
    start = axis.drive.initial_position * scale
    if not low < high:
        raise bad(f"{where}.min_position", "is not below max_position", "exchange the two")
    if not math.isfinite(start):
        raise bad(f"{where}.drive.initial_position", "is not a finite number", "give a position")
    if not low <= start <= high:
        raise bad(
            f"{where}.drive.initial_position",
            f"{axis.drive.initial_position} is outside the axis's travel",
            "put it between min_position and max_position",
        )
    drive, per_turn = complete_drive(
        axis.drive, axis_type, axis.units_per_motor_rev, cycle_s, f"{where}.drive", bad
    )
    check_travel(drive, per_turn, (axis.min_position, axis.max_position), f"{where}.drive", bad)
    if drive.eds and folder is not None:
        drive = msgspec.structs.replace(drive, eds=str(folder / drive.eds))
    default_turn = 10.0 * MM if axis_type is AxisType.LINEAR else TURN
    return Axis(
        index=axis.index,
        type=axis_type,
        max_velocity=axis.max_velocity * scale,
        max_acceleration=axis.max_acceleration * scale,
        max_jerk=math.inf if axis.max_jerk is None else axis.max_jerk * scale,
        min_position=low,
        max_position=high,
        in_position=axis.in_position * scale,
        max_following_error=math.inf
        if axis.max_following_error is None
        else axis.max_following_error * scale,
        travel_per_motor_turn=default_turn if per_turn is None else per_turn * scale,
        initial_position=start,
        drive=drive,
    )
