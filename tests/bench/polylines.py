"""Polylines that stand for an arc, exact and with a path tolerance, beside the arc's own time."""

from __future__ import annotations

import math

from tests.bench.figures import Figure
from tests.bench.machines import ideal

RADIUS, SPEED, ACCELERATION, LENGTH, TOLERANCE = 20.0, 100.0, 1000.0, 500.0, 0.1


def measure() -> list[Figure]:
    """Motion of chords of 0.1, 0.5 and 2 mm at 100 mm/s, 1000 mm/s², with and without a jerk limit."""
    from mcserver.simulation.simulation import simulate

    figures = []
    for name, jerk in (("without jerk limit", None), ("50 000 mm/s³", 50_000.0)):
        arc = float(simulate(arcs(), ideal(axes=2, jerk=jerk)).report["duration_s"])
        for chord in (0.1, 0.5, 2.0):
            for tolerance in (0.0, TOLERANCE):
                machine = ideal(axes=2, jerk=jerk, tolerance_mm=tolerance)
                how = f"tolerance {tolerance:g} mm" if tolerance else "exact"
                took = simulate(program(chord), machine).report["duration_s"]
                figures.append(
                    Figure(
                        f"{chord:g} mm, {name}, {how}",
                        float(took),
                        "s",
                        arc,
                        "the arc itself, as G03",
                        "≤ 1.10 ×" if tolerance else "",
                    )
                )
    return figures


def program(chord: float) -> str:
    """Chords of an arc that begins at the origin [mm]."""
    count = round(LENGTH / chord)
    angles = [i * chord / RADIUS for i in range(1, count + 1)]
    lines = [
        f"G01 X{RADIUS * math.sin(angle):.4f} Y{RADIUS * (1.0 - math.cos(angle)):.4f}" for angle in angles
    ]
    return "\n".join(["G1010", "G64", "G94 F6000", *lines]) + "\n"


def arcs() -> str:
    """The arc itself, in half turns [mm]."""
    turned, lines = 0.0, []
    while turned < LENGTH / RADIUS:
        start, turned = turned, min(turned + math.pi, LENGTH / RADIUS)
        x, y = RADIUS * math.sin(turned), RADIUS * (1.0 - math.cos(turned))
        i, j = -RADIUS * math.sin(start), RADIUS * math.cos(start)
        lines.append(f"G03 X{x:.4f} Y{y:.4f} I{i:.4f} J{j:.4f}")
    return "\n".join(["G1010", "G17", "G64", "G94 F6000", *lines]) + "\n"
