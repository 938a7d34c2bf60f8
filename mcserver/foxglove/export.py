"""A recording with the well-known channels beside its own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.writer import Writer
from mckinematics.solver import MachineKinematics

from mcserver.errors import UsageFault
from mcserver.foxglove import channels
from mcserver.foxglove.channels import NS, WellKnown
from mcserver.foxglove.log import log_message
from mcserver.foxglove.motion import joint_states, moving_frames, standing_frames
from mcserver.foxglove.scene import path_clouds, scene_update
from mcserver.foxglove.shape import shape_of
from mcserver.machine.machine_file import Machine
from mcserver.recorder.reading import RecordedRun
from mcserver.recorder.repair import copy_whole, new_writer
from mcserver.simulation.tool_poses import ToolPoses
from mcserver.units import MM
from mcserver.view.solids import Array

# points of a path
MOST_POINTS = 4000


def export(
    run: RecordedRun,
    machine: Machine,
    kinematics: MachineKinematics | None,
    source: Path,
    output: BinaryIO,
    rate_hz: float,
) -> int:
    """Write a recording's own channels, then the well-known ones; return how many messages those have.

    Args:
        source: file of the recording; of an MCAP file all is copied.
        rate_hz: of frames and joints, at most.

    Raises:
        UsageFault: MC017 its axes are not the machine's. OSError.
        Refused: MC587 the machine's URDF cannot be read.
    """
    recorded = [int(axis) for axis in run.cycles.axes]
    if recorded != [axis.index for axis in machine.axes]:
        raise UsageFault(
            "MC017",
            f"{run.name} has the axes {recorded}, which are not those of {machine.name}",
            "name the machine of the recording with --machine",
        )
    scale = np.array([axis.type.si_per_unit for axis in machine.axes])
    time_s = run.cycles.time_s
    rows = thinned(time_s, 1.0 / rate_hz)
    times = [round((run.start_unix + float(at)) * NS) for at in time_s[rows]]
    positions = run.cycles.actual[rows] * scale
    path_rows = np.unique(np.linspace(0, len(time_s) - 1, min(len(time_s), MOST_POINTS)).astype(np.int64))
    paths = paths_of(machine, kinematics, run.cycles.setpoint[path_rows] * scale)
    shape = shape_of(machine, kinematics, np.concatenate(list(paths.values())))
    velocity = None if run.velocity is None else run.velocity[rows] * scale
    torque = None if run.torque is None else run.torque[rows]

    writer = new_writer(output)
    if source.suffix.lower() == ".mcap":
        with source.open("rb") as stream:
            copy_whole(stream, writer)
    file = _File(writer)
    first = times[0]
    if shape.urdf:
        file.add(channels.ROBOT, first, channels.robot_description(shape.urdf))
    file.add(channels.STANDING_FRAMES, first, standing_frames(shape, first))
    file.add(channels.SCENE, first, scene_update(shape, first, paths))
    for channel, cloud in path_clouds(shape, first, paths):
        file.add(channel, first, cloud)
    frames = moving_frames(shape, times, positions)
    joints = joint_states(shape, times, positions, velocity, torque)
    for time_ns, frame, joint in zip(times, frames, joints, strict=True):
        file.add(channels.FRAMES, time_ns, frame)
        file.add(channels.JOINTS, time_ns, joint)
    for event in run.events:
        time_ns = round(event.wall * NS) or first
        message = log_message(event, time_ns)
        if message is not None:
            file.add(channels.LOG, time_ns, message)
    writer.finish()
    return file.count


def thinned(time_s: Array, period_s: float) -> Array:
    """Return the first row of each period, and the last row of all."""
    periods = np.floor((time_s - time_s[0]) / period_s + 1e-6)
    first = np.flatnonzero(np.diff(periods, prepend=-1.0) > 0.0)
    return np.union1d(first, [len(time_s) - 1])


def paths_of(
    machine: Machine, kinematics: MachineKinematics | None, positions: Array
) -> Mapping[int | None, Array]:
    """Return the way of each tool, or of the axes 0, 1 and 2 (None), points (N, 3) [m].

    Args:
        positions: shape (N, K), of all the machine's axes [SI].
    """
    poses = ToolPoses(machine, kinematics)
    if poses.numbers:
        return {tool: poses.of(tool, positions)[:, :3] * MM for tool in poses.numbers}
    points = np.zeros((len(positions), 3))
    for column, axis in enumerate(machine.axes):
        if axis.index < 3:
            points[:, axis.index] = positions[:, column]
    return {None: points}


class _File:
    """Well-known channels in a file, each declared with its first message."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._channels: dict[str, int] = {}
        self.count = 0

    def add(self, channel: WellKnown, time_ns: int, message: bytes) -> None:
        number = self._channels.get(channel.topic)
        if number is None:
            schema = self._writer.register_schema(
                channel.schema_name, channel.schema_encoding, channel.schema
            )
            number = self._writer.register_channel(channel.topic, channel.encoding, schema)
            self._channels[channel.topic] = number
        self._writer.add_message(number, time_ns, message, time_ns)
        self.count += 1
