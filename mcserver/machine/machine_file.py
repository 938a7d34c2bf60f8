"""The machine file: TOML in mm and degrees outside, SI inside.

Unknown keys and values that do not fit are errors that give the path and the nearest known key.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
from mckinematics.description import EARTH

from mcserver.errors import ConfigurationError
from mcserver.machine.advance_section import check_advance
from mcserver.machine.axis import Axis, check_rollover, check_torques, home_switches, read_axes, reserving
from mcserver.machine.bus_load import refuse_overload
from mcserver.machine.bus_section import BusConfig, read_buses
from mcserver.machine.button_section import Button, read_buttons
from mcserver.machine.clearance_section import (
    Clearance,
    ToolsOfBodies,
    check_switches,
    check_work_systems,
    read_clearance,
)
from mcserver.machine.compensation_section import LEAST_FOR_BACKLASH
from mcserver.machine.coupled_errors import check_coupled
from mcserver.machine.dialect_section import Dialect, read_dialect
from mcserver.machine.drive import CanDrive
from mcserver.machine.follow_section import check_followers
from mcserver.machine.gantry_section import check_gantries
from mcserver.machine.homing_section import LETTERS, Probe, check_inputs, read_probe
from mcserver.machine.io_process_data import check_nodes
from mcserver.machine.io_section import Input, Output, read_inputs, read_outputs
from mcserver.machine.mesh_probe import check_mesh_probe
from mcserver.machine.recovery_section import Recovery, read_recovery
from mcserver.machine.section_reader import Mistakes, read_keys
from mcserver.machine.sections import (
    MAX_AXES,
    KinematicsSection,
    MachineFile,
    MachineSection,
    MotionSection,
    RecorderSection,
)
from mcserver.machine.shaper_section import Shaping, check_shapers
from mcserver.machine.tool_section import Tool, read_tools
from mcserver.units import DEGREE, MM

BUILT_IN = ("cartesian", "robot-dog", "arm6")

# A cycle that is late by fewer cycles than this has not stalled, however slow the cycle is.
LEAST_STALL_CYCLES = 5


class Machine(msgspec.Struct, frozen=True):
    """A machine in SI.

    Attributes:
        axes: sorted by index; indices need not be contiguous.
        path_tolerance: how far G64 may round a corner [m].
        exact_stop_timeout: [s]. exact_stop_cycles: cycles that the encoder has to stay in tolerance.
        tool_tolerance [m], tool_tolerance_angle [rad]: D-54.
        joint_tolerance [m], joint_tolerance_angle [rad]: how far corners of tool paths may be rounded at the
            joints, whatever that is at the tool; 0: by the path tolerance alone (D-36).
        urdf: absolute path or a built-in name, None without kinematics.
        buses: CAN buses, those of ``[[bus]]`` first.
        dialect: what its programs may say.
        inputs, outputs: digital ones first, each kind by number.
        probe: what trips G38.2 … G38.5; None: it cannot probe.
        recorder: how its cycles are recorded. recovery: the way to a line in a program's middle.
        gravity: in the URDF's base frame [m/s²].
        clearance: what must not touch what; None: nothing is said of it.
        buttons: programs that operators start from the page.
        group, tags: what people find it by in a fleet.
        camera: address of a still picture or of MJPEG; empty: none.
        orders_from: instruments that may order, beside what clients and pages may.
        setpoint_timeout: longest time that drives bridge without a setpoint [s]; see `stall_limit_s`.
        shaping: of the setpoints of all axes; None: no axis has a shaper.
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
    buses: tuple[BusConfig, ...] = ()
    dialect: Dialect = Dialect()
    inputs: tuple[Input, ...] = ()
    outputs: tuple[Output, ...] = ()
    probe: Probe | None = None
    recorder: RecorderSection = RecorderSection()
    gravity: tuple[float, float, float] = EARTH
    joint_tolerance: float = 0.0
    joint_tolerance_angle: float = 0.0
    recovery: Recovery | None = None
    setpoint_timeout: float = 0.05
    clearance: Clearance | None = None
    buttons: tuple[Button, ...] = ()
    group: str = ""
    tags: tuple[str, ...] = ()
    camera: str = ""
    orders_from: tuple[str, ...] = ()
    shaping: Shaping | None = None

    @property
    def cycle_s(self) -> float:
        return 1.0 / self.cycle_hz

    @property
    def stall_limit_s(self) -> float:
        """Time between two setpoints from which on the cycle has stalled: motion does not go on then [s]."""
        return max(self.setpoint_timeout, LEAST_STALL_CYCLES * self.cycle_s)

    def corner_tolerance(self, programmed: float | None) -> float:
        """Return how far corners may be rounded where a path may be left by ``programmed`` [m]; None: by the
        machine's own tolerance. What shapers may take of it is not there for corners.
        """
        tolerance = self.path_tolerance if programmed is None else programmed
        return tolerance if self.shaping is None else max(0.0, tolerance - self.shaping_deviation)

    @property
    def compensated(self) -> bool:
        """Whether drives are told something else than the setpoint."""
        return any(axis.compensation is not None for axis in self.axes)

    @property
    def followers(self) -> Mapping[int, int]:
        """Second drives of gantry pairs: their numbers, and those of their leaders."""
        return {axis.index: axis.gantry.leader for axis in self.axes if axis.gantry is not None}

    @property
    def shaping_deviation(self) -> float:
        """How far shapers leave a path at the most [m]."""
        return 0.0 if self.shaping is None else self.shaping.path_deviation

    def axis(self, index: int) -> Axis | None:
        """Return the axis of that number, or None."""
        for axis in self.axes:
            if axis.index == index:
                return axis
        return None

    def bus_of(self, axis: Axis) -> BusConfig:
        """Return the bus of a drive on CAN.

        Raises:
            KeyError: the axis's drive is on none.
        """
        if isinstance(axis.drive, CanDrive):
            for bus in self.buses:
                if bus.name == axis.drive.bus:
                    return bus
        raise KeyError(axis.index)

    def column_of(self, index: int) -> int:
        """Return the column of axis ``index`` in arrays over this machine's axes."""
        for column, axis in enumerate(self.axes):
            if axis.index == index:
                return column
        raise KeyError(index)

    def mask_of(self, indices: Iterable[int]) -> int:
        """Return the bit mask of axes' columns."""
        return sum(1 << self.column_of(index) for index in indices)


