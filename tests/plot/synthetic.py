"""A run made by formula: what the pictures are tested with."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.plot.scene import Scene, build_scene
from mcserver.simulation.recorder import Recorded
from tests.machine_text import axes_text

Array = NDArray[np.float64]

SOURCE = ["G01 X100 ; there", "G01 Y50", "</script><b>\u2028&"]


def machine(*types: str, jerk: str = "max_jerk = 50000.0") -> Machine:
    axes = "".join(
        axes_text([index], rotary=kind == "rotary", acceleration=1000.0, keys=jerk, drive="simulated")
        for index, kind in enumerate(types)
    )
    return parse_machine(f'[machine]\nname = "bench"\ncycle_hz = 1000\n{axes}')


def run(columns: list[Array], line: Array | None = None) -> Recorded:
    setpoint = np.stack(columns, axis=1)
    count = len(setpoint)
    return Recorded(
        time_s=np.arange(count) / 1000.0,
        line=np.ones(count) if line is None else line,
        axes=np.arange(setpoint.shape[1], dtype=float),
        setpoint=setpoint,
        actual=setpoint - 0.01,
    )


def report(count: int) -> dict[str, Any]:
    half = count / 2000.0
    return {
        "duration_s": count / 1000.0,
        "feed_length_mm": 1234.5,
        "lines": [
            {"line": 1, "start_s": 0.0, "end_s": half, "requested_s": 0.9 * half, "bound_by": "axis 0 jerk"},
            {"line": 3, "start_s": half, "end_s": 2 * half, "requested_s": None, "bound_by": None},
        ],
    }


def smooth(count: int, travel: float) -> Array:
    """A motion from rest to rest with bounded jerk."""
    s = np.linspace(0.0, 1.0, count)
    return travel * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def scene(*columns: Array, types: tuple[str, ...] | None = None) -> Scene:
    count = len(columns[0])
    described = machine(*(types or ("linear",) * len(columns)))
    line = np.where(np.arange(count) < count // 2, 1.0, 3.0)
    return build_scene("part.gcode", described, run(list(columns), line), report(count), SOURCE)
