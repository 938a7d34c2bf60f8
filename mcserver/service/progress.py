"""How far a program has come: which lines run, which have ended, and their times."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mcserver.planning.planner_messages import Report, ReportKind
from mcserver.service.reports import LineReport


@dataclass(slots=True)
class _LineRun:
    """A line that has begun and is not known to be over: a canned cycle or a block has parts.

    Attributes:
        start_s: of its first part. part_s: of its newest part. end_s: of the newest part that has ended.
        parts: how many have begun. moves: the newest has not ended.
    """

    start_s: float
    part_s: float
    end_s: float
    parts: int = 1
    moves: bool = True


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
        # what the parts of lines ask for together [s], and of how many that is known
        self._requested: dict[int, tuple[float, int]] = {}
        self._bound_by: dict[int, str] = {}
        self._running: dict[int, _LineRun] = {}
        self._ended: list[LineReport] = []

    def planned(self, reports: Iterable[Report]) -> None:
        """Take what planning found; later reports of a line complete earlier ones."""
        for report in reports:
            if report.requested_s is not None:
                asked, parts = self._requested.get(report.line, (0.0, 0))
                self._requested[report.line] = asked + report.requested_s, parts + 1
            if report.bound_by is not None:
                self._bound_by[report.line] = report.bound_by
            elif report.kind is ReportKind.BOUND:
                # planned anew, and no limit stretches it now
                self._bound_by.pop(report.line, None)

    def line_started(self, line: int, time_s: float) -> None:
        """Note that a line, or a further part of it, begins: those before it have ended."""
        self.started = max(self.started, line)
        run = self._running.get(line)
        if run is None:
            self._running[line] = _LineRun(time_s, time_s, time_s)
        else:
            run.part_s, run.moves, run.parts = time_s, True, run.parts + 1
        self.passed(line - 1)

    def line_ended(self, line: int, time_s: float) -> float:
        """Note the end of a part of a line, and return the start of that part.

        The line itself has ended once it is done: then its report is in the next `take_ended`.
        """
        # also where the event of its beginning was lost, with a planner that was killed
        run = self._running.setdefault(line, _LineRun(time_s, time_s, time_s))
        run.end_s, run.moves = time_s, False
        self.ended_at = time_s
        self.passed(line - 1)
        return run.part_s

    def passed(self, through: int) -> None:
        """Note that this line and every one before it have ended."""
        if self._broken:
            return
        self.done = max(self.done, through)
        # a line may still move where the next one has begun: comma groups end when they end
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
