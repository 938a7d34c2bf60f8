"""What is written into a drive at boot-up, as a list: from the machine file, the cycle and the dictionary.

Process data go by `mcserver.can.pdo_layout`; the order of writing them is CiA 301's (7.5.2.36): COB-ID
invalid, number of entries 0, entries, number, transmission type, COB-ID valid.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from canopen.objectdictionary import ObjectDictionary, ObjectDictionaryError, ODVariable, datatypes

from mcserver.can.cob import Function
from mcserver.can.pdo_layout import RPDOS, TPDOS, Pdo
from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.settings import DriveSettings
from mcserver.canopen.values import pack_number
from mcserver.errors import ConfigurationError

INVALID = 1 << 31
NO_REMOTE_REQUEST = 1 << 30
PDOS = 4
PDO_OBJECTS = range(0x1400, 0x1C00)
# What else follows from the machine file: watching, command, mode, targets, scaling, cycle.
OWN_OBJECTS = frozenset(
    {0x1016, 0x1017, 0x6040, 0x6060, 0x6071, 0x607A, 0x608F, 0x6091, 0x6092, 0x60C2, 0x60FF}
)
# The drive gives up on a master that is silent for so long [ms].
MASTER_HEARTBEAT_TIMEOUT_MS = 1000
# 6007h: what a drive does when communication is lost (CiA 402: 3 = quick stop).
QUICK_STOP_ON_LOSS = 3
# A cycle that 60C2h says less exactly than this would make the drive interpolate to another time.
_CYCLE_ACCURACY = 1e-4

_RPDO_BASES = (Function.RPDO1, Function.RPDO2, Function.RPDO3, Function.RPDO4)
_TPDO_BASES = (Function.TPDO1, Function.TPDO2, Function.TPDO3, Function.TPDO4)


@dataclass(frozen=True)
class SdoWrite:
    """One object to write.

    Attributes:
        payload: little endian, of the object's length. what: in words, for messages.
        optional: a device without the object is as good.
    """

    index: int
    subindex: int
    payload: bytes
    what: str
    optional: bool = False


def configuration_writes(
    drive: DriveSettings, cycle_s: float, dictionary: ObjectDictionary, master: int
) -> list[SdoWrite]:
    """Everything to write into one CiA 402 drive between pre-operational and operational, in order.

    Args:
        cycle_s: time between two SYNCs [s]. dictionary: of an EDS, or the generic one.
        master: node of the heartbeat that the drive watches.

    Raises:
        ConfigurationError: MC552 the drive has no place for what has to be written.
    """
    writer = _Writer(drive, dictionary)
    return [
        *writer.dcf(),
        *writer.heartbeats(master),
        *writer.process_data(),
        *writer.profile(cycle_s),
        *writer.extra(),
    ]


def interpolation_period(cycle_s: float) -> tuple[int, int]:
    """60C2h: (mantissa 1 … 255, exponent) with mantissa · 10^exponent = cycle [s] (CiA 402).

    Raises:
        ConfigurationError: MC552 there is none.
    """
    for exponent in range(0, -7, -1):
        mantissa = round(cycle_s * 10.0**-exponent)
        if 1 <= mantissa <= 255 and abs(mantissa * 10.0**exponent / cycle_s - 1.0) < _CYCLE_ACCURACY:
            return mantissa, exponent
    raise ConfigurationError(
        "MC552",
        f"drives cannot be told a cycle of {cycle_s * 1e3:.6g} ms: 60C2h holds 1 … 255 times a power of ten",
        "set cycle_hz = 100, 125, 200, 250, 400, 500 or 1000",
    )


class _Writer:
    def __init__(self, drive: DriveSettings, dictionary: ObjectDictionary) -> None:
        self._drive = drive
        self._dictionary = dictionary

    def dcf(self) -> Iterator[SdoWrite]:
        """Values of a DCF, but for those of communication that this server itself arranges."""
        for index in self._dictionary:
            if index < 0x1000 or index in PDO_OBJECTS or 0x1200 <= index < 0x1300 or index in OWN_OBJECTS:
                continue
            entry = self._dictionary[index]
            for variable in (entry,) if isinstance(entry, ODVariable) else tuple(entry.values()):
                if variable.value is not None and variable.writable:
                    yield SdoWrite(
                        index, variable.subindex, self._payload(variable), f"{variable.name} of the DCF"
                    )

    def heartbeats(self, master: int) -> Iterator[SdoWrite]:
        yield self._number(0x1017, 0, self._drive.heartbeat_ms, "heartbeat time [ms]")
        watched = master << 16 | MASTER_HEARTBEAT_TIMEOUT_MS
        yield from self._if_there(0x1016, 1, watched, "heartbeat of the master to watch")

    def process_data(self) -> Iterator[SdoWrite]:
        for number in range(1, PDOS + 1):
            yield from self._pdo("RPDO", number, 0x1400, 0x1600, _RPDO_BASES, RPDOS)
        for number in range(1, PDOS + 1):
            yield from self._pdo("TPDO", number, 0x1800, 0x1A00, _TPDO_BASES, TPDOS)

    def profile(self, cycle_s: float) -> Iterator[SdoWrite]:
        drive = self._drive
        yield from self._if_there(0x6007, 0, QUICK_STOP_ON_LOSS, "what to do when the master is silent")
        for index, subindex, value in drive.scaling:
            yield from self._if_there(index, subindex, value, "scaling to increments")
        mantissa, exponent = interpolation_period(cycle_s)
        yield from self._if_there(0x60C2, 1, mantissa, "interpolation time")
        yield from self._if_there(0x60C2, 2, exponent, "interpolation time, power of ten")
        yield self._number(0x6060, 0, drive.mode, "mode of operation")

    def extra(self) -> Iterator[SdoWrite]:
        for write in self._drive.sdo_writes:
            index, subindex, value = write[:3]
            name = f"sdo_writes {object_text(index, subindex)}"
            if index in PDO_OBJECTS or index in OWN_OBJECTS:
                raise self._no_place(
                    index,
                    subindex,
                    "sdo_writes names it, but this server writes it itself",
                    "take it out; what it holds follows from the other keys of the machine file",
                )
            if len(write) > 3:
                yield SdoWrite(index, subindex, self._sized(index, subindex, value, write[3]), name)
            else:
                yield self._number(index, subindex, value, name)

    # ------------------------------------------------------------ one PDO

    def _pdo(
        self,
        kind: str,
        number: int,
        communication: int,
        mapping: int,
        bases: tuple[Function, ...],
        used: tuple[Pdo, ...],
    ) -> Iterator[SdoWrite]:
        communication += number - 1
        mapping += number - 1
        cob = bases[number - 1] + self._drive.node
        if kind == "TPDO":
            # remote frames are not for drives, and some devices refuse a COB-ID that allows them
            cob |= NO_REMOTE_REQUEST
        name = f"{kind}{number}"
        off = _unsigned32(INVALID | cob)
        pdo = next((pdo for pdo in used if pdo.number == number), None)
        if pdo is None:
            if self._has(communication, 1):
                yield SdoWrite(communication, 1, off, f"{name} off", optional=True)
            return
        self._must_have(communication, 1)
        yield SdoWrite(communication, 1, off, f"{name} off")
        yield from self._mapping(name, mapping, pdo)
        yield self._number(communication, 2, pdo.transmission, f"{name} transmission type")
        if kind == "RPDO":
            # Only RPDO1 is watched: RPDO2 stays out in position mode.
            timeout = self._drive.command_timeout_ms if number == 1 else 0
            if self._has(communication, 5):
                payload = struct.pack("<H", timeout)
                yield SdoWrite(communication, 5, payload, f"{name} time-out [ms]", optional=True)
        yield SdoWrite(communication, 1, _unsigned32(cob), f"{name} on")

    def _mapping(self, name: str, mapping: int, pdo: Pdo) -> Iterator[SdoWrite]:
        self._must_have(mapping, 0)
        values = [entry.index << 16 | entry.subindex << 8 | entry.bits for entry in pdo.entries]
        count = self._variable(mapping, 0)
        if count is not None and not count.writable:
            # fixed in the device: as good where it is what is needed
            fixed = [
                getattr(self._variable(mapping, at), "default", None) for at in range(1, len(values) + 1)
            ]
            if fixed == values and count.default in (None, len(values)):
                return
            raise self._no_place(
                mapping,
                0,
                f"{name} cannot be mapped by the master: the EDS says it is fixed",
                "ask the maker for a firmware or an EDS with variable mapping",
            )
        for entry in pdo.entries:
            self._must_have(entry.index, entry.subindex)
        yield SdoWrite(mapping, 0, b"\x00", f"{name} without entries")
        for at, value in enumerate(values, 1):
            entry = pdo.entries[at - 1]
            what = f"{name} entry {at}: {object_text(entry.index, entry.subindex)}"
            yield SdoWrite(mapping, at, _unsigned32(value), what)
        yield SdoWrite(mapping, 0, bytes([len(values)]), f"{name} number of entries")

    # ------------------------------------------------------------ objects

    def _variable(self, index: int, subindex: int) -> ODVariable | None:
        entry = self._dictionary.indices.get(index)
        if entry is None:
            return None
        if isinstance(entry, ODVariable):
            return entry if subindex == 0 else None
        # an array's get() invents members that the file does not name
        member: ODVariable | None = entry.subindices.get(subindex)
        if member is None and subindex > 0 and type(entry).__name__ == "ODArray" and 1 in entry.subindices:
            member = entry[subindex]
        return member

    def _has(self, index: int, subindex: int) -> bool:
        return self._variable(index, subindex) is not None

    def _must_have(self, index: int, subindex: int) -> ODVariable:
        variable = self._variable(index, subindex)
        if variable is None:
            raise self._no_place(
                index,
                subindex,
                "the EDS does not have it",
                "check that `eds` names this drive's file; without `eds` the standard's objects are assumed",
            )
        return variable

    def _if_there(self, index: int, subindex: int, value: int, what: str) -> Iterator[SdoWrite]:
        variable = self._variable(index, subindex)
        if variable is not None and variable.writable:
            write = self._number(index, subindex, value, what)
            yield SdoWrite(index, subindex, write.payload, what, optional=True)

    def _number(self, index: int, subindex: int, value: int, what: str) -> SdoWrite:
        variable = self._must_have(index, subindex)
        kind = variable.data_type
        if kind not in datatypes.INTEGER_TYPES:
            raise self._no_place(
                index,
                subindex,
                f"{what}: the object holds no whole number",
                "give the length in bytes as the fourth number, or check `eds`",
            )
        if value < 0 and kind in datatypes.UNSIGNED_TYPES:
            value += 1 << len(variable)
        try:
            return SdoWrite(index, subindex, pack_number(kind, value), what)
        except ValueError as error:
            raise self._no_place(index, subindex, f"{what}: {error}", "give a value that fits") from error

    def _payload(self, variable: ODVariable) -> bytes:
        assert variable.value is not None
        try:
            return bytes(variable.encode_raw(variable.value))
        except (ValueError, TypeError, ObjectDictionaryError) as error:
            raise self._no_place(
                variable.index,
                variable.subindex,
                f"the ParameterValue {variable.value!r} is no value of its type: {error}",
                "mend it in the DCF",
            ) from error

    def _sized(self, index: int, subindex: int, value: int, length: int) -> bytes:
        try:
            return value.to_bytes(length, "little", signed=value < 0)
        except (OverflowError, ValueError) as error:
            raise self._no_place(
                index, subindex, f"{value} has no room in {length} bytes", "give a longer length"
            ) from error

    def _no_place(self, index: int, subindex: int, what: str, remedy: str) -> ConfigurationError:
        drive = self._drive
        return ConfigurationError(
            "MC552",
            f"{drive.name}: {object_text(index, subindex)}: {what}",
            remedy,
        )


def _unsigned32(value: int) -> bytes:
    return struct.pack("<I", value)
