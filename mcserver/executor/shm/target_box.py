"""The newest targets of one program's axes, from the server to the executor: the newest message wins.

Each message is written to the next of several places, then counted. A reader whose place has been overwritten
meanwhile notices it by the count, and copies again in its next cycle. Any numbers are safe to read: the axes'
limits are kept for any targets.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Points of a message, and places for messages.
POINTS = 128
PLACES = 4
_COUNT, _CLOSING = range(2)
_HEADER_WORDS = 8
# Words of a place: number of points, time of arrival, end of validity, whether only velocities are followed.
_POINTS, _STAMP, _UNTIL, _BY_VELOCITY = range(4)
_PLACE_HEAD = 4


class Targets(NamedTuple):
    """One message of targets.

    Attributes:
        knots: shape (m, 1 + 2 n): executor time [s], positions and velocities of the program's n axes in the
            order of their columns [SI]; cubic between knots, constant velocity after the last one.
        stamp: executor time of arrival [s]. until: end of validity [s].
        by_velocity: only velocities are followed, positions are ignored.
    """

    knots: Array
    stamp: float
    until: float
    by_velocity: bool = False


def _place_words(axes: int) -> int:
    return _PLACE_HEAD + POINTS * (1 + 2 * axes)


def target_box_size(axes: int) -> int:
    """Return the size of a box in bytes."""
    return 8 * (_HEADER_WORDS + PLACES * _place_words(axes))


class TargetBox:
    """Both ends of one program's box.

    Args:
        buffer: at least `target_box_size` bytes, zeroed. axes: K, columns of the machine.
    """

    def __init__(self, buffer: memoryview, axes: int) -> None:
        self._counters = buffer[: 8 * _HEADER_WORDS].cast("q")
        words = np.frombuffer(buffer, np.float64, PLACES * _place_words(axes), 8 * _HEADER_WORDS)
        self._places: Array = words.reshape(PLACES, -1)

    # ------------------------------------------------------------------ the writer

    def restart(self) -> None:
        """Forget the messages for another program."""
        self._counters[_COUNT] = self._counters[_CLOSING] = 0

    def put(self, targets: Targets) -> None:
        """Put a message of 1 to `POINTS` points."""
        count, knots = self._counters[_COUNT], targets.knots
        place = self._places[count % PLACES]
        place[_PLACE_HEAD : _PLACE_HEAD + knots.size] = knots.ravel()
        place[:_PLACE_HEAD] = len(knots), targets.stamp, targets.until, targets.by_velocity
        self._counters[_COUNT] = count + 1

    def close(self) -> None:
        """Announce that no more will come: the axes go on to the last targets, and the program ends there."""
        self._counters[_CLOSING] = 1

    # ------------------------------------------------------------------ the reader

    @property
    def count(self) -> int:
        """Number of messages that were put."""
        return self._counters[_COUNT]

    @property
    def closing(self) -> bool:
        """Whether no more will come."""
        return self._counters[_CLOSING] != 0

    def newest(self, axes: int) -> Targets | None:
        """Copy the newest message for n axes; None: there is none, or it was overwritten meanwhile."""
        count = self._counters[_COUNT]
        if count == 0:
            return None
        place = self._places[(count - 1) % PLACES]
        points, width = place[_POINTS], 1 + 2 * axes
        if not 1.0 <= points <= POINTS:
            return None
        knots = place[_PLACE_HEAD : _PLACE_HEAD + int(points) * width].reshape(-1, width).copy()
        stamp, until, by_velocity = place[_STAMP:_PLACE_HEAD].tolist()
        if self._counters[_COUNT] - count >= PLACES - 1:
            return None
        return Targets(knots, stamp, until, by_velocity != 0.0)
