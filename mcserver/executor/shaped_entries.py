"""Delay control entries of a program on a machine with shapers until the shaped path reaches them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from mcserver.executor.entries import Control, ControlKind
from mcserver.executor.shaping import Shaper

# Kinds of entries that are executed when the shaped path reaches their u.
AT_THEIR_PLACE = frozenset(
    (ControlKind.LINE_START, ControlKind.LINE_END, ControlKind.PASSED, ControlKind.OUTPUT)
)
# Kinds that continue rows and motions without delay. All others wait until shaped setpoints have settled.
GOING_ON = frozenset(
    (
        ControlKind.BEGIN,
        ControlKind.END,
        ControlKind.WAIT,
        ControlKind.RAPID,
        ControlKind.HALT_AXES,
        ControlKind.PAYLOAD,
    )
)
# At the end of a motion these wait until it has settled.
_ENDS = frozenset((ControlKind.LINE_END, ControlKind.PASSED))


class ShapedEntries:
    """Entries that u has passed and the shaped path has not, in order.

    Args:
        shaper: of the machine; None: entries never wait.
    """

    def __init__(self, shaper: Shaper | None) -> None:
        self._delay = 0 if shaper is None else shaper.delay
        self._waiting: deque[tuple[int, Control, float]] = deque()
        self._driven = deque([0], maxlen=self._delay + 1)

    def __bool__(self) -> bool:
        return bool(self._waiting)

    @property
    def driven(self) -> int:
        """Columns that rows drove along a line at the u that the shaped path has reached."""
        return self._driven[0]

    def clear(self) -> None:
        """Drop all entries."""
        self._waiting.clear()

    def drop_outputs(self) -> None:
        """Drop the entries that would set outputs: the program stops."""
        self._waiting = deque(each for each in self._waiting if each[1].kind is not ControlKind.OUTPUT)

    def put_off(self, number: int, control: Control, left: float) -> None:
        """Delay an entry that u passes in cycle ``number``, ``left`` cycles before its end."""
        self._waiting.append((number + self._delay, control, left))

    def pass_cycle(self, number: int, driven: int, *, settling: bool) -> Iterator[tuple[Control, float]]:
        """Take the entries that are due in a cycle, each with the rest of the cycle at its time.

        Args:
            driven: columns that rows drive along a line now. settling: motion is at rest, and its shaped
                setpoints have not arrived.
        """
        self._driven.append(driven)
        while self._waiting:
            due, control, left = self._waiting[0]
            if due > number or (settling and control.kind in _ENDS):
                return
            self._waiting.popleft()
            yield control, left if due == number else 0.0
