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
    quick_zigzag,
    worst_ratios,
)
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


@pytest.mark.parametrize("program", [long_lines, arcs, chords])
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
