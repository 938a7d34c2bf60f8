"""Convert between executor time and the computer's clock, in this one place.

Executor time never steps; the clock does when it is set, by somebody or by NTP. So executor time, with its
instance, is used for comparisons, and UTC, taken at the event, for display.
"""

from __future__ import annotations

from collections.abc import Callable

# Change of the clock against executor time beyond a gradual correction [s].
STEP_S = 0.5


class Timebase:
    """Time of one start of the server.

    Args:
        epoch: Unix time of executor time 0, by the present clock [s].
        clock: Unix time [s]. monotonic: a clock that never steps [s].

    Attributes:
        on_step: called with the step when the clock was set [s].
    """

    def __init__(self, epoch: float, clock: Callable[[], float], monotonic: Callable[[], float]) -> None:
        self.on_step: Callable[[float], None] = lambda _: None
        self._clock = clock
        self._monotonic = monotonic
        self._zero = monotonic() - (clock() - epoch)
        self._epoch = epoch

    def now(self) -> float:
        """Return the executor time [s]."""
        return self._monotonic() - self._zero

    @property
    def epoch(self) -> float:
        """Unix time of executor time 0 by the present clock [s]."""
        before, self._epoch = self._epoch, self._clock() - self.now()
        step = self._epoch - before
        if abs(step) > STEP_S:
            self.on_step(step)
        return self._epoch