def load_machine(name_or_path: str) -> Machine:
    """Return the machine of a built-in name or of a TOML file.

    Raises:
        ConfigurationError: MC001 no such file, MC002 not TOML, MC003 a key or value that does not fit,
            MC004 values that contradict each other, MC007 buses that the cycle does not fit, MC009 a bus's
            address.
    """
    text = machine_text(name_or_path)
    if name_or_path in BUILT_IN:
        return parse_machine(text, source=f"built-in {name_or_path}", folder=None)
    path = Path(name_or_path)
    return parse_machine(text, source=str(path), folder=path.resolve().parent)


def machine_text(name_or_path: str) -> str:
    """Return the text of a built-in machine or of a TOML file.

    Raises:
        ConfigurationError: MC001 no such file.
    """
    if name_or_path in BUILT_IN:
        return builtin_text(name_or_path)
    try:
        return Path(name_or_path).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            "MC001",
            f"the machine file {name_or_path!r} cannot be read: {error}",
            f"give a TOML file or one of {', '.join(BUILT_IN)}",
        ) from error


def parse_machine(text: str, *, source: str = "machine file", folder: Path | None = None) -> Machine:
    """Return the machine that a TOML text describes; ``folder`` is what a relative URDF path starts from.

    Raises:
        ConfigurationError: as `load_machine`.
    """
    try:
        raw = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigurationError(
            "MC002", f"{source} is not TOML: {error}", "correct the syntax there"
        ) from error
    mistakes = Mistakes(text, source)
    machine = _read_machine(raw, folder, mistakes)
    mistakes.raise_if_any()
    assert machine is not None
    refuse_overload(machine, source)
    return machine


