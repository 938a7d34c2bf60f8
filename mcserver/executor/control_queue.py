"""Control entries that wait for u, and where motion has to be able to stop before them."""

from __future__ import annotations

import math
from collections import deque

from mcserver.executor.entries import Control, ControlKind
from mcserver.executor.playback.playback import Playback
from mcserver.executor.shm.rings import ProgramRing
from mcserver.motion.kernels.rate_changes import NEAR_U

# Control entries taken out of the ring in a cycle, besides those that this cycle may pass.
DECODED_A_CYCLE = 64
# Entries up to this far ahead of u are always taken out [cycles].
DECODED_AHEAD = 8.0

# Entries at which u may have to wait.
WAITING = frozenset(
    (
        ControlKind.WAIT,
        ControlKind.DWELL,
        ControlKind.AXIS,
        ControlKind.PAUSE,
        ControlKind.SETTLE,
        ControlKind.HALT_AXES,
        ControlKind.INPUT,
        ControlKind.HOME,
        ControlKind.REFERENCE,
        ControlKind.PROBE,
    )
)


class ControlQueue:
    """Entries taken out of a program's ring, in order.

    Attributes:
        last_u: u of the last entry known.
    """

    def __init__(self, ring: ProgramRing, playback: Playback) -> None:
        self._ring = ring
        self._playback = playback
        self._waiting: deque[Control] = deque()
        self._stops: deque[float] = deque()
        self.open(0)

    def open(self, base: int) -> None:
        """Begins with entry number ``base``."""
        self._waiting.clear()
        self._stops.clear()
        self._decoded = base
        self._open = 0
        self._end = -1.0
        self.last_u = 0.0

    def drop(self) -> None:
        """Frees everything: nothing more of this program is done."""
        self.open(self._ring.controls_written)
        self._ring.free_controls(self._decoded)

    @property
    def head(self) -> Control | None:
        """The next entry."""
        return self._waiting[0] if self._waiting else None

    def pop(self) -> None:
        """The next entry has been reached."""
        control = self._waiting.popleft()
        self._ring.free_controls(self._decoded - len(self._waiting))
        if control.kind in WAITING:
            _leave(self._stops, control.u + NEAR_U)

    def decode(self, u: float) -> None:
        """Take new entries out of the ring and note where motion has to be able to end.

        An entry whose rows have not come does not count yet: u would run on past a motion that begins.
        """
        ring, playback = self._ring, self._playback
        playback.look()
        written, rows = ring.controls_written, playback.written
        number, limit = self._decoded, self._decoded + DECODED_A_CYCLE
        while number < written and (number < limit or self.last_u <= u + DECODED_AHEAD):
            if ring.rows_with(number) > rows:
                break
            control = ring.control(number)
            number += 1
            self._waiting.append(control)
            kind = control.kind
            if kind is ControlKind.BEGIN:
                self._open |= control.axes
            elif kind is ControlKind.END:
                self._open &= ~control.axes
                self._end = control.u
            elif self._open and kind in WAITING:
                self._stops.append(control.u)
            self.last_u = control.u
        self._decoded = number

    def marks_until(self, u: float, limit: int) -> int:
        """Return how many rows after a whole u, up to ``limit``, meet no entry but marks of lines."""
        for control in self._waiting:
            if control.u > u + limit:
                return limit
            whole = round(control.u)
            blurred = control.u != whole and abs(control.u - whole) <= 2.0 * NEAR_U
            if control.kind not in (ControlKind.LINE_START, ControlKind.LINE_END) or blurred:
                return max(0, math.ceil(control.u - u - 2.0 * NEAR_U) - 1)
        if self._decoded < self._ring.controls_written:
            # more entries follow, which have not been taken out yet
            limit = min(limit, max(0, math.ceil(self.last_u - u) - 1))
        return limit

    def edge(self, u: float) -> tuple[float | None, bool]:
        """Before which u the motion under way has to be able to stop, and whether more rows would move that
        on.

        None: it ends by itself before all that.
        """
        edge: float | None = None
        dry = False
        last = self._playback.last_u
        if (self._open or last < self._end - 1.0 + NEAR_U) and not self._playback.rests_at_end:
            edge, dry = last, True
        stops = self._stops
        _leave(stops, u - NEAR_U)
        if stops and (edge is None or stops[0] < edge):
            edge, dry = stops[0], False
        return edge, dry


def _leave(stops: deque[float], u: float) -> None:
    while stops and stops[0] <= u:
        stops.popleft()
