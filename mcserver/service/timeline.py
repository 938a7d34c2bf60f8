"""Compute the remaining time of a run from the simulated times of its lines."""

from __future__ import annotations

from bisect import bisect_right

from mcserver.planning.line_marks import LineMarks

# bounds the remaining time at an override of 0
LEAST_OVERRIDE = 0.01


class Timeline:
    """Times of a whole program at 100 %.

    Args:
        marks: of its simulation. total: count of its lines; during the simulation, further lines are assumed
            to be as fast as those before.

    Attributes:
        duration_s: of the whole program [s]. simulated: share of its lines that the simulation has reached;
            1: the times are not estimated.
    """

    def __init__(self, marks: LineMarks, total: int | None = None) -> None:
        self._marks = marks if total is None else marks.stretched_to(total)
        self.duration_s = self._marks.duration_s
        self.simulated = 1.0 if marks.complete or not total else min(1.0, marks.through / total)

    def remaining_s(self, done: int, in_line_s: float = 0.0, override: float = 1.0) -> float:
        """Return the time from here to the program's end at an override [s].

        Args:
            done: last line that has ended, with all before it.
            in_line_s: time for which the lines after it have run since then [s], at 100 %.
            override: 1 is 100 %; it does not affect dwells.
        """
        reached = self._marks.end_of(done)
        # a line that takes longer than simulated stays at its simulated end
        passed = min(in_line_s, max(self._marks.next_end(done), reached) - reached)
        left = max(0.0, self.duration_s - reached - passed)
        dwells = self._marks.dwells[-1] - self._marks.dwell_of(done) - self.dwelling(done) * passed
        dwells = min(max(0.0, dwells), left)
        return dwells + (left - dwells) / max(override, LEAST_OVERRIDE)

    def dwelling(self, done: int) -> float:
        """Return the share of dwell in the next line that takes time, 0 … 1."""
        following = self._marks.next_line(done)
        if following is None:
            return 0.0
        lasts = self._marks.end_of(following) - self._marks.end_of(done)
        dwells = self._marks.dwell_of(following) - self._marks.dwell_of(done)
        return min(1.0, max(0.0, dwells / lasts)) if lasts > 0.0 else 0.0

    def start_of(self, line: int) -> float:
        """Return when line ``line`` begins [s]."""
        return self._marks.end_of(line - 1)

    def pauses_behind(self, line: int) -> int:
        """Count the pauses after a line, such as M0, whose waits are not part of the times."""
        return len(self._marks.pauses) - bisect_right(self._marks.pauses, line)


class RunClock:
    """Follows a run along its timeline: time advances while lines run, scaled by the override but in dwells.

    It also follows before the timeline is known, since a line may last for minutes.

    Args:
        first: number of the first line that runs.
    """

    def __init__(self, first: int, timeline: Timeline | None = None) -> None:
        self._first = first
        self._timeline = timeline
        self._done = first - 1
        self._in_line_s = 0.0
        self._seen_at: float | None = None

    def foresee(self, timeline: Timeline) -> None:
        """Set the times of the whole program."""
        self._timeline = timeline

    @property
    def total_s(self) -> float | None:
        """Duration of the run at 100 % [s]; None: unknown."""
        if self._timeline is None:
            return None
        return self._timeline.duration_s - self._timeline.start_of(self._first)

    @property
    def simulated(self) -> float:
        """Share of the program's lines that its simulation has reached; 1 without one."""
        return 1.0 if self._timeline is None else self._timeline.simulated

    @property
    def pauses(self) -> int:
        """Known count of pauses to come."""
        return 0 if self._timeline is None else self._timeline.pauses_behind(self._done)

    def observe(
        self, now: float, done: int, override: float, *, running: bool, done_at: float | None = None
    ) -> float | None:
        """Update the progress; return the time until the end at this override [s], None: unknown.

        Args:
            now: a clock [s]. done: last line that has ended. override: 1 is 100 %.
            running: False while it is held, paused or queued, and before its first line.
            done_at: when line ``done`` ended, by the same clock; None: just now.
        """
        seen_at = now if self._seen_at is None else self._seen_at
        self._seen_at = now
        if done > self._done:
            self._done, self._in_line_s = done, 0.0
            seen_at = now if done_at is None else max(seen_at, done_at)
        if running:
            rate = override
            if self._timeline is not None and override > 0.0:
                dwells = self._timeline.dwelling(self._done)
                rate = 1.0 / (dwells + (1.0 - dwells) / override)
            self._in_line_s += max(0.0, now - seen_at) * rate
        return self.remaining_s(override)

    def remaining_s(self, override: float = 1.0) -> float | None:
        """Return the time until the end at an override [s]; None: unknown."""
        if self._timeline is None:
            return None
        return self._timeline.remaining_s(self._done, self._in_line_s, override)

    def fraction(self) -> float | None:
        """Return the share of the run's time that has passed; None: unknown."""
        total, remaining = self.total_s, self.remaining_s()
        if total is None or remaining is None:
            return None
        return 1.0 if total <= 0.0 else min(1.0, max(0.0, 1.0 - remaining / total))
