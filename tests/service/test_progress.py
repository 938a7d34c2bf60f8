"""Which lines are done: those that the executor has passed, and no other."""

from __future__ import annotations

from mcserver.planning.planner_messages import Report, ReportKind
from mcserver.service.progress import LineProgress


def planned(*lines: int) -> list[Report]:
    return [Report(ReportKind.PLANNED, line, requested_s=1.0) for line in lines]


def test_a_line_is_done_when_the_next_one_begins() -> None:
    progress = LineProgress(1)
    progress.line_started(2, 0.0)
    assert progress.done == 1
    progress.line_ended(2, 1.5)
    assert progress.done == 1
    progress.line_started(5, 1.5)
    assert progress.done == 4


def test_what_is_planned_is_not_done() -> None:
    progress = LineProgress(231)
    progress.planned(planned(231, 232))
    assert progress.done == 230


def test_a_line_that_begins_again_has_not_ended_before() -> None:
    progress = LineProgress(1)
    for part in range(3):
        progress.line_started(4, float(part))
        progress.line_ended(4, part + 1.0)
        assert progress.done == 3
    progress.passed(4)
    assert progress.done == 4


def test_the_end_of_a_line_of_several_parts_is_reported_once_when_all_are_over() -> None:
    progress = LineProgress(1)
    progress.planned(planned(2, 2))
    starts = []
    for part in (0.0, 2.0):
        progress.line_started(2, part)
        starts.append(progress.line_ended(2, part + 1.0))
        assert not progress.any_ended
    progress.line_started(3, 4.0)
    (report,) = progress.take_ended()
    assert starts == [0.0, 2.0]
    assert (report.line, report.start_s, report.end_s, report.requested_s) == (2, 0.0, 3.0, 2.0)


def test_a_line_that_is_stopped_between_its_parts_is_reported_neither_ended_nor_done() -> None:
    progress = LineProgress(1)
    progress.line_started(2, 0.0)
    progress.line_ended(2, 0.0)
    progress.faulted(0, lost=False)
    assert (progress.take_ended(), progress.done) == ([], 1)


def test_a_line_that_moves_on_beside_the_next_one_is_reported_at_its_end() -> None:
    progress = LineProgress(1)
    progress.line_started(1, 0.0)
    progress.line_started(2, 1.0)
    assert progress.take_ended() == []
    progress.line_ended(1, 1.5)
    assert [(each.line, each.end_s) for each in progress.take_ended()] == [(1, 1.5)]


def test_a_time_that_one_part_does_not_ask_for_is_not_that_of_the_line() -> None:
    progress = LineProgress(1)
    progress.planned(planned(1))
    for part in (0.0, 1.0):
        progress.line_started(1, part)
        progress.line_ended(1, part + 1.0)
    progress.passed(1)
    assert progress.take_ended()[0].requested_s is None


def test_a_mark_says_that_all_before_it_has_ended() -> None:
    progress = LineProgress(1)
    progress.passed(3)
    assert progress.done == 3
    progress.passed(2)
    assert progress.done == 3


def test_a_line_that_has_faulted_is_not_done() -> None:
    progress = LineProgress(1)
    progress.line_started(4, 0.0)
    progress.line_ended(4, 1.0)
    # the row of this cycle was of the line before
    progress.line_started(5, 1.0)
    progress.faulted(4, lost=True)
    assert progress.done == 3


def test_lines_that_the_other_axes_pass_on_their_way_to_a_stop_are_not_done() -> None:
    progress = LineProgress(1)
    progress.line_started(4, 0.0)
    progress.faulted(4, lost=True)
    progress.line_started(6, 1.0)
    assert progress.done == 3


def test_lines_on_the_way_to_an_emergency_stop_have_ended() -> None:
    progress = LineProgress(1)
    progress.line_started(4, 0.0)
    progress.faulted(4, lost=False)
    progress.line_started(6, 1.0)
    assert progress.done == 5


def test_a_report_holds_times_and_the_limit_that_stretched_the_line() -> None:
    progress = LineProgress(1)
    progress.planned([Report(ReportKind.PLANNED, 1, requested_s=1.0)])
    progress.planned([Report(ReportKind.BOUND, 1, bound_by="axis 2 acceleration")])
    progress.line_started(1, 10.0)
    progress.line_ended(1, 11.5)
    progress.passed(1)
    (report,) = progress.take_ended()
    assert (report.start_s, report.end_s, report.requested_s) == (10.0, 11.5, 1.0)
    assert (report.stretched_by, report.bound_by) == (1.5, "axis 2 acceleration")
    assert progress.take_ended() == []


def test_a_line_without_a_requested_time_has_no_stretch() -> None:
    progress = LineProgress(1)
    progress.line_started(1, 0.0)
    progress.line_ended(1, 2.0)
    progress.passed(1)
    (report,) = progress.take_ended()
    assert (report.requested_s, report.stretched_by) == (None, None)


def test_hours_of_lines_keep_memory_flat() -> None:
    progress = LineProgress(1)
    for line in range(1, 20_001):
        progress.planned(planned(line))
        progress.line_started(line, float(line))
        progress.line_ended(line, line + 0.5)
        progress.take_ended()
    assert progress.done == 19_999
    progress.passed(20_000)
    progress.take_ended()
    assert sum(len(kept) for kept in vars(progress).values() if hasattr(kept, "__len__")) == 0
