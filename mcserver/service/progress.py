"""How far a program has come: which lines run, which have ended, and their times."""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Iterable
from typing import Protocol

from mcserver.service.reports import LineReport


class PlannedTime(Protocol):
    """What planning says about a line; later reports of a line complete earlier ones."""

    @property
    def kind(self) -> enum.Enum: ...
    @property
    def line(self) -> int: ...
    @property
    def requested_s(self) -> float | None: ...
    @property
    def bound_by(self) -> str | None: ...


class LineProgress:
    """Of one program.

    Attributes:
        started: the last line that has begun, 0 before.
        done: every line through this one has ended or needed no time.
        ended_at: when a line last ended, executor time [s]; None: none has.

    Args:
        start_line: the first line that runs.
    """

    def __init__(self, start_line: int) -> None:
        self.started = 0
        self.done = start_line - 1
        self.ended_at: float | None = None
        self._planned_through = start_line - 1
        self._requested: dict[int, float] = {}
        self._bound_by: dict[int, str] = {}
        self._running: dict[int, float] = {}
        # lines that will report their end, in order, and how many reports each still owes
        self._open: deque[int] = deque()
        self._owed: dict[int, int] = {}
        self._ended: list[LineReport] = []

    def planned(self, reports: Iterable[PlannedTime]) -> None:
        """Takes what planning found; each report ``planned`` will be followed by an end of its line."""
        for report in reports:
            if report.kind.value == "planned":
                self._expect(report.line)
            if report.requested_s is not None:
                self._requested[report.line] = report.requested_s
            if report.bound_by is not None:
                self._bound_by[report.line] = report.bound_by
            elif report.kind.value == "bound":
                # planned anew, and no limit stretches it now
                self._bound_by.pop(report.line, None)

    def planned_through(self, line: int) -> None:
        """All lines through ``line`` are planned: those not named in `planned` need no time."""
        self._planned_through = max(self._planned_through, line)
        self._advance()

    def line_started(self, line: int, time_s: float) -> None:
        self.started = max(self.started, line)
        self._running[line] = time_s

    def line_ended(self, line: int, time_s: float) -> None:
        """The line's report is in the next `take_ended`."""
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
        self.ended(line)

    def ended(self, line: int) -> None:
        """One of the things that the line does has ended."""
        if line in self._owed:
            self._owed[line] -= 1
        self._advance()

    def finished(self, through: int) -> None:
        """The program has ended by itself: whatever it took is done."""
        self._open.clear()
        self._owed.clear()
        self.done = max(self.done, through)

    def take_ended(self) -> list[LineReport]:
        """Reports of the lines that ended since the last call, in order."""
        ended, self._ended = self._ended, []
        return ended

    def _expect(self, line: int) -> None:
        if line in self._owed:
            self._owed[line] += 1
        elif line > self.done:
            self._open.append(line)
            self._owed[line] = 1

    def _advance(self) -> None:
        while self._open and self._owed[self._open[0]] <= 0:
            del self._owed[self._open.popleft()]
        through = self._open[0] - 1 if self._open else self._planned_through
        self.done = max(self.done, min(through, self._planned_through))
