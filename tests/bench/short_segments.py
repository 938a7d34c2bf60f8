"""Many short lines: 10 000 × 0.05 mm at 200 mm/s, 1000 mm/s². With too little lookahead it crawls."""

from __future__ import annotations

from tests.bench.figures import Figure, seconds
from tests.bench.machines import ideal
from tests.bench.squares import span

COUNT, LENGTH, SPEED, ACCELERATION = 10_000, 0.05, 200.0, 1000.0


def measure() -> list[Figure]:
    """Motion time of one straight row of segments, and how long its simulation takes."""
    from mcserver.simulation.simulation import simulate

    row = [f"G01 X{LENGTH * i:.2f}" for i in range(1, COUNT + 1)]
    text = "\n".join(["G1010", f"G94 F{SPEED * 60:.0f}", *row])
    machine = ideal(velocity=SPEED, acceleration=ACCELERATION, jerk=None)
    trapezoid = COUNT * LENGTH / SPEED + SPEED / ACCELERATION
    motion = span(simulate(text, machine))
    taken = seconds(lambda: simulate(text, machine), runs=1)
    return [
        Figure("motion", motion, "s", trapezoid, "one trapezoid", "≤ 1.026 (Klipper 1.10, LinuxCNC 2.94)"),
        Figure("simulated in", taken, "s", motion, "the motion itself", "far below 1"),
    ]
