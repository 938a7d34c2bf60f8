"""Emergency messages (CiA 301, 7.2.7; CiA 402 error codes, IEC 61800-7-201 table 8)."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from types import MappingProxyType

# error code, error register; five bytes of the manufacturer follow
_MESSAGE = struct.Struct("<HB")
NO_ERROR = 0x0000

_CLASSES = MappingProxyType(
    {
        0x10: "generic error",
        0x20: "current",
        0x21: "current at the device's input",
        0x22: "current inside the device",
        0x23: "current at the device's output",
        0x30: "voltage",
        0x31: "mains voltage",
        0x32: "voltage of the DC link",
        0x33: "output voltage",
        0x40: "temperature",
        0x41: "ambient temperature",
        0x42: "temperature of the device",
        0x43: "temperature of the drive",
        0x44: "temperature of the supply",
        0x50: "device hardware",
        0x60: "device software",
        0x70: "additional modules",
        0x71: "power: brake or motor",
        0x73: "sensor",
        0x80: "monitoring",
        0x81: "communication",
        0x82: "protocol",
        0x83: "torque control",
        0x84: "velocity control",
        0x85: "position control",
        0x86: "positioning controller",
        0x87: "synchronisation controller",
        0x90: "external error",
        0xF0: "additional functions",
        0xFF: "device specific",
    }
)
_CODES = MappingProxyType(
    {
        0x2310: "continuous over-current",
        0x2320: "short circuit or earth leakage",
        0x2340: "short circuit at the output",
        0x3110: "mains over-voltage",
        0x3120: "mains under-voltage",
        0x3210: "DC link over-voltage",
        0x3220: "DC link under-voltage",
        0x4210: "device too hot",
        0x4310: "drive too hot",
        0x5441: "contactor or enable input",
        0x6320: "parameter error",
        0x7121: "motor blocked",
        0x7305: "incremental encoder 1 faulty",
        0x7306: "incremental encoder 2 faulty",
        0x8110: "CAN overrun: frames lost",
        0x8120: "CAN controller error passive",
        0x8130: "the master's heartbeat is missing",
        0x8140: "recovered from bus off",
        0x8150: "collision of COB-IDs",
        0x8210: "PDO not processed: its length is wrong",
        0x8220: "PDO longer than mapped",
        0x8250: "no commands: the RPDO timed out",
        0x8311: "torque too great",
        0x8400: "velocity control",
        0x8480: "velocity too great",
        0x8500: "position control",
        0x8611: "following error",
        0x8612: "limit of travel",
        0x8700: "SYNC missing or irregular",
    }
)


# ``8611``, ``8611h``, ``0x8611``; x, X, ? and * stand for any digit: ``81xx``
_PATTERN = re.compile(r"(?:0x)?([0-9a-fx?*]{4})h?", re.IGNORECASE)


def is_error(code: int) -> bool:
    """Return whether an error code reports an error; the class 00xxh reports that errors are gone (CiA
    301).
    """
    return code & 0xFF00 != 0


def emergency_pattern(text: str) -> tuple[int, int]:
    """Read a pattern of error codes as (mask, value).

    Raises:
        ValueError: it is no pattern.
    """
    found = _PATTERN.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"{text!r} is no error code: give four hexadecimal digits, x for any")
    mask = value = 0
    for digit in found[1]:
        known = digit not in "xX?*"
        mask = mask << 4 | (0xF if known else 0)
        value = value << 4 | (int(digit, 16) if known else 0)
    return mask, value


@dataclass(frozen=True)
class EmergencyRule:
    """Which emergency messages of a drive stop its axis: those of ``stop_on`` (empty: all), but for those of
    ``warn_on`` that ``stop_on`` does not name.
    """

    stop_on: tuple[tuple[int, int], ...] = ()
    warn_on: tuple[tuple[int, int], ...] = ()

    @classmethod
    def of(cls, stop_on: Iterable[str], warn_on: Iterable[str]) -> EmergencyRule:
        """Make it from patterns such as ``81xx``; raises ValueError as `emergency_pattern` does."""
        return cls(
            tuple(emergency_pattern(text) for text in stop_on),
            tuple(emergency_pattern(text) for text in warn_on),
        )

    def stops(self, code: int) -> bool:
        """Return whether an error code latches a fault."""
        if any(code & mask == value for mask, value in self.stop_on):
            return True
        warned = any(code & mask == value for mask, value in self.warn_on)
        return not self.stop_on and not warned


def unpack_emergency(payload: bytes) -> tuple[int, int] | None:
    """Error code and error register (1001h); None: the payload is not that of an emergency message."""
    return None if len(payload) < _MESSAGE.size else _MESSAGE.unpack_from(payload)


def emergency_text(code: int) -> str:
    """Return what an error code means, as far as the standards say."""
    if code == NO_ERROR:
        return "no error any more"
    text = _CODES.get(code)
    if text is None:
        text = _CLASSES.get(code >> 8) or _CLASSES.get(code >> 8 & 0xF0) or "of the manufacturer"
    return text
