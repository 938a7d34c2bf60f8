"""Ways of several axes from one state to another: within their limits, exact at the ends, and quick."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from ruckig import InputParameter, Result, Ruckig, Trajectory

from mcserver.motion.kernels.corner_trajectory import evaluate_trajectories
from mcserver.motion.kernels.min_time_trajectories import HALVINGS, PHASES, min_time_trajectories
from tests.motion.test_laws import law

Array = NDArray[np.float64]

SPEEDS = st.one_of(st.just(0.0), st.floats(0.0, 0.3))
LIMITS = st.tuples(st.floats(0.3, 20.0), st.one_of(st.just(math.inf), st.floats(5.0, 1000.0)))


@st.composite
def courses(draw: st.DrawFn) -> tuple[Array, Array, float]:
    """States that some acceleration within the limits leads between, those limits, and the time it takes."""
    time = 10.0 ** draw(st.floats(-3.0, 0.0))
    states, limits = [], []
    for _ in range(draw(st.integers(1, 4))):
        most, jerk = draw(LIMITS)
        parts = draw(st.integers(1, 6))
        moments = np.linspace(0.0, time, parts + 1)
        accelerations = [most * draw(st.floats(-1.0, 1.0)) for _ in moments]
        step = jerk * time / parts
        for i in range(1, len(moments)):
            low, high = accelerations[i - 1] - step, accelerations[i - 1] + step
            accelerations[i] = min(max(accelerations[i], low), high)
        v0 = draw(st.floats(-0.5, 0.5))
        place, v = 0.0, v0
        for i, x in enumerate(np.diff(moments)):
            a, b = accelerations[i], accelerations[i + 1]
            place += x * (v + x * (2.0 * a + b) / 6.0)
            v += 0.5 * x * (a + b)
        states.append((place, v0, v, accelerations[0], accelerations[-1]))
        limits.append((most, jerk))
    return np.array(states), np.array(limits).T.copy(), time


@given(courses(), st.booleans())
@law(300)
def test_ways_keep_the_limits_and_meet_both_states(made: tuple[Array, Array, float], cruising: bool) -> None:
    states, limits, time = made
    trajectories = np.empty((len(states), PHASES, 5))
    found = min_time_trajectories(states, limits, time, cruising, trajectories)
    if cruising and math.isinf(found):
        return
    assert found <= time
    at = np.empty((4, 2, len(states)))
    evaluate_trajectories(trajectories, np.array([0.0, found]), at)
    speed = np.abs(states[:, 1:3]).max(axis=1) + limits[0] * found
    assert at[0, 0] == pytest.approx(np.zeros(len(states)), abs=1e-12)
    assert at[0, 1] == pytest.approx(states[:, 0], abs=1e-12)
    # the rest of a bisection is spread over the way
    assert (np.abs(at[1] - states[:, 1:3].T) <= 1e-6 * speed).all()
    for k, (most, jerk) in enumerate(limits.T):
        lasts = np.append(trajectories[k, 1:, 0], found) - trajectories[k, :, 0]
        assert (lasts >= -1e-15).all()
        last = trajectories[k, :, 3] + lasts * trajectories[k, :, 4]
        real = lasts > 1e-12
        assert np.abs(np.concatenate((trajectories[k, real, 3], last[real]))).max(initial=0.0) <= most * (
            1.0 + 1e-9
        )
        if math.isfinite(jerk):
            assert np.abs(trajectories[k, real, 4]).max(initial=0.0) <= jerk * (1.0 + 1e-6)
            # acceleration goes on where one phase meets the next
            ends = np.append(trajectories[k, real, 3], states[k, 4])
            assert ends[1:] == pytest.approx(last[real], abs=1e-6 * (most + jerk * found))
            assert ends[0] == pytest.approx(states[k, 3], abs=1e-6 * (most + jerk * found))


@given(st.floats(1e-4, 1.0), SPEEDS, SPEEDS, LIMITS)
@law(300)
def test_one_axis_is_as_quick_as_can_be(
    travel: float, v0: float, v1: float, limits: tuple[float, float]
) -> None:
    """Ruckig's time is the least one, from and to no acceleration."""
    most, jerk = limits
    given_state, best = InputParameter(1), Trajectory(1)
    given_state.current_velocity, given_state.target_velocity = [v0 / travel], [v1 / travel]
    given_state.target_position, given_state.max_velocity = [1.0], [1e6 / travel]
    given_state.max_acceleration, given_state.max_jerk = [most / travel], [jerk / travel]
    result = Ruckig(1).calculate(given_state, best)
    if result not in (Result.Working, Result.Finished) or min(best.profiles[0][0].v) < -1e-7:
        return
    # at speed there may be no way that takes much longer, from rest to rest there is one for any time
    longest = best.duration * (4.0 if v0 == v1 == 0.0 else 1.0 + 1e-6)
    states = np.array([[travel, v0, v1, 0.0, 0.0]])
    found = min_time_trajectories(
        states, np.array([[most], [jerk]]), longest, False, np.empty((1, PHASES, 5))
    )
    assume(v0 == v1 == 0.0 or math.isfinite(found))
    assert found <= best.duration * (1.0 + 1e-6) + longest / 2.0**HALVINGS
    assert found >= best.duration * (1.0 - 1e-6)


def test_there_may_be_no_way_in_the_time() -> None:
    trajectories = np.empty((1, PHASES, 5))
    limits = np.array([[1.0], [math.inf]])
    assert math.isinf(
        min_time_trajectories(np.array([[1.0, 0.0, 0.0, 0.0, 0.0]]), limits, 1.9, False, trajectories)
    )
    assert min_time_trajectories(
        np.array([[1.0, 0.0, 0.0, 0.0, 0.0]]), limits, 2.1, False, trajectories
    ) == pytest.approx(2.0, abs=3e-4)


def test_an_axis_with_plenty_of_time_does_not_run_back() -> None:
    """From rest to 1 m/s by 1 m/s² takes 1 s, while another axis needs 1.6 s."""
    states = np.array([[0.5, 0.0, 1.0, 0.0, 0.0], [1.1, 1.0, 0.0, 0.0, 0.0]])
    trajectories = np.empty((2, PHASES, 5))
    limits = np.array([[1.0, 1.0], [math.inf, math.inf]])
    found = min_time_trajectories(states, limits, 4.0, True, trajectories)
    assert found == pytest.approx(1.6, abs=1e-3)
    at = np.empty((4, 200, 2))
    evaluate_trajectories(trajectories, np.linspace(0.0, found, 200), at)
    assert at[0, :, 0].min() >= -1e-6
    assert at[1].min() >= -1e-6
    assert at[1].max() <= 1.0 + 1e-6
