"""Abort codes of SDO transfers in words (CiA 301, table 22), what helps, and faults of transfers."""

from __future__ import annotations

from types import MappingProxyType

from canopen.sdo.exceptions import SdoAbortedError

from mcserver.canopen.canopen_errors import DriveError, object_text
from mcserver.canopen.settings import DriveSettings

NO_SUCH_OBJECT = 0x0602_0000
NO_SUCH_SUBINDEX = 0x0609_0011
UNSUPPORTED_ACCESS = 0x0601_0000
READ_ONLY = 0x0601_0002
# An object that the device has not, or that it lets nobody write.
ABSENT = frozenset({NO_SUCH_OBJECT, NO_SUCH_SUBINDEX, UNSUPPORTED_ACCESS, READ_ONLY})
# A value that the device does not take.
OUT_OF_RANGE = frozenset({0x0609_0030, 0x0609_0031, 0x0609_0032, 0x0800_0000})
# What a drive answers where it cannot exchange an object, or has no such PDO.
UNMAPPABLE = frozenset({*ABSENT, 0x0604_0041, 0x0604_0042, 0x0604_0043, 0x0606_0000, 0x0800_0000})

_REMEDIES = MappingProxyType(
    {
        0x0504_0000: "the drive is busy or the bus is overloaded: try again, see `mcserver doctor --machine`",
        0x0504_0005: "the drive has no memory left: switch it off and on",
        UNSUPPORTED_ACCESS: "the drive does not let this object be reached: see its manual",
        0x0601_0001: "the object can only be written",
        READ_ONLY: "the object can only be read",
        NO_SUCH_OBJECT: "the drive has no such object: see its EDS file, and give it by `eds`",
        0x0604_0041: "the drive cannot map this object: it may need another mode or newer firmware",
        0x0604_0042: "the drive's PDO is too short for this",
        0x0606_0000: "a fault of the drive's hardware: see its manual",
        0x0607_0010: "another length is expected: see its EDS file, and give the type",
        0x0607_0012: "the value is too long: see its EDS file, and give the type",
        0x0607_0013: "the value is too short: see its EDS file, and give the type",
        NO_SUCH_SUBINDEX: "the drive has no such subindex: see its EDS file, and give it by `eds`",
        0x0609_0030: "the value is out of the drive's range: see its EDS file",
        0x0609_0031: "the value is too high for the drive: see its EDS file",
        0x0609_0032: "the value is too low for the drive: see its EDS file",
        0x0800_0021: "the drive is under local control: end that at the drive or in its own software",
        0x0800_0022: "the drive's state does not allow it now: it may have to be off (G1001)",
    }
)


def abort_text(code: int) -> str:
    """``0602 0000h, object does not exist``."""
    text = SdoAbortedError.CODES.get(code, "unknown to the standard: see the drive's manual")
    return f"abort {code >> 16:04X} {code & 0xFFFF:04X}h, {text[0].lower()}{text[1:]}"


def abort_remedy(code: int) -> str:
    """Return what helps against an abort."""
    return _REMEDIES.get(code, "see the drive's manual for this object and code")


def refused(drive: DriveSettings, index: int, subindex: int, verb: str, code: int) -> DriveError:
    """Return MC553 of an object that a drive refuses; ``verb``: read or written."""
    return drive.fault(
        "MC553",
        f"{object_text(index, subindex)} cannot be {verb}: {abort_text(code)}",
        abort_remedy(code),
        index=index,
        subindex=subindex,
        abort_code=code,
    )


def unanswered(drive: DriveSettings, index: int, subindex: int, what: str, remedy: str) -> DriveError:
    """Return MC554 of an object whose answer stays out."""
    what = f"{object_text(index, subindex)} {what}"
    return drive.fault("MC554", what, remedy, index=index, subindex=subindex)
