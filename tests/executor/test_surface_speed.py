"""G96: the spindle turns as the tool's distance from its axis asks, in each cycle (D-120)."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.units import MM, TURN
from tests.executor.planned import Planned
from tests.executor.threading_rig import SPINDLE, lathe

LATHE = lathe(drive="ideal")
HEAD = "G21 G18 G90\nG0 X30 Z5\nS400 M3\n"


def run(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the radius [mm] and the spindle's turns a minute in each cycle, X0 being its axis."""
    planned = Planned(LATHE, HEAD + text)
    for _ in range(20):
        planned.step(1000)
        if planned.ended:
            break
    assert planned.ended
    assert not planned.faults
    rows = np.array(planned.rows)
    turns = 60.0 * np.diff(rows[:, SPINDLE], prepend=rows[0, SPINDLE]) / LATHE.cycle_s / TURN
    return np.abs(rows[:, 0]) / MM, turns


def within(radius: np.ndarray, first: float, last: float) -> slice:
    """Return the cycles in which the tool goes inwards between two radii."""
    begin = int(np.flatnonzero(radius > first)[-1])
    return slice(begin, begin + int(np.argmax(radius[begin:] < last)))


def test_the_surface_speed_is_kept_in_each_cycle_up_to_the_greatest_turns() -> None:
    radius, turns = run("G96 S100 D2000\nG4 P0.5\nG1 X1 F600\nM2")
    facing = within(radius, 29.9, 1.01)
    wanted = np.minimum(1e5 / (TURN * radius[facing]), 2000.0)
    # where it comes to its greatest the jerk limit rounds the corner
    assert turns[facing] == pytest.approx(wanted, rel=0.04)
    assert np.median(np.abs(turns[facing] / wanted - 1.0)) < 0.005
    assert turns.max() < 2000.5


def test_it_follows_rapids_another_zero_and_the_other_direction_too() -> None:
    waits = "\nG4 P0.3\n"
    radius, turns = run(waits.join(["G96 S100 D2000\nM4\nG0 X60", "G92 X20", "G97 S300", "M5", "M2"]))
    assert -turns[radius > 59.999][250] == pytest.approx(1e5 / (TURN * 60.0), rel=0.005)
    assert turns.min() == pytest.approx(-1e5 / (TURN * 20.0), rel=0.005)
    assert -300.0 in np.round(turns, 6)
    assert turns[-1] == 0.0


def test_f_per_turn_follows_the_turns_along_a_line() -> None:
    radius, turns = run("G96 S100 D1500\nG4 P0.5\nG95 F0.2\nG1 X5\nM2")
    speed = -60.0 * np.diff(radius, append=radius[-1]) / LATHE.cycle_s
    facing = within(radius, 28.0, 6.0)
    feed = speed[facing] / turns[facing]
    assert feed.max() < 0.2 * 1.02
    assert feed.min() > 0.2 * 0.93
