"""Which lines are done, when some run and some need no time."""

from __future__ import annotations

from mcserver.planning.planner_messages import Report, ReportKind
from mcserver.service.progress import LineProgress


def planned(*lines: int) -> list[Report]:
    return [Report(ReportKind.PLANNED, line, requested_s=1.0) for line in lines]


def test_lines_without_time_are_done_once_read() -> None:
    progress = LineProgress(1)
    progress.planned_through(3)
    assert progress.done == 3


def test_lines_behind_one_that_runs_are_not_done() -> None:
    progress = LineProgress(1)
    progress.planned(planned(2))
    progress.planned_through(4)
    assert progress.done == 1
    progress.line_started(2, 0.0)
    progress.line_ended(2, 1.5)
    assert progress.done == 4


def test_a_line_that_ends_before_an_earlier_one_does_not_count_yet() -> None:
    progress = LineProgress(1)
    progress.planned(planned(1, 2))
    progress.planned_through(2)
    progress.line_ended(2, 1.0)
    assert progress.done == 0
    progress.line_ended(1, 1.0)
    assert progress.done == 2


def test_a_report_holds_times_and_the_limit_that_stretched_the_line() -> None:
    progress = LineProgress(1)
    progress.planned([Report(ReportKind.PLANNED, 1, requested_s=1.0)])
    progress.planned([Report(ReportKind.BOUND, 1, bound_by="axis 2 acceleration")])
    progress.line_started(1, 10.0)
    progress.line_ended(1, 11.5)
    (report,) = progress.take_ended()
    assert (report.start_s, report.end_s, report.requested_s) == (10.0, 11.5, 1.0)
    assert (report.stretched_by, report.bound_by) == (1.5, "axis 2 acceleration")
    assert progress.take_ended() == []


def test_a_line_of_two_commands_is_done_with_the_second() -> None:
    progress = LineProgress(1)
    progress.planned(planned(1, 1))
    progress.planned_through(1)
    progress.ended(1)
    assert progress.done == 0
    progress.ended(1)
    assert progress.done == 1


def test_a_line_without_a_requested_time_has_no_stretch() -> None:
    progress = LineProgress(1)
    progress.line_started(1, 0.0)
    progress.line_ended(1, 2.0)
    (report,) = progress.take_ended()
    assert (report.requested_s, report.stretched_by) == (None, None)


def test_hours_of_lines_keep_memory_flat() -> None:
    progress = LineProgress(1)
    for line in range(1, 20_001):
        progress.planned(planned(line))
        progress.planned_through(line)
        progress.line_started(line, float(line))
        progress.line_ended(line, line + 0.5)
        progress.take_ended()
    assert progress.done == 20_000
    assert sum(len(kept) for kept in vars(progress).values() if hasattr(kept, "__len__")) == 0
