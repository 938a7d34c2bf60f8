"""The search for a change of rate: its curves in closed form, interpolation, and the bound of its work."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.executor.playback.rate_plan import RatePlan
from mcserver.motion.kernels.rate_changes import MOST_PHASES, add_ramp, stop_at_edge, total_advance
from mcserver.motion.kernels.rate_search import TRIES, search_rate
from mcserver.motion.kernels.row_interpolation import interpolate_rows, positions_between
from tests.executor.rig import Rig, machine

RATES = st.floats(0.0, 2.0)
SLOPES = st.floats(1e-4, 0.3)
CURVATURES = st.floats(1e-5, 0.3)


@settings(deadline=None)
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


@settings(deadline=None)
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


@settings(deadline=None)
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
    limits = np.full(2, most)
    tried, played, slope = np.zeros(2), np.zeros(2), np.zeros(2)
    positions_between(rows[0], rows[1], velocities[0], velocities[1], share, 1.0, limits, tried)
    interpolate_rows(rows, velocities, 0, 1, share, 1.0, 1.0, limits, np.ones(2, np.bool_), played, slope)
    assert tried == pytest.approx(played, abs=1e-12)


def test_one_cycle_tries_only_some_changes_and_the_next_one_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(machine(axes=64, jerk=300_000.0, travel=2000.0))
    rig.program.capture()
    rig.program.move(dict.fromkeys(range(64), 1.0), 2000)
    rig.program.finish()
    rig.step(250)
    calls: list[tuple[int, int]] = []

    def searched(*arguments: Any) -> Any:
        found = search_rate(*arguments)
        calls.append((arguments[14], found[4]))
        return found

    monkeypatch.setattr("mcserver.executor.playback.rate_control.search_rate", searched)
    # twice the rate fits here, but not where the first tries get to: they are long
    rig.executor.mailbox.set_override(2.0, 0)
    rig.step(12)
    assert calls[0][0] == 0
    assert calls[0][1] <= TRIES // 2
    assert calls[1][0] == calls[0][1]
    rig.run()
    assert np.abs(np.diff(rig.setpoint[:, 0])).max() <= 1.001e-3
    assert np.abs(rig.acceleration()).max() <= 10.1


@settings(max_examples=10, deadline=None)
@given(rate=st.floats(0.02, 1.0))
def test_a_plan_is_followed_as_it_was_tried(rate: float) -> None:
    phases = np.array([[10.5, 1.0, (rate - 1.0) / 10.5, 0.0], [100.25, rate, 0.0, 0.0]])
    plan = RatePlan.of(phases, rate, 3)
    assert len(plan) == math.ceil(110.75) + 3
    steps = np.diff([plan.at(cycle)[0] for cycle in range(len(plan) + 1)])
    assert steps[0] <= 1.0
    assert steps[20:] == pytest.approx(rate, abs=1e-9)
    assert plan.at(len(plan))[1:] == (rate, 0.0)
