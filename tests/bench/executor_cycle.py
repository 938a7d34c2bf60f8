"""The body of one executor cycle while every axis moves, beside the least that NumPy needs for such rows."""

from __future__ import annotations

import time

import numpy as np

from mcserver.executor.entries import Control, ControlKind
from mcserver.motion.canonical import AxisOperation
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.bench.figures import Figure, percentile
from tests.bench.machines import ideal

CYCLES = 3000
CAPTURE = list(AxisOperation).index(AxisOperation.CAPTURE)


def measure() -> list[Figure]:
    """8 and 64 simulated axes."""
    figures = []
    for axes in (8, 64):
        taken, floor = cycles(axes), numpy_rows(axes)
        for share in (0.5, 0.999):
            goal = "≤ 50 µs" if (axes, share) == (64, 0.5) else ""
            figures.append(
                Figure(
                    f"{axes} axes, p{100 * share:g}",
                    percentile(taken, share),
                    "µs",
                    percentile(floor, share),
                    "four NumPy operations on a row",
                    goal,
                )
            )
    return figures


def cycles(axes: int) -> list[float]:
    """Time of each cycle of a motion of all axes [µs], simulated drives included."""
    machine = ideal(axes=axes, kind="simulated")
    executor = VirtualExecutor(machine)
    mask = (1 << axes) - 1
    ring = executor.open_slot(0, mask)
    u = np.arange(CYCLES + 200.0)
    position = np.repeat(1e-3 * (1.0 - np.cos(u / 200.0))[:, None], axes, axis=1)
    velocity = np.repeat(1e-3 * np.sin(u / 200.0)[:, None] / 200.0 / machine.cycle_s, axes, axis=1)
    ring.put_control(Control(ControlKind.AXIS, 0.0, 1, axes=mask, operation=CAPTURE))
    ring.put_control(Control(ControlKind.BEGIN, 0.0, 2, axes=mask))
    given = 0
    taken = []
    for number in range(CYCLES):
        if given < len(u) and ring.row_room() > 100:
            part = slice(given, given + 100)
            ring.put_rows(
                given,
                position[part],
                velocity[part],
                np.full(len(u[part]), mask, dtype=np.uint64),
                np.full(len(u[part]), 2, dtype=np.int64),
            )
            given += len(u[part])
        start = time.perf_counter_ns()
        executor.executor.cycle(number * machine.cycle_s)
        taken.append((time.perf_counter_ns() - start) / 1000.0)
    executor.close()
    return taken[200:]


def numpy_rows(axes: int) -> list[float]:
    """The floor [µs]: copy a row, compare it, multiply and add."""
    row, other, out = np.zeros(axes), np.ones(axes), np.zeros(axes)
    taken = []
    for _ in range(CYCLES):
        start = time.perf_counter_ns()
        out[:] = row
        np.multiply(row, other, out=out)
        np.add(out, other, out=out)
        np.less(out, row)
        taken.append((time.perf_counter_ns() - start) / 1000.0)
    return taken
