"""How far a program has come: which lines run, which have ended, and their times."""

from __future__ import annotations

from collections.abc import Iterable

from mcserver.planning.planner_messages import Report, ReportKind
from mcserver.service.reports import LineReport


class LineProgress:
    """Follow one program by what the executor has passed; nothing that was only planned counts.

    The executor passes the lines of a program in order. So all before a line have ended when it begins, and
    it has when the next one begins, at a mark behind it (`ControlKind.PASSED`), or at the program's end.

    Attributes:
        started: the last line that has begun, 0 before.
        done: this line and every one before it have ended.
        ended_at: when a line last ended, executor time [s]; None: none has.

    Args:
        start_line: the first line that runs.
    """

    def __init__(self, start_line: int) -> None:
        self.started = 0
        self.done = start_line - 1
        self.ended_at: float | None = None
        # an axis has failed: what the others still pass is no whole line any more
        self._broken = False
        self._requested: dict[int, float] = {}
        self._bound_by: dict[int, str] = {}
        self._running: dict[int, float] = {}
        self._ended: list[LineReport] = []

    def planned(self, reports: Iterable[Report]) -> None:
        """Take what planning found; later reports of a line complete earlier ones."""
        for report in reports:
            if report.requested_s is not None:
                self._requested[report.line] = report.requested_s
            if report.bound_by is not None:
                self._bound_by[report.line] = report.bound_by
            elif report.kind is ReportKind.BOUND:
                # planned anew, and no limit stretches it now
                self._bound_by.pop(report.line, None)

    def line_started(self, line: int, time_s: float) -> None:
        """Note that a line begins: those before it have ended."""
        self.started = max(self.started, line)
        self._running[line] = time_s
        self.passed(line - 1)

    def line_ended(self, line: int, time_s: float) -> float:
        """Note the end of a line's motion and return its start; its report is in the next `take_ended`."""
        start = self._running.pop(line, time_s)
        requested = self._requested.pop(line, None)
        actual = time_s - start
        self._ended.append(
            LineReport(
                line=line,
                start_s=start,
                end_s=time_s,
                requested_s=requested,
                stretched_by=actual / requested if requested else None,
                bound_by=self._bound_by.pop(line, None),
            )
        )
        self.ended_at = time_s
        # also where the event of its beginning was lost, with a planner that was killed
        self.passed(line - 1)
        return start

    def passed(self, through: int) -> None:
        """Note that this line and every one before it have ended."""
        if not self._broken:
            self.done = max(self.done, through)

    def faulted(self, line: int, *, lost: bool) -> None:
        """Note a fault at a line, which is not done; 0: between lines.

        Args:
            lost: an axis of the program takes no part any more.
        """
        if line > 0:
            self.done = min(self.done, line - 1)
        self._broken |= lost

    @property
    def any_ended(self) -> bool:
        """Whether `take_ended` has reports."""
        return bool(self._ended)

    def take_ended(self) -> list[LineReport]:
        """Reports of the lines that ended since the last call, in order."""
        ended, self._ended = self._ended, []
        return ended
