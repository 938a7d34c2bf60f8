"""Motion that is handed over is planned anew where an override above 100 % is raised."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.executor.shm.rings import ProgramRing
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.geometry.segment import AxisLimits
from mcserver.motion.lookahead.pace import Pace
from mcserver.planning.planner_messages import Report, ReportKind
from mcserver.planning.take_back import TakeBack
from mcserver.service.progress import LineProgress
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
    timed,
    worst_ratios,
)
from tests.bench.text_laws import broken_laws_of_text
from tests.motion.measure import ACCELERATION_SLACK, JERK_SLACK, VELOCITY_SLACK

# What a change of the rate that is under way may keep a new plan from, beside the 100 ms.
SOON = 160


def machine() -> Machine:
    return ideal(axes=2, velocity=500.0, acceleration=3000.0, jerk=60_000.0, tolerance_mm=0.02)


def zigzag_bound_by_corners() -> list[str]:
    return quick_zigzag(1.0)[:25]


def assert_laws(run: Run) -> None:
    velocity, acceleration, jerk = worst_ratios(machine(), run)
    assert velocity <= VELOCITY_SLACK
    assert acceleration <= ACCELERATION_SLACK
    assert jerk <= JERK_SLACK
    assert run.faults == 0


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """The executor's answers."""
    answers: list[bool] = []
    waits = TakeBack.waits

    def noted(self: TakeBack) -> bool:
        asked, before = self._asked, self._plan.motion
        waiting = waits(self)
        if asked is not None and not waiting:
            answers.append(self._plan.motion is not before)
        return waiting

    monkeypatch.setattr(TakeBack, "waits", noted)
    return answers


@pytest.mark.parametrize("program", [quick_zigzag, exact_stops])
def test_where_limits_bind_a_new_plan_is_played_soon_after_its_order(
    program: Program, taken: list[bool]
) -> None:
    lines = program(1.0)[:24]
    whole = play(machine(), lines, [])
    for share in (0.21, 0.47):
        order: Order = (int(share * whole.moved_s / machine().cycle_s), 1.5)
        run = play(machine(), lines, [order])
        after = run.planned_after(order)
        assert after is not None
        assert after <= SOON
        assert run.lines == whole.lines
        assert run.setpoint[-1] == pytest.approx(whole.setpoint[-1], abs=1e-12)
        assert run.moved_s <= whole.moved_s + machine().cycle_s
        assert_laws(run)
    assert any(taken)


@pytest.mark.parametrize("program", [long_lines, arcs, chords, timed])
def test_rows_that_are_played_faster_meanwhile_are_planned_anew_within_100_ms(
    program: Program, taken: list[bool]
) -> None:
    lines = program(1.0)
    whole = play(machine(), lines, [])
    order: Order = (int(0.31 * whole.moved_s / machine().cycle_s), 2.0)
    run = play(machine(), lines, [order])
    after = run.planned_after(order)
    assert after is not None
    assert after <= 100
    assert run.lines == whole.lines
    assert_laws(run)
    assert any(taken)


def programmed_times(run: Run, orders: list[Order]) -> list[float]:
    """Time that each line takes, each cycle counted as often as the override in force says [s]."""
    override = np.ones(len(run.setpoint))
    for cycle, order in orders:
        override[run.begun + cycle :] = order
    passed = np.concatenate(([0.0], np.cumsum(override))) * machine().cycle_s
    return [float(passed[run.ends[line]] - passed[run.begins[line]]) for line in run.lines]


@pytest.mark.parametrize(
    ("t", "orders"),
    [
        (1.0, [(2300, 2.0)]),
        (1.0, [(2100, 1.5), (2400, 2.0)]),
        # back to before where the first order cut it
        (1.0, [(2100, 1.5), (2120, 2.0)]),
        (1.0, [(2100, 1.5), (2113, 1.6), (2125, 1.7), (2140, 2.0)]),
        (1.0, [(2100, 2.0), (2300, 0.5), (2800, 2.0)]),
        (1.0, [(2100, 2.0), (2350, 1.2), (2500, 2.0)]),
        # more rows than there is room for are left of it
        (5.0, [(7300, 2.0)]),
        (5.0, [(7100, 1.5), (7400, 1.0), (7700, 2.0)]),
    ],
)
def test_a_line_with_a_time_of_its_own_is_cut_inside_and_its_rest_takes_the_rest_of_that_time(
    t: float, orders: list[Order], taken: list[bool]
) -> None:
    lines = ["G93", *(f"G01 X{30 * index} F{60 / t:g}" for index in range(1, 7))]
    run = play(machine(), lines, orders)
    after = run.planned_after(orders[0] if len(orders) == 1 else orders[-1])
    assert after is not None
    assert after <= 100
    assert run.lines == list(range(3, 9))
    found = programmed_times(run, orders)
    # each change of the rate takes a little, and nothing ends before its time
    assert found == pytest.approx([t] * len(found), abs=0.015 * len(orders) + 0.01)
    assert min(found) >= t - 2.5 * machine().cycle_s
    later = [run.ends[line] - run.begins[line] for line in run.lines[3:]]
    assert later == pytest.approx([1e3 * t / orders[-1][1]] * 3, abs=1)
    assert_laws(run)
    assert any(taken)


