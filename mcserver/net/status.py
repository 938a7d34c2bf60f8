"""Report the machine in the units of its edges: mm, deg, seconds, N·m."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.clearance.mounted import SPINDLE
from mcserver.executor.shm.mailbox import SLOTS
from mcserver.gcode.text.source import MAX_LINE_LENGTH
from mcserver.machine.axis import Axis
from mcserver.machine.dialect_section import Cutter, Dialect
from mcserver.machine.io_section import Input, Output
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.machine.probing_cycles import probing_cycles
from mcserver.machine.work_systems import ANGLE, SYSTEM_NUMBERS
from mcserver.net.answers import REMEMBERED_ANSWERS, REMEMBERED_S
from mcserver.net.info_messages import (
    ArgumentInfo,
    AxisInfo,
    ButtonInfo,
    Info,
    InputInfo,
    LimitsInfo,
    OutputInfo,
    TelemetryInfo,
    ToolInfo,
)
from mcserver.net.messages import (
    MAX_LINES_A_MESSAGE,
    PROTOCOL_VERSION,
)
from mcserver.net.table_messages import Tables, ToolRow
from mcserver.service.approval_basis import server_version
from mcserver.service.executor_port import Cycles, Snapshot
from mcserver.service.line_queue import QUEUE_LINES
from mcserver.service.reports import (
    AxesStatus,
    AxisState,
    MachineStatus,
    MountedTool,
    ToolPose,
    WorkOffset,
)
from mcserver.service.service import OPEN_PROGRAMS, MachineService
from mcserver.service.work_offsets import NO_NOTE, WorkOffsets
from mcserver.simulation.tool_poses import ToolPoses
from mcserver.units import DEGREE, MINUTE, MM

TELEMETRY_FIELDS = ("setpoint", "position", "velocity", "torque")
CYCLES_A_MESSAGE = 10
STATE_HZ = 20.0


NO_SIZE = Cutter(0.0)


class EdgeUnits:
    """Converts arrays over a machine's axes from SI to mm and deg, and to poses of its tools.

    Attributes:
        index: the axes' numbers. scale: SI to mm or deg, by axis.
    """

    def __init__(self, machine: Machine) -> None:
        self.index = [axis.index for axis in machine.axes]
        self.scale = [1.0 / axis.type.si_per_unit for axis in machine.axes]
        self._row_scale: NDArray[np.float64] = np.array(self.scale)
        # column of each axis's leader, or its own
        self._leaders = [
            column if axis.gantry is None else machine.column_of(axis.gantry.leader)
            for column, axis in enumerate(machine.axes)
        ]
        self._paired = bool(machine.followers)
        self._poses = ToolPoses(machine, build_kinematics(machine))

    def of(self, values: Sequence[float]) -> list[float]:
        """Convert one quantity of all axes to mm or deg, or these per second.

        In plain Python: for a single row NumPy's overhead is many times the work.
        """
        return [value * scale for value, scale in zip(values, self.scale, strict=True)]

    def skew(self, position: Sequence[float]) -> list[float]:
        """Return how far second drives are ahead of their leaders; empty without gantries."""
        if not self._paired:
            return []
        return self.of([here - position[at] for here, at in zip(position, self._leaders, strict=True)])

    def tools(self, position: Sequence[float]) -> list[ToolPose]:
        """Return the pose of each tool with the axes at ``position``, length K [SI]."""
        if not self._poses.numbers:
            return []
        row = np.array([position])
        poses = {tool: self._poses.of(tool, row)[0] for tool in self._poses.numbers}
        return [ToolPose(tool, pose[:3].tolist(), pose[3:].tolist()) for tool, pose in poses.items()]

    def work_offsets(self, systems: Mapping[int, Mapping[int, float]]) -> list[WorkOffset]:
        """Return the work coordinate systems that were set, with origins in mm and deg."""
        found: list[WorkOffset] = []
        if not systems:
            return found
        scale = dict(zip(self.index, self.scale, strict=True))
        for name, number in SYSTEM_NUMBERS.items():
            kept = systems.get(number, {})
            origin = {str(axis): value * scale[axis] for axis, value in sorted(kept.items()) if axis in scale}
            rotation = kept.get(ANGLE, 0.0) / DEGREE
            if origin or rotation:
                found.append(WorkOffset(name, origin, rotation))
        return found

    def tables(self, kept: WorkOffsets, *, tool_table: bool) -> Tables:
        """Return the tables that programs start with, and their changes, in mm and deg."""
        scale = {str(axis): scale for axis, scale in zip(self.index, self.scale, strict=True)}
        scale |= {"R": 1.0 / DEGREE, "length": 1.0 / MM, "diameter": 1.0 / MM}
        scale |= {"life": 1.0 / MINUTE, "used": 1.0 / MINUTE}

        def shown(row: Mapping[str, float]) -> dict[str, float]:
            return {name: value * scale[name] for name, value in row.items() if name in scale}

        rows = []
        for number, each in sorted(kept.cutters.items()):
            note = kept.notes.get(f"T{number}", NO_NOTE)
            life_min, used_min = note.life_s / MINUTE, note.used_s / MINUTE
            changed = kept.is_changed(number)
            rows.append(
                ToolRow(number, each.length / MM, each.diameter / MM, changed, note.name, life_min, used_min)
            )
        names = {
            row: note.name for row, note in sorted(kept.notes.items()) if row in SYSTEM_NUMBERS and note.name
        }
        changes = [
            msgspec.structs.replace(each, before=shown(each.before), after=shown(each.after))
            for each in reversed(kept.changes)
        ]
        offsets = self.work_offsets(kept.systems)
        return Tables(offsets, tool_table, rows if tool_table else [], changes, names)

    def rows(self, cycles: Cycles) -> NDArray[np.float32]:
        """Return telemetry of some cycles, shape (n, K, 4), with the fields of `TELEMETRY_FIELDS`."""
        rows = np.empty((*cycles.setpoint.shape, len(TELEMETRY_FIELDS)), dtype="<f4")
        rows[:, :, 0] = cycles.setpoint * self._row_scale
        rows[:, :, 1] = cycles.position * self._row_scale
        rows[:, :, 2] = cycles.velocity * self._row_scale
        rows[:, :, 3] = cycles.torque
        return rows


def axes_at_rest(service: MachineService) -> set[int]:
    """Return the axes of programs that a feed hold has brought to rest; to the executor they are moving.

    Axes with superimposed motion are left out, as that continues.
    """
    going_on = {axis.index for axis in service.machine.axes if axis.reserved is not None}
    held = [each for each in service.current() if each.held and each.slot is not None]
    slots = service.port.slots() if held else []
    return {
        axis for each in held if each.slot is not None and not slots[each.slot].rate for axis in each.axes
    } - going_on


def states_shown(snapshot: Snapshot, index: Sequence[int], at_rest: Container[int]) -> list[AxisState]:
    """Return the axes' states; held axes at rest are standstill, except in a homing search."""
    rows = zip(index, snapshot.states, snapshot.homed or [True] * len(index), strict=True)
    return [
        "standstill" if state == "moving" and homed and axis in at_rest else state
        for axis, state, homed in rows
    ]


