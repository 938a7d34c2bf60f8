"""Draw docs/images/threading.png: a pass of G33 while a load slows the spindle.

python -m tests.bench.threading_picture docs/images/threading.png
"""

from __future__ import annotations

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from mcserver.units import MM
from tests.executor.threading_rig import SPINDLE, Turned, lathe


def draw(path: str) -> None:
    """Draw Z against turns with its distance from the helix, and the spindle's speed."""
    cell = Turned(lathe(), "G21 G18 G90\nS1000 M3\nG0 X10 Z3\nG33 Z-20 K1.5\nM2")
    begin, end = 700, 850

    def load(cycle: int) -> None:
        if cycle in (begin, end):
            cell.bus.load(SPINDLE, 1500.0 if cycle == begin else 0.0)

    cell.run(load)
    along = cell.path(4)
    z, turns = np.array(cell.rows)[along, 2] / MM, cell.turns[along]
    # the wait for the spindle, at rest, left out
    moves = np.flatnonzero(np.diff(z))
    z, turns = z[moves], turns[moves]
    beside = z - 3.0 + 1.5 * turns
    beside -= 1.5 * round(float(np.median(beside)) / 1.5)
    turns = turns - turns[0]
    figure, (place, error, speed) = plt.subplots(3, 1, figsize=(8, 7), sharex=True, constrained_layout=True)
    place.plot(turns, z)
    place.set_ylabel("Z [mm]")
    error.plot(turns, beside / MM)
    error.set_ylim(-15.0, 15.0)
    error.set_ylabel("Z beside the helix [µm]")
    rpm = np.gradient(turns) * 60e3
    speed.plot(turns, np.convolve(np.pad(rpm, 5, mode="edge"), np.full(11, 1.0 / 11.0), "valid"))
    speed.set_ylabel("spindle [rpm]")
    speed.set_xlabel("turns of the spindle since the pass began")
    for each in (place, error, speed):
        each.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    draw(sys.argv[1] if len(sys.argv) > 1 else "docs/images/threading.png")
