"""The control entries ahead of u, and the edges before which motion has to be able to stop."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Array, Control, ControlKind
from mcserver.executor.playback.playback import Playback
from mcserver.executor.shm.rings import ProgramRing
from mcserver.motion.kernels.rate_changes import NEAR_U

# Most control entries that are noted in a cycle, besides those that this cycle may pass.
NOTED_A_CYCLE = 64
# Entries up to this far ahead of u are always noted [cycles].
NOTED_AHEAD = 8.0

# Most entries that are examined for a block of cycles.
LOOKED_AT = 1024

# Kinds of entries at which u may have to wait.
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
        ControlKind.THREAD,
        ControlKind.MESH,
    )
)
# LINE_START and LINE_END: all other kinds have greater numbers.
_LAST_EDGE = int(ControlKind.LINE_END)
_OUTPUT = int(ControlKind.OUTPUT)


@dataclass(frozen=True, eq=False)
class EntryBatch:
    """Entries that were taken, in order.

    Attributes:
        u, line, kind: shape (n,). outputs: by index, those that set outputs.
    """

    u: Array
    line: NDArray[np.int64]
    kind: NDArray[np.int64]
    outputs: Mapping[int, Control]


class ControlQueue:
    """Entries of a program's ring that u has not reached, in order.

    Attributes:
        noted: one past the number of the last noted entry. last_u: u of that entry.
    """

    def __init__(self, ring: ProgramRing, playback: Playback) -> None:
        self._ring = ring
        self._playback = playback
        self._stops: deque[float] = deque()
        self.open(0)

    def open(self, base: int) -> None:
        """Begin with entry number ``base``."""
        self._stops.clear()
        self._next = self.noted = base
        self._head: Control | None = None
        self._open = 0
        self._end = -1.0
        self.last_u = 0.0

    def drop(self) -> None:
        """Free all entries without executing them."""
        self.open(self._ring.controls_written)
        self._ring.free_controls(self.noted)

    @property
    def head(self) -> Control | None:
        """The next entry."""
        if self._head is None and self._next < self.noted:
            self._head = self._ring.control(self._next)
        return self._head

    def pop(self) -> None:
        """Take the next entry, which u has reached."""
        control = self._head or self._ring.control(self._next)
        self._head = None
        self._next += 1
        self._ring.free_controls(self._next)
        if control.kind in WAITING:
            _leave(self._stops, control.u + NEAR_U)

    def note(self, u: float = math.inf) -> None:
        """Note new entries, and the edges before which motion has to be able to stop.

        An entry is noted only once the rows that belong to it have come: else u would run on past a motion
        that begins.

        Args:
            u: of the program; inf, on a virtual clock: as many as there are.
        """
        ring, playback = self._ring, self._playback
        playback.look()
        written, rows = ring.controls_written, playback.written
        number, limit = self.noted, self.noted + NOTED_A_CYCLE
        while number < written and (number < limit or self.last_u <= u + NOTED_AHEAD):
            comes_with, kind, at = ring.glance(number)
            if comes_with > rows:
                break
            if kind > _LAST_EDGE:
                self._note(ring.control(number))
            self.last_u = at
            number += 1
        self.noted = number

    def _note(self, control: Control) -> None:
        if control.kind is ControlKind.BEGIN:
            self._open |= control.axes
        elif control.kind is ControlKind.END:
            self._open &= ~control.axes
            self._end = control.u
        elif self._open and control.kind in WAITING:
            self._stops.append(control.u)

    def edges_until(self, u: float, limit: int) -> int:
        """Return how many rows after a whole u, up to ``limit``, pass only line edges and outputs."""
        ring = self._ring
        known = min(self.noted, self._next + LOOKED_AT)
        places = np.arange(self._next, known) % ring.controls
        at = ring.entry_u[places]
        far = at > u + limit
        ahead = int(np.argmax(far)) if far.any() else len(at)
        at = at[:ahead]
        whole = np.rint(at)
        blurred = (at != whole) & (np.abs(at - whole) <= 2.0 * NEAR_U)
        kind = ring.entry_kind[places[:ahead]]
        others = np.flatnonzero(blurred | ((kind > _LAST_EDGE) & (kind != _OUTPUT)))
        if len(others):
            return max(0, math.ceil(float(at[others[0]]) - u - 2.0 * NEAR_U) - 1)
        if ahead == len(places) and known < ring.controls_written:
            # more entries follow, which have not been examined or whose rows have not come yet
            last = float(at[-1]) if ahead else self.last_u
            limit = min(limit, max(0, math.ceil(last - u) - 1))
        return limit

    def take_until(self, u: float) -> EntryBatch:
        """Take the entries up to u, which are line edges and outputs, as `edges_until` has found."""
        ring, first = self._ring, self._next
        places = np.arange(first, min(self.noted, first + LOOKED_AT)) % ring.controls
        at = ring.entry_u[places]
        behind = at > u
        if behind.any():
            places = places[: int(np.argmax(behind))]
        self._head = None
        self._next += len(places)
        kind = ring.entry_kind[places]
        (outputs,) = np.nonzero(kind == _OUTPUT)
        taken = EntryBatch(
            at[: len(places)].copy(),
            ring.entry_line[places],
            kind,
            {number: ring.control(first + number) for number in outputs.tolist()},
        )
        ring.free_controls(self._next)
        return taken

    def edge(self, u: float) -> tuple[float | None, bool]:
        """Return the u before which the motion under way has to be able to stop, and whether more rows would
        move it further.

        None: the motion ends by itself before that.
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
