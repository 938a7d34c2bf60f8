"""Track how far a program has come: running lines, ended lines, and their times."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mcserver.planning.planner_messages import Report, ReportKind
from mcserver.service.reports import LineReport


@dataclass(slots=True)
class _LineRun:
    """A line that has begun and may not have ended: a canned cycle or a block has several parts.

    Attributes:
        start_s, part_s: starts of its first and newest part. end_s: of the newest part that has ended.
        parts: count that have begun. moves: the newest has not ended.
    """

    start_s: float
    part_s: float
    end_s: float
    parts: int = 1
    moves: bool = True


class LineProgress:
    """Tracks one program by what the executor has passed; planned motion does not count.

    The executor passes the lines of a program in order. So when a line begins, all before it have ended; the
    line itself has ended when the next one begins, at a mark after it (`ControlKind.PASSED`), or at the
    program's end.

    Attributes:
        started: the last line that has begun, 0 before.
        done: this line and all before it have ended.
        ended_at: when a line last ended, executor time [s]; None: none has.

    Args:
        start_line: first line that runs.
    """

    def __init__(self, start_line: int) -> None:
        self.started = 0
        self.done = start_line - 1
        self.ended_at: float | None = None
        # an axis has failed: lines that the others still pass are not complete
        self._broken = False
        # by line: sum of the requested times of its parts [s], and count of parts that have one
        self._requested: dict[int, tuple[float, int]] = {}
        self._bound_by: dict[int, str] = {}
        self._running: dict[int, _LineRun] = {}
        self._ended: list[LineReport] = []

    def planned(self, reports: Iterable[Report]) -> None:
        """Store reports of the planner; later reports of a line complete earlier ones."""
        for report in reports:
            if report.requested_s is not None:
                asked, parts = self._requested.get(report.line, (0.0, 0))
                self._requested[report.line] = asked + report.requested_s, parts + 1
            if report.bound_by is not None:
                self._bound_by[report.line] = report.bound_by
            elif report.kind is ReportKind.BOUND:
                # planned again, now without a limit that stretches it
                self._bound_by.pop(report.line, None)

    def line_started(self, line: int, time_s: float) -> None:
        """Note that a line, or another part of it, begins; those before it have ended."""
        self.started = max(self.started, line)
        run = self._running.get(line)
        if run is None:
            self._running[line] = _LineRun(time_s, time_s, time_s)
        else:
            run.part_s, run.moves, run.parts = time_s, True, run.parts + 1
        self.passed(line - 1)

    def line_ended(self, line: int, time_s: float) -> float:
        """Note the end of a part of a line, and return that part's start.

        The line has ended once it is done: then its report is in the next `take_ended`.
        """
        # also if the event of its beginning was lost with a killed planner
        run = self._running.setdefault(line, _LineRun(time_s, time_s, time_s))
        run.end_s, run.moves = time_s, False
        self.ended_at = time_s
        self.passed(line - 1)
        return run.part_s

    def passed(self, through: int) -> None:
        """Note that this line and all before it have ended."""
        if self._broken:
            return
        self.done = max(self.done, through)
        # a line may still move when the next one has begun: comma groups end separately
        for line in [line for line, run in self._running.items() if line <= self.done and not run.moves]:
            self._report(line, self._running.pop(line))

    def _report(self, line: int, run: _LineRun) -> None:
        asked, parts = self._requested.pop(line, (0.0, 0))
        requested = asked if parts and parts >= run.parts else None
        self._ended.append(
            LineReport(
                line=line,
                start_s=run.start_s,
                end_s=run.end_s,
                requested_s=requested,
                stretched_by=(run.end_s - run.start_s) / requested if requested else None,
                bound_by=self._bound_by.pop(line, None),
            )
        )

    def faulted(self, line: int, *, lost: bool) -> None:
        """Note a fault at a line, which is then not done; 0: between lines.

        Args:
            lost: an axis of the program no longer takes part.
        """
        if line > 0:
            self.done = min(self.done, line - 1)
        self._broken |= lost

    @property
    def any_ended(self) -> bool:
        """Whether `take_ended` has reports."""
        return bool(self._ended)

    def take_ended(self) -> list[LineReport]:
        """Return reports of the lines that ended since the last call, in order."""
        ended, self._ended = self._ended, []
        return ended
