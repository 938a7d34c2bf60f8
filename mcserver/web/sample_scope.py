"""A scope on one axis by telemetry: every cycle of it, around a trigger or as it comes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from mcclient.telemetry import Samples

from mcserver.canopen.cycle_samples import Array
from mcserver.canopen.scope import FOLLOWING_ERROR, ScopeTrace, Trigger, TriggerSearch

SETPOINT, POSITION, VELOCITY, TORQUE = "setpoint", "position", "velocity", "torque"
# columns of a trace, in this order
QUANTITIES = (SETPOINT, POSITION, FOLLOWING_ERROR, VELOCITY, TORQUE)
# what is drawn: so many rows at most, of each span of time the least and the greatest of each curve
MOST_ROWS = 1200


@dataclass
class SampleScope:
    """Gathers cycles of one axis; bounded by its duration.

    Attributes:
        axis: of the machine. unit: of its positions. cycle_s: [s]. cycles: to keep. before: of these, before
            the trigger. trigger: by the column of `QUANTITIES`; None: the newest cycles are kept.
        lost: cycles that did not come; they are NaN. triggered: whether the trigger has come.
    """

    axis: int
    unit: str
    cycle_s: float
    cycles: int
    before: int = 0
    trigger: Trigger | None = None
    lost: int = 0
    triggered: bool = False

    def __post_init__(self) -> None:
        self._rows: Array = np.empty((0, len(QUANTITIES)))
        self._search = self._new_search()
        self._zero = 0
        self._next: int | None = None
        self._ended_s = math.nan

    @property
    def is_done(self) -> bool:
        """Whether everything is there."""
        return self.triggered and len(self._rows) >= self.cycles

    @property
    def zero_s(self) -> float:
        """Executor time of the trace's zero: of the trigger, or of the newest cycle [s]."""
        last = len(self._rows) - 1
        return self._ended_s - (last - self._zero if self.triggered else 0) * self.cycle_s

    def take(self, samples: Samples) -> None:
        """Take some cycles; once everything is there no more."""
        if self.is_done or not len(samples.time_s) or self.axis not in samples.axes:
            return
        at = samples.axes.index(self.axis)
        setpoint, actual = samples.setpoint[:, at], samples.actual[:, at]
        new = np.stack(
            [setpoint, actual, setpoint - actual, samples.velocity[:, at], samples.torque[:, at]], axis=1
        )
        lost = 0 if self._next is None else samples.seq - self._next
        if lost < 0:
            # the server has begun anew
            self._rows, lost, self._search = self._rows[:0], 0, self._new_search()
        self._next = samples.seq + len(new)
        self.lost += lost
        gap = np.full((min(lost, self.cycles), len(QUANTITIES)), np.nan)
        known, self._rows = len(self._rows), np.concatenate([self._rows, gap, new])
        self._ended_s = float(samples.time_s[-1])
        if not self.triggered and self._search is not None:
            self._look_for(self._search, known)
        if not self.triggered:
            self._rows = self._rows[-self.cycles :]
        elif len(self._rows) > self.cycles:
            self._ended_s -= (len(self._rows) - self.cycles) * self.cycle_s
            self._rows = self._rows[: self.cycles]

    def trace(self) -> ScopeTrace:
        """Return what is kept; 0 is the trigger, or the newest cycle."""
        zero = self._zero if self.triggered else len(self._rows) - 1
        speed = f"{self.unit}/s"
        return ScopeTrace(
            self.axis,
            QUANTITIES,
            (self.unit, self.unit, self.unit, speed, "N·m"),
            ("",) * len(QUANTITIES),
            (np.arange(len(self._rows), dtype=np.float64) - zero) * self.cycle_s,
            self._rows,
        )

    def _new_search(self) -> TriggerSearch | None:
        return None if self.trigger is None else TriggerSearch(self.trigger)

    def _look_for(self, search: TriggerSearch, known: int) -> None:
        """Find the trigger in the rows behind ``known``, and let time begin there."""
        new = self._rows[known:, search.trigger.column].tolist()
        found = next((row for row, value in enumerate(new, known) if search.fires(value)), None)
        if found is not None:
            first = max(0, found - self.before)
            self._rows, self._zero, self.triggered = self._rows[first:], found - first, True


def drawn_rows(trace: ScopeTrace, columns: list[int]) -> list[list[float | None]]:
    """Return rows of time and some columns for a chart: all, or of each span the extremes of each curve."""
    values = trace.values[:, columns]
    count, spans = len(values), max(1, MOST_ROWS // (2 * max(1, len(columns))))
    if count > MOST_ROWS:
        edges = np.linspace(0, count, spans + 1).astype(int)
        kept = {0, count - 1}
        for first, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            for column in values[first:end].T:
                if np.isfinite(column).any():
                    kept |= {first + int(np.nanargmin(column)), first + int(np.nanargmax(column))}
                else:
                    kept.add(first)
        rows = sorted(kept)
    else:
        rows = list(range(count))
    return [
        [
            round(float(trace.time_s[row]), 6),
            *(None if each != each else float(f"{each:.7g}") for each in values[row]),
        ]
        for row in rows
    ]
