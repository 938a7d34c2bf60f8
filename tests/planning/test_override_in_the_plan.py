"""Overrides above 100 % are planned: what is not handed over yet runs as with an F that is as much higher."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from mcserver.executor.shm.mailbox import OVERRIDE_MAX
from mcserver.machine.machine_file import Machine
from mcserver.motion.geometry.segment import AxisLimits, anchor, segment_of
from mcserver.motion.lookahead.commit_moments import LATE_S, commit_moment, hand_over_moment
from mcserver.motion.lookahead.feed_scale import plan_at_feed_scale
from mcserver.motion.lookahead.lookahead import Lookahead
from tests.bench.machines import ideal
from tests.bench.override import (
    Order,
    Program,
    Run,
    arcs,
    chords,
    exact_stops,
    long_lines,
    play,
    quick_chords,
    quick_zigzag,
)
from tests.bench.text_laws import broken_laws_of_text
from tests.limits import assert_keeps, limits_of
from tests.motion.support import alike, at_speed, in_time, line_curve

# The horizon: from an order above 100 % until all that is played is planned for it [s].
SOON_S = 0.5


def machine() -> Machine:
    return ideal(axes=2, velocity=500.0, acceleration=3000.0, jerk=60_000.0, tolerance_mm=0.02)


def zigzag(k: float) -> list[str]:
    points = [(5 * ((index + 2) // 2), 5 * ((index + 1) // 2)) for index in range(24)]
    return ["G94", f"F{2400 * k:g}", *(f"G01 X{x} Y{y}" for x, y in points)]


def line_and_circles(k: float) -> list[str]:
    return ["G94", f"G01 X60 F{3600 * k:g}", "G02 X60 Y0 I0 J15", "G02 X60 Y0 I0 J15", "G01 X0"]


def timed(k: float) -> list[str]:
    points = [(10 * index, 8 * (index % 2)) for index in range(1, 9)]
    return ["G93", *(f"G01 X{x} Y{y} F{120 * k:g}" for x, y in points)]


def stops_and_commas(k: float) -> list[str]:
    f = f"F{2400 * k:g}"
    return [
        "G94",
        "G61",
        f"G01 X20 {f}",
        "G01 Y10",
        "G04 P0.02",
        f"G01 X0 {f}, G01 Y20 F{1200 * k:g}",
        "G01 Y0",
    ]


def assert_laws(run: Run) -> None:
    assert_keeps(run.setpoint, limits_of(machine()))
    assert run.faults == 0
    assert run.lines == sorted(set(run.lines))


@pytest.mark.parametrize(
    ("program", "k"), [(zigzag, 2.0), (line_and_circles, 1.37), (timed, 2.0), (stops_and_commas, 1.5)]
)
def test_an_override_from_the_start_takes_as_long_as_the_text_with_that_f(program: Program, k: float) -> None:
    run, floor = play(machine(), program(1.0), [(0, k)]), play(machine(), program(k), [])
    assert run.moved_s == pytest.approx(floor.moved_s, abs=0.002)
    assert run.lines == floor.lines
    assert run.setpoint[-1] == pytest.approx(floor.setpoint[-1], abs=1e-12)
    assert_laws(run)


@pytest.mark.parametrize("program", [zigzag, timed])
def test_an_override_on_the_way_is_planned_for_all_that_is_not_handed_over(program: Program) -> None:
    slow, fast = play(machine(), program(1.0), []).moved_s, play(machine(), program(2.0), []).moved_s
    run = play(machine(), program(1.0), [(1000, 2.0)])
    assert run.moved_s <= 1.0 + fast * (1.0 - 1.0 / slow) + SOON_S
    assert_laws(run)


def test_a_line_alone_is_planned_again_while_it_runs() -> None:
    # its end is known, yet not all of it is handed over
    program = ["G94", "G01 X200 F2400", "G01 Y5", "G01 X190", "G01 Y0", "G01 X180"]
    run = play(machine(), program, [(1500, 2.0)])
    floor = play(machine(), [line.replace("F2400", "F4800") for line in program], [])
    assert run.moved_s <= 1.5 + floor.moved_s * (1.0 - 60.0 / 218.0) + SOON_S
    assert_laws(run)


@pytest.mark.parametrize("program", [zigzag, line_and_circles])
def test_back_at_100_percent_no_motion_is_faster_than_f_and_little_slower(program: Program) -> None:
    whole = play(machine(), program(1.0), [])
    ordered = 500
    run = play(machine(), program(1.0), [(0, 2.0), (ordered, 1.0)])
    assert_laws(run)
    # what was handed over for 200 % is played at half its rate
    assert run.moved_s <= whole.moved_s + 0.5
    (moving,) = np.nonzero((np.diff(run.setpoint, axis=0) != 0.0).any(axis=1))
    speed = np.linalg.norm(np.diff(run.setpoint[int(moving[0]) + ordered + 200 :], axis=0), axis=1)
    feed = 2400 if program is zigzag else 3600
    assert speed.max() <= feed / 60_000 * machine().cycle_s * 1.001


def test_orders_every_few_cycles_keep_all_limits_and_report_each_line_once() -> None:
    rng = np.random.default_rng(5)
    cycles = np.cumsum(rng.integers(1, 60, 60)).tolist()
    rates = rng.choice([0.2, 0.7, 1.0, 1.3, 1.7, 2.0], 60).tolist()
    run = play(machine(), zigzag(1.0), [*zip(cycles, rates, strict=True), (cycles[-1] + 1, 2.0)])
    assert run.lines == list(range(4, 28))
    assert run.setpoint[-1] == pytest.approx([0.06, 0.06], abs=1e-12)
    assert_laws(run)


def long_timed(k: float) -> list[str]:
    return ["G93", *(f"G01 X{30 * index} F{12 * k:g}" for index in range(1, 4))]


@pytest.mark.parametrize(
    ("program", "first"),
    [
        (long_lines, 3),
        (arcs, 3),
        (chords, 500),
        (quick_chords, 800),
        (quick_zigzag, 60),
        (exact_stops, 22),
        (timed, 9),
        (long_timed, 3),
    ],
)
def test_an_order_above_100_percent_is_wholly_effective_within_half_a_second(
    program: Program, first: int
) -> None:
    # the first lines of each: some seconds, of which an order leaves more than the half one
    lines = program(1.0)[:first]
    whole = play(machine(), lines, [])
    # lines come one every few cycles, or are all there at once
    for share, every in ((0.21, 3), (0.53, 0)):
        order: Order = (int(share * whole.moved_s / machine().cycle_s), 2.0)
        run = play(machine(), lines, [order], every=every)
        after = run.planned_after(order)
        assert after is not None
        # a curve that lines still come for is not cut inside
        longer = 2.0 if program is quick_chords else 1.0
        assert after <= longer * SOON_S / machine().cycle_s
        assert run.lines == whole.lines
        assert run.setpoint[-1] == pytest.approx(whole.setpoint[-1], abs=1e-12)
        assert_laws(run)


def programmed_times(run: Run, orders: list[Order]) -> list[float]:
    """Time that each line takes, each cycle counted as often as the feed scale in force says [s]."""
    passed = np.concatenate(([0.0], np.cumsum(run.scale))) * machine().cycle_s
    del orders
    return [float(passed[run.ends[line]] - passed[run.begins[line]]) for line in run.lines]


@pytest.mark.parametrize("t", [1.0, 3.0])
@pytest.mark.parametrize(
    "orders", [[(2300, 2.0)], [(2100, 1.5), (2400, 2.0)], [(2100, 1.5), (2113, 1.6), (2140, 2.0)]]
)
def test_a_line_with_a_time_of_its_own_takes_the_rest_of_that_time_at_the_new_override(
    t: float, orders: list[Order]
) -> None:
    lines = ["G93", *(f"G01 X{30 * index} F{60 / t:g}" for index in range(1, 5))]
    run = play(machine(), lines, orders)
    assert run.lines == list(range(3, 7))
    found = programmed_times(run, orders)
    assert found == pytest.approx([t] * len(found), abs=4.0 * machine().cycle_s)
    assert run.ends[6] - run.begins[6] == pytest.approx(1e3 * t / orders[-1][1], abs=1)
    assert_laws(run)


@pytest.mark.parametrize("every", [0, 20])
def test_orders_that_rise_every_few_cycles_report_each_line_once(every: int) -> None:
    orders = [(90 * index, 1.0 + 0.25 * (index % 5)) for index in range(25)]
    run = play(machine(), quick_zigzag(1.0)[:25], orders, every=every)
    assert run.lines == list(range(3, 27))
    assert_laws(run)


def test_a_program_that_is_handed_over_up_to_its_end_reports_its_last_line_once() -> None:
    # speed turns just before its end but for rounding
    assert broken_laws_of_text(110211, orders=True)[0] == []


def window_of(*speeds: float, timed: bool = False) -> Lookahead:
    """Lines of 20 mm on end, each with its F, or with a time of its own."""
    machine = alike(1, velocity=500.0, acceleration=1000.0, jerk=20_000.0)
    window, position = Lookahead(AxisLimits.of(machine)), np.zeros(1)
    for index, speed in enumerate(speeds):
        curve = line_curve(machine, (0,), [0.02 * index], [0.02 * (index + 1)])
        group = in_time(0.02 / speed, curve) if timed else at_speed(speed, curve)
        segment = segment_of(group, index + 1, {0: 0}, np.ones(1, np.bool_))
        anchor(segment, position)
        window.append(segment)
    return window


def test_a_motion_too_fast_for_a_lower_scale_keeps_its_own_until_it_has_slowed_down() -> None:
    window = window_of(0.05, 0.05, 0.05, 0.05)
    faster = plan_at_feed_scale(window, OVERRIDE_MAX)
    assert faster is not None
    assert {each.feed_scale for each in faster.segments} == {OVERRIDE_MAX}
    window.entry = 0.1
    slower = plan_at_feed_scale(window, 1.0)
    assert slower is not None
    scales = [each.feed_scale for each in slower.segments]
    assert scales[0] == OVERRIDE_MAX
    assert scales[-1] == 1.0
    assert scales == sorted(scales, reverse=True)
    speeds = slower.phases.at(np.linspace(0.0, slower.phases.duration, 500))
    bounds = np.searchsorted(slower.bounds, speeds[0], side="right") - 1
    feeds = np.array([each.feed * each.scale for each in slower.segments])
    assert (speeds[1] <= feeds[np.minimum(bounds, len(feeds) - 1)] * (1.0 + 1e-6)).all()


def test_a_window_of_one_scale_is_not_planned_again() -> None:
    window = window_of(0.05, 0.08)
    assert plan_at_feed_scale(window, 1.0) is None


def test_a_motion_that_has_peaks_of_speed_only_is_handed_over_up_to_one() -> None:
    plan = window_of(0.4, 0.4).plan()
    assert hand_over_moment(plan, 0.0) > 0.0


def test_motion_is_handed_over_up_to_a_moment_without_acceleration_that_is_not_its_end() -> None:
    plan = window_of(0.4, 0.4, 0.05, 0.4).plan()
    ends = plan.phases.duration
    for want in np.linspace(0.0, ends + 0.5, 60).tolist():
        moment = hand_over_moment(plan, want, closing=True)
        assert moment <= ends - LATE_S
        assert abs(plan.phases.state(moment)[1]) > 0.0
        assert moment == 0.0 or plan.phases.state(moment)[2] == pytest.approx(0.0, abs=1e-6)
        # nearer to what is wanted than where speed is steady
        steady = commit_moment(plan, want)
        assert moment <= max(steady, want + LATE_S) or moment < want


def test_a_line_with_a_time_of_its_own_is_cut_inside_only_for_the_horizon() -> None:
    plan = window_of(0.05, 0.05, timed=True).plan()
    assert commit_moment(plan, 0.2) == plan.times[1]
    moment = hand_over_moment(plan, 0.2)
    assert 0.2 <= moment < plan.times[1]
    first, second = plan.after(moment).segments[:2]
    assert first.duration == pytest.approx(0.4 - moment, abs=1e-9)
    assert second.duration == pytest.approx(0.4)
    assert not first.opens


def test_a_line_is_not_cut_inside_where_little_is_left_of_it_or_its_time_is_not_kept() -> None:
    plan = window_of(0.05, 0.05, 0.05, timed=True).plan()
    ends = float(plan.times[2])
    assert hand_over_moment(plan, ends - 0.1) == ends - 0.1
    # its end is near enough, and a T of what is left would be one of rounding
    assert hand_over_moment(plan, ends - 0.001) == ends
    segments = plan.segments.copy()
    segments[1] = msgspec.structs.replace(segments[1], duration=0.35)
    late = dataclasses.replace(plan, segments=segments)
    assert hand_over_moment(late, ends - 0.1) == ends


def test_what_is_left_of_a_line_keeps_its_scale_where_it_would_end_before_its_time_otherwise() -> None:
    window = window_of(0.0397, 0.0933, 0.0862, timed=True)
    faster = plan_at_feed_scale(window, 2.0)
    assert faster is not None
    rest = faster.after(hand_over_moment(faster, 0.169))
    left = rest.segments[0]
    assert left.duration is not None
    now = msgspec.structs.replace(
        window.table.segments[0], begin=left.begin, duration=left.duration, opens=False
    )
    window.table.replace(0, now)
    window.entry = float(rest.phases.velocity[0])
    # twice the rest of its T leaves no profile as slow as that
    before = window.table.save(0)
    window.table.set_feed_scale(1.0)
    assert window.plan().ends_early
    window.table.put_back(before)
    slower = plan_at_feed_scale(window, 1.0)
    assert slower is None or not slower.ends_early
    scales = window.table.feed_scales.tolist()
    assert scales[0] == 2.0
    assert scales == sorted(scales, reverse=True)


def test_a_motion_is_not_cut_where_two_corners_in_a_time_of_their_own_meet() -> None:
    # each takes half of a line, and at its middle the speed of the path is that of neither
    quick = ideal(axes=2, velocity=600.0, acceleration=3000.0, jerk=200_000.0, tolerance_mm=0.1)
    turns = [(2.94, 1.38), (3.82, 1.04), (4.58, -1.04), (0.69, 2.13), (2.28, -2.4), (0.6, 3.33), (1.28, 0.28)]
    program = ["G94", "G91", "F5749", *(f"G01 X{x} Y{y}" for _ in range(3) for x, y in turns)]
    # each order plans anew from the cut
    run = play(quick, program, [(60 * index, 2.0 - 0.7 * (index % 2)) for index in range(30)])
    assert_keeps(run.setpoint, limits_of(quick))


@pytest.mark.parametrize("jerk", [None, 50_000.0])
def test_a_higher_override_takes_no_longer_where_vertices_bind_the_speed(jerk: float | None) -> None:
    exact = ideal(axes=2, velocity=200.0, acceleration=1000.0, jerk=jerk)
    x = 0.1 * np.arange(1, 160)
    lines = ["G94 F1800", *(f"G01 X{a:.4f} Y{b:.4f}" for a, b in zip(x, 2.0 * np.sin(x), strict=True))]
    programmed = play(exact, lines, []).moved_s
    assert play(exact, lines, [(0, 1.7)]).moved_s <= programmed
    assert play(exact, lines, [(round(250 * programmed), 1.7)]).moved_s <= programmed
