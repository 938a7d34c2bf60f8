"""What is to be drawn: plain arrays in mm and degrees, free of any drawing library."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
from mckinematics.solver import MachineKinematics
from numpy.typing import NDArray

from mcserver.machine.axis import Axis, axis_name
from mcserver.machine.machine_file import Machine
from mcserver.plot.surroundings import Surroundings, surroundings_of
from mcserver.simulation.recorder import Recorded
from mcserver.simulation.tool_poses import tool_poses
from mcserver.units import AxisType

Array = NDArray[np.float64]
Lines = NDArray[np.int64]

MAX_TOOL_POINTS = 2000
# less travel than this is a reading of the encoder, not a motion [mm, deg]
LEAST_TRAVEL = 1e-6
# A drive's lag is shorter [s].
LAG_S = 0.25
MAX_PIECES = 501


class AxisTrace(msgspec.Struct, frozen=True):
    """One axis that moved.

    Attributes:
        setpoint, actual: shape (N,) [mm or deg].
        limits: of velocity, acceleration and jerk [mm, deg; s]; infinite where not limited.
        readings: shape (N,), True where the setpoint is the encoder's reading: the axis is at rest, or not
            energized.
    """

    index: int
    name: str
    unit: str
    linear: bool
    setpoint: Array
    actual: Array
    limits: tuple[float, float, float]
    readings: NDArray[np.bool_]

    @property
    def following_error(self) -> Array:
        """Setpoint minus encoder, shape (N,) [mm or deg]; 0 where the axis is not energized."""
        return self.setpoint - self.actual

    def derivatives(self, cycle_s: float) -> tuple[Array, Array, Array]:
        """Velocity, acceleration and jerk of the setpoint as differences of whole cycles, shape (N,) each.

        Differences, not smoothed derivatives: limits are judged on setpoints at the cycle rate (D-36). Where
        an axis is not energized its setpoint is the encoder's reading, which obeys no limit: that counts as
        rest.
        """
        velocity = np.diff(self.setpoint, prepend=self.setpoint[:1]) / cycle_s
        velocity[self.readings] = 0.0
        acceleration = np.diff(velocity, prepend=0.0) / cycle_s
        jerk = np.diff(acceleration, prepend=0.0) / cycle_s
        return velocity, acceleration, jerk


class PathTrace(msgspec.Struct, frozen=True):
    """A path in the plane or in space, of axes or of a tool.

    Attributes:
        label: what it is the path of; empty for the machine's own axes.
        names: of the two or three coordinates.
        time: shape (M,) [s].
        line: shape (M,), the program's line at each point.
        setpoint, actual: shape (M, 2 or 3) [mm].
    """

    label: str
    names: tuple[str, ...]
    time: Array
    line: Lines
    setpoint: Array
    actual: Array

    def speed(self) -> Array:
        """Speed of the setpoint along the path, shape (M,) [mm/s]."""
        if len(self.time) < 2:
            return np.zeros(len(self.time))
        steps = np.linalg.norm(np.diff(self.setpoint, axis=0), axis=1) / np.diff(self.time)
        return np.concatenate([[0.0], steps])

    def deviation(self) -> Array:
        """Distance of the encoders' path from that of the setpoints, shape (M,) [mm].

        Of each point from the nearest of the pieces around its own time: a drive that lags, but follows the
        path, has no deviation.
        """
        count = len(self.time)
        if count < 2:
            return np.zeros(count)
        rows = np.arange(count)
        near = max(2, int(np.searchsorted(self.time, self.time[0] + LAG_S)))
        # of a long run every so many pieces, and not more of them
        offsets = np.unique(np.linspace(-near, near, min(2 * near + 1, MAX_PIECES)).astype(np.int64))
        best = np.full(count, np.inf)
        for offset, following in pairwise(offsets.tolist()):
            first = self.setpoint[np.clip(rows + offset, 0, count - 1)]
            last = self.setpoint[np.clip(rows + following, 0, count - 1)]
            np.minimum(best, _distance(self.actual, first, last), out=best)
        return best


def _distance(points: Array, first: Array, last: Array) -> Array:
    """Distances of points from straight pieces, shape (M,)."""
    piece = last - first
    length2 = np.einsum("ij,ij->i", piece, piece)
    along = np.einsum("ij,ij->i", points - first, piece) / np.where(length2 > 0.0, length2, 1.0)
    nearest = first + np.clip(along, 0.0, 1.0)[:, np.newaxis] * piece
    distance: Array = np.linalg.norm(points - nearest, axis=1)
    return distance


class TimedLine(msgspec.Struct, frozen=True):
    """A line that took time [s]; ``requested_s`` is None where nothing was asked."""

    line: int
    start_s: float
    end_s: float
    requested_s: float | None
    bound_by: str | None
    source: str


class WorkZero(msgspec.Struct, frozen=True):
    """Where a work coordinate system reads zero, in the path's coordinates [mm]; ``name``: such as G54."""

    name: str
    at: tuple[float, ...]


class Scene(msgspec.Struct, frozen=True):
    """A run to be drawn in the machine's coordinates; ``time`` and ``line`` are of shape (N,)."""

    title: str
    cycle_s: float
    duration_s: float
    feed_length_mm: float
    time: Array
    line: Lines
    axes: tuple[AxisTrace, ...]
    paths: tuple[PathTrace, ...]
    timed_lines: tuple[TimedLine, ...]
    zeros: tuple[WorkZero, ...] = ()
    around: Surroundings = Surroundings()