def test_the_last_stretch_of_a_program_is_taken_back_too(taken: list[bool]) -> None:
    lines = quick_chords(1.0)
    whole = play(machine(), lines, [])
    order: Order = (int(0.71 * whole.moved_s / machine().cycle_s), 2.0)
    run = play(machine(), lines, [order])
    after = run.planned_after(order)
    assert after is not None
    assert after <= SOON
    assert run.moved_s < whole.moved_s
    assert run.setpoint[-1] == pytest.approx(whole.setpoint[-1], abs=1e-12)
    assert run.lines == whole.lines
    assert_laws(run)
    assert any(taken)


def test_a_program_that_has_been_handed_over_up_to_its_end_reports_its_last_line_once() -> None:
    # speed turns just before its end but for rounding
    assert broken_laws_of_text(110211, orders=True)[0] == []


def test_orders_that_rise_every_few_cycles_keep_all_limits_and_report_each_line_once(
    taken: list[bool],
) -> None:
    orders = [(90 * index, 1.0 + 0.25 * (index % 5)) for index in range(25)]
    run = play(machine(), zigzag_bound_by_corners(), orders)
    assert run.lines == list(range(3, 27))
    assert sum(taken) >= 5
    assert_laws(run)


def test_streamed_lines_are_taken_back_too(taken: list[bool]) -> None:
    run = play(machine(), zigzag_bound_by_corners(), [(700, 1.4), (1500, 2.0)], every=20)
    assert run.lines == list(range(3, 27))
    assert any(taken)
    assert_laws(run)


def test_a_refusal_changes_nothing(monkeypatch: pytest.MonkeyPatch, taken: list[bool]) -> None:
    orders = [(300, 1.3), (900, 1.0), (1000, 1.8)]
    monkeypatch.setattr("mcserver.executor.slot.answer_replacement", refuse)
    refused = play(machine(), zigzag_bound_by_corners(), orders)
    assert taken
    assert not any(taken)
    monkeypatch.setattr(TakeBack, "ask", lambda *_: False)
    np.testing.assert_array_equal(
        refused.setpoint, play(machine(), zigzag_bound_by_corners(), orders).setpoint
    )


def refuse(ring: ProgramRing, *_: object, **__: object) -> None:
    ring.refuse_replacement()


def test_lines_that_set_outputs_as_they_begin_are_not_taken_back(taken: list[bool]) -> None:
    axes = "".join(
        f'[[axis]]\nindex = {index}\ntype = "linear"\nmax_velocity = 500.0\nmax_acceleration = 3000.0\n'
        'max_jerk = 60000.0\n[axis.drive]\nkind = "ideal"\n'
        for index in range(2)
    )
    motion = "[motion]\npath_tolerance_mm = 0.02\n"
    lamp = '[[output]]\nnumber = 0\nname = "lamp"\n'
    cell = parse_machine(f'[machine]\nname = "cell"\n{motion}{axes}{lamp}')
    moves = zigzag_bound_by_corners()
    lines = [text for line in moves[1:] for text in ("M62 P0", line, "M63 P0")]
    run = play(cell, ["G94", *lines], [(600, 1.5), (1200, 2.0)])
    assert run.faults == 0
    assert run.lines == sorted(set(run.lines))
    assert not any(taken)
    # a lamp far ahead is no obstacle
    run = play(cell, [*moves, "M62 P0", *(line.replace("X", "X-") for line in moves[1:])], [(600, 1.5)])
    assert run.faults == 0
    assert any(taken)


def test_a_line_that_is_planned_anew_without_a_limit_is_reported_without_one() -> None:
    progress = LineProgress(1)
    progress.planned(
        [Report(ReportKind.PLANNED, 1, requested_s=1.0), Report(ReportKind.BOUND, 1, bound_by="x")]
    )
    progress.planned([Report(ReportKind.BOUND, 1)])
    progress.line_started(1, 0.0)
    progress.line_ended(1, 1.0)
    (report,) = progress.take_ended()
    assert report.bound_by is None


def test_the_pace_rises_no_further_than_the_rows_before_it_let_playback_rise() -> None:
    pace = Pace(AxisLimits.of(machine()), most=2.0, now=1.0, plain=1.0, under_way=True)
    slow = np.full((200, 2), 0.04)
    assert pace.reachable(1.5, slow) == 1.5
    assert pace.reachable(1.5, slow[:20]) < 1.5
    # who is that quick already needs no rows for it
    assert pace.reachable(1.5, slow[:20], 1.5) == 1.5
    assert pace.reachable(1.5, slow[:2], 1.5) == 1.0
    fast = np.full((200, 2), 0.49)
    assert pace.reachable(1.5, fast, 1.5) == 1.0
