"""G93 keeps a duration, G94 a speed (D-30, D-31, D-33): to the microsecond, by the marks of the lines."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mcserver.machine.machine_file import Machine
from mcserver.motion.bound import PlanningError
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.sample_limits import Run
from mcserver.motion.lookahead.missed_times import slow_early
from mcserver.motion.profile.profile_solver import KnotSolver, Solution
from tests.motion.measure import acceleration_ratio, least_time, rest_to_rest, speed_over_feed
from tests.motion.programs import ACCELERATIONS, JERKS, LENGTHS, VELOCITIES, Program, programs
from tests.motion.support import (
    AxisSpec,
    Commit,
    Move,
    alike,
    arc_curve,
    at_speed,
    in_time,
    line_curve,
    machine_of,
    plan,
)
from tests.motion.test_laws import law

MICROSECOND = 1e-6
LIMITS = st.builds(
    AxisSpec,
    velocity=st.sampled_from(VELOCITIES),
    acceleration=st.sampled_from(ACCELERATIONS),
    jerk=st.sampled_from(JERKS),
)


@given(
    specs=st.lists(LIMITS, min_size=2, max_size=2),
    length=st.sampled_from(LENGTHS),
    share=st.sampled_from([0.0, 0.03, 0.5, 1.0]),
    slower=st.sampled_from([1.0 + 1e-6, 1.001, 1.1, 2.0, 30.0]),
)
@law(100)
def test_a_line_between_stops_lasts_60_over_f_wherever_any_profile_does(
    specs: list[AxisSpec], length: float, share: float, slower: float
) -> None:
    machine = machine_of(specs)
    curve = line_curve(machine, (0, 1), (0.0, 0.0), (length, share * length))
    duration = slower * least_time(machine, in_time(1.0, curve))
    motion = plan(machine, [in_time(duration, curve)])
    assert motion.took(1) == pytest.approx(duration, abs=MICROSECOND)
    assert 1 not in motion.bounds


@given(
    specs=st.lists(LIMITS, min_size=2, max_size=2),
    length=st.sampled_from(LENGTHS),
    share=st.sampled_from([0.0, 0.03, 0.5, 1.0]),
    faster=st.sampled_from([0.999, 0.7, 0.01]),
)
@law(100)
def test_a_line_asked_to_be_too_quick_is_stretched_by_the_least_and_says_what_bound_it(
    specs: list[AxisSpec], length: float, share: float, faster: float
) -> None:
    machine = machine_of(specs)
    curve = line_curve(machine, (0, 1), (0.0, 0.0), (length, share * length))
    least = least_time(machine, in_time(1.0, curve))
    motion = plan(machine, [in_time(faster * least, curve)])
    assert motion.took(1) == pytest.approx(least, rel=1e-5)
    assert motion.bounds[1].bound.kind in ("velocity", "acceleration", "jerk")


@given(programs(kinds=("line", "onward", "back")))
@law(60)
def test_no_line_of_a_chain_takes_longer_than_t_if_it_could_be_kept_from_rest_to_rest(
    program: Program,
) -> None:
    """D-33: the speeds between lines are chosen so that every T that is feasible is kept."""
    moves = [
        Move(
            in_time(
                max(move.group.requested, 1.0001 * least_time(program.machine, move.group)),
                *move.group.curves,
            )
        )
        for move in program.moves
    ]
    assume(sum(move.group.requested for move in moves) < 60.0)
    motion = plan(program.machine, moves)
    for number, move in enumerate(moves, start=1):
        assert motion.took(number) == pytest.approx(move.group.requested, abs=MICROSECOND)


@given(
    count=st.integers(3, 8),
    length=st.sampled_from([1e-4, 1e-3, 0.05]),
    jerk=st.sampled_from(JERKS),
    share=st.sampled_from([0.3, 0.9]),
)
@law(40)
def test_lines_that_follow_each_other_straight_keep_a_t_that_none_could_keep_between_stops(
    count: int, length: float, jerk: float | None, share: float
) -> None:
    machine = alike(2, velocity=200.0, acceleration=2000.0, jerk=jerk)
    duration = length / (share * 0.2)
    motion = plan(
        machine,
        [
            in_time(duration, line_curve(machine, (0,), (i * length,), ((i + 1) * length,)))
            for i in range(count)
        ],
    )
    least = least_time(machine, motion.moves[0].group)
    for line in range(1, count + 1):
        fast = (
            motion.starts[line] * machine.cycle_s > 2.0 * least
            and (motion.ends[count] - motion.ends[line]) * machine.cycle_s > 2.0 * least
        )
        if fast:
            assert motion.took(line) == pytest.approx(duration, abs=MICROSECOND)


@given(
    spec=LIMITS,
    length=st.sampled_from(LENGTHS),
    share=st.sampled_from([0.01, 0.5, 1.0, 3.0]),
)
@law(60)
def test_a_g94_line_reaches_f_where_the_limits_allow_and_takes_the_least_time_at_it(
    spec: AxisSpec, length: float, share: float
) -> None:
    machine = machine_of([spec, spec])
    axis = machine.axes[0]
    speed = share * axis.max_velocity
    assume(length / speed < 20.0)
    motion = plan(machine, [at_speed(speed, line_curve(machine, (0,), (0.0,), (length,)))])
    least = rest_to_rest(length, min(speed, axis.max_velocity), axis.max_acceleration, axis.max_jerk)
    assert motion.took(1) == pytest.approx(least, rel=1e-5)


def test_a_full_circle_under_g93_lasts_60_over_f() -> None:
    machine = alike(2, velocity=500.0, acceleration=2000.0, jerk=100_000.0)
    motion = plan(machine, [in_time(2.0, arc_curve((0.0, 0.0), (0.05, 0.0), 2.0 * math.pi))])
    assert motion.took(1) == pytest.approx(2.0, abs=MICROSECOND)


def test_the_others_of_a_concatenation_keep_the_fraction_of_the_first() -> None:
    machine = alike(4, velocity=500.0, acceleration=2000.0)
    arc = arc_curve((0.0, 0.0), (0.05, 0.0), math.pi)
    line = line_curve(machine, (2, 3), (0.0, 0.0), (0.03, -0.2))
    motion = plan(machine, [in_time(1.0, arc, line)])
    rows = motion.position
    fraction = rows[:, 3] / -0.2
    assert rows[:, 2] == pytest.approx(0.03 * fraction, abs=1e-12)
    swept = [math.atan2(-y, 0.05 - x) % (2.0 * math.pi) for x, y in rows[:-1, :2]]
    assert swept == pytest.approx((math.pi * fraction[:-1]).tolist(), abs=1e-9)


def test_a_slow_follower_stretches_the_whole_group_by_the_least() -> None:
    machine = machine_of([AxisSpec(1000.0, 10_000.0), AxisSpec(100.0, 10_000.0)])
    first = line_curve(machine, (0,), (0.0,), (0.1,))
    follower = line_curve(machine, (1,), (0.0,), (0.1,))
    motion = plan(machine, [in_time(0.2, first, follower)])
    assert motion.took(1) == pytest.approx(1.01, rel=1e-6)
    assert motion.bounds[1].bound.column == 1
    assert motion.bounds[1].bound.kind == "velocity"


@pytest.mark.parametrize("growth", [5e-6, -5e-6])
def test_the_speed_of_an_arc_whose_radius_changes_is_f_at_its_widest(growth: float) -> None:
    # 5 um are allowed whatever the radius (D-22)
    machine = alike(2, velocity=500.0, acceleration=2000.0)
    arc = arc_curve((0.0, 0.0), (2e-4, 0.0), 2.0 * math.pi, growth=growth)
    motion = plan(machine, [at_speed(5e-3, arc)])
    assert 0.999 <= speed_over_feed(motion) <= 1.0001


def test_the_speed_of_a_helix_is_that_along_the_helix() -> None:
    machine = alike(3, velocity=500.0, acceleration=5000.0)
    helix = arc_curve((0.0, 0.0, 0.0), (0.02, 0.0), 4.0 * math.pi, axes=(0, 1, 2), further=(0.1,))
    motion = plan(machine, [at_speed(0.1, helix)])
    length = math.hypot(4.0 * math.pi * 0.02, 0.1)
    assert motion.took(1) == pytest.approx(length / 0.1 + 0.1 / 5.0, rel=1e-3)


@pytest.mark.parametrize("want", [1.0, 50.0, 333.3])
def test_a_line_under_way_keeps_its_t_when_more_lines_come(want: float) -> None:
    machine = alike(2, jerk=20_000.0)
    groups: list[FeedGroup] = [
        in_time(1.0, line_curve(machine, (0,), (0.1 * i,), (0.1 * (i + 1),))) for i in range(4)
    ]
    commits = [Commit(after=line, ahead=want) for line in range(1, 5)]
    motion = plan(machine, groups, commits=commits)
    for line in (2, 3):
        assert motion.took(line) == pytest.approx(1.0, abs=MICROSECOND)
    assert acceleration_ratio(motion) <= 1.01


def test_late_timed_lines_take_no_longer_than_with_a_stop_between_them() -> None:
    # a vertex that is passed slowly takes its part of the acceleration on all of the line behind it
    machine = alike(2, acceleration=500.0)
    points = [(0.0, 0.0), (3.7e-5, -1.2e-5), (0.017, -0.0043), (0.0166, -0.0046)]
    lines = [line_curve(machine, (0, 1), *ends) for ends in pairwise(points)]
    groups = [in_time(duration, line) for duration, line in zip((1.5e-3, 1.3e-4, 7.3e-4), lines, strict=True)]
    flowing = plan(machine, groups)
    stopping = plan(machine, [Move(group, from_rest=True) for group in groups])
    assert flowing.duration <= stopping.duration * (1.0 + 1e-6)
    assert set(flowing.bounds) == {1, 2, 3}


@pytest.mark.parametrize("cycles", [110, 117, 130])
def test_the_last_row_of_a_motion_is_at_rest_to_the_last_bit(cycles: int) -> None:
    # who holds within the last row waits for one that ends at rest, and would wait for ever
    machine = alike(1, acceleration=1000.0, jerk=20_000.0)
    line = line_curve(machine, (0,), (0.0,), ((cycles * 1e-3) ** 2,))
    motion = plan(machine, [at_speed(10.0, line)])
    assert motion.velocity[-1] == 0.0
    assert motion.position[-1] == line.end[0]


def late_chain(seed: int) -> tuple[Machine, list[Move], list[Commit]]:
    """Many short lines that bend, with times that few of them can keep, and where their window is cut."""
    rng = np.random.default_rng(seed)
    jerk = None if rng.random() < 0.3 else float(rng.choice([5e3, 5e4]))
    machine = alike(2, velocity=300.0, acceleration=float(rng.choice([500, 3000])), jerk=jerk)
    count, scale = int(rng.integers(12, 40)), float(rng.choice([1e-4, 1e-3, 1e-2]))
    turn, heading, here = float(rng.choice([0.2, 1.0])), 0.0, (0.0, 0.0)
    moves = []
    for _ in range(count):
        heading += rng.normal() * turn
        length = scale * math.exp(0.7 * rng.normal())
        there = (here[0] + length * math.cos(heading), here[1] + length * math.sin(heading))
        line = line_curve(machine, (0, 1), here, there)
        moves.append(Move(in_time(length / 0.5 * math.exp(0.4 * rng.normal()), line)))
        here = there
    cuts = sorted(rng.integers(1, count, size=3).tolist())
    return machine, moves, [Commit(after, float(rng.choice([0.0, 5.0, 50.0]))) for after in cuts]


@pytest.mark.parametrize("seed", [*range(8), 329, 436])
def test_a_late_chain_is_not_slower_in_one_window_than_in_several_or_with_stops(seed: int) -> None:
    machine, moves, commits = late_chain(seed)
    whole = plan(machine, moves)
    assert whole.duration <= 1.05 * plan(machine, moves, commits=commits).duration
    stopping = plan(machine, [Move(move.group, from_rest=True) for move in moves])
    assert whole.duration <= 1.05 * stopping.duration
    assert acceleration_ratio(whole) <= 1.01


def test_speeds_of_a_plan_that_ends_more_lines_early_are_not_kept() -> None:
    phases, knots, speeds = np.array([[2.0, 0.0, 1.0, 0.0, 0.0]]), np.array([0, 2]), np.array([0.0, 1.0, 0.0])
    given = Solution(knots, speeds, phases, np.array([0, 1]), (), (0,), cast("Run", None))

    def slow_down(_early: object, _speeds: Array, bounds: Array, _which: object) -> None:
        bounds[1] *= 0.5

    def attempt(bounds: Array) -> Solution:
        if bounds[1] == 0.0:
            raise PlanningError(1)
        return replace(given, early=(0, 1))

    held = np.ones(2, np.bool_)
    solver = SimpleNamespace(held=held, durations=np.full(2, np.nan), slow_down=slow_down)
    bounds = np.array([0.0, 1.0, 0.0])
    assert slow_early(cast("KnotSolver", solver), given, bounds, np.arange(3.0), attempt) is given
    assert bounds.tolist() == [0.0, 1.0, 0.0]
