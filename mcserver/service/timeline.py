"""When each line of a program ends, as it was simulated, and so how long a run still takes."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from itertools import accumulate
from typing import Any

# an override of 0 would make the time left infinite
LEAST_OVERRIDE = 0.01


class Timeline:
    """Times of a whole program at 100 %.

    Args:
        report: the answer of the method ``simulate``, ``ok`` true.

    Attributes:
        duration_s: of the whole program [s]. size: how many lines it has times of.
    """

    def __init__(self, report: Mapping[str, Any]) -> None:
        timed = sorted(
            (int(each["line"]), float(each["start_s"]), float(each["end_s"])) for each in report["lines"]
        )
        self._lines = [line for line, _, _ in timed]
        self._starts = [start for _, start, _ in timed]
        self._ends = list(accumulate((end for _, _, end in timed), max))
        self.duration_s = float(report["duration_s"])
        self.size = len(timed)

    def remaining_s(self, done: int, in_line_s: float = 0.0) -> float:
        """Return the time from here to the program's end at 100 % [s].

        Args:
            done: the last line of which all before it, and itself, have ended.
            in_line_s: for how long the lines behind it have run since then [s], at 100 %.
        """
        behind = bisect_right(self._lines, done)
        reached = self._ends[behind - 1] if behind else 0.0
        # a line that takes longer than it was simulated keeps the time at its end
        limit = self._ends[behind] if behind < len(self._ends) else self.duration_s
        return max(0.0, self.duration_s - min(reached + in_line_s, max(limit, reached)))

    def start_of(self, line: int) -> float:
        """Return when the first timed line from ``line`` on begins [s]."""
        at = bisect_left(self._lines, line)
        return self._starts[at] if at < len(self._starts) else self.duration_s


class RunClock:
    """Follows a run along its timeline: time passes while lines run, at the rate of the override.

    It follows the run from its beginning, also before the timeline is there: a line may last for minutes.

    Args:
        first: number of the first line that runs.
    """

    def __init__(self, first: int, timeline: Timeline | None = None) -> None:
        self._first = first
        self._timeline = timeline
        self._done = first - 1
        self._in_line_s = 0.0
        self._seen_at: float | None = None

    def simulated(self, timeline: Timeline) -> None:
        """Take the times of the whole program."""
        self._timeline = timeline

    @property
    def total_s(self) -> float | None:
        """Return the duration of the run at 100 % [s]; None: not known yet."""
        if self._timeline is None:
            return None
        return self._timeline.duration_s - self._timeline.start_of(self._first)

    def observe(
        self, now: float, done: int, override: float, *, running: bool, done_at: float | None = None
    ) -> float | None:
        """Note how far the run is; return the time until its end at this override [s], None: not known yet.

        Args:
            now: a clock [s]. done: the last line that has ended. override: 1 is 100 %.
            running: False while it is held, paused or queued, and before its first line.
            done_at: when the line ``done`` ended, by the same clock; None: just now.
        """
        seen_at = now if self._seen_at is None else self._seen_at
        self._seen_at = now
        if done > self._done:
            self._done, self._in_line_s = done, 0.0
            seen_at = now if done_at is None else max(seen_at, done_at)
        if running:
            self._in_line_s += max(0.0, now - seen_at) * override
        remaining = self.remaining_s()
        return None if remaining is None else remaining / max(override, LEAST_OVERRIDE)

    def remaining_s(self) -> float | None:
        """Return the time until the end at 100 % [s]; None: not known yet."""
        return None if self._timeline is None else self._timeline.remaining_s(self._done, self._in_line_s)

    def fraction(self) -> float | None:
        """Return the share of the run's time that has passed; None: not known yet."""
        total, remaining = self.total_s, self.remaining_s()
        if total is None or remaining is None:
            return None
        return 1.0 if total <= 0.0 else min(1.0, max(0.0, 1.0 - remaining / total))
