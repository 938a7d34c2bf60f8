"""For how long each tool has cut: the lines of a program by the tool that is fitted."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from mcserver.gcode.profiles.frame import Frame
from mcserver.planning.planner_messages import Report

# lines planned ahead whose ends were lost: forgotten when there are more
MOST_AHEAD = 1 << 16


class ToolUse:
    """Follow one program: a tool cuts in G01 to G03 and thread passes while M3 or M4 has the spindle turn.

    Rapids, dwells, holds and what moves with the spindle at rest do not count. Times are of the executor [s].
    """

    def __init__(self) -> None:
        # from which line on which tool cuts; 0: none does
        self._cutting: deque[tuple[int, int]] = deque([(0, 0)])
        # by line, how often it is planned at a feed and has not ended
        self._feeds: Counter[int] = Counter()
        self._counted_to = 0.0
        self._held_from: float | None = None
        self._held_s = 0.0

    def behind(self, line: int, frame: Frame) -> None:
        """Take the frame that a line leaves; lines come in order."""
        tool = frame.changed or 0 if frame.direction else 0
        if self._cutting[-1][1] != tool:
            self._cutting.append((line, tool))

    def planned(self, reports: Iterable[Report]) -> None:
        """Take what planning found."""
        for report in reports:
            if report.feed_length > 0.0:
                self._feeds[report.line] += 1
        if len(self._feeds) > MOST_AHEAD:
            self._feeds = Counter(dict(list(self._feeds.items())[MOST_AHEAD // 2 :]))

    def held(self, time_s: float) -> None:
        """Note that the motion is held; the line under way does not count until `released`."""
        if self._held_from is None:
            self._held_from = time_s

    def released(self, time_s: float) -> None:
        """Note the end of a hold."""
        if self._held_from is not None:
            self._held_s += time_s - self._held_from
            self._held_from = None

    def ended(self, line: int, start_s: float, end_s: float) -> tuple[int, float]:
        """Return which tool a line that has ended has cut with, 0: none, and for how long [s]."""
        while len(self._cutting) > 1 and self._cutting[1][0] <= line:
            self._cutting.popleft()
        # lines that flow into each other overlap
        seconds = max(0.0, end_s - max(start_s, self._counted_to) - self._held_s)
        self._counted_to, self._held_s = end_s, 0.0
        feeds = self._feeds.get(line, 0)
        if feeds > 1:
            self._feeds[line] = feeds - 1
        else:
            self._feeds.pop(line, None)
        return (self._cutting[0][1] if feeds else 0), seconds
