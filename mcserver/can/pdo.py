"""Process data objects as they are agreed between a master and a node (CiA 301, 7.2.2)."""

from __future__ import annotations

import msgspec


class MappedObject(msgspec.Struct, frozen=True):
    """One object in a PDO's mapping (1600h, 1A00h): index, subindex, length in bits."""

    index: int
    subindex: int
    bits: int

    @property
    def word(self) -> int:
        """The mapping entry as a 32-bit number."""
        return self.index << 16 | self.subindex << 8 | self.bits


class MappedPdo(msgspec.Struct, frozen=True):
    """One PDO of a node.

    Attributes:
        number: of its parameter records, from 1 (1400h, 1800h). cob_id: that it is sent with.
        objects: in order. transmission: type (1400h:02): n = at every n-th SYNC; 254, 255: by events.
    """

    number: int
    cob_id: int
    objects: tuple[MappedObject, ...]
    transmission: int

    @property
    def length(self) -> int:
        """Bytes of the payload."""
        return sum(mapped.bits for mapped in self.objects) // 8

    def offset(self, index: int, subindex: int = 0) -> int | None:
        """Byte at which an object begins; None where it is not mapped, or not on a whole byte."""
        bits = 0
        for mapped in self.objects:
            if (mapped.index, mapped.subindex) == (index, subindex):
                return bits // 8 if bits % 8 == 0 else None
            bits += mapped.bits
        return None


class ProcessData(msgspec.Struct, frozen=True):
    """The PDOs of one axis, from the master to the drive and back."""

    rpdos: tuple[MappedPdo, ...]
    tpdos: tuple[MappedPdo, ...]
