"""One object of a drive's configuration, and the dictionary that it is made from."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from canopen.objectdictionary import ODVariable, datatypes

from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.profiles import CIA_402, device_text
from mcserver.canopen.settings import DriveSettings
from mcserver.canopen.values import pack_number
from mcserver.errors import ConfigurationError


@dataclass(frozen=True)
class SdoWrite:
    """One object to write.

    Attributes:
        payload: little endian, of the object's length. what: in words, for messages.
        optional: a device without the object is as good.
        unless: nothing is written where the object holds this.
        verify: nothing is written: the object has to hold the payload.
        doubt: with `verify`, where the object holds something else this is only said.
        spare_pdo: name of the PDO that the drive may refuse: it is switched off then, and not used.
        instead: what serves nearly as well, best first, where the value is out of the drive's range.
        remedy: what to do where the drive does not have it or does not take the value; empty: what the abort
            code says.
    """

    index: int
    subindex: int
    payload: bytes
    what: str
    optional: bool = False
    unless: bytes | None = None
    verify: bool = False
    doubt: str = ""
    spare_pdo: str = ""
    instead: tuple[bytes, ...] = ()
    remedy: str = ""


def unsigned32(value: int) -> bytes:
    """Pack a number as UNSIGNED32."""
    return struct.pack("<I", value)


class DriveDictionary:
    """A drive's dictionary with messages that name the drive."""

    def __init__(self, drive: DriveSettings, dictionary: DeviceDictionary) -> None:
        self.drive = drive
        self.objects = dictionary

    def variable(self, index: int, subindex: int = 0) -> ODVariable | None:
        """Return an object, or None; an array's members are there where its first one is.

        Raises:
            ConfigurationError: MC008 the EDS has it in a form that cannot be read.
        """
        for place in ((index, subindex), (index, 0)):
            if place in self.objects.unreadable:
                raise self.objects.unreadable[place]
        entry = self.objects.indices.get(index)
        if entry is None:
            return None
        if isinstance(entry, ODVariable):
            return entry if subindex == 0 else None
        # an array's get() invents members that the file does not name
        member: ODVariable | None = entry.subindices.get(subindex)
        if member is None and subindex > 0 and type(entry).__name__ == "ODArray" and 1 in entry.subindices:
            member = entry[subindex]
        return member

    def has(self, index: int, subindex: int = 0) -> bool:
        """Return whether the drive has an object."""
        return self.variable(index, subindex) is not None

    def writable(self, index: int, subindex: int = 0) -> bool:
        """Return whether the drive has an object that can be written."""
        variable = self.variable(index, subindex)
        return variable is not None and variable.writable

    def default(self, index: int, subindex: int = 0) -> int | None:
        """Return the value that the EDS gives, or the DCF; None where neither has one."""
        variable = self.variable(index, subindex)
        if variable is None:
            return None
        value = variable.default if variable.value is None else variable.value
        return value if isinstance(value, int) else None

    def must_have(self, index: int, subindex: int = 0) -> ODVariable:
        """Return an object.

        Raises:
            ConfigurationError: MC552 the drive does not have it.
        """
        variable = self.variable(index, subindex)
        if variable is None:
            raise self.no_place(
                index,
                subindex,
                f"the EDS does not have it{self.other_device}",
                "check that `eds` names this drive's file; without `eds` the standard's objects are assumed",
            )
        return variable

    @property
    def device_type(self) -> int | None:
        """1000h by the EDS; None where it does not say it, or not as a number: the drive itself is asked."""
        return None if (0x1000, 0) in self.objects.unreadable else self.default(0x1000)

    @property
    def other_device(self) -> str:
        """What the EDS is of, in words, where it is not of a drive."""
        device_type = self.device_type
        if device_type is None or device_type & 0xFFFF == CIA_402 or self.drive.kind != "cia402":
            return ""
        return f": it is of {device_text(device_type)}, not of a drive"

    def number(self, index: int, subindex: int, value: int, what: str, *, optional: bool = False) -> SdoWrite:
        """Make the write of a number.

        Raises:
            ConfigurationError: MC552 the object is not there, or does not hold the number.
        """
        variable = self.must_have(index, subindex)
        kind = variable.data_type
        if kind not in datatypes.INTEGER_TYPES:
            raise self.no_place(
                index,
                subindex,
                f"{what}: the object holds no whole number",
                "give the length in bytes as the fourth number, or check `eds`",
            )
        if value < 0 and kind in datatypes.UNSIGNED_TYPES:
            value += 1 << len(variable)
        try:
            return SdoWrite(index, subindex, pack_number(kind, value), what, optional)
        except ValueError as error:
            raise self.no_place(index, subindex, f"{what}: {error}", "give a value that fits") from error

    def if_there(self, index: int, subindex: int, value: int, what: str) -> list[SdoWrite]:
        """Make the write of a number; none where the object is not there or cannot be written."""
        if not self.writable(index, subindex):
            return []
        return [self.number(index, subindex, value, what, optional=True)]

    def no_place(self, index: int, subindex: int, what: str, remedy: str) -> ConfigurationError:
        """Make the refusal of an object."""
        return ConfigurationError(
            "MC552", f"{self.drive.name}: {object_text(index, subindex)}: {what}", remedy
        )
