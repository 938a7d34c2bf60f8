"""Profiles on one coordinate: exact in time, never backwards."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mcserver.motion.geometry.segment import AxisLimits
from mcserver.motion.kernels.phases import PHASE, PHASES_PER_MOVE, moves_to_phases
from mcserver.motion.kernels.ramp_kernels import (
    MAX_MOVES,
    MAX_TABLE_ROWS,
    MOVE,
    min_time_moves,
    ramp_distance,
    ramp_time,
    reachable_speed,
)
from mcserver.motion.kernels.sample_limits import make_limit_table, run_of
from mcserver.motion.kernels.timed_moves import EARLY, KEPT, LATE, moves_in_time
from mcserver.motion.limits.path_limits import sample_rows
from mcserver.motion.profile.velocity_profile import Phases, join_phases
from tests.motion.measure import rest_to_rest
from tests.motion.support import alike
from tests.motion.test_laws import law

DISTANCES = st.floats(-9.0, 1.0).map(lambda power: 10.0**power)
JERKS = st.sampled_from([math.inf, 10.0, 1000.0, 1e5])
ACCELERATIONS = st.sampled_from([0.5, 10.0, 100.0])
VELOCITIES = st.sampled_from([1e-3, 0.2, 5.0])
A_DAY = 86_400.0
SHARES = st.sampled_from([0.0, 0.1, 0.7, 1.0])


class AccelerationLimit(NamedTuple):
    """A row of a limit table: up to this speed this acceleration and jerk are free."""

    velocity: float
    acceleration: float
    jerk: float


Table = list[AccelerationLimit]


def rows_of(table: Table) -> np.ndarray:
    return np.array(table)


def phases_of(moves: np.ndarray, count: int) -> Phases:
    rows = np.empty((PHASES_PER_MOVE * count, PHASE))
    written = moves_to_phases(moves, count, rows, 0, 0.0)
    return join_phases(rows[:written], float(moves[:count, 4].sum()))


def quickest(distance: float, entry: float, exit_: float, table: Table) -> Phases | None:
    moves, spare = np.empty((2, MAX_MOVES, MOVE))
    count = min_time_moves(moves, spare, distance, entry, exit_, rows_of(table), len(table))
    return phases_of(moves, count) if count else None


def rest_to_rest_phases(distance: float, velocity: float, acceleration: float, jerk: float) -> Phases:
    solved = quickest(distance, 0.0, 0.0, [AccelerationLimit(velocity, acceleration, jerk)])
    assert solved is not None
    return solved


def in_time(distance: float, entry: float, exit_: float, table: Table, wanted: float) -> tuple[Phases, int]:
    moves, spare = np.empty((2, MAX_MOVES, MOVE))
    count, timing = moves_in_time(moves, spare, distance, entry, exit_, rows_of(table), len(table), wanted)
    assert count > 0
    return phases_of(moves, count), timing


def assert_within(phases: Phases, distance: float, limit: AccelerationLimit) -> None:
    """Judge the phases' own polynomials, without the clipping of `Phases.at`."""
    velocity = limit.velocity
    for lasts, p, v, a, j in phases.rows:
        t = np.linspace(0.0, lasts, 50)
        speed = v + t * (a + t * j / 2.0)
        place = p + t * (v + t * (a / 2.0 + t * j / 6.0))
        assert speed.min() >= -1e-6 * velocity
        assert speed.max() <= velocity * (1.0 + 1e-6)
        assert np.abs(a + t * j).max() <= limit.acceleration * (1.0 + 1e-6)
        assert abs(j) <= limit.jerk * (1.0 + 1e-6)
        assert place.min() >= -1e-6 * distance
        assert place.max() <= distance * (1.0 + 1e-6)


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS)
@law(100)
def test_from_rest_to_rest_takes_the_textbook_time(
    distance: float, velocity: float, acceleration: float, jerk: float
) -> None:
    solved = rest_to_rest_phases(distance, velocity, acceleration, jerk)
    assert solved.duration == pytest.approx(rest_to_rest(distance, velocity, acceleration, jerk), rel=1e-6)


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS, st.sampled_from([1.0, 1.0001, 1.5, 10.0, 1000.0]))
@law(100)
def test_a_duration_that_is_long_enough_is_kept_exactly(
    distance: float, velocity: float, acceleration: float, jerk: float, slower: float
) -> None:
    wanted = slower * (1.0 + 1e-9) * rest_to_rest(distance, velocity, acceleration, jerk) + 1e-9
    assume(wanted < A_DAY)
    limit = AccelerationLimit(velocity, acceleration, jerk)
    made, timing = in_time(distance, 0.0, 0.0, [limit], wanted)
    assert timing == KEPT
    assert made.duration == pytest.approx(wanted, rel=2e-9, abs=2e-9)
    assert made.end == pytest.approx(distance, rel=1e-8)
    assert_within(made, distance, limit)


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS, st.sampled_from([0.1, 0.9, 0.9999]))
@law(60)
def test_a_duration_that_is_too_short_is_missed_by_the_least(
    distance: float, velocity: float, acceleration: float, jerk: float, faster: float
) -> None:
    least = rest_to_rest(distance, velocity, acceleration, jerk)
    assume(faster * least > 1e-5)
    made, timing = in_time(
        distance, 0.0, 0.0, [AccelerationLimit(velocity, acceleration, jerk)], faster * least
    )
    assert timing == LATE
    assert made.duration == pytest.approx(least, rel=1e-6)


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS, SHARES, SHARES, st.floats(0.0, 1.0))
@law(200)
def test_between_two_speeds_every_duration_from_the_quickest_to_the_steadily_slowest_is_kept(
    distance: float,
    velocity: float,
    acceleration: float,
    jerk: float,
    entry: float,
    exit_: float,
    share: float,
) -> None:
    limit = AccelerationLimit(velocity, acceleration, jerk)
    low, high = sorted((entry * velocity, exit_ * velocity))
    quick = quickest(distance, entry * velocity, exit_ * velocity, [limit])
    assume(quick is not None and low > 0.0)
    assert quick is not None
    ramp = ramp_time(low, high, acceleration, jerk)
    slow = ramp + (distance - 0.5 * (low + high) * ramp) / low
    assume(slow > quick.duration)
    wanted = quick.duration + share * (slow - quick.duration)
    made, timing = in_time(distance, entry * velocity, exit_ * velocity, [limit], wanted)
    assert timing == KEPT
    assert made.duration == pytest.approx(wanted, rel=2e-9, abs=2e-9)
    assert made.end == pytest.approx(distance, rel=1e-8)
    assert_within(made, distance, limit)


