"""The 100 mm square of the comparisons: 100 mm/s, 1000 mm/s², no jerk limit; and with one."""

from __future__ import annotations

import numpy as np

from tests.bench.figures import Figure
from tests.bench.machines import ideal

SIDE, SPEED, ACCELERATION, JERK, TOLERANCE = 100.0, 100.0, 1000.0, 50_000.0, 0.1
CORNERS = np.array([[SIDE, 0.0], [SIDE, SIDE], [0.0, SIDE], [0.0, 0.0]])
SQUARE = "G1010\nG94 F6000\n{mode}\nG01 X100\nG01 Y100\nG01 X0\nG01 Y0\n"


def measure() -> list[Figure]:
    """With exact stop, and with a path tolerance."""
    from mcserver.simulation.simulation import simulate

    ideal_time = 4.0 * (SIDE / SPEED + SPEED / ACCELERATION)
    stopping = simulate(SQUARE.format(mode="G61"), ideal(jerk=None), record=True)
    rounded = simulate(SQUARE.format(mode="G64"), ideal(jerk=None, tolerance_mm=TOLERANCE), record=True)
    smooth_stops = simulate(SQUARE.format(mode="G61"), ideal(jerk=JERK))
    smooth = simulate(SQUARE.format(mode="G64"), ideal(jerk=JERK, tolerance_mm=TOLERANCE), record=True)
    tolerant = f"G64, tolerance {TOLERANCE} mm"
    return [
        Figure("exact stop", span(stopping), "s", ideal_time, "four trapezoids", "≤ 4.402 s"),
        Figure(
            "exact stop: farthest from a corner", 1000.0 * corner_error(stopping), "µm", None, "", "≤ 1 µm"
        ),
        Figure(tolerant, span(rounded), "s", span(stopping), "exact stop", "below 1"),
        Figure("G64: farthest from a corner", corner_error(rounded), "mm", TOLERANCE, "the tolerance", "≤ 1"),
        Figure(
            f"{tolerant}, {JERK:.0f} mm/s³", span(smooth), "s", span(smooth_stops), "exact stop", "below 1"
        ),
        Figure("the same: farthest from a corner", corner_error(smooth), "mm", TOLERANCE, "", "≤ 1"),
    ]


def span(simulation: object) -> float:
    """From the first line's start to the last one's end [s]."""
    lines = simulation.report["lines"]  # type: ignore[attr-defined]
    return float(lines[-1]["end_s"] - lines[0]["start_s"])


def corner_error(simulation: object) -> float:
    """The largest distance between a corner and the nearest setpoint [mm]."""
    path = simulation.recording.setpoint[:, :2]  # type: ignore[attr-defined]
    return float(max(np.linalg.norm(path - corner, axis=1).min() for corner in CORNERS))
