"""Profiles on one coordinate: Ruckig's law in phases, exact in time, never backwards."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mcserver.motion.geometry.segment import AxisLimits
from mcserver.motion.kernels.ramp_kernels import ramp_distance, ramp_time, reachable_speed
from mcserver.motion.lookahead.path_limits import AccelerationLimit, RunLimits, sample_rows
from mcserver.motion.profile.speed_ramps import min_time_profiles, profiles_in_time, ramp
from mcserver.motion.profile.velocity_profile import (
    Phases,
    Profile,
    ProfileSolver,
    join,
)
from tests.motion.measure import rest_to_rest
from tests.motion.support import alike
from tests.motion.test_laws import law

DISTANCES = st.floats(-9.0, 1.0).map(lambda power: 10.0**power)
JERKS = st.sampled_from([math.inf, 10.0, 1000.0, 1e5])
ACCELERATIONS = st.sampled_from([0.5, 10.0, 100.0])
VELOCITIES = st.sampled_from([1e-3, 0.2, 5.0])
A_DAY = 86_400.0
SHARES = st.sampled_from([0.0, 0.1, 0.7, 1.0])


def phases_of(profiles: list[Profile]) -> Phases:
    return join(profiles)


def dense(phases: Phases, count: int = 2001) -> tuple[np.ndarray, np.ndarray]:
    return phases.at(np.linspace(0.0, phases.duration, count))


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS)
@law(100)
def test_from_rest_to_rest_takes_the_textbook_time(
    distance: float, velocity: float, acceleration: float, jerk: float
) -> None:
    solved = ProfileSolver().solve(distance, 0.0, 0.0, velocity, acceleration, jerk)
    assert solved is not None
    assert solved.duration == pytest.approx(rest_to_rest(distance, velocity, acceleration, jerk), rel=1e-6)


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS, st.sampled_from([1.0, 1.0001, 1.5, 10.0, 1000.0]))
@law(100)
def test_a_duration_that_is_long_enough_is_kept_exactly(
    distance: float, velocity: float, acceleration: float, jerk: float, slower: float
) -> None:
    wanted = slower * (1.0 + 1e-9) * rest_to_rest(distance, velocity, acceleration, jerk) + 1e-9
    assume(wanted < A_DAY)
    made = profiles_in_time(
        ProfileSolver(), distance, 0.0, 0.0, [AccelerationLimit(velocity, acceleration, jerk)], wanted
    )
    assert made is not None
    assert sum(part.duration for part in made) == pytest.approx(wanted, rel=1e-9, abs=1e-6)
    # over hours the solver's own rounding grows to nanometres; the end itself is exact in `Phases`
    assert sum(part.positions[-1] for part in made) == pytest.approx(distance, rel=1e-8)


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS, st.sampled_from([0.1, 0.9, 0.9999]))
@law(60)
def test_a_duration_that_is_too_short_has_no_profile(
    distance: float, velocity: float, acceleration: float, jerk: float, faster: float
) -> None:
    wanted = faster * rest_to_rest(distance, velocity, acceleration, jerk)
    assume(wanted > 1e-5)
    solved = ProfileSolver().solve(distance, 0.0, 0.0, velocity, acceleration, jerk, wanted)
    assert solved is None or solved.duration > wanted * 1.00001


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS, SHARES, SHARES)
@law(100)
def test_a_profile_never_goes_back_nor_past_its_limits_nor_past_its_end(
    distance: float, velocity: float, acceleration: float, jerk: float, entry: float, exit_: float
) -> None:
    solved = ProfileSolver().solve(distance, entry * velocity, exit_ * velocity, velocity, acceleration, jerk)
    assume(solved is not None)
    assert solved is not None
    phases = join([solved])
    # the phases' own polynomials, without the clipping of `Phases.at`
    for start, p, v, a, j, end in zip(
        phases.start,
        phases.position,
        phases.velocity,
        phases.acceleration,
        phases.jerk,
        [*phases.start[1:], phases.duration],
        strict=True,
    ):
        t = np.linspace(0.0, end - start, 50)
        speed = v + t * (a + t * j / 2.0)
        place = p + t * (v + t * (a / 2.0 + t * j / 6.0))
        assert speed.min() >= -1e-6 * velocity
        assert speed.max() <= velocity * (1.0 + 1e-6)
        assert np.abs(a + t * j).max() <= acceleration * (1.0 + 1e-6)
        assert abs(j) <= jerk * (1.0 + 1e-6)
        assert place.min() >= -1e-6 * distance
        assert place.max() <= distance * (1.0 + 1e-6)


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS, SHARES, SHARES)
@law(60)
def test_time_at_is_the_inverse_of_at(
    distance: float, velocity: float, acceleration: float, jerk: float, entry: float, exit_: float
) -> None:
    solved = ProfileSolver().solve(distance, entry * velocity, exit_ * velocity, velocity, acceleration, jerk)
    assume(solved is not None)
    assert solved is not None
    phases = join([solved, ramp(exit_ * velocity, velocity, acceleration, jerk)] if exit_ < 1.0 else [solved])
    places = np.linspace(0.0, phases.end, 101)
    times = phases.time_at(places)
    assert (np.diff(times) >= 0.0).all()
    assert times[0] == 0.0
    assert times[-1] == phases.duration
    assert phases.at(times)[0] == pytest.approx(places, abs=1e-6 * phases.end)


def test_beyond_its_ends_a_time_law_rests() -> None:
    solved = ProfileSolver().solve(1.0, 0.0, 0.0, 1.0, 1.0, math.inf)
    assert solved is not None
    place, speed = join([solved]).at(np.array([-1.0, 0.0, 2.0, 5.0]))
    assert place.tolist() == [0.0, 0.0, 1.0, 1.0]
    assert speed == pytest.approx([0.0, 0.0, 0.0, 0.0])


@given(st.floats(0.0, 0.999), DISTANCES, VELOCITIES, ACCELERATIONS, JERKS)
@law(60)
def test_what_is_left_of_a_time_law_goes_on_as_the_whole(
    share: float, distance: float, velocity: float, acceleration: float, jerk: float
) -> None:
    solved = ProfileSolver().solve(distance, 0.0, 0.0, velocity, acceleration, jerk)
    assert solved is not None
    whole = join([solved])
    moment = share * whole.duration
    rest = whole.after(moment)
    here = float(whole.at(np.array([moment]))[0][0])
    times = np.linspace(0.0, rest.duration, 100)
    place, speed = rest.at(times)
    expected, expected_speed = whole.at(times + moment)
    assert place + here == pytest.approx(expected, abs=1e-9 * distance)
    assert speed == pytest.approx(expected_speed, abs=1e-7 * velocity)


@given(VELOCITIES, SHARES, SHARES, ACCELERATIONS, JERKS)
@law(60)
def test_a_ramp_is_the_quickest_change_of_speed(
    velocity: float, start: float, end: float, acceleration: float, jerk: float
) -> None:
    assume(start != end)
    made = ramp(start * velocity, end * velocity, acceleration, jerk)
    low, high = sorted((start * velocity, end * velocity))
    assert made.duration == pytest.approx(ramp_time(low, high, acceleration, jerk))
    assert made.positions[-1] == pytest.approx(ramp_distance(low, high, acceleration, jerk))
    assert made.velocities[-1] == pytest.approx(end * velocity)
    assert made.peak_acceleration <= acceleration * (1.0 + 1e-12)


@given(SHARES, DISTANCES, VELOCITIES, ACCELERATIONS, JERKS)
@law(60)
def test_the_reachable_speed_is_reached_in_the_distance_and_no_more(
    low: float, distance: float, cap: float, acceleration: float, jerk: float
) -> None:
    speed = reachable_speed(low * cap, distance, acceleration, jerk, cap)
    assert low * cap <= speed <= cap
    assert ramp_distance(low * cap, speed, acceleration, jerk) <= distance * (1.0 + 1e-6)
    if speed < cap:
        beyond = ramp_distance(low * cap, speed * (1.0 + 1e-6) + 1e-12, acceleration, jerk)
        assert beyond >= distance * (1.0 - 1e-6)


LIMIT_TABLES = st.sampled_from(
    [
        [AccelerationLimit(0.2, 2.0, math.inf)],
        [
            AccelerationLimit(0.1, 2.0, 100.0),
            AccelerationLimit(0.15, 1.0, 50.0),
            AccelerationLimit(0.2, 0.2, 20.0),
        ],
        [
            AccelerationLimit(0.09, 9.0, 1e4),
            AccelerationLimit(0.13, 7.0, 9e3),
            AccelerationLimit(0.16, 5.0, 7e3),
            AccelerationLimit(0.18, 3.0, 5e3),
            AccelerationLimit(0.2, 0.3, 1e3),
        ],
    ]
)


@pytest.mark.parametrize("velocity", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("acceleration", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("jerk", [5.0, 10.0, 20.0, 50.0, math.inf])
def test_round_numbers_at_the_borders_between_kinds_of_profiles_are_solved(
    velocity: float, acceleration: float, jerk: float
) -> None:
    borders = {2.0 * ramp_distance(0.0, velocity, acceleration, jerk)}
    if math.isfinite(jerk):
        borders.add(2.0 * acceleration**3 / jerk**2)
    for distance in [*sorted(borders), 1e-5, 0.001, 0.01, 0.02, 0.04, 0.05, 0.1]:
        made = min_time_profiles(distance, 0.0, 0.0, [AccelerationLimit(velocity, acceleration, jerk)])
        assert made is not None
        least = rest_to_rest(distance, velocity, acceleration, jerk)
        assert sum(part.duration for part in made) == pytest.approx(least, rel=1e-6)
        assert sum(part.positions[-1] for part in made) == pytest.approx(distance, rel=1e-9)


@given(LIMIT_TABLES, DISTANCES)
@law(60)
def test_a_limit_table_is_followed_within_its_rows(
    limit_table: list[AccelerationLimit], distance: float
) -> None:
    made = min_time_profiles(distance, 0.0, 0.0, limit_table)
    assert made is not None
    assert sum(part.positions[-1] for part in made) == pytest.approx(distance, rel=1e-9)
    for part in made:
        row = next(row for row in limit_table if part.peak_velocity <= row.velocity * (1.0 + 1e-9))
        assert part.peak_acceleration <= row.acceleration * (1.0 + 1e-9)
    for before, after in itertools.pairwise(made):
        assert after.velocities[0] == pytest.approx(before.velocities[-1], rel=1e-9)


@pytest.mark.parametrize("beside", [0.11, 0.137, 0.19, 3.0])
def test_a_limit_table_is_the_same_whatever_is_beside_its_group(beside: float) -> None:
    limits = AxisLimits.of(alike(1, velocity=5000.0, acceleration=5000.0, jerk=100_000.0))
    bend, line = sample_rows(np.ones((1, 1)), np.full((1, 1), 60.0), np.zeros((1, 1))), np.zeros((1, 7))
    line[0, 0], line[0, -2:] = 1.0, math.inf
    alone = RunLimits(bend, np.array([0, 1]), np.array([0.1]), limits)
    other = RunLimits(np.concatenate((line, bend)), np.array([0, 1, 2]), np.array([beside, 0.1]), limits)
    assert len(alone.limit_table(0, 1)) > 3
    assert other.limit_table(1, 2) == alone.limit_table(0, 1)


@given(LIMIT_TABLES, DISTANCES, st.sampled_from([1.0, 1.001, 1.2, 3.0, 50.0]))
@law(60)
def test_a_limit_table_keeps_every_duration_from_the_quickest_on(
    limit_table: list[AccelerationLimit], distance: float, slower: float
) -> None:
    quickest = min_time_profiles(distance, 0.0, 0.0, limit_table)
    assert quickest is not None
    wanted = slower * sum(part.duration for part in quickest) + 1e-9
    made = profiles_in_time(ProfileSolver(), distance, 0.0, 0.0, limit_table, wanted)
    assert made is not None
    assert sum(part.duration for part in made) == pytest.approx(wanted, abs=1e-6)
