"""What a program's pipeline has ready for the executor: rows and control entries, waiting for room in
the rings."""

from __future__ import annotations

from collections import deque

from mcserver.executor.entries import Control, MotionSink
from mcserver.motion.sampling import Rows


class Output:
    """Keeps the order between rows and control entries while the rings have no room.

    Control entries at u must be in the ring before the row that is played at u, so each is put when its
    turn comes. ``last_u`` is where what has been handed over ends. The pipeline stops planning while
    anything waits here, so what waits is bounded by one piece of a plan.
    """

    def __init__(self, sink: MotionSink) -> None:
        self._sink = sink
        self._waiting: deque[Control | Rows] = deque()
        self.last_u = 0.0

    def put(self, entry: Control | Rows) -> None:
        self._waiting.append(entry)

    @property
    def blocked(self) -> bool:
        """Whether something still waits for room."""
        return bool(self._waiting)

    def drop(self) -> None:
        """Forgets what waits: the program was aborted."""
        self._waiting.clear()

    def flush(self) -> bool:
        """Hands over what fits; True if anything moved."""
        moved = False
        while self._waiting:
            entry = self._waiting[0]
            if isinstance(entry, Control):
                if self._sink.control_room() < 1:
                    break
                self._sink.put_control(entry)
                self.last_u = max(self.last_u, entry.u)
                self._waiting.popleft()
                moved = True
                continue
            count = min(self._sink.row_room(), len(entry.line))
            if count < 1:
                break
            part = _head(entry, count)
            self._sink.put_rows(part.first, part.position, part.velocity, part.axes, part.line)
            self.last_u = max(self.last_u, part.first + count - 1)
            moved = True
            if count < len(entry.line):
                self._waiting[0] = _tail(entry, count)
                break
            self._waiting.popleft()
        return moved


def _head(rows: Rows, count: int) -> Rows:
    return Rows(
        rows.first, rows.position[:count], rows.velocity[:count], rows.axes[:count], rows.line[:count]
    )


def _tail(rows: Rows, count: int) -> Rows:
    return Rows(
        rows.first + count, rows.position[count:], rows.velocity[count:], rows.axes[count:], rows.line[count:]
    )
