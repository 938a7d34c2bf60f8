"""Count each tool's cutting time: from the lines of a program, by the fitted tool."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from mcserver.gcode.profiles.frame import Frame
from mcserver.planning.planner_messages import Report

# most planned lines without an end, whose events may be lost: all are dropped when there are more
MOST_AHEAD = 1 << 16


class ToolUse:
    """Tracks one program: a tool cuts in G01 to G03 and thread passes while the spindle turns by M3 or M4.

    Rapids, dwells, holds and motion with the spindle at rest do not count. Times are of the executor [s].
    """

    def __init__(self) -> None:
        # from which line on which tool cuts; 0: none
        self._cutting: deque[tuple[int, int]] = deque([(0, 0)])
        # by line: count of planned feed moves that have not ended
        self._feeds: Counter[int] = Counter()
        self._counted_to = 0.0
        self._held_from: float | None = None
        self._held_s = 0.0

    def behind(self, line: int, frame: Frame) -> None:
        """Note the frame after a line; lines come in order."""
        tool = frame.changed or 0 if frame.direction else 0
        if self._cutting[-1][1] != tool:
            self._cutting.append((line, tool))

    def planned(self, reports: Iterable[Report]) -> None:
        """Store reports of the planner."""
        for report in reports:
            if report.feed_length > 0.0:
                self._feeds[report.line] += 1
        if len(self._feeds) > MOST_AHEAD:
            self._feeds = Counter(dict(list(self._feeds.items())[MOST_AHEAD // 2 :]))

    def held(self, time_s: float) -> None:
        """Note a feed hold; the present line does not count until `released`."""
        if self._held_from is None:
            self._held_from = time_s

    def released(self, time_s: float) -> None:
        """Note the end of a hold."""
        if self._held_from is not None:
            self._held_s += time_s - self._held_from
            self._held_from = None

    def ended(self, line: int, start_s: float, end_s: float) -> tuple[int, float]:
        """Return the tool with which an ended line has cut, 0: none, and its cutting time [s]."""
        while len(self._cutting) > 1 and self._cutting[1][0] <= line:
            self._cutting.popleft()
        # blended lines overlap in time
        seconds = max(0.0, end_s - max(start_s, self._counted_to) - self._held_s)
        self._counted_to, self._held_s = end_s, 0.0
        feeds = self._feeds.get(line, 0)
        if feeds > 1:
            self._feeds[line] = feeds - 1
        else:
            self._feeds.pop(line, None)
        return (self._cutting[0][1] if feeds else 0), seconds
