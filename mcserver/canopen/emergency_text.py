"""Emergency messages in words: CiA 301, 7.2.7; the bits of 1001h."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from mcserver.drives.cia402.emergency_codes import emergency_text, is_error

_LAYOUT = struct.Struct("<HB5s")
_REGISTER = (
    "generic",
    "current",
    "voltage",
    "temperature",
    "communication",
    "profile",
    "reserved",
    "maker's",
)


def register_text(register: int) -> str:
    """Return the bits of 1001h: ``voltage, temperature``, or ``clear``."""
    return ", ".join(name for bit, name in enumerate(_REGISTER) if register >> bit & 1) or "clear"


@dataclass(frozen=True)
class Emergency:
    """One emergency message.

    Attributes:
        code: 0: all errors are gone. register: 1001h. vendor: the maker's five bytes.
    """

    code: int
    register: int
    vendor: bytes

    @property
    def cleared(self) -> bool:
        """Whether it says that there is no error any more."""
        return not is_error(self.code)

    @property
    def text(self) -> str:
        """``8611h following error (register: profile; 00 00 00 00 00)``."""
        meaning = "no error any more" if self.cleared else emergency_text(self.code)
        return (
            f"{self.code:04X}h {meaning} (register: {register_text(self.register)}; {self.vendor.hex(' ')})"
        )


def decode_emergency(payload: bytes) -> Emergency | None:
    """Return the message of a frame; None for a frame that is no emergency."""
    if len(payload) != _LAYOUT.size:
        return None
    return Emergency(*_LAYOUT.unpack(payload))
