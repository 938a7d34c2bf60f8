"""Feed hold in the middle of an arc and of a line: how soon the motion stands, and where, without a clock."""

from __future__ import annotations

import numpy as np

from mcserver.planning.pipeline import Pipeline
from mcserver.planning.start_state import StartState
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.bench.figures import Figure
from tests.bench.machines import ideal

SPEED, ACCELERATION, RADIUS = 0.1, 1.0, 0.05
PROGRAMS = {
    "a line": "G01 X500 F6000",
    "an arc": "G02 X100 Y0 R50 F6000",
}


def measure() -> list[Figure]:
    """At 100 mm/s and 1000 mm/s²."""
    figures = []
    for name, line in PROGRAMS.items():
        standstill, away = held(line)
        figures.append(
            Figure(
                f"hold to standstill on {name}",
                1000.0 * standstill,
                "ms",
                1000.0 * SPEED / ACCELERATION,
                "v/a",
                "≤ v/a + 10 ms",
            )
        )
        if "arc" in name:
            figures.append(
                Figure("farthest from the arc while it stops", 1e9 * away, "nm", None, "", "on the path")
            )
    return figures


def held(line: str) -> tuple[float, float]:
    """Seconds from the order to the first cycle at rest, and the distance from the arc until then [m]."""
    machine = ideal(axes=2, acceleration=1000.0 * ACCELERATION, jerk=None)
    rows: list[np.ndarray[tuple[int], np.dtype[np.float64]]] = []
    executor = VirtualExecutor(
        machine, recorder=lambda _t, _line, setpoint, _actual: rows.append(setpoint.copy())
    )
    pipeline = Pipeline(machine, executor.open_slot(0), start=StartState.of(machine))
    pipeline.lines.put(1, ["G1010", "G94", line])
    pipeline.lines.closed = True
    for _ in range(600):
        while pipeline.pump(executor.u(0)):
            pass
        executor.step(1)
        for event in executor.events():
            pipeline.on_event(event)
    executor.mailbox.set_hold(True)
    ordered = len(rows)
    executor.step(300)
    path = np.array(rows)[ordered - 1 :]
    moved = np.linalg.norm(np.diff(path, axis=0), axis=1)
    standing = int(np.argmax(moved == 0.0))
    away = np.abs(np.linalg.norm(path - np.array([RADIUS, 0.0]), axis=1) - RADIUS).max()
    return standing * machine.cycle_s, float(away)