def machine_status(service: MachineService, units: EdgeUnits) -> MachineStatus:
    """Return the present state of the whole machine."""
    snapshot = service.port.snapshot()
    if service.latch.faults:
        service.latch.refresh_faults(dict(zip(units.index, snapshot.states, strict=True)))
    axes = AxesStatus(
        index=units.index,
        position=units.of(snapshot.position),
        setpoint=units.of(snapshot.setpoint),
        velocity=units.of(snapshot.velocity),
        torque=snapshot.torque,
        state=states_shown(snapshot, units.index, axes_at_rest(service)),
        homed=snapshot.homed,
        skew=units.skew(snapshot.position),
        silent=snapshot.silent,
    )
    return MachineStatus(
        t=snapshot.time,
        wall=service.time.epoch + snapshot.time,
        instance=service.options.instance,
        state=service.latch.state,
        axes=axes,
        programs=[program.status() for program in service.current()],
        faults=service.latch.faults,
        override=100.0 * service.override,
        late_cycles=snapshot.late_cycles,
        tools=units.tools(snapshot.position),
        probe=service.axis_reports.probe,
        work_offsets=units.work_offsets(service.work_tables.systems),
        inputs=service.channels.inputs(snapshot),
        outputs=service.channels.outputs(snapshot),
        disk=service.disk.status,
        mounted=_mounted(service),
        bed_mesh=service.axis_reports.bed_mesh if service.machine.dialect.mesh_axis is not None else None,
    )