def build_scene(
    title: str,
    machine: Machine,
    recording: Recorded,
    report: Mapping[str, Any],
    source_lines: Sequence[str],
    kinematics: MachineKinematics | None = None,
) -> Scene:
    """Everything that a picture needs, from a recorded run.

    The path is that of each tool whose tip moved; without tools, that of the first linear axes that moved.
    """
    line = np.asarray(recording.line).astype(np.int64)
    traces = []
    for column, number in enumerate(recording.axes):
        axis = machine.axis(int(number))
        setpoint, actual = recording.setpoint[:, column], recording.actual[:, column]
        if axis is not None and len(setpoint) and np.ptp(setpoint) > LEAST_TRAVEL:
            traces.append(_axis_trace(axis, setpoint, actual, _name_of(axis.index, kinematics)))
    paths = _tool_paths(machine, recording, line, kinematics) if kinematics is not None else ()
    return Scene(
        title=title,
        cycle_s=machine.cycle_s,
        duration_s=float(report["duration_s"]),
        feed_length_mm=float(report["feed_length_mm"]),
        time=np.asarray(recording.time_s),
        line=line,
        axes=tuple(traces),
        paths=paths or _axes_path(np.asarray(recording.time_s), line, traces),
        timed_lines=tuple(_timed_line(each, source_lines) for each in report["lines"]),
        # tools have a frame of their own
        zeros=() if paths else _work_zeros(report, traces),
        around=surroundings_of(
            machine, report, [] if paths else [trace.index for trace in traces if trace.linear][:3]
        ),
    )


def _work_zeros(report: Mapping[str, Any], traces: Sequence[AxisTrace]) -> tuple[WorkZero, ...]:
    """Zeros of the work coordinate systems of a run whose path is that of axes."""
    linear = [trace for trace in traces if trace.linear][:3]
    return tuple(
        WorkZero(each["system"], tuple(float(each["origin"].get(str(trace.index), 0.0)) for trace in linear))
        for each in report.get("work_offsets", ())
    )


def _name_of(index: int, kinematics: MachineKinematics | None) -> str:
    """Return the joint's name where the axis is one of a tool's chain: X of a robot is no axis of its own."""
    if kinematics is not None:
        for tool in kinematics.tools:
            chain = kinematics.tool(tool).chain
            if index in chain.axes:
                return f"{chain.joint_names[list(chain.axes).index(index)]} (axis {index})"
    return axis_name(index)


def _axis_trace(axis: Axis, setpoint: Array, actual: Array, name: str) -> AxisTrace:
    scale = axis.type.si_per_unit
    return AxisTrace(
        index=axis.index,
        name=name,
        unit=axis.type.unit,
        linear=axis.type is AxisType.LINEAR,
        setpoint=setpoint,
        actual=actual,
        limits=(axis.max_velocity / scale, axis.max_acceleration / scale, axis.max_jerk / scale),
        # an ideal drive's encoder always shows the setpoint, and nothing jumps when it is released
        readings=(setpoint == actual) & axis.drive.has_inertia,
    )


def _axes_path(time: Array, line: Lines, traces: Sequence[AxisTrace]) -> tuple[PathTrace, ...]:
    linear = [trace for trace in traces if trace.linear][:3]
    if len(linear) < 2:
        return ()
    return (
        PathTrace(
            label="",
            names=tuple(trace.name for trace in linear),
            time=time,
            line=line,
            setpoint=np.stack([trace.setpoint for trace in linear], axis=1),
            actual=np.stack([trace.actual for trace in linear], axis=1),
        ),
    )


def _tool_paths(
    machine: Machine, recording: Recorded, line: Lines, kinematics: MachineKinematics
) -> tuple[PathTrace, ...]:
    columns = {int(number): column for column, number in enumerate(recording.axes)}
    si_per_unit = np.array([axis.type.si_per_unit for axis in machine.axes])
    count = len(recording.time_s)
    rows = np.unique(np.linspace(0, count - 1, min(count, MAX_TOOL_POINTS)).astype(np.int64))
    paths = []
    for tool in kinematics.tools:
        chain = kinematics.axes(tool)
        if not any(np.ptp(recording.setpoint[:, columns[axis]]) > LEAST_TRAVEL for axis in chain):
            continue
        paths.append(
            PathTrace(
                label=f"T{tool}",
                names=("X", "Y", "Z"),
                time=np.asarray(recording.time_s)[rows],
                line=line[rows],
                setpoint=_tips(kinematics, tool, recording.setpoint[rows] * si_per_unit, columns),
                actual=_tips(kinematics, tool, recording.actual[rows] * si_per_unit, columns),
            )
        )
    return tuple(paths)


def _tips(kinematics: MachineKinematics, tool: int, positions: Array, columns: Mapping[int, int]) -> Array:
    """Return where the tool's tip is [mm], from the positions of all axes [m, rad]."""
    joints = positions[:, [columns[axis] for axis in kinematics.axes(tool)]]
    return tool_poses(kinematics, tool, joints)[:, :3]


def _timed_line(each: Mapping[str, Any], source_lines: Sequence[str]) -> TimedLine:
    number = int(each["line"])
    source = source_lines[number - 1].split(";")[0].strip() if 0 < number <= len(source_lines) else ""
    return TimedLine(
        line=number,
        start_s=float(each["start_s"]),
        end_s=float(each["end_s"]),
        requested_s=each["requested_s"],
        bound_by=each["bound_by"],
        source=source,
    )
