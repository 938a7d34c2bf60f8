"""The search for a change of rate: its curves in closed form, interpolation, and the bound of its work."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.executor.playback.rate_plan import RatePlan
from mcserver.motion.geometry.row_torques import NUMBERS
from mcserver.motion.kernels.rate_changes import (
    MOST_PHASES,
    add_ramp,
    change_onto_rows,
    stop_at_edge,
    total_advance,
    total_time,
)
from mcserver.motion.kernels.rate_search import TRIES, search_rate
from mcserver.motion.kernels.rate_window import LIMITS, RingRows, Window, find_window
from mcserver.motion.kernels.row_interpolation import interpolate_rows, positions_between
from tests.executor.rig import Rig, machine

RATES = st.floats(0.0, 2.0)
SLOPES = st.floats(1e-4, 0.3)
CURVATURES = st.floats(1e-5, 0.3)


@given(rate=RATES, slope=st.floats(-0.05, 0.05), target=RATES, most=SLOPES, curvature=CURVATURES)
def test_a_change_ends_at_its_rate_with_no_slope_and_keeps_its_limits(
    rate: float, slope: float, target: float, most: float, curvature: float
) -> None:
    phases = np.zeros((MOST_PHASES, 4))
    count = add_ramp(phases, 0, rate, slope, target, most, curvature)
    plan = RatePlan.of(phases[:count], target, 3)
    last = plan.phases[-2] if count else plan.phases[-1]
    duration = plan.phases[-1].start - last.start
    assert last.rate + duration * (last.slope + 0.5 * duration * last.curvature) == pytest.approx(
        target if count else rate, abs=1e-6
    )
    assert last.slope + duration * last.curvature == pytest.approx(0.0, abs=1e-6)
    for phase in plan.phases:
        assert abs(phase.slope) <= max(most, abs(slope)) + 1e-9
        assert abs(phase.curvature) <= curvature + 1e-12


@given(rate=st.floats(0.05, 2.0), room=st.floats(1.0, 500.0), most=SLOPES, curvature=CURVATURES)
def test_a_stop_at_an_edge_ends_on_it_or_is_not_made(
    rate: float, room: float, most: float, curvature: float
) -> None:
    phases = np.zeros((MOST_PHASES, 4))
    count = stop_at_edge(phases, room, rate, 0.0, 1.0, most, curvature)
    if count < 0:
        straight = np.zeros((MOST_PHASES, 4))
        assert total_advance(straight, add_ramp(straight, 0, rate, 0.0, 0.0, most, curvature)) > room - 1e-3
    else:
        assert total_advance(phases, count) <= room + 1e-6


@given(
    start=st.floats(-1.0, 1.0),
    end=st.floats(-1.0, 1.0),
    speeds=st.tuples(st.sampled_from([0.0, 0.3, -2.0]), st.sampled_from([0.0, 0.5, -1.0])),
    share=st.floats(0.0, 1.0),
    most=st.sampled_from([math.inf, 3.0, 1e5]),
)
def test_setpoints_are_tried_as_they_are_played(
    start: float, end: float, speeds: tuple[float, float], share: float, most: float
) -> None:
    rows, velocities = np.array([[start, 0.0], [end, 1.0]]), np.array([[speeds[0], 1.0], [speeds[1], 1.0]])
    bounds = np.array([[most, most], [2.0 * most, 2.0 * most]])
    tried, played, slope = np.zeros(2), np.zeros(2), np.zeros(2)
    positions_between(rows[0], rows[1], velocities[0], velocities[1], share, 1.0, bounds, tried)
    interpolate_rows(rows, velocities, 0, 1, share, 1.0, 1.0, bounds, np.ones(2, np.bool_), played, slope)
    assert tried == pytest.approx(played, abs=1e-12)


@given(
    place=st.floats(0.0, 1.0),
    phase=st.floats(0.0, 1.0),
    before=st.floats(-2.0, 2.0),
    step=st.sampled_from([-1.0, 1.0]),
    rate=st.floats(0.1, 1.0),
    # an axis with a jerk limit, and one without
    bounds=st.sampled_from([(math.inf, 1.5), (0.99, math.inf)]),
)
def test_a_vertex_costs_no_more_between_rows_than_its_own_step_of_velocity(
    place: float, phase: float, before: float, step: float, rate: float, bounds: tuple[float, float]
) -> None:
    # 1.07 and 1.18 times the step by the cubic, 1.1 and 1.27 times by the motion of least acceleration
    after, limits = before + step, np.array(bounds)[:, None]
    moved = before * place + after * (1.0 - place)
    points = []
    for u in rate * (np.arange(-8, 12) + phase):
        if 0.0 < u < 1.0:
            here = np.zeros(1)
            ends = np.array([[0.0], [moved], [before], [after]])
            positions_between(*ends, u, 1.0, limits, here)
            points.append(float(here[0]))
        else:
            points.append(before * u if u <= 0.0 else moved + after * (u - 1.0))
    for order in (2, 3):
        assert np.abs(np.diff(points, order)).max() <= rate + 1e-9


@given(place=st.floats(0.0, 1.0), share=st.floats(0.0, 1.0), braking=st.floats(0.01, 0.45))
def test_an_axis_without_a_jerk_limit_gets_no_faster_between_rows_than_it_is_on_them(
    place: float, share: float, braking: float
) -> None:
    # at its greatest speed, of 1, until it begins to brake; the cubic gained 4 % before that. Where the cubic
    # itself would brake by more than the limit, of 0.6, least acceleration comes before speed
    left = 1.0 - place
    rows = np.array([[0.0], [1.0 - 0.5 * braking * left**2]])
    speeds = np.array([[1.0], [1.0 - braking * left]])
    bounds, here, slope = np.array([[0.6], [math.inf]]), np.zeros(1), np.zeros(1)
    driven = np.ones(1, np.bool_)
    interpolate_rows(rows, speeds, 0, 1, share, 1.0, 1.0, bounds, driven, here, slope)
    assert slope[0] <= 1.0 + 1e-6


def test_a_change_from_next_to_100_percent_ends_on_whole_rows() -> None:
    phases = np.zeros((MOST_PHASES, 4))
    for rate in (0.5, 0.995, 0.9999):
        count = change_onto_rows(phases, 200.3, rate, 0.0, 0.01, 0.001)
        end = 200.3 + total_advance(phases, count) - total_time(phases, count)
        assert end == pytest.approx(round(end), abs=1e-6)
        assert total_time(phases, count) < 300.0


@pytest.mark.parametrize(("jump", "count"), [(0.02, 3), (0.0, 6)])
def test_a_change_is_tried_as_far_as_where_u_waits_for_an_axis_that_moves_by_itself(
    jump: float, count: int
) -> None:
    # a step of positions behind a rest counted as what rows do themselves, and let any jerk pass beside it
    position = np.array([[-1e-5, 0.0], [-1e-6, 0.0], [0.0, 0.0], [0.0, jump], [1e-6, jump], [1e-5, jump]])
    velocity = np.array([[9e-3, 0.0], [1e-3, 0.0], [0.0, 0.0], [1e-5, 0.0], [1e-3, 0.0], [9e-3, 0.0]])
    places, at, driven = np.zeros(14), np.zeros(14, np.int64), np.ones(2, np.bool_)
    limits = np.full((LIMITS, 2), 2e-6)
    still = np.zeros(2)
    rows = RingRows(np.arange(6), position, velocity, np.zeros((6, NUMBERS, 0)))
    window = Window(0, 6, False, False, 0.0, still, driven, driven, np.zeros((3, 2)))
    found = find_window(rows, window, limits, 1e-3, places, at)
    assert (found.length, found.ends) == (count, jump > 0.0)


def test_one_cycle_tries_only_some_changes_and_the_next_one_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(machine(axes=64, jerk=300_000.0, travel=2000.0))
    rig.program.capture()
    rig.program.move(dict.fromkeys(range(64), 1.0), 2000)
    rig.program.finish()
    rig.step(250)
    calls: list[tuple[int, int]] = []

    def searched(*arguments: Any) -> Any:
        found = search_rate(*arguments)
        calls.append((arguments[4].from_try, found[4]))
        return found

    monkeypatch.setattr("mcserver.executor.playback.rate_control.search_rate", searched)
    # where the rows accelerate they leave little to the first tries
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(40)
    assert calls[0][0] == 0
    assert calls[0][1] <= TRIES // 2
    if calls[0][1] < len(calls):
        assert calls[1][0] == calls[0][1]
    rig.executor.mailbox.resume(0)
    rig.run()
    assert np.abs(np.diff(rig.setpoint[:, 0])).max() <= 1.001e-3
    assert np.abs(rig.acceleration()).max() <= 10.1


@settings(max_examples=10)
@given(rate=st.floats(0.02, 1.0))
def test_a_plan_is_followed_as_it_was_tried(rate: float) -> None:
    phases = np.array([[10.5, 1.0, (rate - 1.0) / 10.5, 0.0], [100.25, rate, 0.0, 0.0]])
    plan = RatePlan.of(phases, rate, 3)
    assert len(plan) == math.ceil(110.75) + 3
    steps = np.diff([plan.at(cycle)[0] for cycle in range(len(plan) + 1)])
    assert steps[0] <= 1.0
    assert steps[20:] == pytest.approx(rate, abs=1e-9)
    assert plan.at(len(plan))[1:] == (rate, 0.0)