def _mounted(service: MachineService) -> list[MountedTool]:
    """Return the mounted tools with bodies, cutters with their sizes."""
    found: list[MountedTool] = []
    for place, tools in service.mounted.at.items():
        for number in tools if len(tools) == 1 else ():
            size = service.work_tables.cutters.get(number, NO_SIZE) if place == SPINDLE else NO_SIZE
            if number:
                found.append(MountedTool(number, place == SPINDLE, size.length / MM, size.diameter / MM))
    return found


def machine_info(service: MachineService, methods: list[str]) -> Info:
    """Return the information that does not change while the server runs."""
    machine = service.machine
    return Info(
        machine=machine.name,
        server=server_version(),
        protocol=[PROTOCOL_VERSION],
        instance=service.options.instance,
        epoch=service.time.epoch,
        cycle_s=machine.cycle_s,
        axes=[axis_info(axis, machine.dialect) for axis in machine.axes],
        tools=[
            ToolInfo(
                number=tool.number,
                frame=tool.frame,
                axes=list(tool.axes),
                orientation=tool.orientation,
                euler=tool.euler,
                work=tool.work or "",
            )
            for tool in machine.tools
        ],
        telemetry=TelemetryInfo(
            axes=[axis.index for axis in machine.axes],
            fields=list(TELEMETRY_FIELDS),
            cycles_a_message=CYCLES_A_MESSAGE,
            state_hz=STATE_HZ,
        ),
        limits=limits_info(at_once=SLOTS, opened=OPEN_PROGRAMS),
        buttons=[
            ButtonInfo(
                each.name,
                each.text,
                each.role,
                each.confirm,
                [ArgumentInfo(one.name, one.low, one.high, one.first, one.unit) for one in each.argument],
                each.group,
            )
            for each in (*machine.buttons, *probing_cycles(machine))
        ],
        group=machine.group,
        tags=list(machine.tags),
        camera=machine.camera,
        orders_from=list(machine.orders_from),
        methods=sorted(methods),
        inputs=[_input_info(each) for each in machine.inputs],
        outputs=[_output_info(each) for each in machine.outputs],
    )


def limits_info(*, at_once: int, opened: int) -> LimitsInfo:
    """Return the bounds of a service that runs ``at_once`` programs at once and has ``opened`` open."""
    return LimitsInfo(
        max_line_length=MAX_LINE_LENGTH,
        max_lines_a_message=MAX_LINES_A_MESSAGE,
        queue_lines=QUEUE_LINES,
        programs_at_once=at_once,
        open_programs=opened,
        remembered_answers=REMEMBERED_ANSWERS,
        remembered_answer_s=REMEMBERED_S,
    )


def _input_info(each: Input) -> InputInfo:
    return InputInfo(
        name=each.name,
        number=each.number,
        kind="digital" if each.digital else "analog",
        unit=each.unit,
        source="" if each.source is None else each.source.shown,
        hold=math.isfinite(each.hold_below) or math.isfinite(each.hold_above),
        stop=math.isfinite(each.stop_below) or math.isfinite(each.stop_above),
    )


def _output_info(each: Output) -> OutputInfo:
    return OutputInfo(
        name=each.name,
        number=each.number,
        kind="digital" if each.digital else "analog",
        unit=each.unit,
        target="" if each.target is None else each.target.shown,
        min=each.low,
        max=each.high,
        safe=each.safe,
    )


def axis_info(axis: Axis, dialect: Dialect) -> AxisInfo:
    """Return an axis's information for clients; ``dialect``: of the machine's programs."""
    scale = 1.0 / axis.type.si_per_unit

    def limit(value: float) -> float | None:
        return value * scale if math.isfinite(value) else None

    return AxisInfo(
        index=axis.index,
        type=axis.type.value,
        unit="mm" if axis.type.unit == "mm" else "deg",
        max_velocity=axis.max_velocity * scale,
        max_acceleration=axis.max_acceleration * scale,
        drive=axis.drive.kind,
        max_jerk=limit(axis.max_jerk),
        min_position=limit(axis.min_position),
        max_position=limit(axis.max_position),
        in_position=axis.in_position * scale,
        homing=None if axis.homing is None else axis.homing.method,
        letter=min((letter for letter, index in dialect.letters.items() if index == axis.index), default=""),
        spindle=axis.index == dialect.spindle,
    )