def test_a_line_between_speeds_that_leave_no_slower_profile_ends_early() -> None:
    _, timing = in_time(1e-3, 0.2, 0.2, [AccelerationLimit(0.2, 1.0, 10.0)], 1.0)
    assert timing == EARLY


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS, SHARES, SHARES)
@law(100)
def test_a_profile_never_goes_back_nor_past_its_limits_nor_past_its_end(
    distance: float, velocity: float, acceleration: float, jerk: float, entry: float, exit_: float
) -> None:
    limit = AccelerationLimit(velocity, acceleration, jerk)
    solved = quickest(distance, entry * velocity, exit_ * velocity, [limit])
    assume(solved is not None)
    assert solved is not None
    assert_within(solved, distance, limit)


@given(DISTANCES, VELOCITIES, ACCELERATIONS, JERKS, SHARES, SHARES)
@law(60)
def test_time_at_is_the_inverse_of_at(
    distance: float, velocity: float, acceleration: float, jerk: float, entry: float, exit_: float
) -> None:
    phases = quickest(
        distance, entry * velocity, exit_ * velocity, [AccelerationLimit(velocity, acceleration, jerk)]
    )
    assume(phases is not None)
    assert phases is not None
    places = np.linspace(0.0, phases.end, 101)
    times = phases.time_at(places)
    assert (np.diff(times) >= 0.0).all()
    assert times[0] == 0.0
    assert times[-1] == phases.duration
    assert phases.at(times)[0] == pytest.approx(places, abs=1e-6 * phases.end)


