"""The output queue of a pipeline: rows and control entries that wait for room in the executor's rings."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from mcserver.executor.entries import Control, ControlKind
from mcserver.executor.shm.rings import ProgramRing
from mcserver.motion.lookahead.setpoint_sampling import CYCLE_ROUNDING
from mcserver.motion.pieces import Deactivation, LineEdges, Piece, Rows
from mcserver.planning.clearance_guard import ClearanceGuard

# Token of the report that the executor has reached the end of motion before a contact; others are above 0.
LAST_TOKEN = 0


class Output:
    """Keeps the order between rows and control entries while the rings have no room.

    Control entries at u must be in the ring before the row that is played at u. Both are put here in order of
    u, entries ahead of the rows that they lie between, so that many rows can be handed over at once, together
    with the entries before the last of them; fewer rows where there is no room for these entries. ``last_u``
    is the end of what has been handed over. The pipeline stops planning while anything waits here, so at most
    one piece of a plan waits.

    Args:
        guard: says how much may be handed over; None: all. Nothing after a contact is handed over, and the
            executor reports `LAST_TOKEN` once it stands before it. While another program is waited for,
            output is kept back: the executor comes to rest on the rows that it has.
    """

    def __init__(self, sink: ProgramRing, guard: ClearanceGuard | None = None) -> None:
        self._sink = sink
        self._guard = guard
        # u of the last row that was put here
        self._row_u = -math.inf
        self._controls: deque[Control | LineEdges] = deque()
        self._waiting = 0
        self._rows: deque[Rows] = deque()
        # output that waits for another program, and all that follows it
        self._kept: deque[Control | LineEdges | Rows] = deque()
        self.last_u = 0.0

    def put(self, entry: Control | LineEdges | Rows) -> None:
        guard = self._guard
        if self._kept:
            self._kept.append(entry)
            return
        if guard is not None:
            if guard.contact is not None:
                return
            if isinstance(entry, Rows):
                count = guard.admit_rows(entry)
                if guard.waiting.fault is not None:
                    self._kept.append(entry.part(count, len(entry)))
                    entry = entry.part(0, count)
                elif count < len(entry):
                    self._end_before(entry, count)
                    return
                if not count:
                    return
                self._row_u = entry.first + count - 1
            elif isinstance(entry, Control) and not guard.admit_control(entry):
                if guard.waiting.fault is not None:
                    self._kept.append(entry)
                    return
                self._queue(Control(ControlKind.SETTLE, entry.u, entry.line, token=LAST_TOKEN))
                return
        self._queue(entry)

    def _put_kept(self) -> None:
        """Queue output that has waited for another program, as far as that has left."""
        if not self._kept or self._guard is None or not self._guard.waiting.due:
            return
        kept, self._kept = self._kept, deque()
        for entry in kept:
            self.put(entry)

    def _end_before(self, rows: Rows, count: int) -> None:
        """Queue the first ``count`` rows and the entries before them, and end the output there."""
        begun = count > 0 or self._row_u == rows.first - 1
        # if the motion does not even begin, keep the entries before it
        last = rows.first + count - 1 if begun else rows.first
        kept, self._controls, self._waiting = self._controls, deque(), 0
        end = self.last_u
        for entry in kept:
            if isinstance(entry, LineEdges):
                entry = entry.part(slice(0, int(np.searchsorted(entry.u, last, "right"))))
                end = max(end, float(entry.u[-1])) if len(entry) else end
            elif entry.u > last or (not begun and entry.kind is ControlKind.BEGIN):
                continue
            else:
                end = max(end, entry.u)
            self._queue(entry)
        line = int(rows.line[count])
        self._queue(Control(ControlKind.SETTLE, last if begun else end, line, token=LAST_TOKEN))
        if count:
            self._queue(rows.part(0, count))

    def _queue(self, entry: Control | LineEdges | Rows) -> None:
        if isinstance(entry, Rows):
            self._rows.append(entry)
        elif count := _count(entry):
            self._controls.append(entry)
            self._waiting += count

    @property
    def blocked(self) -> bool:
        """Whether something still waits."""
        return bool(self._rows or self._controls or self._kept)

    def drop(self) -> None:
        """Drop all that waits: the program was aborted."""
        self._controls.clear()
        self._waiting = 0
        self._rows.clear()
        self._kept.clear()

    def flush(self) -> bool:
        """Hand over what fits; True if anything moved."""
        moved = False
        self._put_kept()
        while self._rows:
            rows = self._rows[0]
            count = min(self._sink.row_room(), len(rows))
            if count < 1:
                break
            room = self._sink.control_room()
            entries = self._entries_before(rows.first + count)
            if entries > room:
                # no room for all entries: hand over only the rows before the first that does not fit
                entries = room
                until = math.floor(self._u_of(room) + CYCLE_ROUNDING) + 1
                count = max(0, min(count, until - rows.first))
            moved |= self._put_controls(entries, count)
            if count < 1:
                return moved
            self._sink.put_rows(rows.part(0, count))
            self.last_u = max(self.last_u, rows.first + count - 1)
            moved = True
            if count < len(rows):
                self._rows[0] = rows.part(count, len(rows))
                return moved
            self._rows.popleft()
        if not self._rows:
            kept = self._kept[0] if self._kept else None
            # entries come before the rows that they lie between
            ready = self._entries_before(kept.first) if isinstance(kept, Rows) else self._waiting
            moved |= self._put_controls(min(ready, self._sink.control_room()), 0)
        return moved

    def _entries_before(self, u: float) -> int:
        """Return how many entries come before u."""
        count = 0
        for block in self._controls:
            before = int(block.u < u) if isinstance(block, Control) else int(np.searchsorted(block.u, u))
            count += before
            if before < _count(block):
                break
        return count

    def _u_of(self, index: int) -> float:
        """Return u of an entry that waits."""
        for block in self._controls:
            if index < _count(block):
                return block.u if isinstance(block, Control) else float(block.u[index])
            index -= _count(block)
        raise IndexError(index)

    def _put_controls(self, count: int, rows: int) -> bool:
        """Hand over the next entries, which ``rows`` rows follow; return whether there was one."""
        left = count
        while left > 0:
            block = self._controls.popleft()
            if isinstance(block, Control):
                last = block.u
                self._sink.put_control(block, rows)
                left -= 1
            else:
                if len(block) > left:
                    self._controls.appendleft(block.part(slice(left, len(block))))
                    block = block.part(slice(0, left))
                last = float(block.u[-1])
                self._sink.put_edges(block, rows)
                left -= len(block)
            if not self._rows:
                self.last_u = max(self.last_u, last)
        self._waiting -= count
        return count > 0


def then(first: Iterator[Piece | Control] | None, after: list[Control]) -> Iterator[Piece | Control]:
    """Merge ``first`` with ``after`` in order of u: motion may end within the cycle whose row is its last."""
    remaining = list(after)
    for piece in first or ():
        if isinstance(piece, Deactivation):
            while remaining and remaining[0].u < piece.u:
                yield remaining.pop(0)
        yield piece
    yield from remaining


def _count(entry: Control | LineEdges) -> int:
    return 1 if isinstance(entry, Control) else len(entry)