def builtin_text(name: str) -> str:
    """Return the TOML text of a built-in machine.

    Raises:
        ConfigurationError: MC001 no machine has that name.
    """
    if name not in BUILT_IN:
        near = difflib.get_close_matches(name, BUILT_IN, n=1)
        raise ConfigurationError(
            "MC001",
            f"there is no built-in machine {name!r}",
            f"did you mean {near[0]!r}?" if near else f"there are {', '.join(BUILT_IN)}",
        )
    return resources.files("mcserver.machine.builtin").joinpath(f"{name}.toml").read_text("utf-8")


def _read_machine(raw: dict[str, Any], folder: Path | None, mistakes: Mistakes) -> Machine | None:
    """Return the machine; None, or a machine that must not be used, where there are mistakes."""
    file = read_keys(raw, MachineFile, (), mistakes)
    section: MachineSection | None = file["machine"]
    cycle_hz = section.cycle_hz if section is not None else MachineSection("").cycle_hz
    axes, drives = read_axes(file["axis"], 1.0 / cycle_hz, folder, mistakes)
    buses = read_buses(file.get("bus") or (), drives, mistakes)
    sound = file["axis"] is not None and None not in file["axis"]
    scales = {index: axis.type.si_per_unit for index, axis in axes.items()}
    tools = read_tools(file.get("tool") or (), axes if sound else range(MAX_AXES), scales, mistakes)
    _check_tools(tools, axes, mistakes)
    numbers = axes if sound else range(MAX_AXES)
    names = {bus.name for bus in buses}
    by_axis = {axis: drive for _, axis, drive in drives}
    inputs = read_inputs(file.get("input") or (), names, mistakes, by_axis)
    outputs = read_outputs(file.get("output") or (), inputs, names, mistakes, by_axis)
    dialect = read_dialect(
        file.get("dialect"),
        file.get("cutter") or [],
        numbers,
        outputs,
        mistakes,
        inputs=inputs,
        folder=folder,
    )
    check_rollover(file["axis"], dialect, mistakes)
    letters = {**LETTERS, **dialect.letters}
    probe = read_probe(file.get("probe"), letters, scales, mistakes) if sound else None
    if probe is not None:
        dialect = msgspec.structs.replace(dialect, probes=True)
    if file.get("input") is None or None not in file["input"]:
        digital = {each.number for each in inputs if each.digital}
        check_inputs(home_switches(file["axis"]), probe, digital, mistakes)
        check_switches(file.get("zone") or (), digital, mistakes)
    check_nodes(inputs, outputs, drives, mistakes)
    kinematics: KinematicsSection | None = file.get("kinematics")
    if "tool" in raw and "kinematics" not in raw:
        mistakes.add(("tool",), "tools need a [kinematics] section", "name the URDF there")
    if sound and None not in (file.get("tool") or ()):
        check_torques(file["axis"], tools, mistakes)
    motion: MotionSection | None = file.get("motion", MotionSection())
    if section is None or motion is None:
        return None
    shaping = None
    if sound:
        joints = frozenset(index for tool in tools for index in tool.axes)
        by_path = {path[:-1]: axes[index] for path, index, _ in drives}
        for index, share in check_coupled(by_path, mistakes, LEAST_FOR_BACKLASH).items():
            told = axes[index].compensation
            assert told is not None
            axes[index] = msgspec.structs.replace(
                axes[index], compensation=msgspec.structs.replace(told, share=share)
            )
        probed = check_mesh_probe(by_path, dialect, mistakes, probes=probe is not None)
        dialect = msgspec.structs.replace(dialect, mesh_axis=probed)
        bodies = file.get("body") or ()
        check_gantries(by_path, tools, bodies, mistakes)
        follow = {path[:-1]: file["axis"][path[1]].follow for path, _, _ in drives}
        columns = {each.number: column for column, each in enumerate(inputs) if each.digital}
        carried = {
            each.number: (("tool", position), each.follow)
            for position, each in enumerate(file.get("tool") or ())
            if each is not None and each.follow is not None
        }
        if carried and any(file.get(key) for key in ("clearance", "body", "zone")):
            mistakes.add(
                *(("tool",), "a tool with follow on a machine whose clearance is judged"),
                "leave [clearance], [[body]] and [[zone]] out: where it is would not be known beforehand",
                "MC094",
            )
        followers, tips = check_followers(by_path, follow, tools, carried, bodies, columns, mistakes)
        for index, found in followers.items():
            axes[index] = msgspec.structs.replace(reserving(axes[index], found), follow=found)
        tools = tuple(msgspec.structs.replace(tool, follow=tips.get(tool.number)) for tool in tools)
        for tool in tools:
            for index in tool.axes if tool.number in tips else ():
                axes[index] = reserving(axes[index], tips[tool.number])
        by_path = {path: axes[axis.index] for path, axis in by_path.items()}
        advances = {path: file["axis"][path[1]].pressure_advance for path in by_path}
        led = check_advance(by_path, advances, dialect, mistakes)
        if led is not None:
            axes[led.index] = led
            by_path = {path: axes[axis.index] for path, axis in by_path.items()}
            dialect = msgspec.structs.replace(dialect, leads=True)
        tolerance = motion.path_tolerance_mm * MM
        shaping = check_shapers(by_path, joints, dialect.profile, 1.0 / cycle_hz, tolerance, mistakes)
    urdf = None if kinematics is None else kinematics.urdf
    if urdf is not None and folder is not None:
        urdf = str(folder / urdf)
    missing = "it has a URDF" if kinematics is not None else ""
    if dialect.profile not in ("cnc", "robot"):
        missing = f"the profile {dialect.profile} has no work systems"
    check_work_systems(file.get("zone") or (), missing, mistakes)
    return Machine(
        name=section.name,
        cycle_hz=section.cycle_hz,
        axes=tuple(axes[index] for index in sorted(axes)),
        path_tolerance=motion.path_tolerance_mm * MM,
        exact_stop_timeout=motion.exact_stop_timeout_s,
        exact_stop_cycles=motion.exact_stop_cycles,
        tool_tolerance=motion.tool_tolerance_mm * MM,
        tool_tolerance_angle=motion.tool_tolerance_deg * DEGREE,
        joint_tolerance=motion.joint_tolerance_mm * MM,
        joint_tolerance_angle=motion.joint_tolerance_deg * DEGREE,
        urdf=urdf,
        tools=tools,
        buses=tuple(buses),
        dialect=dialect,
        inputs=inputs,
        outputs=outputs,
        probe=probe,
        recorder=file.get("recorder") or RecorderSection(),
        gravity=EARTH if kinematics is None else kinematics.gravity,
        recovery=read_recovery(file.get("recovery"), axes, mistakes) if sound else None,
        setpoint_timeout=section.setpoint_timeout_s,
        group=section.group,
        tags=section.tags,
        camera=section.camera,
        orders_from=section.orders_from,
        buttons=read_buttons(file.get("button") or (), mistakes),
        shaping=shaping,
        clearance=read_clearance(
            file.get("clearance"),
            file.get("body") or (),
            file.get("zone") or (),
            axes,
            letters,
            _tools_of_bodies(file, dialect),
            folder,
            mistakes,
            urdf=urdf is not None,
        ),
    )


def _tools_of_bodies(file: dict[str, Any], dialect: Dialect) -> ToolsOfBodies:
    """Return the tools that bodies may come with; where a section has a mistake any number may be one."""
    spindle = dialect.profile == "cnc"
    sections = file.get("cutter" if spindle else "tool") or ()
    known = {each.number for each in sections if each is not None}
    cutters = {
        position: (each.length_mm, each.diameter_mm)
        for position, each in enumerate(file.get("cutter") or ())
        if each is not None
    }
    # a machine without a tool table takes any T
    open_ended = None in sections or (spindle and not known)
    return ToolsOfBodies(None if open_ended else frozenset(known), spindle, cutters)


def _check_tools(tools: tuple[Tool, ...], axes: Mapping[int, Axis], mistakes: Mistakes) -> None:
    """Refuse tools on axes that follow no path."""
    for tool in tools:
        for index in tool.axes:
            if index in axes and axes[index].profiled:
                mistakes.add(
                    ("tool",),
                    f"T{tool.number} moves axis {index}, whose drive follows no path",
                    'use a drive with csp or ip there: mode = "pp" goes to points',
                )
