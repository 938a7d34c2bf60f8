"""A node's object dictionary: types, access and defaults from an EDS file; values, read and written."""

from __future__ import annotations

import dataclasses
import functools
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from types import MappingProxyType

from canopen.objectdictionary import ODVariable

from mcserver.canopen.eds import parse_description
from mcserver.drive_sim.sdo_abort import Abort, SdoAbort

EDS = "cia402.eds"
# Store all parameters, by the signature "save" (CiA 301, 7.5.2.13).
STORE, SAVE = (0x1010, 1), int.from_bytes(b"save", "little")
# CiA 301, table 44: the types of the simulated drive.
FORMATS: Mapping[int, str] = MappingProxyType({2: "b", 3: "h", 4: "i", 5: "B", 6: "H", 7: "I"})
# Called before a value is taken; raises SdoAbort where it cannot be.
WriteCheck = Callable[[int], None]
# Called after a value was taken.
WriteAction = Callable[[int], None]


@dataclass(eq=False, slots=True)
class Entry:
    """One value of the dictionary.

    Attributes:
        value: of a number; PDOs and the drive's own code set it directly. text: of a string.
        packing: empty for a string. bits: 0 for a string.
        default: what a reset brings back. written: whether a master has written it since then.
    """

    index: int
    subindex: int
    packing: str
    bits: int
    readable: bool
    writable: bool
    mappable_in: bool
    mappable_out: bool
    least: int
    greatest: int
    default: int
    text: bytes
    value: int = 0
    written: bool = False
    check: WriteCheck | None = None
    action: WriteAction | None = None


class ObjectStore:
    """Entries by index and subindex."""

    def __init__(self, node: int) -> None:
        """Read the shipped EDS file."""
        objects, entries = _described(node)
        self._objects = objects
        self._entries = {(each.index, each.subindex): dataclasses.replace(each) for each in entries}
        storing = self._entries[STORE]
        storing.check, storing.action = _check_signature, self._keep
        self.reset()

    def entry(self, index: int, subindex: int = 0) -> Entry:
        """Return an entry that is known to exist."""
        return self._entries[index, subindex]

    def find(self, index: int, subindex: int) -> Entry:
        """Return the entry that a master asks for.

        Raises:
            SdoAbort: no such object or subindex.
        """
        found = self._entries.get((index, subindex))
        if found is None:
            raise SdoAbort(Abort.NO_SUBINDEX if index in self._objects else Abort.NO_OBJECT)
        return found

    def add(self, variables: Iterable[ODVariable]) -> None:
        """Add what the device has besides; entries that are there stay."""
        for variable in variables:
            place = variable.index, variable.subindex
            if place not in self._entries:
                self._entries[place] = _entry(variable)
                self._objects |= {variable.index}

    def remove(self, indices: range) -> None:
        """Remove the objects of a range."""
        self._objects -= set(indices)
        self._entries = {place: entry for place, entry in self._entries.items() if place[0] not in indices}

    def _keep(self, _signature: int) -> None:
        """Store what a master has written: a reset brings that back from now on."""
        storing = self._entries[STORE]
        storing.value, storing.written = storing.default, False
        for entry in self._entries.values():
            if entry.written:
                entry.default = entry.value

    def reset(self, first: int = 0, last: int = 0xFFFF) -> None:
        """Default values for the objects first … last, as after switching on."""
        for entry in self._entries.values():
            if first <= entry.index <= last:
                entry.value = entry.default
                entry.written = False

    def read(self, index: int, subindex: int) -> bytes:
        """Return a value as it is transferred.

        Raises:
            SdoAbort: it cannot be read.
        """
        entry = self.find(index, subindex)
        if not entry.readable:
            raise SdoAbort(Abort.WRITE_ONLY)
        return struct.pack(f"<{entry.packing}", entry.value) if entry.packing else entry.text

    def write(self, index: int, subindex: int, raw: bytes) -> None:
        """Take a value as it was transferred.

        Raises:
            SdoAbort: it cannot be written, or does not fit.
        """
        entry = self.find(index, subindex)
        if not entry.writable or not entry.packing:
            raise SdoAbort(Abort.READ_ONLY)
        if 8 * len(raw) != entry.bits:
            raise SdoAbort(Abort.LENGTH_TOO_HIGH if 8 * len(raw) > entry.bits else Abort.LENGTH_TOO_LOW)
        value: int = struct.unpack(f"<{entry.packing}", raw)[0]
        if value > entry.greatest:
            raise SdoAbort(Abort.VALUE_TOO_HIGH)
        if value < entry.least:
            raise SdoAbort(Abort.VALUE_TOO_LOW)
        if entry.check is not None:
            entry.check(value)
        entry.value = value
        entry.written = True
        if entry.action is not None:
            entry.action(value)


def _check_signature(value: int) -> None:
    if value != SAVE:
        raise SdoAbort(Abort.NOT_STORED)


@functools.lru_cache(maxsize=32)
def _described(node: int) -> tuple[frozenset[int], tuple[Entry, ...]]:
    """Read the shipped EDS file, which takes ten times as long as making a node of it.

    Returns:
        The indices of its objects, and their entries: to be copied, for they hold the values of a node.
    """
    text = resources.files("mcserver.drive_sim").joinpath(EDS).read_text("ascii")
    variables = parse_description(text, node).dictionary.variables
    entries = tuple(_entry(variable) for variable in variables if variable.index >= 0x1000)
    return frozenset(entry.index for entry in entries), entries


def _entry(variable: ODVariable) -> Entry:
    packing = FORMATS.get(variable.data_type or 0, "")
    bits = 8 * struct.calcsize(f"<{packing}")
    access = variable.access_type
    signed = packing.islower()
    least = variable.min if variable.min is not None else (-(1 << (bits - 1)) if signed else 0) if bits else 0
    greatest = variable.max if variable.max is not None else (1 << (bits - signed)) - 1 if bits else 0
    default, text = variable.default, b""
    if not packing:
        text, default = str(default or "").encode("latin-1", "replace"), 0
    number = int(default or 0)
    mappable = variable.pdo_mappable
    return Entry(
        index=variable.index,
        subindex=variable.subindex,
        packing=packing,
        bits=bits if packing else 0,
        readable="r" in access or access == "const",
        writable="w" in access,
        mappable_in=mappable and access in ("rw", "rww", "wo"),
        mappable_out=mappable and access in ("ro", "rw", "rwr", "const"),
        least=least,
        greatest=greatest,
        default=number,
        text=text,
        value=number,
    )
