"""The tool's speed after orders above 100 %: it goes to the new one soon, and never above both on the way."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.machine.machine_file import Machine
from tests.bench.machines import ideal
from tests.bench.override import Order, Run, play
from tests.limits import assert_keeps, limits_of

F = 3600.0
# Cycles in which speed has to be that of an order: one that the executor follows, and one above what the rows
# that are handed over are planned for.
SLOWER_CYCLES, FASTER_CYCLES = 100, 500
NEAR = 0.01


def machine() -> Machine:
    return ideal(axes=2, velocity=500.0, acceleration=3000.0, jerk=60_000.0, tolerance_mm=0.02)


def line() -> list[str]:
    return ["G94", f"G01 X400 Y100 F{F:g}"]


def chords() -> list[str]:
    angle = np.linspace(0.0, 2.2, 500)
    points = 150.0 * np.column_stack((np.sin(angle), 1.0 - np.cos(angle)))
    return ["G94", f"F{F:g}", *(f"G01 X{x:.4f} Y{y:.4f}" for x, y in points[1:])]


def circle() -> list[str]:
    return ["G94", f"G02 X0 Y0 I60 J0 F{F:g}"]


def speeds(run: Run) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Speed in shares of F from the first cycle that moves on."""
    speed = np.linalg.norm(np.diff(run.setpoint, axis=0), axis=1) / machine().cycle_s * 60_000.0 / F
    return speed[int(np.argmax(speed > 0.0)) :]


def assert_speeds_follow(run: Run, orders: list[Order]) -> None:
    speed = speeds(run)
    assert_keeps(run.setpoint, limits_of(machine()))
    before, planned = None, 1.0
    for index, (cycle, override) in enumerate(orders):
        until = orders[index + 1][0] if index + 1 < len(orders) else cycle + 1200
        if before is not None:
            part = speed[cycle:until]
            low, high = min(before, override), max(before, override)
            # where a motion planned for more slows down to rows planned for less, it is played slowly still
            dip = low / max(planned, 1.0) if override < planned else 1.0
            assert part.min() >= low * min(dip, 1.0) * (1.0 - NEAR)
            assert part.max() <= high * (1.0 + NEAR)
            soon = SLOWER_CYCLES if override <= 1.0 else FASTER_CYCLES
            assert part[soon:] == pytest.approx(override, rel=NEAR)
            planned = max(planned, override)
        before = override


@pytest.mark.parametrize(
    "orders",
    [
        [(0, 1.0), (800, 1.5)],
        [(0, 1.0), (1537, 2.0)],
        [(0, 1.0), (1101, 1.2), (1800, 1.9)],
        [(0, 2.0), (700, 1.0), (1200, 1.5)],
        [(0, 1.5), (600, 1.0), (750, 1.3), (1300, 1.1), (1900, 2.0)],
        [(0, 1.0), (700, 0.6), (900, 1.7), (1500, 0.4), (1750, 1.7)],
    ],
)
def test_speed_on_a_line_goes_from_one_override_to_the_next_and_stays(orders: list[Order]) -> None:
    assert_speeds_follow(play(machine(), line(), orders), orders)


@pytest.mark.parametrize("program", [chords, circle])
def test_speed_on_a_curve_goes_from_one_override_to_the_next_and_stays(program: list[str]) -> None:
    orders = [(0, 1.0), (900, 1.5), (1700, 1.2), (2300, 1.6)]
    assert_speeds_follow(play(machine(), program(), orders), orders)


def test_streamed_lines_follow_an_override_as_those_that_are_there_at_once() -> None:
    orders = [(0, 1.0), (900, 1.5), (1700, 1.2)]
    assert_speeds_follow(play(machine(), chords(), orders, every=1), orders)
