"""Playing a recorded run: where in its time it is."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5", "10")


@dataclass
class Playback:
    """A clock over a recording that can be stopped, set and made faster.

    Attributes:
        time_s: of the recording's rows, rising, at least one. now: [s]. speed: of the recording [1].
        repeat: whether it begins anew at its end.
    """

    time_s: Sequence[float]
    now: float = 0.0
    speed: float = 1.0
    playing: bool = True
    repeat: bool = False

    def __post_init__(self) -> None:
        self.now = self.start

    @property
    def start(self) -> float:
        """Time of the first row [s]."""
        return self.time_s[0]

    @property
    def end(self) -> float:
        """Time of the last row [s]."""
        return self.time_s[-1]

    def advance(self, elapsed: float) -> None:
        """Go on by ``elapsed`` seconds of the wall; stop at the end, or begin anew."""
        if not self.playing:
            return
        if self.repeat and self.now >= self.end:
            self.now = self.start
            return
        self.now = min(self.now + elapsed * self.speed, self.end)
        if self.now >= self.end and not self.repeat:
            self.playing = False

    def toggle(self) -> None:
        """Play or pause; at the end it begins anew."""
        self.playing = not self.playing
        if self.playing and self.now >= self.end:
            self.now = self.start

    def seek(self, time: float) -> None:
        """Go to a time of the recording [s], kept within it."""
        self.now = min(max(time, self.start), self.end)

    @property
    def row(self) -> int:
        """The newest row at this time."""
        return max(0, bisect_right(self.time_s, self.now + 1e-9) - 1)
