"""A scope on one axis: every mapped object in every cycle, from before a trigger on; nothing is sent."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.cycle_samples import POSITION, SETPOINTS, Array, CycleSampler, Signal, following_error
from mcserver.errors import UsageFault

FOLLOWING_ERROR = "following error"
_TRIGGER = re.compile(r"(.+?)\s*([<>])\s*([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)", re.I)


@dataclass(frozen=True)
class Trigger:
    """When a recording is kept.

    Attributes:
        column: of a signal; that behind the last one is the following error. level: in its unit.
        above: fires above the level, else below it. edge: only where the cycle before was not there yet.
    """

    column: int
    level: float
    above: bool
    edge: bool = True

    def meets(self, value: float) -> bool:
        return value > self.level if self.above else value < self.level


class TriggerSearch:
    """Looks for a trigger in the values of its column, in their order; a missing one (NaN) is passed over."""

    def __init__(self, trigger: Trigger) -> None:
        self.trigger = trigger
        self._last = math.nan

    def fires(self, value: float) -> bool:
        """Return whether the trigger is at this value, in its unit."""
        trigger = self.trigger
        was, self._last = self._last, value if math.isfinite(value) else self._last
        return trigger.meets(value) and not (trigger.edge and (math.isnan(was) or trigger.meets(was)))


@dataclass(frozen=True)
class ScopeTrace:
    """What a scope has recorded.

    Attributes:
        axis: of the machine. names, units, objects: of k columns; a computed one has no object.
        time_s: (n,), a multiple of the cycle, 0 at the trigger. values: (n, k); NaN: nothing came.
    """

    axis: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    objects: tuple[str, ...]
    time_s: Array
    values: Array


class Scope:
    """Gathers cycles of one axis; bounded by its duration.

    Args:
        signals: of the axis. cycle_s: time between SYNCs [s]. cycles: to keep, before: of those how many
            before the trigger. trigger: None: the first cycle.

    Attributes:
        rows: cycles that were seen. triggered: whether the trigger has come. cycle_s, duration_s: of a
            cycle, and of all that is kept [s].
    """

    def __init__(
        self, signals: Sequence[Signal], cycle_s: float, cycles: int, before: int, trigger: Trigger | None
    ) -> None:
        self.triggered = False
        self._signals = list(signals)
        self.cycle_s = cycle_s
        self._cycles = cycles
        self._sampler = CycleSampler(signals)
        self._before: deque[list[float]] = deque(maxlen=max(1, before + 1))
        self._kept: list[list[float]] = []
        self._search = None if trigger is None else TriggerSearch(trigger)
        self._zero = 0

    @property
    def rows(self) -> int:
        return self._sampler.rows

    @property
    def duration_s(self) -> float:
        return self._cycles * self.cycle_s

    def take(self, identifier: int, payload: bytes) -> bool:
        """Take a frame; True once everything is there."""
        row = self._sampler.take(identifier, payload)
        if row is None:
            return False
        if self.triggered:
            self._kept.append(row)
        else:
            before = self._before[-1] if self._before else None
            self._before.append(row)
            if self._fires(before, row):
                self.triggered = True
                self._zero = len(self._before) - 1
                self._kept = list(self._before)
        return self.triggered and len(self._kept) >= self._cycles

    def trace(self) -> ScopeTrace:
        """Return what is kept."""
        numbers = np.array(self._kept[: self._cycles]).reshape(-1, len(self._signals))
        columns = [signal.values(numbers[:, at]) for at, signal in enumerate(self._signals)]
        names = [signal.name for signal in self._signals]
        units = [signal.unit for signal in self._signals]
        objects = [object_text(*signal.place) for signal in self._signals]
        error = following_error(numbers, self._signals)
        if error is not None:
            columns.append(error)
            names.append(FOLLOWING_ERROR)
            units.append(next(signal.unit for signal in self._signals if signal.place == POSITION))
            objects.append("")
        time_s = np.arange(len(numbers), dtype=np.float64) * self.cycle_s - self._zero * self.cycle_s
        axis = self._signals[0].axis
        return ScopeTrace(axis, tuple(names), tuple(units), tuple(objects), time_s, np.stack(columns, axis=1))

    def _fires(self, before: list[float] | None, row: list[float]) -> bool:
        if self._search is None:
            return True
        column = self._search.trigger.column
        if column < len(self._signals):
            signal = self._signals[column]
            return self._search.fires(row[column] * signal.scale + signal.zero)
        error = None if before is None else following_error(np.array([before, row]), self._signals)
        return self._search.fires(math.nan if error is None else float(error[1]))


def read_trigger(text: str, signals: Sequence[Signal], *, edge: bool) -> Trigger:
    """Return the trigger that a text such as ``following error > 0.05`` means; ``edge``: see `Trigger`.

    Raises:
        UsageFault: MC568 it makes no sense, or names nothing or several of what is on the bus.
    """
    parts = _TRIGGER.fullmatch(text.strip())
    try:
        level = float(parts[3]) if parts is not None else math.nan
    except ValueError:
        level = math.nan
    if parts is None or not math.isfinite(level):
        raise UsageFault(
            "MC568", f"{text!r} is no trigger", 'give a name, > or <, and a level: "following error > 0.05"'
        )
    return Trigger(find_signal(parts[1], signals), level, parts[2] == ">", edge)


def find_signal(text: str, signals: Sequence[Signal]) -> int:
    """Column of what a text names: its object, its name, or words that only its name has.

    Raises:
        UsageFault: MC568 nothing or several of what is on the bus.
    """
    names = [signal.name.lower() for signal in signals]
    numbers = [object_text(*signal.place).lower() for signal in signals]
    if _has_error(signals):
        names.append(FOLLOWING_ERROR)
    plain = " ".join(text.lower().split())
    exact = [at for at, name in enumerate(names) if plain == name]
    exact += [at for at, number in enumerate(numbers) if plain in (number, number[:5], number[:4])]
    found = exact or [at for at, name in enumerate(names) if all(word in name for word in plain.split())]
    if len(found) == 1:
        return found[0]
    shown = ", ".join(names[at] for at in found) if found else ", ".join(names)
    raise UsageFault(
        "MC568",
        f"{'more than one signal is' if found else 'no signal on the bus is'} named {text!r}",
        f'there is {shown}; more by `monitor = ["6079h:00 DC link voltage"]` in [axis.drive]',
    )


def _has_error(signals: Sequence[Signal]) -> bool:
    places = {signal.place for signal in signals}
    return POSITION in places and bool(SETPOINTS & places)
