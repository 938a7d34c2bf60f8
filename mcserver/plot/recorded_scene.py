"""The scene of a recording of a real run."""

from __future__ import annotations

from typing import Any

import numpy as np
from mckinematics.solver import MachineKinematics

from mcserver.errors import UsageFault
from mcserver.machine.machine_file import Machine
from mcserver.plot.scene import Scene, build_scene
from mcserver.plot.strokes import runs_of
from mcserver.recorder.reading import RecordedRun
from mcserver.units import AxisType


def recorded_scene(run: RecordedRun, machine: Machine, kinematics: MachineKinematics | None) -> Scene:
    """Everything that a picture needs, from a recording.

    Args:
        machine: whose axes and limits are drawn.

    Raises:
        UsageFault: MC017 the recording has an axis that the machine lacks.
    """
    missing = [int(axis) for axis in run.cycles.axes if machine.axis(int(axis)) is None]
    if missing:
        raise UsageFault(
            "MC017",
            f"{run.name} has an axis {missing[0]}, which {machine.name} lacks",
            "name the machine of the recording with --machine",
        )
    text = [run.text.get(number, "") for number in range(1, max(run.text, default=0) + 1)]
    return build_scene(run.name, machine, run.cycles, _report(run, machine), text, kinematics)


def _report(run: RecordedRun, machine: Machine) -> dict[str, Any]:
    time_s = run.cycles.time_s
    linear = [
        column
        for column, axis in enumerate(run.cycles.axes)
        if (found := machine.axis(int(axis))) is not None and found.type is AxisType.LINEAR
    ]
    steps = np.diff(run.cycles.setpoint[:, linear], axis=0)
    lines: list[dict[str, Any]]
    if run.lines:
        lines = [
            {
                "line": mark.line,
                "start_s": mark.start_s,
                "end_s": mark.end_s,
                "requested_s": mark.requested_s,
                "bound_by": mark.bound_by,
            }
            for mark in run.lines
            if mark.end_s > mark.start_s
        ]
    else:
        # without reports, as long as each line has set the rows
        numbers = run.cycles.line.astype(np.int64)
        lines = [
            {
                "line": number,
                "start_s": float(time_s[first]),
                "end_s": float(time_s[end - 1]),
                "requested_s": None,
                "bound_by": None,
            }
            for number, first, end in runs_of(numbers)
            if number > 0
        ]
    return {
        "duration_s": float(time_s[-1]),
        "feed_length_mm": float(np.linalg.norm(steps, axis=1).sum()) if linear else 0.0,
        "lines": lines,
    }
