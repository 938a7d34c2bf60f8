"""Polylines that flow: never slower than with a stop at each vertex, and free of a vertex away from it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.machine.machine_file import Machine
from mcserver.motion.bound import PlanningError
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.pieces import Deactivation
from tests.motion.measure import ACCELERATION_SLACK, VELOCITY_SLACK, acceleration_ratio, velocity_ratio
from tests.motion.support import AxisSpec, Commit, Move, alike, machine_of, plan, polyline
from tests.motion.test_laws import law

SPECS = st.builds(
    AxisSpec,
    velocity=st.sampled_from([50.0, 200.0, 1000.0]),
    acceleration=st.sampled_from([500.0, 2000.0, 20_000.0]),
    jerk=st.sampled_from([None, 20_000.0, 200_000.0]),
)
MACHINES = st.builds(
    lambda specs, hz: machine_of(specs, cycle_hz=hz),
    st.lists(SPECS, min_size=2, max_size=3),
    st.sampled_from([1000.0, 250.0]),
)


@st.composite
def polylines(draw: st.DrawFn) -> tuple[Machine, list[FeedGroup]]:
    """Lines of like or unlike lengths from 0.1 to 30 mm that turn a little, and here and there a lot."""
    machine = draw(MACHINES)
    size = 10.0 ** draw(st.floats(-4.0, -1.5))
    spread = draw(st.sampled_from([1.2, 3.0, 20.0]))
    bend = draw(st.sampled_from([0.01, 0.05, 0.2, 0.6]))
    place = [0.0] * len(machine.axes)
    places, heading = [tuple(place)], 0.0
    for _ in range(draw(st.integers(4, 24))):
        heading += bend * draw(st.floats(-1.0, 1.0)) + draw(st.sampled_from([0.0, 0.0, 0.0, 0.0, 1.5]))
        length = size * spread ** draw(st.floats(-1.0, 1.0))
        place[0] += length * math.cos(heading)
        place[1] += length * math.sin(heading)
        if len(place) > 2:
            place[2] += 0.1 * length * draw(st.floats(-1.0, 1.0))
        places.append(tuple(place))
    return machine, polyline(machine, places, draw(st.sampled_from([0.05, 0.2, 1.0])))


@given(polylines(), st.sampled_from([0.0, 1e-5, 1e-4]))
@law(75)
def test_flowing_is_never_slower_than_stopping(
    made: tuple[Machine, list[FeedGroup]], tolerance: float
) -> None:
    machine, lines = made
    stopping = plan(machine, [Move(group, from_rest=True) for group in lines])
    flowing = plan(machine, [Move(group, tolerance=tolerance) for group in lines])
    assert flowing.duration <= stopping.duration * 1.0005 + 1.5 * flowing.cycle
    assert velocity_ratio(flowing) <= VELOCITY_SLACK
    assert acceleration_ratio(flowing) <= ACCELERATION_SLACK


@given(polylines(), st.lists(st.tuples(st.integers(1, 24), st.floats(0.0, 300.0)), min_size=1, max_size=8))
@law(40)
def test_a_window_that_is_cut_anywhere_keeps_the_limits(
    made: tuple[Machine, list[FeedGroup]], cuts: list[tuple[int, float]]
) -> None:
    machine, lines = made
    whole = plan(machine, lines)
    cut = plan(machine, lines, commits=[Commit(after, ahead) for after, ahead in sorted(cuts)])
    assert velocity_ratio(cut) <= VELOCITY_SLACK
    assert acceleration_ratio(cut) <= ACCELERATION_SLACK
    assert cut.position[-1] == pytest.approx(whole.position[-1], abs=1e-9)


def test_a_rest_that_cannot_be_planned_anew_is_driven_as_it_was_planned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine = alike(2, velocity=50.0, acceleration=500.0)
    lines = polyline(machine, [(0.0, 0.0), (1e-3, 0.0), (2e-3, 0.0), (3e-3, 1e-4)], 0.02)
    whole = plan(machine, lines)
    planned = Lookahead.plan

    def only_from_rest(window: Lookahead) -> PlannedRun:
        if window.entry > 0.0:
            raise PlanningError(window.table.segments[0].line)
        return planned(window)

    monkeypatch.setattr(Lookahead, "plan", only_from_rest)
    cut = plan(machine, lines, commits=[Commit(3, 20.0)])
    assert cut.position == pytest.approx(whole.position, abs=1e-12)
    assert cut.ends == pytest.approx(whole.ends)
    assert isinstance(cut.pieces[-1], Deactivation)


@pytest.mark.parametrize("jerk", [None, 500_000.0])
def test_between_the_vertices_of_long_lines_all_of_the_acceleration_is_used(jerk: float | None) -> None:
    """Ideal: up and down again between vertices that are passed at 0.97 max_acceleration·dt / |Δq'|."""
    machine = alike(2, velocity=1000.0, acceleration=1000.0, jerk=jerk)
    turn, length, count = 0.025, 2e-3, 40
    places, heading = [(0.0, 0.0)], 0.0
    for index in range(count):
        # left and right in turn: no axis meets with more than the next one
        heading = turn / 2.0 if index % 2 else -turn / 2.0
        x, y = places[-1]
        places.append((x + length * math.cos(heading), y + length * math.sin(heading)))
    motion = plan(machine, polyline(machine, places, 1.0))
    step = 2.0 * math.sin(turn / 2.0)
    speed = 0.97 * 1.0 * machine.cycle_s / step
    # three cycles beside each vertex are passed at its speed
    ramp = length - 2.0 * (3.0 * machine.cycle_s * speed + 4.5 * machine.cycle_s**2)
    ideal = 6.0 * machine.cycle_s + 2.0 * (math.sqrt(speed**2 + ramp) - speed)
    if jerk is not None:
        # a change of speed with bounded jerk takes acceleration / jerk longer, of which there are two
        ideal += 2.0 * 1000.0 / jerk
    took = motion.took(count // 2)
    assert took <= 1.03 * ideal
    assert took < 0.9 * length / speed
    assert acceleration_ratio(motion) <= ACCELERATION_SLACK
