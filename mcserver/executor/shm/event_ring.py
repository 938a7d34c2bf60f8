"""The ring of events from the executor to the planner: line starts and ends, faults, positions.

Single writer, single reader, as `mcserver.executor.shm.rings`. When it is full the executor does not wait:
the event is lost, and counted.
"""

from __future__ import annotations

import struct
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import EventKind, ExecutorEvent

# By number: used twice a line, where calling the enumeration takes longer than all the rest.
_KINDS = MappingProxyType({kind.value: kind for kind in EventKind})

EVENTS = 16384
PAYLOADS = 256

# kind, program, line, time, code, axis, token, number of values, the first two values
_EVENT = struct.Struct("<qqqdqqqqdd")
_INLINE = 2
_HEADER_WORDS = 8
_WRITTEN, _READ, _LOST, _PAYLOADS_WRITTEN, _PAYLOADS_READ = range(5)


def event_ring_size(axes: int, events: int = EVENTS) -> int:
    """Return the size of the ring in bytes."""
    return 8 * _HEADER_WORDS + events * _EVENT.size + PAYLOADS * 2 * axes * 8


class EventRing:
    """Both ends of the ring.

    Args:
        buffer: at least `event_ring_size` bytes, zeroed; None: memory of this process.
        axes: K; an event carries up to 2·K values.
    """

    def __init__(self, buffer: bytearray | memoryview | None, axes: int, events: int = EVENTS) -> None:
        size = event_ring_size(axes, events)
        self._buffer = memoryview(bytearray(size) if buffer is None else buffer)
        if len(self._buffer) < size:
            raise ValueError(f"the ring needs {size} bytes, the buffer has {len(self._buffer)}")
        self._events = events
        self._counters = self._buffer[: 8 * _HEADER_WORDS].cast("q")
        self._at = 8 * _HEADER_WORDS
        self._payloads: NDArray[np.float64] = np.frombuffer(
            self._buffer, np.float64, PAYLOADS * 2 * axes, self._at + events * _EVENT.size
        ).reshape(PAYLOADS, 2 * axes)

    def put(self, event: ExecutorEvent) -> bool:
        """Add an event; return False if there was no room and it is lost."""
        counters = self._counters
        written = counters[_WRITTEN]
        count = len(event.values)
        large = count > _INLINE
        payload = counters[_PAYLOADS_WRITTEN]
        if written - counters[_READ] >= self._events or (
            large and payload - counters[_PAYLOADS_READ] >= PAYLOADS
        ):
            counters[_LOST] += 1
            return False
        if large:
            self._payloads[payload % PAYLOADS, :count] = event.values
            counters[_PAYLOADS_WRITTEN] = payload + 1
        _EVENT.pack_into(
            self._buffer,
            self._at + written % self._events * _EVENT.size,
            event.kind,
            event.program,
            event.line,
            event.time,
            event.code,
            event.axis,
            event.token,
            count,
            event.values[0] if count and not large else 0.0,
            event.values[1] if count > 1 and not large else 0.0,
        )
        counters[_WRITTEN] = written + 1
        return True

    def take(self, limit: int = EVENTS) -> list[ExecutorEvent]:
        """Return the events since the last call, in order."""
        counters = self._counters
        read, written = counters[_READ], counters[_WRITTEN]
        payload = counters[_PAYLOADS_READ]
        events: list[ExecutorEvent] = []
        for number in range(read, min(written, read + limit)):
            kind, program, line, time, code, axis, token, count, first, second = _EVENT.unpack_from(
                self._buffer, self._at + number % self._events * _EVENT.size
            )
            values: tuple[float, ...] = (first, second)[:count]
            if count > _INLINE:
                values = tuple(self._payloads[payload % PAYLOADS, :count].tolist())
                payload += 1
            events.append(ExecutorEvent(_KINDS[kind], program, line, time, code, axis, token, values))
        counters[_PAYLOADS_READ] = payload
        counters[_READ] = read + len(events)
        return events

    @property
    def lost(self) -> int:
        """Number of events that found no room since the start."""
        return self._counters[_LOST]
