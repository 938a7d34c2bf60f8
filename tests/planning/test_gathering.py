"""The planner's process takes and tells together what nobody waits for, and at once what somebody does."""

from __future__ import annotations

import math

import pytest

from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.planning.gathering import GATHER_S, Gathering
from mcserver.planning.planner_messages import (
    CloseProgram,
    Consumed,
    ExecutorEvents,
    HaltProgram,
    LineRejected,
    Lines,
    PlannerCommand,
    PlannerEvent,
    PlannerFailed,
    Validated,
)

STREAMED = Lines("a", 0, 1, ["G04 P0"], awaited=False)
SUBMITTED = Lines("a", 0, 2, ["G04 P0"], awaited=True)


def executor(kind: EventKind) -> ExecutorEvents:
    return ExecutorEvents([ExecutorEvent(EventKind.LINE_START, 0, 1, 0.1), ExecutorEvent(kind, 0, 1, 0.2)])


def test_lines_that_nobody_waits_for_leave_a_pause_before_the_next_look() -> None:
    gathering = Gathering()
    gathering.came([STREAMED], now=10.0)
    assert gathering.until_look(10.0) == pytest.approx(GATHER_S)
    assert gathering.until_look(10.0 + 2 * GATHER_S) == 0.0


@pytest.mark.parametrize("command", [SUBMITTED, CloseProgram("a"), HaltProgram("a")])
def test_whatever_else_came_with_them_leaves_none(command: PlannerCommand) -> None:
    gathering = Gathering()
    gathering.came([STREAMED, command], now=10.0)
    assert gathering.until_look(10.0) == 0.0


def test_no_command_leaves_no_pause() -> None:
    gathering = Gathering()
    gathering.came([], now=10.0)
    assert gathering.until_look(10.0) == 0.0


@pytest.mark.parametrize(
    "event",
    [Consumed("a", 1), Validated("a", 1, 0.0), executor(EventKind.LINE_END), executor(EventKind.AXIS_DONE)],
)
def test_progress_is_sent_within_a_moment_and_in_order(event: PlannerEvent) -> None:
    gathering = Gathering()
    gathering.happened([event], now=10.0)
    gathering.happened([Consumed("a", 2)], now=10.0 + GATHER_S / 2)
    assert not gathering.due(10.0 + 0.9 * GATHER_S)
    assert gathering.due(10.0 + GATHER_S)
    assert gathering.take() == [event, Consumed("a", 2)]
    assert gathering.until_due(10.0) == math.inf


@pytest.mark.parametrize(
    "event",
    [
        LineRejected("a", 0, 1, (), final=False),
        PlannerFailed("", "gone"),
        executor(EventKind.FAULT),
        executor(EventKind.FINISHED),
        executor(EventKind.STOPPED),
        executor(EventKind.PAUSED),
    ],
)
def test_what_somebody_may_wait_for_is_sent_at_once_behind_what_came_before(event: PlannerEvent) -> None:
    gathering = Gathering()
    gathering.happened([Consumed("a", 1), event], now=10.0)
    assert gathering.due(10.0)
    assert gathering.take() == [Consumed("a", 1), event]


def test_the_verdict_on_a_line_that_is_waited_for_is_sent_at_once() -> None:
    gathering = Gathering()
    gathering.came([STREAMED, SUBMITTED], now=10.0)
    gathering.happened([Validated("a", 1, 0.0)], now=10.0)
    assert not gathering.due(10.0)
    gathering.happened([Validated("b", 2, 0.0)], now=10.0)
    assert not gathering.due(10.0)
    gathering.happened([Validated("a", 2, 0.0)], now=10.0)
    assert gathering.due(10.0)
    gathering.take()
    gathering.happened([Validated("a", 3, 0.0)], now=10.0)
    assert not gathering.due(10.0)


def test_events_that_are_due_end_the_pause() -> None:
    gathering = Gathering()
    gathering.happened([Consumed("a", 1)], now=10.0)
    gathering.came([STREAMED], now=10.0 + GATHER_S / 2)
    assert gathering.until_look(10.0 + GATHER_S / 2) == pytest.approx(GATHER_S / 2)
