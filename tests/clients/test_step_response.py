"""A step of an axis, measured: synthetic motions whose figures are known."""

from __future__ import annotations

import numpy as np
import pytest
from mcclient.cli.step import measured
from mcclient.step_response import Array, step_response

CYCLE_S = 1e-3


def ramp(distance: float = 1.0, cycles: int = 100, before: int = 300, after: int = 1000) -> Array:
    return np.concatenate(
        (np.zeros(before), distance * np.arange(1, cycles + 1) / cycles, np.full(after, distance))
    )


def time_of(setpoint: Array) -> Array:
    return 5.0 + CYCLE_S * np.arange(len(setpoint))


def delayed(setpoint: Array, cycles: int) -> Array:
    return np.concatenate((np.full(cycles, setpoint[0]), setpoint[: len(setpoint) - cycles]))


def test_a_pure_delay_is_a_delay_and_no_error_of_the_loop() -> None:
    setpoint = ramp()
    found = step_response(time_of(setpoint), setpoint, delayed(setpoint, 4), 0.005)
    assert found is not None
    assert found.delay_s == pytest.approx(0.004)
    assert found.greatest_error == pytest.approx(0.04)
    assert found.error_without_delay == pytest.approx(0.0, abs=1e-12)
    assert found.duration_s == pytest.approx(0.1)
    assert (found.overshoot, found.noise) == (0.0, 0.0)
    assert found.settling_s == pytest.approx(0.004)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_overshoot_and_settling_are_those_of_a_damped_oscillation(sign: float) -> None:
    setpoint = ramp(sign)
    after = np.arange(1000) * CYCLE_S
    actual = setpoint.copy()
    actual[400:] += sign * 0.1 * np.exp(-after / 0.05) * np.cos(2.0 * np.pi * 20.0 * after)
    found = step_response(time_of(setpoint), setpoint, actual, 0.005)
    assert found is not None
    assert found.distance == pytest.approx(sign)
    assert found.overshoot == pytest.approx(0.1)
    # 0.1 e^(-t/0.05) falls to 0.005 after 0.15 s
    assert found.settling_s is not None
    assert 0.12 < found.settling_s < 0.151


def test_an_axis_that_never_arrives_never_settles() -> None:
    setpoint = ramp()
    found = step_response(time_of(setpoint), setpoint, 0.9 * setpoint, 0.005)
    assert found is not None
    assert found.settling_s is None


def test_what_does_not_move_is_no_step() -> None:
    flat = np.zeros(500)
    assert step_response(time_of(flat), flat, flat, 0.01) is None
    assert measured(np.column_stack((time_of(flat), flat, flat)), 0.01) == []


def test_there_and_back_are_measured_each_for_itself() -> None:
    there = ramp()
    setpoint = np.concatenate((there, 1.0 - ramp(before=0)))
    rows = np.column_stack((time_of(setpoint), setpoint, delayed(setpoint, 2)))
    legs = measured(rows, 0.005)
    assert [leg.distance for leg in legs] == pytest.approx([1.0, -1.0])
    assert [leg.delay_s for leg in legs] == pytest.approx([0.002, 0.002])
