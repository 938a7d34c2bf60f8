"""Process data: parameters with the standard's rules, packing and times (CiA 301, 7.5.2).

Mapping changes only while the PDO is invalid (bit 31 of its COB-ID) and subindex 0 is 0. Transmission types:
0 at the SYNC after a change, 1 … 240 at every n-th SYNC, 254 and 255 on change and by the event timer.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

from mcserver.drive_sim.dictionary import FORMATS, Entry, ObjectStore
from mcserver.drive_sim.sdo_abort import Abort, SdoAbort

INVALID = 1 << 31
EXTENDED = 1 << 29
LAST_SYNCHRONOUS = 240
FIRST_EVENT_DRIVEN = 254
MAX_ENTRIES = 8
MAX_BITS = 64
# COB-IDs that are no PDO's (CiA 301, table 40), and what has more than 11 bits.
RESTRICTED = (
    (0x000, 0x07F),
    (0x080, 0x080),
    (0x101, 0x180),
    (0x581, 0x5FF),
    (0x601, 0x67F),
    (0x6E0, 0x6FF),
    (0x701, 0x1FFFFFFF),
)
INHIBIT_UNIT_S = 100e-6
EVENT_UNIT_S = 1e-3
NEVER = math.inf


class Pdo:
    """What both directions have in common: parameters, their rules, and the mapping as a `struct`."""

    def __init__(self, store: ObjectStore, number: int, base: int, on_change: Callable[[], None]) -> None:
        """``base``: 1400h or 1800h; the mapping is 200h above. ``number`` from 1."""
        self.number = number
        self._store = store
        self._incoming = base == 0x1400
        self._on_change = on_change
        communication, mapping = base + number - 1, base + 0x200 + number - 1
        self._identifier = store.entry(communication, 1)
        self._type = store.entry(communication, 2)
        self._inhibit = store.entry(communication, 3)
        self._event = store.entry(communication, 5)
        self._count = store.entry(mapping, 0)
        self._mapped = [store.entry(mapping, subindex) for subindex in range(1, MAX_ENTRIES + 1)]
        self._identifier.check = self._check_identifier
        self._type.check = self._check_type
        self._inhibit.check = self._check_invalid
        self._count.check = self._check_count
        for entry in self._mapped:
            entry.check = self._check_mapped
        for entry in (self._identifier, self._type, self._inhibit, self._event, self._count):
            entry.action = self._changed
        self.entries: tuple[Entry, ...] = ()
        self.packing = struct.Struct("")
        self.compile()

    @property
    def valid(self) -> bool:
        return not self._identifier.value & INVALID

    @property
    def identifier(self) -> int:
        return self._identifier.value & 0x7FF

    @property
    def transmission(self) -> int:
        return self._type.value

    @property
    def synchronous(self) -> bool:
        return self._type.value <= LAST_SYNCHRONOUS

    @property
    def event_s(self) -> float:
        """The event timer [s]; 0: none."""
        return self._event.value * EVENT_UNIT_S

    @property
    def inhibit_s(self) -> float:
        """Least time between two transmissions [s]."""
        return self._inhibit.value * INHIBIT_UNIT_S

    def compile(self) -> None:
        """Take the mapping as it stands in the dictionary."""
        entries = []
        for mapped in self._mapped[: self._count.value]:
            entries.append(self._object(mapped.value))
        self.entries = tuple(entries)
        self.packing = struct.Struct("<" + "".join(entry.packing for entry in entries))

    def _changed(self, _value: int) -> None:
        self.compile()
        self._on_change()

    # ------------------------------------------------------------------ rules

    def _check_identifier(self, value: int) -> None:
        if value & INVALID:
            return
        identifier = value & 0x1FFFFFFF
        if value & EXTENDED or any(first <= identifier <= last for first, last in RESTRICTED):
            raise SdoAbort(Abort.INVALID_VALUE)
        if self.valid and identifier != self.identifier:
            raise SdoAbort(Abort.DEVICE_STATE)

    def _check_type(self, value: int) -> None:
        if LAST_SYNCHRONOUS < value < FIRST_EVENT_DRIVEN:
            raise SdoAbort(Abort.INVALID_VALUE)

    def _check_invalid(self, _value: int) -> None:
        if self.valid:
            raise SdoAbort(Abort.DEVICE_STATE)

    def _check_mapped(self, value: int) -> None:
        if self.valid or self._count.value:
            raise SdoAbort(Abort.UNSUPPORTED_ACCESS)
        if value:
            self._object(value)

    def _check_count(self, value: int) -> None:
        if self.valid:
            raise SdoAbort(Abort.UNSUPPORTED_ACCESS)
        if value > MAX_ENTRIES:
            raise SdoAbort(Abort.INVALID_VALUE)
        if sum(self._object(mapped.value).bits for mapped in self._mapped[:value]) > MAX_BITS:
            raise SdoAbort(Abort.PDO_LENGTH_EXCEEDED)

    def _object(self, mapped: int) -> Entry:
        """Return the entry that a mapping parameter means.

        Raises:
            SdoAbort: the object does not exist, cannot be mapped in this direction, or has another length.
        """
        index, subindex, bits = mapped >> 16, mapped >> 8 & 0xFF, mapped & 0xFF
        if index in FORMATS and self._incoming and subindex == 0:
            found = _dummy(index)
        else:
            found = self._store.find(index, subindex)
        allowed = found.mappable_in if self._incoming else found.mappable_out
        if not allowed or found.bits != bits:
            raise SdoAbort(Abort.CANNOT_BE_MAPPED)
        return found


class Rpdo(Pdo):
    """Process data that the node receives."""

    def __init__(self, store: ObjectStore, number: int, on_change: Callable[[], None]) -> None:
        super().__init__(store, number, 0x1400, on_change)
        self._waiting: bytes | None = None
        self._received_at = NEVER
        self._late = False

    def start(self) -> None:
        """The node becomes operational: nothing has been received."""
        self._waiting = None
        self._received_at = NEVER
        self._late = False

    def receive(self, payload: bytes, now: float) -> tuple[bool, int]:
        """Take a frame; whether values have changed now, and an EMCY code or 0.

        Too short a frame is not processed (8210h), a longer one up to its mapped length (8220h).
        """
        size = self.packing.size
        if len(payload) < size:
            return False, 0x8210
        self._received_at = now
        self._late = False
        if self.synchronous:
            self._waiting = payload[:size]
            return False, 0x8220 if len(payload) > size else 0
        self._apply(payload[:size])
        return True, 0x8220 if len(payload) > size else 0

    def sync(self) -> None:
        """Apply what was received since the last SYNC; the newest counts."""
        if self._waiting is not None:
            self._apply(self._waiting)
            self._waiting = None

    def _apply(self, payload: bytes) -> None:
        for entry, value in zip(self.entries, self.packing.unpack(payload), strict=True):
            entry.value = value

    def poll(self, now: float) -> tuple[bool, float]:
        """Return whether the event timer has just expired (once a silence), and when to ask again.

        Monitoring begins with the first reception (CiA 301, 7.5.2.36).
        """
        if not self.valid or not self.event_s or self._received_at == NEVER or self._late:
            return False, NEVER
        deadline = self._received_at + self.event_s
        if now < deadline:
            return False, deadline
        self._late = True
        return True, NEVER


@dataclass
class Outgoing:
    """What transmitting a TPDO needs besides its parameters."""

    syncs: int = 0
    sent: bytes | None = None
    sent_at: float = -math.inf


class Tpdo(Pdo):
    """Process data that the node transmits."""

    def __init__(self, store: ObjectStore, number: int, on_change: Callable[[], None]) -> None:
        super().__init__(store, number, 0x1800, on_change)
        self._state = Outgoing()

    def start(self) -> None:
        """The node becomes operational: event-driven data are sent at once."""
        self._state = Outgoing()

    def payload(self) -> bytes:
        """Return the values as they are now."""
        return self.packing.pack(*[entry.value for entry in self.entries])

    def at_sync(self) -> bytes | None:
        """Return what is transmitted at this SYNC."""
        if not self.valid:
            return None
        kind = self._type.value
        if kind == 0:
            payload = self.payload()
            if payload == self._state.sent:
                return None
            self._state.sent = payload
            return payload
        if kind > LAST_SYNCHRONOUS:
            return None
        self._state.syncs += 1
        if self._state.syncs < kind:
            return None
        self._state.syncs = 0
        return self.payload()

    def poll(self, now: float) -> tuple[bytes | None, float]:
        """Return what an event-driven TPDO transmits now, and when to ask again at the latest."""
        if not self.valid or self._type.value < FIRST_EVENT_DRIVEN:
            return None, NEVER
        state, period = self._state, self.event_s
        payload = self.payload()
        due = state.sent_at + period if period else NEVER
        if payload == state.sent and now < due:
            return None, due
        allowed = state.sent_at + self.inhibit_s
        if now < allowed:
            return None, allowed
        state.sent, state.sent_at = payload, now
        return payload, now + period if period else NEVER


def _dummy(data_type: int) -> Entry:
    """Return a type as an object: room in an RPDO that nothing is made of (CiA 301, 7.4.7)."""
    packing = FORMATS[data_type]
    bits = 8 * struct.calcsize(f"<{packing}")
    return Entry(data_type, 0, packing, bits, False, True, True, False, 0, 0, 0, b"")
