"""Margins of a loop by what was measured of an axis, one that rings too, and the program that shakes it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mcserver.canopen.chirp import chirp_lines, half_period_travel
from mcserver.canopen.cycle_samples import Array
from mcserver.canopen.frequency_response import MeasuredMargins, measure_response, measured_margins
from mcserver.canopen.speed_tuning import (
    MeasuredSpeed,
    SpeedGains,
    speed_controller,
    speed_margins,
)
from mcserver.canopen.torque_tuning import TorqueGains, margins, torque_controller, usual_gains
from mcserver.drives.cia402.loop_gains import DELAY_CYCLES, ETHERCAT_DELAY_CYCLES
from mcserver.drives.cia402.loops import DAMPING_CYCLES
from mcserver.machine.machine_file import load_machine
from mcserver.simulation.simulation import simulate

CYCLE_S = 1e-3
INERTIA, TURN_COUNTS = 8e-5, 65536
STEPS = 10


def shaken(count: int = 12_000) -> Array:
    """Commands that sweep from slow to quick, as the loop of a moved axis orders them, shape (n,)."""
    at = np.arange(count) / count
    phase = np.cumsum(0.002 * 75.0**at) * 2.0 * math.pi
    return np.sign(np.sin(phase)) + np.random.default_rng(7).normal(0.0, 0.2, count)


class Shaft:
    """A motor in whole counts; ``share`` of the inertia is behind a spring that rings."""

    def __init__(self, share: float = 0.0, natural_hz: float = 0.0, damping: float = 0.02) -> None:
        self._motor, self._load = INERTIA * (1.0 - share), INERTIA * share
        self._stiff = self._load * (2.0 * math.pi * natural_hz) ** 2
        self._damped = 2.0 * damping * math.sqrt(self._stiff * self._load)
        self._angle = self._rate = self._far = self._far_rate = 0.0

    def turn(self, torque: float) -> float:
        """Go on for a cycle; return the angle at its end [rad]."""
        step = CYCLE_S / STEPS
        for _ in range(STEPS):
            through = self._stiff * (self._far - self._angle) + self._damped * (self._far_rate - self._rate)
            self._rate += (torque + through) / self._motor * step
            self._angle += self._rate * step
            if self._load:
                self._far_rate -= through / self._load * step
                self._far += self._far_rate * step
        counts = 2.0 * math.pi / TURN_COUNTS
        return round(self._angle / counts) * counts


def turned(torque: Array, shaft: Shaft | None = None) -> Array:
    """Angles of a shaft at the begin of each cycle, shape (n,) [rad]."""
    made = shaft or Shaft()
    return np.array([0.0, *map(made.turn, torque[:-1].tolist())])


def is_stable(gains: TorqueGains, shaft: Shaft) -> bool:
    """Whether a shaft that was pushed comes to rest under its loop, whose readings are two cycles late."""
    errors = [0.0] * (DAMPING_CYCLES + 1)
    swings, torque, integral = [], 0.2, 0.0
    for cycle in range(6000):
        reading = shaft.turn(torque)
        damped = (errors[-1] - errors[-1 - DAMPING_CYCLES]) / (DAMPING_CYCLES * CYCLE_S)
        integral += gains.position_gain * CYCLE_S / gains.integral_time_s * errors[-1]
        torque = gains.velocity_gain * (gains.position_gain * errors[-1] + damped + integral)
        if not abs(torque) < 1e3:
            return False
        errors.append(-reading)
        swings.append(abs(reading))
        del errors[0], cycle
    return max(swings[-1000:]) < 0.2 * max(swings[:1000])


def margins_of(gains: TorqueGains, angle: Array, torque: Array, delay: int = DELAY_CYCLES) -> MeasuredMargins:
    response = measure_response(torque, angle, 2)
    assert response is not None
    found = measured_margins(response, torque_controller(gains, response.frequency, CYCLE_S), CYCLE_S, delay)
    assert found is not None
    return found


ON_BUSES = pytest.mark.parametrize("delay", [DELAY_CYCLES, ETHERCAT_DELAY_CYCLES], ids=["can", "ethercat"])


@ON_BUSES
def test_a_rigid_load_measures_the_margins_that_its_inertia_gives(delay: int) -> None:
    torque = 0.05 * shaken()
    gains = usual_gains(INERTIA, CYCLE_S, delay)
    found = margins_of(gains, turned(torque), torque, delay)
    known = margins(gains, INERTIA, CYCLE_S, delay)
    assert found.phase == pytest.approx(known.phase, abs=math.radians(3.0))
    assert found.gain == pytest.approx(1.0 / known.least, rel=0.1)


@pytest.mark.parametrize(("share", "natural_hz"), [(0.8, 25.0), (0.5, 30.0), (0.5, 60.0)])
def test_a_load_that_rings_has_the_gain_margin_at_which_its_loop_becomes_unstable(
    share: float, natural_hz: float
) -> None:
    torque = 0.05 * shaken()
    gains = usual_gains(INERTIA, CYCLE_S, DELAY_CYCLES)
    angle = turned(torque, Shaft(share, natural_hz))
    found = margins_of(gains, angle, torque)
    assert found.gain is not None
    assert found.gain < 0.5 * (margins_of(gains, turned(torque), torque).gain or 0.0)
    for part, stable in ((0.8, True), (1.25, False)):
        changed = replace(gains, velocity_gain=part * found.gain * gains.velocity_gain)
        assert is_stable(changed, Shaft(share, natural_hz)) is stable
    slower = margins_of(replace(gains, velocity_gain=0.25 * gains.velocity_gain), angle, torque)
    assert slower.gain == pytest.approx(4.0 * found.gain, rel=0.05)


@ON_BUSES
def test_a_drive_that_follows_speeds_late_measures_the_margins_of_its_delay(delay: int) -> None:
    speed, late = 10.0 * shaken(), 3
    followed = np.concatenate((np.zeros(late), speed[:-late]))
    place = np.concatenate(([0.0], np.cumsum(followed)[:-1])) * CYCLE_S
    gains = SpeedGains(40.0, 0.5)
    response = measure_response(speed, place, 1)
    assert response is not None
    found = measured_margins(response, speed_controller(gains, response.frequency, CYCLE_S), CYCLE_S, delay)
    known = speed_margins(gains, MeasuredSpeed(1.0, late * CYCLE_S, 0.0), CYCLE_S, delay)
    assert found is not None
    assert found.phase == pytest.approx(known.phase, abs=math.radians(3.0))
    assert found.gain == pytest.approx(known.greatest, rel=0.1)


def test_noise_a_motion_that_is_too_short_and_readings_that_are_missing_tell_nothing() -> None:
    torque = 0.05 * shaken()
    angle = turned(torque)
    assert measure_response(torque[:2000], angle[:2000], 2) is None
    rng = np.random.default_rng(3)
    assert measure_response(rng.normal(size=len(torque)), angle, 2) is None
    assert measure_response(torque, np.zeros(len(torque)), 2) is None
    few, many = angle.copy(), angle.copy()
    few[100::500], many[::3] = np.nan, np.nan
    assert measure_response(torque, few, 2) is not None
    assert measure_response(torque, many, 2) is None


@pytest.mark.parametrize("jerk", [None, 200.0])
@pytest.mark.parametrize("duration", [0.01, 0.1, 0.5, 3.0])
def test_an_axis_gets_as_far_as_its_limits_let_it(jerk: float | None, duration: float) -> None:
    from msgspec.structs import replace as changed

    axis = changed(load_machine("cartesian").axes[0], max_jerk=jerk)
    travel = half_period_travel(axis, duration)
    assert 0.0 < travel < axis.max_velocity * duration
    # a little more takes longer: it goes at a limit all the time
    assert half_period_travel(axis, duration * 1.01) > travel
    if jerk is None and duration < 0.2:
        assert travel == pytest.approx(axis.max_acceleration * duration**2 / 4.0)


def test_a_chirp_is_a_program_without_faults_that_ends_where_it_began_as_quick_as_it_is_written() -> None:
    machine = load_machine("cartesian")
    axis = machine.axes[0]
    unit = axis.type.si_per_unit
    lines = chirp_lines(axis, "X", 3.0, machine.cycle_s, unit)
    run = simulate("\n".join(lines), machine)
    assert run.report["diagnostics"] == []
    assert run.report["duration_s"] == pytest.approx(3.0, rel=0.1)
    assert sum(float(line.partition("X")[2]) for line in lines if "X" in line) == pytest.approx(0.0, abs=1e-9)
    # in less room it begins at a higher frequency
    short = [float(line.partition("X")[2]) for line in chirp_lines(axis, "X", 3.0, 0.001, unit, 2.0)[2:]]
    assert 1.7 < max(short) <= 2.0
