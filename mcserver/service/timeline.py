"""How long a run still takes, by the times of its lines as they were simulated."""

from __future__ import annotations

from bisect import bisect_right

from mcserver.planning.line_marks import LineMarks

# an override of 0 would make the time left infinite
LEAST_OVERRIDE = 0.01


class Timeline:
    """Times of a whole program at 100 %.

    Args:
        marks: of its simulation. total: how many lines it has; where the simulation is still under way the
            lines to come count as quick as those before.

    Attributes:
        duration_s: of the whole program [s]. simulated: share of its lines that the simulation has reached;
            1: the times are those of the simulation, not estimated.
    """

    def __init__(self, marks: LineMarks, total: int | None = None) -> None:
        self._marks = marks if total is None else marks.stretched_to(total)
        self.duration_s = self._marks.duration_s
        self.simulated = 1.0 if marks.complete or not total else min(1.0, marks.through / total)

    def remaining_s(self, done: int, in_line_s: float = 0.0, override: float = 1.0) -> float:
        """Return the time from here to the program's end at an override [s].

        Args:
            done: the last line of which all before it, and itself, have ended.
            in_line_s: for how long the lines behind it have run since then [s], at 100 %.
            override: 1 is 100 %; dwells take their time whatever it is.
        """
        reached = self._marks.end_of(done)
        # a line that takes longer than it was simulated keeps the time at its end
        passed = min(in_line_s, max(self._marks.next_end(done), reached) - reached)
        left = max(0.0, self.duration_s - reached - passed)
        dwells = self._marks.dwells[-1] - self._marks.dwell_of(done) - self.dwelling(done) * passed
        dwells = min(max(0.0, dwells), left)
        return dwells + (left - dwells) / max(override, LEAST_OVERRIDE)

    def dwelling(self, done: int) -> float:
        """Return which share of the time of the next line that takes any is dwell, 0 … 1."""
        following = self._marks.next_line(done)
        if following is None:
            return 0.0
        lasts = self._marks.end_of(following) - self._marks.end_of(done)
        dwells = self._marks.dwell_of(following) - self._marks.dwell_of(done)
        return min(1.0, max(0.0, dwells / lasts)) if lasts > 0.0 else 0.0

    def start_of(self, line: int) -> float:
        """Return when the lines from ``line`` on begin [s]."""
        return self._marks.end_of(line - 1)

    def pauses_behind(self, line: int) -> int:
        """Count the pauses behind a line, such as M0, whose waiting is no part of the times."""
        return len(self._marks.pauses) - bisect_right(self._marks.pauses, line)


class RunClock:
    """Follows a run along its timeline: time passes while lines run, at the override's rate but in dwells.

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

    def foresee(self, timeline: Timeline) -> None:
        """Take the times of the whole program."""
        self._timeline = timeline

    @property
    def total_s(self) -> float | None:
        """Return the duration of the run at 100 % [s]; None: not known yet."""
        if self._timeline is None:
            return None
        return self._timeline.duration_s - self._timeline.start_of(self._first)

    @property
    def simulated(self) -> float:
        """Return the share of the program's lines that its simulation has reached; 1 without one."""
        return 1.0 if self._timeline is None else self._timeline.simulated

    @property
    def pauses(self) -> int:
        """Return how many pauses are known to come."""
        return 0 if self._timeline is None else self._timeline.pauses_behind(self._done)

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
            rate = override
            if self._timeline is not None and override > 0.0:
                dwells = self._timeline.dwelling(self._done)
                rate = 1.0 / (dwells + (1.0 - dwells) / override)
            self._in_line_s += max(0.0, now - seen_at) * rate
        return self.remaining_s(override)

    def remaining_s(self, override: float = 1.0) -> float | None:
        """Return the time until the end at an override [s]; None: not known yet."""
        if self._timeline is None:
            return None
        return self._timeline.remaining_s(self._done, self._in_line_s, override)

    def fraction(self) -> float | None:
        """Return the share of the run's time that has passed; None: not known yet."""
        total, remaining = self.total_s, self.remaining_s()
        if total is None or remaining is None:
            return None
        return 1.0 if total <= 0.0 else min(1.0, max(0.0, 1.0 - remaining / total))
