"""The documentation's pictures of chords: python -m tests.motion.picture CHORDS STRETCHES.

The same chords without and with a tolerance, and others with speed by knots alone and solved as a whole.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from unittest import mock

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from tests.motion.support import Motion, Move, alike, plan, polyline
from tests.motion.test_faster_stretches import chords_of, lissajous, only_knots

SPEED, ACCELERATION, JERK, TOLERANCE, CHORD = 0.1, 2000.0, 50_000.0, 2e-5, 5e-4
MM = 1e3


def chords() -> list[tuple[float, float]]:
    """A line, two bends one way and the other in chords of 0.5 mm, and a line [m]."""
    x = y = heading = 0.0
    points = [(-0.01, 0.0), (x, y)]
    for radius, turn in ((0.01, math.pi / 2.0), (-0.006, math.pi / 2.0)):
        for _ in range(round(abs(radius) * turn / CHORD)):
            heading += CHORD / radius
            x, y = x + CHORD * math.cos(heading), y + CHORD * math.sin(heading)
            points.append((round(x, 6), round(y, 6)))
    return [*points, (x + 0.01 * math.cos(heading), y + 0.01 * math.sin(heading))]


def draw(output: Path) -> None:
    """Draw speed, acceleration and jerk of the same chords without and with a tolerance."""
    machine = alike(2, acceleration=ACCELERATION, jerk=JERK)
    groups = polyline(machine, chords(), SPEED)
    start = np.array(chords()[0])
    figure, axes = plt.subplots(3, 2, figsize=(11, 7), sharex=True, sharey="row", layout="constrained")
    for column, tolerance in enumerate((0.0, TOLERANCE)):
        motion = plan(machine, [Move(group, tolerance=tolerance) for group in groups], start=start)
        title = f"tolerance {tolerance * MM:g} mm" if tolerance else "exact"
        axes[0, column].set_title(f"{title}: {motion.duration:.3f} s")
        _draw_one(motion, [row[column] for row in axes])
    axes[0, 0].set_ylabel("speed [mm/s]")
    axes[1, 0].set_ylabel("acceleration [mm/s²]")
    axes[2, 0].set_ylabel("jerk [mm/s³]")
    for axis in axes[2]:
        axis.set_yscale("symlog", linthresh=2.0 * JERK)
        axis.set_xlabel("time [s]")
    figure.savefig(output, dpi=90)


def draw_stretches(output: Path) -> None:
    """Draw the same of chords of a Lissajous figure, with speed by knots alone and solved as a whole."""
    machine = alike(2, velocity=500.0, acceleration=ACCELERATION, jerk=JERK)
    points = chords_of(lissajous(1.0, 2.0, 0.7), CHORD)
    moves = [Move(group, tolerance=TOLERANCE) for group in polyline(machine, points.tolist(), 2.0 * SPEED)]
    figure, axes = plt.subplots(3, 2, figsize=(11, 7), sharex=True, sharey="row", layout="constrained")
    with mock.patch("mcserver.motion.lookahead.lookahead.quicker_stretches", only_knots):
        before = plan(machine, moves, start=points[0])
    for column, (name, motion) in enumerate(
        (("by knots alone", before), ("as a whole", plan(machine, moves, start=points[0])))
    ):
        axes[0, column].set_title(f"{name}: {motion.duration:.3f} s")
        _draw_one(motion, [row[column] for row in axes])
    axes[0, 0].set_ylabel("speed [mm/s]")
    axes[1, 0].set_ylabel("acceleration [mm/s²]")
    axes[2, 0].set_ylabel("jerk [mm/s³]")
    for axis in axes[2]:
        axis.set_xlabel("time [s]")
    figure.savefig(output, dpi=90)


def _draw_one(motion: Motion, axes: list[plt.Axes]) -> None:
    rows, cycle = motion.rested * MM, motion.cycle
    speed = np.linalg.norm(np.diff(rows, axis=0), axis=1) / cycle
    axes[0].plot(np.arange(len(speed)) * cycle, speed, linewidth=1.0)
    for order, limit in ((2, ACCELERATION), (3, JERK)):
        axis = axes[order - 1]
        values = np.diff(rows, order, axis=0) / cycle**order
        axis.plot(np.arange(len(values)) * cycle, values, linewidth=0.7, label=["X", "Y"])
        axis.axhline(limit, color="0.6", linestyle="--", linewidth=0.8)
        axis.axhline(-limit, color="0.6", linestyle="--", linewidth=0.8)
    axes[1].legend(loc="upper right")


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
    draw_stretches(Path(sys.argv[2]))
