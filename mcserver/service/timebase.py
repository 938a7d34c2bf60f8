"""Executor time and the computer's clock: the one place that converts between them.

Executor time never steps; the clock does, when somebody or NTP sets it. So what is compared is executor time
with the instance it belongs to, and what is shown is UTC, taken when it happened.
"""

from __future__ import annotations

from collections.abc import Callable

# A change of the clock against executor time that is no slow correction [s].
STEP_S = 0.5


class Timebase:
    """The time of one start of the server.

    Args:
        epoch: Unix time of executor time 0, by the clock as it goes now [s].
        clock: Unix time [s]. monotonic: a clock that never steps [s].

    Attributes:
        on_step: called when the clock was set, with by how much [s].
    """

    def __init__(self, epoch: float, clock: Callable[[], float], monotonic: Callable[[], float]) -> None:
        self.on_step: Callable[[float], None] = lambda _: None
        self._clock = clock
        self._monotonic = monotonic
        self._zero = monotonic() - (clock() - epoch)
        self._epoch = epoch

    def now(self) -> float:
        """Executor time [s]."""
        return self._monotonic() - self._zero

    @property
    def epoch(self) -> float:
        """Unix time of executor time 0 as the clock goes now [s]."""
        before, self._epoch = self._epoch, self._clock() - self.now()
        step = self._epoch - before
        if abs(step) > STEP_S:
            self.on_step(step)
        return self._epoch
