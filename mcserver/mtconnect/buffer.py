"""The agent's buffer: what data items observed, numbered in order, the newest of them kept (Part 1)."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Mapping
from itertools import islice
from typing import NamedTuple

from mcserver.mtconnect.device import Reading

# as the reference agent's, 2^17 observations
SIZE = 131_072


class Observation(NamedTuple):
    """A reading of a data item, with its number and its time (UTC, ISO 8601)."""

    sequence: int
    item: str
    time: str
    reading: Reading


# by data item: its value alone, or every fault of a condition that is active
State = dict[str, list[Observation]]


class Window(NamedTuple):
    """Some observations, and where the next ones begin."""

    observations: list[Observation]
    next_sequence: int


class Buffer:
    """Observations of all devices.

    Args:
        size: observations that are kept.
    """

    def __init__(self, size: int = SIZE) -> None:
        self.size = size
        self._kept: deque[Observation] = deque()
        # just before the oldest one that is kept, and now
        self._before: State = {}
        self._now: State = {}
        self._next = 1

    @property
    def first(self) -> int:
        return self._next - len(self._kept)

    @property
    def next(self) -> int:
        return self._next

    def observe(self, time: str, readings: Mapping[str, tuple[Reading, ...]]) -> bool:
        """Add what has changed; return whether anything has."""
        before = self._next
        for item, found in readings.items():
            active = [each.reading for each in self._now.get(item, ())]
            if set(found) == set(active):
                continue
            if found[0].code and any(each not in found for each in active if each.code):
                # one fault has gone: a Normal without a code clears all, those that stay follow (Part 3, 5.8)
                self._append(item, time, Reading("Normal"))
                active = []
            for reading in found:
                if reading not in active:
                    self._append(item, time, reading)
        return self._next > before

    def state(self, at: int | None = None) -> State:
        """Return the newest value of every item, as it was at a number of those that are kept."""
        if at is None:
            return self._now
        state = {item: list(found) for item, found in self._before.items()}
        for observation in islice(self._kept, at - self.first + 1):
            _apply(state, observation)
        return state

    def window(self, start: int, count: int, items: Collection[str]) -> Window:
        """Return at most ``count`` observations of some items from number ``start`` on."""
        found: list[Observation] = []
        for observation in islice(self._kept, start - self.first, None):
            if observation.item in items:
                found.append(observation)
                if len(found) == count:
                    return Window(found, observation.sequence + 1)
        return Window(found, self._next)

    def _append(self, item: str, time: str, reading: Reading) -> None:
        if len(self._kept) == self.size:
            _apply(self._before, self._kept.popleft())
        observation = Observation(self._next, item, time, reading)
        self._kept.append(observation)
        _apply(self._now, observation)
        self._next += 1


def _apply(state: State, observation: Observation) -> None:
    active = state.get(observation.item, [])
    beside = observation.reading.code and active and active[0].reading.code
    state[observation.item] = [*active, observation] if beside else [observation]


def flat(state: State, items: Iterable[str]) -> list[Observation]:
    """Return the observations of some items."""
    return [observation for item in items for observation in state.get(item, ())]