def test_beyond_its_ends_a_time_law_rests() -> None:
    place, speed = rest_to_rest_phases(1.0, 1.0, 1.0, math.inf).at(np.array([-1.0, 0.0, 2.0, 5.0]))
    assert place.tolist() == [0.0, 0.0, 1.0, 1.0]
    assert speed == pytest.approx([0.0, 0.0, 0.0, 0.0])


@given(st.floats(0.0, 0.999), DISTANCES, VELOCITIES, ACCELERATIONS, JERKS)
@law(60)
def test_what_is_left_of_a_time_law_goes_on_as_the_whole(
    share: float, distance: float, velocity: float, acceleration: float, jerk: float
) -> None:
    whole = rest_to_rest_phases(distance, velocity, acceleration, jerk)
    moment = share * whole.duration
    rest = whole.after(moment)
    here = float(whole.at(np.array([moment]))[0][0])
    times = np.linspace(0.0, rest.duration, 100)
    place, speed = rest.at(times)
    expected, expected_speed = whole.at(times + moment)
    assert place + here == pytest.approx(expected, abs=1e-9 * distance)
    assert speed == pytest.approx(expected_speed, abs=1e-7 * velocity)


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
        made = rest_to_rest_phases(distance, velocity, acceleration, jerk)
        least = rest_to_rest(distance, velocity, acceleration, jerk)
        assert made.duration == pytest.approx(least, rel=1e-6)
        assert made.end == pytest.approx(distance, rel=1e-9)


@given(LIMIT_TABLES, DISTANCES)
@law(60)
def test_a_limit_table_is_followed_within_its_rows(limit_table: Table, distance: float) -> None:
    moves, spare = np.empty((2, MAX_MOVES, MOVE))
    count = min_time_moves(moves, spare, distance, 0.0, 0.0, rows_of(limit_table), len(limit_table))
    assert count > 0
    assert moves[:count, 4].sum() == pytest.approx(distance, rel=1e-9)
    for start, end, acceleration, _, _ in moves[:count]:
        row = next(row for row in limit_table if max(start, end) <= row.velocity * (1.0 + 1e-9))
        assert acceleration <= row.acceleration * (1.0 + 1e-9)
    for before, after in itertools.pairwise(moves[:count]):
        assert after[0] == pytest.approx(before[1], rel=1e-9)


@pytest.mark.parametrize("beside", [0.11, 0.137, 0.19, 3.0])
def test_a_limit_table_is_the_same_whatever_is_beside_its_group(beside: float) -> None:
    limits = AxisLimits.of(alike(1, velocity=5000.0, acceleration=5000.0, jerk=100_000.0))
    bend, line = sample_rows(np.ones((1, 1)), np.full((1, 1), 60.0), np.zeros((1, 1))), np.zeros((1, 7))
    line[0, 0], line[0, -2:] = 1.0, math.inf
    alone = run_of(bend, np.array([0, 1]), np.array([0.1]), limits.rows, limits.cycle)
    both, vmax = np.concatenate((line, bend)), np.array([beside, 0.1])
    other = run_of(both, np.array([0, 1, 2]), vmax, limits.rows, limits.cycle)
    tables = np.zeros((2, MAX_TABLE_ROWS, 3))
    count = make_limit_table(alone, 0, 1, 0.0, tables[0])
    assert count > 3
    assert make_limit_table(other, 1, 2, 0.0, tables[1]) == count
    assert np.array_equal(tables[0], tables[1])


@given(LIMIT_TABLES, DISTANCES, st.sampled_from([1.0, 1.001, 1.2, 3.0, 50.0]))
@law(60)
def test_a_limit_table_keeps_every_duration_from_the_quickest_on(
    limit_table: Table, distance: float, slower: float
) -> None:
    quick = quickest(distance, 0.0, 0.0, limit_table)
    assert quick is not None
    wanted = slower * quick.duration + 1e-9
    made, timing = in_time(distance, 0.0, 0.0, limit_table, wanted)
    assert timing == KEPT
    assert made.duration == pytest.approx(wanted, abs=1e-6)
