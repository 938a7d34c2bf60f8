"""Comma lines whose longest group flows, streamed and under overrides and stops of the rate."""

from __future__ import annotations

import random

import numpy as np
import pytest

from mcserver.machine.machine_file import Machine
from tests.bench.machines import ideal
from tests.bench.override import Run, play
from tests.limits import assert_keeps, limits_of


def machine() -> Machine:
    return ideal(axes=3, velocity=500.0, acceleration=3000.0, jerk=60_000.0, tolerance_mm=0.02)


def text_of(seed: int) -> tuple[list[str], list[float]]:
    """A program of ten lines, X and Y beside Z, and where it ends [m]."""
    draw = random.Random(seed)
    x = y = z = 0
    lines = [draw.choice(("G94", "G93"))]
    for _ in range(10):
        x, y, z = x + draw.choice((3, 8, -5)), y + draw.choice((0, 4, 8)), z + draw.choice((1, 4, -3))
        if lines[0] == "G94":
            plane, beside = f"G01 X{x} Y{y} F{draw.choice((1200, 3000))}", f"G01 Z{z} F2400"
        else:
            plane, beside = f"G01 X{x} Y{y} F{draw.choice((200, 400))}", "G01 F600 Z" + str(z)
        kind = draw.random()
        if kind < 0.15:
            lines.append(plane)
            z = round(z)
            lines.append(beside)
        else:
            lines.append(f"{plane}, {beside}" if kind < 0.9 else f"{beside}, {plane}")
    return lines, [x / 1000.0, y / 1000.0, z / 1000.0]


def check(run: Run, lines: list[str], end: list[float]) -> None:
    assert_keeps(run.setpoint, limits_of(machine()))
    assert run.faults == 0
    # G1010 ends too
    assert [line for line in run.lines if line > 2] == list(range(3, len(lines) + 2))
    assert run.setpoint[-1] == pytest.approx(end, abs=1e-12)


def orders(seed: int) -> list[tuple[int, float]]:
    rng = np.random.default_rng(seed)
    cycles = np.cumsum(rng.integers(5, 250, 12)).tolist()
    rates = rng.choice([0.0, 0.3, 0.8, 1.0, 1.4, 2.0], 12).tolist()
    return [*zip(cycles, rates, strict=True), (cycles[-1] + 50, 1.0)]


@pytest.mark.parametrize("seed", range(6))
def test_overrides_and_stops_of_the_rate_keep_all_limits_and_report_each_line_once(seed: int) -> None:
    lines, end = text_of(seed)
    check(play(machine(), lines, orders(seed)), lines, end)


@pytest.mark.parametrize("every", [7, 60])
def test_comma_lines_that_come_one_by_one_keep_all_limits_and_report_each_line_once(every: int) -> None:
    lines, end = text_of(every)
    check(play(machine(), lines, orders(every), every=every), lines, end)


def test_an_override_above_100_percent_from_the_start_is_planned_for_comma_lines() -> None:
    def text(k: float) -> list[str]:
        return ["G94", *(f"G01 X{10 * n} F{2400 * k:g}, G01 Z{2 * n} F{1200 * k:g}" for n in range(1, 8))]

    run, floor = play(machine(), text(1.0), [(0, 1.5)]), play(machine(), text(1.5), [])
    assert run.moved_s == pytest.approx(floor.moved_s, abs=0.002)
