"""A recording thinned to what a browser plays: ``python -m mcserver.web.replay OUTPUT FILE``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np
from mckinematics.solver import MachineKinematics

from mcserver.errors import McError
from mcserver.machine.axis import axis_name
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.recorder.reading import read_recording
from mcserver.simulation.recorder import Recorded
from mcserver.simulation.tool_poses import ToolPoses
from mcserver.terminal import visible
from mcserver.units import AxisType
from mcserver.web.replay_format import Replay, ReplayAxis, Tip

MOST_ROWS = 4000


def replay_of(
    cycles: Recorded,
    machine: Machine | None,
    kinematics: MachineKinematics | None,
    text: Mapping[int, str] | None = None,
    zeros: Mapping[str, list[float]] | None = None,
) -> Replay:
    """Thin a recording to `MOST_ROWS`.

    Args:
        machine: that it is of; without one, or with other axes, its positions alone are shown.
        text: of the program's lines. zeros: of work coordinate systems.
    """
    count = len(cycles.time_s)
    rows = np.unique(np.linspace(0, count - 1, min(count, MOST_ROWS)).astype(np.int64))
    position = cycles.actual[rows]
    numbers = [int(axis) for axis in cycles.axes]
    if machine is None or [axis.index for axis in machine.axes] != numbers:
        axes = [ReplayAxis(number, axis_name(number), "") for number in numbers]
        tips = []
    else:
        axes = axes_of(machine, kinematics)
        poses = ToolPoses(machine, kinematics)
        scale = np.array([axis.type.si_per_unit for axis in machine.axes])
        tips = [
            Tip(tool, np.round(poses.of(tool, position * scale)[:, :3], 3).tolist()) for tool in poses.numbers
        ]
    if not tips:
        points = np.zeros((len(rows), 3))
        for column, axis in enumerate(numbers):
            if axis < 3:
                points[:, axis] = position[:, column]
        tips = [Tip(None, np.round(points, 3).tolist())]
    return Replay(
        np.round(cycles.time_s[rows], 3).tolist(),
        cycles.line[rows].astype(int).tolist(),
        axes,
        np.round(position, 4).tolist(),
        tips,
        dict(text or {}),
        dict(zeros or {}),
    )


def axes_of(machine: Machine, kinematics: MachineKinematics | None) -> list[ReplayAxis]:
    """Return the axes of a machine, each called by its joint where it has one."""
    names = {axis.index: axis_name(axis.index) for axis in machine.axes}
    chains = [] if kinematics is None else [kinematics.tool(tool).chain for tool in kinematics.tools]
    for chain in chains:
        for number, joint in zip(chain.axes, chain.joint_names, strict=True):
            names[number] = f"{axis_name(number)} {joint.removesuffix('_joint').replace('_', ' ')}"
    return [
        ReplayAxis.of(
            axis.index,
            names[axis.index],
            rotary=axis.type is AxisType.ROTARY,
            low=axis.min_position / axis.type.si_per_unit,
            high=axis.max_position / axis.type.si_per_unit,
        )
        for axis in machine.axes
    ]


def main(output: str, file: str) -> int:
    """Write the replay of a recording; what is wrong with it goes to standard error."""
    try:
        run = read_recording(Path(file))
    except McError as error:
        sys.stderr.write(f"{visible(str(error))}\n")
        return 1
    try:
        kinematics = None if run.machine is None else build_kinematics(run.machine)
    except McError:
        # its URDF is on another computer
        kinematics = None
    part = Path(f"{output}.part")
    part.write_bytes(msgspec.json.encode(replay_of(run.cycles, run.machine, kinematics, run.text)))
    part.replace(output)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2]))
