"""PDO mapping and assignment of a CoE slave: 1600h …, 1A00h …, 1C00h, 1C12h, 1C13h (ETG.1000.6, 5.6.7)."""

from __future__ import annotations

import struct
from collections.abc import Callable

from mcserver.drive_sim.dictionary import Entry, ObjectStore
from mcserver.drive_sim.sdo_abort import Abort, SdoAbort

RECORDS, MAX_ENTRIES, MAX_ASSIGNED = 4, 16, 4
MAX_BYTES = 256
RX_MAPPING, TX_MAPPING = 0x1600, 0x1A00
TYPES, RX_ASSIGNMENT, TX_ASSIGNMENT = 0x1C00, 0x1C12, 0x1C13
# What the sync managers 0 to 3 are for.
_SYNC_MANAGER_TYPES = bytes((1, 2, 3, 4))
_DEFAULT_RX = (0x60400010, 0x60600008, 0x607A0020)
_DEFAULT_TX = (0x60410010, 0x60610008, 0x60640020)


class _List:
    """A count in sub-index 0 and numbers behind it; changed only while the count is 0."""

    def __init__(self, width: str, limit: int, values: tuple[int, ...]) -> None:
        self._packing = struct.Struct(width)
        self._limit = limit
        self.values = list(values) + [0] * (limit - len(values))
        self.count = len(values)

    @property
    def entries(self) -> list[int]:
        return self.values[: self.count]

    def read(self, subindex: int) -> bytes:
        if subindex == 0:
            return bytes((self.count,))
        if subindex > self._limit:
            raise SdoAbort(Abort.NO_SUBINDEX)
        return self._packing.pack(self.values[subindex - 1])

    def write(self, subindex: int, raw: bytes) -> None:
        wanted = 1 if subindex == 0 else self._packing.size
        if subindex > self._limit:
            raise SdoAbort(Abort.NO_SUBINDEX)
        if len(raw) != wanted:
            raise SdoAbort(Abort.LENGTH_TOO_HIGH if len(raw) > wanted else Abort.LENGTH_TOO_LOW)
        number = int.from_bytes(raw, "little")
        if subindex == 0:
            if number > self._limit:
                raise SdoAbort(Abort.PDO_LENGTH_EXCEEDED)
            self.count = number
        elif self.count:
            raise SdoAbort(Abort.UNSUPPORTED_ACCESS)
        else:
            self.values[subindex - 1] = number


class PdoAssignment:
    """Which objects are outputs and inputs, as the master has arranged it.

    Args:
        store: of the device. changeable: whether the state allows a change (PREOP).
    """

    def __init__(self, store: ObjectStore, changeable: Callable[[], bool]) -> None:
        self._store = store
        self._changeable = changeable
        self.reset()

    def reset(self) -> None:
        """The device's defaults."""
        self._lists: dict[int, _List] = {}
        for first, default in ((RX_MAPPING, _DEFAULT_RX), (TX_MAPPING, _DEFAULT_TX)):
            for number in range(RECORDS):
                self._lists[first + number] = _List("<I", MAX_ENTRIES, default if number == 0 else ())
        self._lists[RX_ASSIGNMENT] = _List("<H", MAX_ASSIGNED, (RX_MAPPING,))
        self._lists[TX_ASSIGNMENT] = _List("<H", MAX_ASSIGNED, (TX_MAPPING,))

    def has(self, index: int) -> bool:
        """Return whether an object is one of these."""
        return index == TYPES or index in self._lists

    def read(self, index: int, subindex: int) -> bytes:
        """Read one. Raises: SdoAbort."""
        if index == TYPES:
            if subindex > len(_SYNC_MANAGER_TYPES):
                raise SdoAbort(Abort.NO_SUBINDEX)
            return bytes((len(_SYNC_MANAGER_TYPES), *_SYNC_MANAGER_TYPES))[subindex : subindex + 1]
        return self._lists[index].read(subindex)

    def write(self, index: int, subindex: int, raw: bytes) -> None:
        """Write one. Raises: SdoAbort."""
        if index == TYPES:
            raise SdoAbort(Abort.READ_ONLY)
        if not self._changeable():
            raise SdoAbort(Abort.DEVICE_STATE)
        changed = self._lists[index]
        before = changed.count
        changed.write(subindex, raw)
        try:
            for outgoing in (False, True):
                if sum(entry.bits // 8 if entry else 1 for entry in self._mapped(outgoing)) > MAX_BYTES:
                    raise SdoAbort(Abort.PDO_LENGTH_EXCEEDED)
        except SdoAbort:
            changed.count = before
            raise

    def outputs(self) -> list[Entry | None]:
        """Objects in the outputs, in order; None: a byte of padding."""
        return self._mapped(False)

    def inputs(self) -> list[Entry | None]:
        """Objects in the inputs, in order; None: a byte of padding."""
        return self._mapped(True)

    def _mapped(self, outgoing: bool) -> list[Entry | None]:
        assignment, first = (TX_ASSIGNMENT, TX_MAPPING) if outgoing else (RX_ASSIGNMENT, RX_MAPPING)
        found: list[Entry | None] = []
        for index in self._lists[assignment].entries:
            if not first <= index < first + RECORDS:
                raise SdoAbort(Abort.INVALID_VALUE)
            for word in self._lists[index].entries:
                found += self._entry(word, outgoing)
        return found

    def _entry(self, word: int, outgoing: bool) -> list[Entry | None]:
        index, subindex, bits = word >> 16, word >> 8 & 0xFF, word & 0xFF
        if index == 0:
            if bits % 8:
                raise SdoAbort(Abort.CANNOT_BE_MAPPED)
            return [None] * (bits // 8)
        entry = self._store.find(index, subindex)
        if not (entry.mappable_out if outgoing else entry.mappable_in) or entry.bits != bits:
            raise SdoAbort(Abort.CANNOT_BE_MAPPED)
        return [entry]
