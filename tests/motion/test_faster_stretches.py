"""Curves of changing curvature: acceleration at the knots too, every limit kept, never slower than before."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.motion.canonical import FeedGroup
from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.node_phases import PHASE_LIMITS, exceed_limits, to_phases
from mcserver.motion.kernels.path_speed import quicker_phases
from mcserver.motion.kernels.phases import PHASE
from mcserver.motion.kernels.sample_limits import run_of
from mcserver.motion.profile.faster_stretches import KnotProfile, _Known
from mcserver.motion.profile.velocity_profile import join_phases
from mcserver.simulation.simulation import simulate
from tests.bench.analytic import least_time
from tests.bench.machines import ideal
from tests.bench.polylines import lines_along
from tests.motion.measure import (
    ACCELERATION_SLACK,
    JERK_SLACK,
    VELOCITY_SLACK,
    acceleration_ratio,
    jerk_ratio,
)
from tests.motion.support import (
    AxisSpec,
    Commit,
    Motion,
    Move,
    alike,
    at_speed,
    in_time,
    line_curve,
    machine_of,
    plan,
    polyline,
)

JERK, TOLERANCE = 50_000.0, 2e-5


def chords_of(curve: Array, chord: float) -> Array:
    """Points a chord apart along a dense curve, from the origin, rounded as a program writes them [m]."""
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))))
    at = np.linspace(0.0, along[-1], round(along[-1] / chord) + 1)
    points = np.stack([np.interp(at, along, column) for column in (curve - curve[0]).T], axis=1)
    rounded = np.round(points, 7)
    # where the curve turns back on itself two points may be one
    distinct: Array = rounded[np.append(True, (np.diff(rounded, axis=0) != 0.0).any(axis=1))]
    return distinct


def lissajous(first: float, second: float, phase: float, size: float = 0.02) -> Array:
    t = np.linspace(0.0, 2.0 * math.pi, 20_001)
    return size * np.stack([np.sin(first * t), np.sin(second * t + phase)], axis=1)


def clothoid(length: float, sharpest: float) -> Array:
    """Curvature from -1/sharpest to 1/sharpest, which changes evenly along it."""
    s = np.linspace(-0.5 * length, 0.5 * length, 20_001)
    heading = s**2 / (length * sharpest)
    step = np.stack([np.cos(heading), np.sin(heading)], axis=1) * (s[1] - s[0])
    return np.cumsum(step, axis=0)


def driven(
    points: Array,
    speed: float,
    commits: list[Commit] | None = None,
    jerk: float = JERK,
    tolerance: float = TOLERANCE,
) -> Motion:
    machine = alike(points.shape[1], velocity=500.0, jerk=jerk)
    moves = [Move(group, tolerance=tolerance) for group in polyline(machine, points.tolist(), speed)]
    return plan(machine, moves, start=points[0], commits=commits or [])


def assert_kept(motion: Motion, speed: float) -> None:
    along = np.linalg.norm(np.diff(motion.rested, axis=0), axis=1)
    assert along.max() / motion.cycle <= VELOCITY_SLACK * speed
    assert acceleration_ratio(motion) <= ACCELERATION_SLACK
    assert jerk_ratio(motion) <= JERK_SLACK


def only_knots(*arguments: object, **_stops: bool) -> KnotProfile:
    given = arguments[4]
    assert isinstance(given, KnotProfile)
    return given


@pytest.mark.parametrize(
    ("curve", "speed", "share"),
    [
        (lissajous(1.0, 2.0, 0.7), 0.2, 0.8),
        # its sharp tips are vertices: the stretches are between them
        (lissajous(3.0, 2.0, math.pi / 4.0), 0.2, 0.75),
        (clothoid(0.2, 0.006), 0.2, 0.9),
    ],
)
def test_changing_curvature_is_driven_quicker_than_by_knots_within_every_limit(
    curve: Array, speed: float, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = chords_of(curve, 5e-4)
    quick = driven(points, speed)
    assert_kept(quick, speed)
    monkeypatch.setattr("mcserver.motion.lookahead.lookahead.quicker_stretches", only_knots)
    assert quick.duration <= share * driven(points, speed).duration


def test_an_axis_without_a_jerk_limit_that_rests_costs_no_time() -> None:
    # as a spindle, or a turntable
    points = chords_of(lissajous(1.0, 2.0, 0.7), 5e-4)
    with_another = machine_of([AxisSpec(500.0, 1000.0, JERK)] * 2 + [AxisSpec(500.0, 1000.0, None)])
    moves = [Move(group, tolerance=TOLERANCE) for group in polyline(with_another, points.tolist(), 0.2)]
    motion = plan(with_another, moves, start=np.append(points[0], 0.0))
    assert motion.duration == pytest.approx(driven(points, 0.2).duration, rel=1e-3)


def test_a_short_ramp_from_rest_keeps_only_itself_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    # a corner of 1 rad behind a quarter of a circle, whose curve begins at rest with a low peak
    quarter = np.linspace(0.0, math.pi / 2.0, 41)
    arc = 0.01 * np.stack([np.cos(quarter), np.sin(quarter)], axis=1)
    turn = math.pi + 1.0
    line = arc[-1] + 0.02 * np.array([math.cos(turn), math.sin(turn)])
    points = np.concatenate(([[0.0, 0.0]], arc, [line]))
    machine = alike(2, velocity=1000.0, acceleration=10_000.0, jerk=200_000.0)
    moves = [Move(group, tolerance=1e-4) for group in polyline(machine, points.tolist(), 0.1)]
    quick = plan(machine, moves)
    assert_kept(quick, 0.1)
    monkeypatch.setattr(_Known, "_abrupt", lambda *_: False)
    assert quick.duration < 0.97 * plan(machine, moves).duration


def ellipse(long: float, short: float) -> Array:
    t = np.linspace(0.0, 2.0 * math.pi, 20_001)
    return np.stack([long * np.cos(t), short * np.sin(t)], axis=1)


def test_a_smooth_file_is_driven_without_a_stop_wherever_its_windows_meet() -> None:
    # some of it is handed over before the last lines are known, which bend to R2 in front of that speed
    text = lines_along(1e3 * (ellipse(0.03, 0.008) - [0.03, 0.0]), 0.1, 200.0)
    machine = ideal(axes=2, velocity=500.0, jerk=100_000.0, tolerance_mm=0.05)
    recording = simulate(text, machine, record=True).recording
    assert recording is not None
    speed = 1e3 * np.linalg.norm(np.diff(recording.setpoint, axis=0), axis=1)
    moving = np.nonzero(speed > 30.0)[0]
    assert speed[moving[0] : moving[-1]].min() > 30.0


@pytest.mark.parametrize(
    ("curve", "tolerance", "jerk", "share"),
    [
        (ellipse(0.03, 0.008), 2e-5, 50_000.0, 1.10),
        (clothoid(0.15, 0.003), 1e-5, 30_000.0, 1.10),
        (lissajous(1.0, 2.0, 0.7), 2e-5, 50_000.0, 1.12),
        (lissajous(3.0, 2.0, math.pi / 4.0), 5e-5, 100_000.0, 1.10),
    ],
)
def test_bends_down_to_the_length_of_a_chord_take_little_more_than_the_least_time(
    curve: Array, tolerance: float, jerk: float, share: float
) -> None:
    points = chords_of(curve, 5e-4)
    motion = driven(points, 0.2, jerk=jerk, tolerance=tolerance)
    assert_kept(motion, 0.2)
    assert motion.duration <= share * least_time(1e3 * curve, 200.0, 1000.0, jerk)


@settings(max_examples=8)
@given(
    first=st.sampled_from([1.0, 2.0, 3.0]),
    second=st.sampled_from([1.0, 2.0, 5.0]),
    phase=st.floats(0.0, 3.0),
    speed=st.sampled_from([0.05, 0.1, 0.3]),
    chord=st.sampled_from([3e-4, 1e-3]),
    jerk=st.sampled_from([30_000.0, 100_000.0]),
    every=st.sampled_from([0, 40, 150]),
)
def test_any_lissajous_figure_keeps_every_limit_whole_or_piece_by_piece(
    first: float, second: float, phase: float, speed: float, chord: float, jerk: float, every: int
) -> None:
    points = chords_of(lissajous(first, second, phase, size=0.01), chord)
    commits = [Commit(each, 0.1) for each in range(every, len(points) - 1, every)] if every else []
    assert_kept(driven(points, speed, commits, jerk), speed)


def bend(count: int = 30) -> tuple[Array, Array]:
    """Samples of a path whose curvature rises and falls, in groups of one millimetre, and their edges."""
    at = np.linspace(0.0, 1.0, count)
    rows = np.zeros((count, 12))
    rows[:, 0] = rows[:, 1] = 1.0
    rows[:, 2] = rows[:, 3] = 20.0 + 80.0 * np.sin(math.pi * at) ** 2
    rows[:, 10:] = math.inf
    return rows, np.linspace(0.0, 1e-3 * count, count + 1)


LIMITS = np.array([[0.5, 0.5], [1.0, 1.0], [50.0, 50.0]])


def test_a_stretch_keeps_the_speeds_and_the_length_that_it_is_given() -> None:
    rows, edges = bend()
    count = len(rows)
    run = run_of(rows, np.arange(count + 1), np.full(count, 0.2), LIMITS, 1e-3)
    nodes, speeds = np.linspace(0.0, edges[-1], 90), np.full(90, 0.05)
    phases, _ = quicker_phases(
        run, edges, np.zeros((count, 4)), np.full(count, 0.2), 0, count, nodes, speeds, (0.0, 0.0)
    )
    profile = join_phases(phases, float(edges[-1]))
    assert profile.duration < 0.95 * edges[-1] / 0.05
    assert phases[0, 1:4].tolist() == [0.0, 0.05, 0.0]
    last = phases[-1]
    assert last[2] + last[0] * (last[3] + last[0] * last[4] / 2.0) == pytest.approx(0.05, abs=1e-12)
    assert last[3] + last[0] * last[4] == pytest.approx(0.0, abs=1e-12)
    place = last[1] + last[0] * (last[2] + last[0] * (last[3] / 2.0 + last[0] * last[4] / 6.0))
    assert place == pytest.approx(edges[-1], abs=1e-12)
    assert np.abs(phases[:, 4]).max() <= 50.0 * 1.035


@pytest.mark.parametrize("trimmed", ["start", "end"])
def test_samples_of_a_trimmed_segment_count_where_they_stand(trimmed: str) -> None:
    # half of a segment is left, along which curvature rises: as fast as with samples of that half alone
    rows, _ = bend(17)
    rows[:, 2] = rows[:, 3] = 20.0 + 80.0 * np.linspace(0.0, 1.0, 17)
    far, steep = 0.03, 8
    half = rows[steep:] if trimmed == "start" else rows[: steep + 1]
    edges, nodes, speeds = np.array([0.0, far]), np.linspace(0.0, far, 90), np.full(90, 0.05)
    start = -far if trimmed == "start" else 0.0
    found = []
    for samples, span in ((half, (0.0, far)), (rows, (start, 2.0 * far))):
        run = run_of(samples, np.array([0, len(samples)]), np.full(1, 0.2), LIMITS, 1e-3)
        # of a segment as a whole, trimmed or not
        run.sample_vmax[:] = run.segment_vmax[:] = 0.098
        spans = np.array([[*span, len(samples), 0.0]])
        phases, _ = quicker_phases(run, edges, spans, np.full(1, 0.2), 0, 1, nodes, speeds, (0.0, 0.0))
        found.append(float(phases[:, 0].sum()))
    assert found[0] > 0.0
    # but for the sample beside the cut, which counts for the nodes next to it
    assert found[1] == pytest.approx(found[0], rel=5e-3)


@pytest.mark.parametrize("spoilt", ["vertex", "nothing to gain", "too fast"])
def test_what_has_no_better_profile_is_left_as_it_was(spoilt: str) -> None:
    rows, edges = bend()
    count = len(rows)
    speeds = np.full(90, 0.05)
    if spoilt == "vertex":
        rows[10, 6] = 1e-3
    run = run_of(rows, np.arange(count + 1), np.full(count, 0.2), LIMITS, 1e-3)
    if spoilt == "nothing to gain":
        run.sample_vmax[:] = 0.05
    if spoilt == "too fast":
        speeds[:] = 0.3
    nodes = np.linspace(0.0, edges[-1], 90)
    spans, feed = np.zeros((count, 4)), np.full(count, 0.2)
    phases, looked = quicker_phases(run, edges, spans, feed, 0, count, nodes, speeds, (0.0, 0.0))
    assert len(phases) == 0
    assert not looked


@pytest.mark.parametrize("turn", [0.1, 0.25, 0.4, 0.5, 0.75, 0.9])
@pytest.mark.parametrize("by_feed", [False, True])
def test_a_phase_is_looked_at_where_its_speed_turns(turn: float, by_feed: bool) -> None:
    # 8 ms, with a peak at this share of it: 1.2 times the limit where the ends and the middle keep it
    duration, limit, peak = 8e-3, 1.0, 1.2
    jerk = -2.0 * (peak - 0.9) / (max(turn, 1.0 - turn) * duration) ** 2
    acceleration = -jerk * turn * duration
    start = peak + 0.5 * jerk * (turn * duration) ** 2
    phases = np.array([[duration, 0.0, start, acceleration, jerk]])
    demand = np.zeros((2, 4, 1))
    demand[:, 0] = 1e-6 if by_feed else 1.0
    fed = np.full(2, limit if by_feed else np.inf)
    limits, over = np.array([[limit], [1e9], [1e9]]), np.empty((1, 3))
    assert exceed_limits(phases, demand, np.full(2, np.inf), fed, limits, 0.0, over)
    assert over[0, 0] == pytest.approx(peak / PHASE_LIMITS[0])


@pytest.mark.parametrize("speed", [0.3, 1e-3, 1e-6])
def test_phases_from_node_to_node_meet_at_every_node_however_slowly_they_begin(speed: float) -> None:
    nodes = np.linspace(0.0, 0.01, 60)
    b = speed * speed + 6.0 * nodes
    phases = np.empty((len(nodes) - 1, PHASE))
    assert to_phases(nodes, b, (0.0, 3.0), phases)
    lasts, position, velocity, acceleration, jerk = phases.T
    moved = lasts * (velocity + lasts * (acceleration / 2.0 + lasts * jerk / 6.0))
    assert position + moved == pytest.approx(nodes[1:], abs=1e-12)


def test_lines_too_quick_for_the_axes_flow_as_the_same_path_without_a_time_does() -> None:
    machine = alike(2, velocity=500.0, jerk=100_000.0)
    curve = lissajous(1.0, 2.0, 0.7)
    points = chords_of(curve, 5e-4)
    lines = [line_curve(machine, (0, 1), a.tolist(), b.tolist()) for a, b in itertools.pairwise(points)]
    commits = [Commit(at, 60.0) for at in range(40, len(lines), 40)]

    def took(groups: list[FeedGroup]) -> float:
        moves = [Move(group, tolerance=TOLERANCE) for group in groups]
        motion = plan(machine, moves, start=points[0], commits=commits)
        speed = np.linalg.norm(motion.velocity, axis=1)
        # it is never near rest between its ends
        assert speed[50:-50].min() > 0.02
        assert jerk_ratio(motion) <= JERK_SLACK
        return motion.duration

    fed = took([at_speed(0.5, line) for line in lines])
    assert took([in_time(1e-3, line) for line in lines]) <= 1.05 * fed
