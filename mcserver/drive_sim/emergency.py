"""Emergency messages, their history 1003h and the error register 1001h (CiA 301, 7.2.7)."""

from __future__ import annotations

import struct
from collections.abc import Callable

from mcserver.drive_sim.dictionary import ObjectStore
from mcserver.drive_sim.sdo_abort import Abort, SdoAbort

MESSAGE = struct.Struct("<HB5s")
INVALID = 1 << 31
GENERIC = 0x01
NO_ERROR = 0x0000


class Emergencies:
    """What a node says of its errors."""

    def __init__(self, store: ObjectStore, transmit: Callable[[int, bytes], None]) -> None:
        self._transmit = transmit
        self._identifier = store.entry(0x1014)
        self._register = store.entry(0x1001)
        self._count = store.entry(0x1003, 0)
        self._history = [store.entry(0x1003, number) for number in range(1, 9)]
        self._count.check = self._may_clear
        self._count.action = self._clear_history
        self._active: set[int] = set()

    def raise_error(self, code: int) -> None:
        """An error has come up; sent once, until `clear`."""
        if code in self._active:
            return
        self._active.add(code)
        self._register.value |= register_bits(code)
        for newer, older in zip(self._history[-2::-1], self._history[:0:-1], strict=True):
            older.value = newer.value
        self._history[0].value = code
        self._count.value = min(self._count.value + 1, len(self._history))
        self._tell(code)

    def end_error(self, code: int) -> None:
        """One error is over; sent where it was the last one."""
        if code in self._active:
            self._active.discard(code)
            if self._active:
                self._register.value = 0
                for left in self._active:
                    self._register.value |= register_bits(left)
            else:
                self._register.value = 0
                self._tell(NO_ERROR)

    def clear(self) -> None:
        """No error is left: sent where there was one."""
        if self._active or self._register.value:
            self._active.clear()
            self._register.value = 0
            self._tell(NO_ERROR)

    def forget(self) -> None:
        """As after switching on: nothing is sent."""
        self._active.clear()
        self._register.value = 0

    def _tell(self, code: int) -> None:
        identifier = self._identifier.value
        if not identifier & INVALID:
            self._transmit(identifier & 0x7FF, MESSAGE.pack(code, self._register.value, b""))

    def _may_clear(self, value: int) -> None:
        if value != 0:
            raise SdoAbort(Abort.INVALID_VALUE)

    def _clear_history(self, _value: int) -> None:
        for entry in self._history:
            entry.value = 0


def register_bits(code: int) -> int:
    """Bits of the error register for an error code (CiA 301, tables 26 and 48)."""
    kind = code >> 12
    if kind in (2, 3, 4):
        return GENERIC | 1 << (kind - 1)
    if code >> 8 in (0x81, 0x82):
        return GENERIC | 0x10
    if kind in (7, 8):
        return GENERIC | 0x20
    if kind == 0xF:
        return GENERIC | 0x80
    return GENERIC
