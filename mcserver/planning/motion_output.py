"""What a program's pipeline has ready for the executor: rows and control entries, waiting for room in
the rings."""

from __future__ import annotations

import math
from collections import deque
from itertools import islice, takewhile

from mcserver.executor.entries import Control, MotionSink
from mcserver.motion.profile.setpoint_sampling import CYCLE_ROUNDING, Rows


class Output:
    """Keeps the order between rows and control entries while the rings have no room.

    Control entries at u must be in the ring before the row that is played at u. Both come here in order of u,
    entries ahead of the rows that they lie between, so that many rows can be handed over in one go: with them
    go the entries up to the last of them, or as many rows as there is room for entries. ``last_u`` is where
    what has been handed over ends. The pipeline stops planning while anything waits here, so what waits is
    bounded by one piece of a plan.
    """

    def __init__(self, sink: MotionSink) -> None:
        self._sink = sink
        self._controls: deque[Control] = deque()
        self._rows: deque[Rows] = deque()
        self.last_u = 0.0

    def put(self, entry: Control | Rows) -> None:
        if isinstance(entry, Control):
            self._controls.append(entry)
        else:
            self._rows.append(entry)

    @property
    def blocked(self) -> bool:
        """Whether something still waits for room."""
        return bool(self._rows or self._controls)

    def drop(self) -> None:
        """Forgets what waits: the program was aborted."""
        self._controls.clear()
        self._rows.clear()

    def flush(self) -> bool:
        """Hand over what fits; True if anything moved."""
        moved = False
        while self._rows:
            rows = self._rows[0]
            count = min(self._sink.row_room(), len(rows.line))
            if count < 1:
                break
            room = self._sink.control_room()
            entries = self._entries_before(rows.first + count, room + 1)
            if entries > room:
                # no room for an entry: the rows that come before it may go
                entries = room
                until = math.floor(self._controls[room].u + CYCLE_ROUNDING) + 1
                count = max(0, min(count, until - rows.first))
            moved |= self._put_controls(entries, count)
            if count < 1:
                return moved
            part = _head(rows, count)
            self._sink.put_rows(part.first, part.position, part.velocity, part.axes, part.line, part.torque)
            self.last_u = max(self.last_u, part.first + count - 1)
            moved = True
            if count < len(rows.line):
                self._rows[0] = _tail(rows, count)
                return moved
            self._rows.popleft()
        if not self._rows:
            moved |= self._put_controls(min(len(self._controls), self._sink.control_room()), 0)
        return moved

    def _entries_before(self, u: float, most: int) -> int:
        """Return how many entries come before u, up to ``most``."""
        return sum(1 for _ in takewhile(lambda each: each.u < u, islice(self._controls, most)))

    def _put_controls(self, count: int, rows: int) -> bool:
        """Hand over the next entries, with which ``rows`` rows come; True if there was one."""
        for _ in range(count):
            control = self._controls.popleft()
            self._sink.put_control(control, rows)
            if not self._rows:
                self.last_u = max(self.last_u, control.u)
        return count > 0


def _head(rows: Rows, count: int) -> Rows:
    return Rows(
        rows.first,
        rows.position[:count],
        rows.velocity[:count],
        rows.axes[:count],
        rows.line[:count],
        None if rows.torque is None else rows.torque[:count],
    )


def _tail(rows: Rows, count: int) -> Rows:
    return Rows(
        rows.first + count,
        rows.position[count:],
        rows.velocity[count:],
        rows.axes[count:],
        rows.line[count:],
        None if rows.torque is None else rows.torque[count:],
    )
