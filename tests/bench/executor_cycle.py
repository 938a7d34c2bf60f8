"""The body of one executor cycle while every axis moves, beside the least that NumPy needs for such rows; and
the same while orders come that change the rate, beside one without.
"""

from __future__ import annotations

import gc
import time

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Control, ControlKind
from mcserver.motion.canonical import AxisOperation
from mcserver.motion.kernels.rate_search import warm_up_playback
from mcserver.motion.pieces import Rows
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.bench.figures import Figure, percentile, percentiles
from tests.bench.machines import ideal

CYCLES = 3000
# Of the runs with orders: cycles, those before the first order, and between two.
ORDER_CYCLES, FIRST_ORDER, BETWEEN = 12_000, 1500, 250
ORDERS = ("hold", "resume", 0.5, 1.0, 1.5, 1.0, 2.0, 1.0)
CAPTURE = list(AxisOperation).index(AxisOperation.CAPTURE)


def measure() -> list[Figure]:
    """8 and 64 simulated axes; 2 and 64 ideal ones under orders."""
    figures = []
    for axes in (8, 64):
        goals = {0.5: "≤ 50 µs"} if axes == 64 else {}
        against = "four NumPy operations on a row"
        taken = cycles(axes)
        figures += percentiles(f"{axes} axes", taken, numpy_rows(axes), against, goals, shares=(0.5, 0.999))
    for axes in (2, 64):
        # all beside the median without orders
        plain, taken = [percentile(with_orders(axes, False), 0.5)], with_orders(axes, True)
        goals = {1.0: "≤ 150 µs"} if axes == 64 else {}
        what = f"{axes} axes under orders"
        figures += percentiles(what, taken, plain, "p50 without orders", goals, shares=(0.5, 0.99, 1.0))
    return figures


def with_orders(axes: int, orders: bool) -> list[float]:
    """Processor time of each cycle [µs] of a motion near its limits, with holds and overrides or without."""
    warm_up_playback()
    machine = ideal(axes=axes)
    executor = VirtualExecutor(machine)
    mask = (1 << axes) - 1
    ring = executor.open_slot(0, mask)
    position, velocity = sines(axes, 2 * ORDER_CYCLES, machine.cycle_s)
    ring.put_control(Control(ControlKind.AXIS, 0.0, 1, axes=mask, operation=CAPTURE))
    ring.put_control(Control(ControlKind.BEGIN, 0.0, 2, axes=mask))
    given = ordered = 0
    taken = []
    gc.collect()
    gc.disable()
    try:
        for number in range(ORDER_CYCLES):
            while ring.row_room() > 100 and given - executor.u(0) < 3000.0:
                part = slice(given, given + 100)
                masks, lines = np.full(100, mask, np.uint64), np.full(100, 2, np.int64)
                ring.put_rows(Rows(given + 1, position[part], velocity[part], masks, lines))
                given += 100
            if orders and number >= FIRST_ORDER and number % BETWEEN == 0:
                _give(executor, ORDERS[ordered % len(ORDERS)])
                ordered += 1
            start = time.thread_time_ns()
            executor.executor.cycle(number * machine.cycle_s)
            taken.append((time.thread_time_ns() - start) / 1000.0)
    finally:
        gc.enable()
        executor.close()
    return taken[FIRST_ORDER:]


def sines(axes: int, count: int, cycle_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions and velocities of axes on one sine each, shape (count, axes)."""
    size, pulsation = 0.05, 1.0 / 500.0
    slope = np.clip(np.arange(count) / 800.0, 0.0, 1.0) * pulsation
    phase = np.cumsum(slope)[:, None] + 0.3 * np.arange(axes)
    return size * (np.sin(phase) - np.sin(phase[0])), size * np.cos(phase) * slope[:, None] / cycle_s


def _give(executor: VirtualExecutor, order: str | float) -> None:
    if order == "hold":
        executor.mailbox.set_hold(True, 0)
    elif order == "resume":
        executor.mailbox.resume(0)
    else:
        executor.mailbox.set_override(float(order), 0)


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
            masks, lines = np.full(len(u[part]), mask, np.uint64), np.full(len(u[part]), 2, np.int64)
            ring.put_rows(Rows(given, position[part], velocity[part], masks, lines))
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
