"""How late a drive follows speeds by a motion, and the margins of the loop that is closed onto it."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from mcserver.canopen.speed_tuning import (
    PHASE,
    MeasuredSpeed,
    SpeedGains,
    measure_speed,
    proposed_gains,
    speed_margins,
)
from mcserver.drives.bus import Array
from mcserver.drives.cia402.loop_gains import DELAY_CYCLES, ETHERCAT_DELAY_CYCLES
from mcserver.drives.cia402.loops import PositionPart, SpeedLoop
from tests.drives.can_rig import machine

CYCLE_S = 1e-3
COUNTS_PER_MM = 1000.0


def driven(speed: Array, scale: float, lag: float) -> Array:
    """Places of an encoder at each cycle of a drive of first order that follows speeds, shape (n,) [mm]."""
    kept = math.exp(-CYCLE_S / lag)
    rate = place = 0.0
    found = []
    for each in speed.tolist():
        found.append(round(place * COUNTS_PER_MM) / COUNTS_PER_MM)
        change = (scale * each - rate) * (1.0 - kept)
        place += scale * each * CYCLE_S - lag * change
        rate += change
    return np.array(found)


@pytest.mark.parametrize(("scale", "lag"), [(1.0, 0.004), (0.5, 0.0008)])
def test_scale_and_lag_of_a_drive_come_out_of_a_motion(scale: float, lag: float) -> None:
    at = np.arange(3000) * CYCLE_S
    speed = 80.0 * np.sin(15.0 * at) * np.sin(2.0 * at)
    found = measure_speed(speed, driven(speed, scale, lag), CYCLE_S)
    assert found is not None
    assert found.scale == pytest.approx(scale, rel=0.005)
    assert found.lag == pytest.approx(lag, abs=2e-4)
    assert found.uncertainty < 1e-4


def test_what_a_drive_goes_while_a_sync_is_late_does_not_count() -> None:
    at = np.arange(5000) * CYCLE_S
    speed = 80.0 * np.sin(15.0 * at) * np.sin(2.0 * at)
    place = driven(speed, 1.0, 0.004)
    for late in range(170, 5000, 450):
        place[late:] += 30.0 * CYCLE_S * speed[late]
    found = measure_speed(speed, place, CYCLE_S)
    assert found is not None
    assert found.scale == pytest.approx(1.0, rel=0.01)
    assert found.lag == pytest.approx(0.004, abs=2e-4)


def test_speeds_that_do_not_change_or_move_nothing_tell_nothing() -> None:
    even = np.full(2000, 5.0)
    assert measure_speed(even, np.arange(2000) * 5.0 * CYCLE_S, CYCLE_S) is None
    assert measure_speed(even, np.full(2000, np.nan), CYCLE_S) is None
    at = np.arange(2000) * CYCLE_S
    found = measure_speed(np.sin(15.0 * at), np.random.default_rng(3).normal(0.0, 1.0, 2000), CYCLE_S)
    assert found is None or found.uncertainty > 0.5 * CYCLE_S


@pytest.mark.parametrize("delay", [DELAY_CYCLES, ETHERCAT_DELAY_CYCLES])
@pytest.mark.parametrize(("times", "stable"), [(0.9, True), (1.1, False)])
@pytest.mark.parametrize("integral", ["", "integral_time_s = 0.05"])
def test_the_loop_is_stable_up_to_the_gain_that_its_margin_says(
    delay: int, times: float, stable: bool, integral: str
) -> None:
    lag = 4
    measured = MeasuredSpeed(1.0, lag * CYCLE_S, 0.0)
    axes = machine(1, drive=f'mode = "csv"\nposition_gain = 100.0\n{integral}').axes
    time = getattr(axes[0].drive, "integral_time_s", 0.0)
    margin = speed_margins(SpeedGains(100.0, time), measured, CYCLE_S, delay)
    part = PositionPart(axes, CYCLE_S, delay)
    part._gain *= times * margin.greatest
    loop, yes, at = SpeedLoop(axes, part), np.array([True]), np.zeros(1)
    # from the speed of a cycle to the first reading that it has moved
    under_way = deque([np.zeros(1)] * (delay + lag - 1))
    reading, swing = np.full(1, 1e-4), []
    for _ in range(1500):
        under_way.append(loop.step(at, reading, yes, yes))
        part.keep(at)
        reading = reading + CYCLE_S * under_way.popleft()
        swing.append(abs(float(reading[0])))
    assert (max(swing[-100:]) < max(swing[:200])) is stable


def test_the_proposed_gain_leaves_its_phase_and_is_slower_on_ethercat() -> None:
    late, now = MeasuredSpeed(1.0, 0.02, 0.0), SpeedGains(20.0, 0.0)
    for delay in (DELAY_CYCLES, ETHERCAT_DELAY_CYCLES):
        gains = proposed_gains(late, now, CYCLE_S, delay)
        assert speed_margins(gains, late, CYCLE_S, delay).phase == pytest.approx(PHASE, abs=0.02)
    prompt = MeasuredSpeed(1.0, 0.0, 0.0)
    assert proposed_gains(prompt, now, CYCLE_S, DELAY_CYCLES).position_gain == pytest.approx(100.0)
    assert proposed_gains(prompt, now, CYCLE_S, ETHERCAT_DELAY_CYCLES).position_gain == pytest.approx(75.0)
