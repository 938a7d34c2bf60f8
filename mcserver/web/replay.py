"""A recording thinned to what a browser plays: ``python -m mcserver.web.replay OUTPUT FILE``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from mcserver.errors import McError
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.recorder.reading import RecordedRun, read_recording
from mcserver.simulation.tool_poses import ToolPoses
from mcserver.terminal import visible

MOST_ROWS = 4000


def replay_of(run: RecordedRun) -> dict[str, Any]:
    """Return ``time_s`` (n,), ``line`` (n,), ``axes`` (k,), ``position`` (n, k) [mm, deg], and ``tips``.

    ``tips``: of each ``tool`` (None: the axes 0, 1 and 2 themselves) its ``points`` (n, 3) [mm].
    """
    cycles = run.cycles
    count = len(cycles.time_s)
    rows = np.unique(np.linspace(0, count - 1, min(count, MOST_ROWS)).astype(np.int64))
    position = cycles.actual[rows]
    axes = [int(axis) for axis in cycles.axes]
    tips: list[dict[str, Any]] = []
    kinematics = None
    if run.machine is not None and [axis.index for axis in run.machine.axes] == axes:
        try:
            kinematics = build_kinematics(run.machine)
        except McError:
            # its URDF is on another computer
            kinematics = None
        if kinematics is not None:
            poses = ToolPoses(run.machine, kinematics)
            scale = np.array([axis.type.si_per_unit for axis in run.machine.axes])
            tips = [
                {"tool": tool, "points": np.round(poses.of(tool, position * scale)[:, :3], 3).tolist()}
                for tool in poses.numbers
            ]
    if not tips:
        points = np.zeros((len(rows), 3))
        for column, axis in enumerate(axes):
            if axis < 3:
                points[:, axis] = position[:, column]
        tips = [{"tool": None, "points": np.round(points, 3).tolist()}]
    return {
        "time_s": np.round(cycles.time_s[rows], 3).tolist(),
        "line": cycles.line[rows].astype(int).tolist(),
        "axes": axes,
        "position": np.round(position, 4).tolist(),
        "tips": tips,
    }


def main(output: str, file: str) -> int:
    """Write the replay of a recording; what is wrong with it goes to standard error."""
    try:
        made = replay_of(read_recording(Path(file)))
    except McError as error:
        sys.stderr.write(f"{visible(str(error))}\n")
        return 1
    part = Path(f"{output}.part")
    part.write_bytes(msgspec.json.encode(made))
    part.replace(output)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2]))
