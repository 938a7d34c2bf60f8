"""Polylines that stand for an arc, exact and with a path tolerance, beside the arc's own time; and those of
changing curvature, beside the least time for the curve itself.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tests.bench.analytic import least_time
from tests.bench.figures import Figure
from tests.bench.machines import ideal

RADIUS, SPEED, ACCELERATION, LENGTH, TOLERANCE = 20.0, 100.0, 1000.0, 500.0, 0.1
TIGHT_CHORD = 2.0


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
    return figures + tight() + changing()


def tight() -> list[Figure]:
    """Chords of 2 mm that miss the arc by some tolerances."""
    from mcserver.simulation.simulation import simulate

    figures = []
    missed = TIGHT_CHORD**2 / (8.0 * RADIUS)
    floor = float(simulate(arcs(), ideal(axes=2, jerk=50_000.0)).report["duration_s"])
    for tolerances in (2.0, 4.0, 6.0):
        machine = ideal(axes=2, jerk=50_000.0, tolerance_mm=missed / tolerances)
        took = simulate(program(TIGHT_CHORD), machine).report["duration_s"]
        # up to two tolerances an arc fits between chords and vertices
        goal = "≤ 1.10 ×" if tolerances <= 2.0 else ""
        what = f"{TIGHT_CHORD:g} mm, 50 000 mm/s³, tolerance {1e3 * missed / tolerances:.1f} µm"
        what += f", which chords miss {tolerances:g} times"
        figures.append(Figure(what, float(took), "s", floor, "the arc itself, as G03", goal))
    return figures


def changing() -> list[Figure]:
    """Curves of changing curvature in chords, with tolerance and jerk limit [mm]."""
    from mcserver.simulation.simulation import simulate

    figures = []
    for name, curve, speed, chord, tolerance, jerk in (
        ("Lissajous 1:2, 0.5 mm", lissajous(1, 2, 0.7), 200.0, 0.5, 0.02, 50_000.0),
        ("Lissajous 3:2, 0.2 mm", lissajous(3, 2, math.pi / 4.0), 100.0, 0.2, 0.02, 50_000.0),
        ("Lissajous 3:2, 0.5 mm", lissajous(3, 2, math.pi / 4.0), 200.0, 0.5, 0.05, 100_000.0),
        ("clothoid to R6, 0.5 mm", clothoid(200.0, 6.0), 200.0, 0.5, 0.02, 50_000.0),
        ("sphere contour, 1 mm", sphere(), 150.0, 1.0, 0.05, 30_000.0),
    ):
        width = curve.shape[1]
        machine = ideal(axes=width, velocity=500.0, jerk=jerk, tolerance_mm=tolerance)
        took = simulate(lines_along(curve, chord, speed), machine).report["duration_s"]
        floor = least_time(curve, speed, ACCELERATION, jerk)
        what = f"{name}, {speed:g} mm/s, {jerk:g} mm/s³, tolerance {tolerance:g} mm"
        missed = chord**2 * sharpest(curve) / 8.0
        if missed > tolerance:
            # the curve itself is then out of tolerance: another one, no more than that apart, has to be found
            what += f", which chords miss by {missed:.3f} mm"
        figures.append(Figure(what, float(took), "s", floor, "the curve, by linear programs", "≤ 1.10 ×"))
    return figures


def sharpest(curve: NDArray[np.float64]) -> float:
    """Greatest curvature of a dense curve [1/mm]."""
    first = np.gradient(curve, axis=0)
    second = np.gradient(first, axis=0)
    speed = np.linalg.norm(first, axis=1)
    along = np.einsum("ij,ij->i", first, second) / speed
    across = np.sqrt(np.maximum(np.einsum("ij,ij->i", second, second) - along**2, 0.0))
    return float((across / speed**2)[5:-5].max())


def lissajous(first: float, second: float, phase: float) -> NDArray[np.float64]:
    t = np.linspace(0.0, 2.0 * math.pi, 20_001)
    curve = 20.0 * np.stack([np.sin(first * t), np.sin(second * t + phase)], axis=1)
    return curve - curve[0]


def clothoid(length: float, sharpest: float) -> NDArray[np.float64]:
    """Curvature from -1/sharpest to 1/sharpest, which changes evenly along it."""
    s = np.linspace(-0.5 * length, 0.5 * length, 20_001)
    heading = s**2 / (length * sharpest)
    step = np.stack([np.cos(heading), np.sin(heading)], axis=1) * (s[1] - s[0])
    return np.concatenate((np.zeros((1, 2)), np.cumsum(step, axis=0)))


def sphere() -> NDArray[np.float64]:
    """A line round a sphere of R25 that climbs."""
    t = np.linspace(0.0, 1.0, 20_001)
    angle, height = 6.0 * math.pi * t, 0.2 + 1.1 * t
    across = 25.0 * np.cos(height)
    curve = np.stack([across * np.cos(angle), across * np.sin(angle), 25.0 * np.sin(height)], axis=1)
    return curve - curve[0]


def lines_along(curve: NDArray[np.float64], chord: float, speed: float) -> str:
    """A program of chords along a dense curve from the origin [mm]."""
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))))
    at = np.linspace(0.0, along[-1], round(along[-1] / chord) + 1)[1:]
    points = np.stack([np.interp(at, along, column) for column in curve.T], axis=1)
    lines = [
        "G01 " + " ".join(f"{axis}{value:.4f}" for axis, value in zip("XYZ", point, strict=False))
        for point in points.tolist()
    ]
    return "\n".join(["G1010", "G64", f"G94 F{60.0 * speed:g}", *lines]) + "\n"


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
