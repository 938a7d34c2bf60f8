"""The objects of a device, and those of a CiA 402 drive that comes without an EDS.

Types and places by CiA 301 (1000h … 1A03h) and CiA 402 (6000h ff.).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from canopen.objectdictionary import ObjectDictionary, ODRecord, ODVariable, datatypes

from mcserver.can.cob import RPDOS, TPDOS
from mcserver.can.pdo import MappedObject
from mcserver.errors import ConfigurationError

_U8, _U16, _U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
_I8, _I16, _I32 = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.INTEGER32
_PDOS = 4
_MAPPED = 8

# (index, name, type, access)
_VARIABLES = (
    (0x1000, "Device type", _U32, "ro"),
    (0x1001, "Error register", _U8, "ro"),
    (0x1005, "COB-ID SYNC message", _U32, "rw"),
    (0x1008, "Manufacturer device name", datatypes.VISIBLE_STRING, "const"),
    (0x1009, "Manufacturer hardware version", datatypes.VISIBLE_STRING, "const"),
    (0x100A, "Manufacturer software version", datatypes.VISIBLE_STRING, "const"),
    (0x1014, "COB-ID EMCY", _U32, "rw"),
    (0x1017, "Producer heartbeat time", _U16, "rw"),
    (0x6007, "Abort connection option code", _I16, "rw"),
    (0x603F, "Error code", _U16, "ro"),
    (0x6040, "Controlword", _U16, "rw"),
    (0x6041, "Statusword", _U16, "ro"),
    (0x605A, "Quick stop option code", _I16, "rw"),
    (0x605B, "Shutdown option code", _I16, "rw"),
    (0x605C, "Disable operation option code", _I16, "rw"),
    (0x605D, "Halt option code", _I16, "rw"),
    (0x605E, "Fault reaction option code", _I16, "rw"),
    (0x6060, "Modes of operation", _I8, "rw"),
    (0x6061, "Modes of operation display", _I8, "ro"),
    (0x6064, "Position actual value", _I32, "ro"),
    (0x6065, "Following error window", _U32, "rw"),
    (0x6066, "Following error time out", _U16, "rw"),
    (0x606C, "Velocity actual value", _I32, "ro"),
    (0x6071, "Target torque", _I16, "rw"),
    (0x6072, "Max torque", _U16, "rw"),
    (0x6073, "Max current", _U16, "rw"),
    (0x6075, "Motor rated current", _U32, "rw"),
    (0x6076, "Motor rated torque", _U32, "rw"),
    (0x6077, "Torque actual value", _I16, "ro"),
    (0x6079, "DC link circuit voltage", _U32, "ro"),
    (0x607A, "Target position", _I32, "rw"),
    (0x607C, "Home offset", _I32, "rw"),
    (0x607E, "Polarity", _U8, "rw"),
    (0x607F, "Max profile velocity", _U32, "rw"),
    (0x6080, "Max motor speed", _U32, "rw"),
    (0x6081, "Profile velocity", _U32, "rw"),
    (0x6083, "Profile acceleration", _U32, "rw"),
    (0x6084, "Profile deceleration", _U32, "rw"),
    (0x6085, "Quick stop deceleration", _U32, "rw"),
    (0x6086, "Motion profile type", _I16, "rw"),
    (0x6098, "Homing method", _I8, "rw"),
    (0x609A, "Homing acceleration", _U32, "rw"),
    (0x60B0, "Position offset", _I32, "rw"),
    (0x60B1, "Velocity offset", _I32, "rw"),
    (0x60B2, "Torque offset", _I16, "rw"),
    (0x60F4, "Following error actual value", _I32, "ro"),
    (0x60FD, "Digital inputs", _U32, "ro"),
    (0x60FF, "Target velocity", _I32, "rw"),
    (0x6502, "Supported drive modes", _U32, "ro"),
)
# (index, name, types from subindex 1 on, access)
_RECORDS = (
    (0x1003, "Pre-defined error field", (_U32,) * 8, "ro"),
    (0x1010, "Store parameters", (_U32,) * 4, "rw"),
    (0x1011, "Restore default parameters", (_U32,) * 4, "rw"),
    (0x1016, "Consumer heartbeat time", (_U32,), "rw"),
    (0x1018, "Identity object", (_U32,) * 4, "ro"),
    (0x607D, "Software position limit", (_I32, _I32), "rw"),
    (0x608F, "Position encoder resolution", (_U32, _U32), "rw"),
    (0x6091, "Gear ratio", (_U32, _U32), "rw"),
    (0x6092, "Feed constant", (_U32, _U32), "rw"),
    (0x6099, "Homing speeds", (_U32, _U32), "rw"),
    (0x60C1, "Interpolation data record", (_I32,), "rw"),
    (0x60FE, "Digital outputs", (_U32, _U32), "rw"),
    (0x60C2, "Interpolation time period", (_U8, _I8), "rw"),
)


@dataclass(frozen=True)
class FixedPdo:
    """A PDO that a master can assign and not map.

    Attributes:
        objects: in order; index 0 is padding. excludes: PDOs that are not assigned beside it.
    """

    index: int
    objects: tuple[MappedObject, ...]
    excludes: frozenset[int] = frozenset()


@dataclass(frozen=True)
class CoeDevice:
    """What an ESI file says of a drive on EtherCAT besides its objects.

    Attributes:
        vendor_id, product_code, revision: 1018h.
        outputs, inputs: the PDOs whose mapping a master may write; None: all are fixed.
        fixed_outputs, fixed_inputs: the PDOs of whole bytes that are fixed.
        sync0: it can act at SYNC0 alone.
    """

    vendor_id: int = 0
    product_code: int = 0
    revision: int = 0
    outputs: int | None = 0x1600
    inputs: int | None = 0x1A00
    fixed_outputs: tuple[FixedPdo, ...] = ()
    fixed_inputs: tuple[FixedPdo, ...] = ()
    sync0: bool = True


class DeviceDictionary(ObjectDictionary):
    """The objects that a device has.

    Attributes:
        unreadable: MC008 by (index, subindex) of objects whose entries in the EDS cannot be read. A file of
            thousands of objects is not refused for one of them: whoever uses the object refuses it.
        generic: these are the standard's objects; the device's own are not known.
        coe: what an ESI file says; without one what is usual.
        sha256: of the file; empty for the standard's objects.
    """

    def __init__(self, *, generic: bool = False) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.coe = CoeDevice()
        self.sha256 = ""
        self.unreadable: dict[tuple[int, int], ConfigurationError] = {}
        self.generic = generic

    @property
    def variables(self) -> Iterator[ODVariable]:
        """Its objects without members, and the members of the others, by number."""
        for entry in self.values():
            if isinstance(entry, ODVariable):
                yield entry
            else:
                yield from entry.values()


@dataclass(frozen=True)
class Description:
    """A device as its EDS, DCF or ESI file describes it.

    Attributes:
        dictionary: with `ODVariable.value` set where a DCF gives a ``ParameterValue``.
        commissioned_node: the node that a DCF was made for; None where it does not say.
        ignored: entries that make no sense, and change nothing that is used.
    """

    dictionary: DeviceDictionary
    commissioned_node: int | None = None
    ignored: tuple[str, ...] = ()


def generic_dictionary(node: int) -> DeviceDictionary:
    """Return a dictionary of the standard's objects, with four RPDOs and four TPDOs."""
    dictionary = DeviceDictionary(generic=True)
    dictionary.node_id = node
    for index, name, kind, access in _VARIABLES:
        dictionary.add_object(_variable(name, index, 0, kind, access))
    for index, name, kinds, access in _RECORDS:
        dictionary.add_object(_record(name, index, kinds, access))
    for number in range(_PDOS):
        for communication, mapping, name, cob in (
            (0x1400, 0x1600, "RPDO", RPDOS[number] + node),
            (0x1800, 0x1A00, "TPDO", TPDOS[number] + node),
        ):
            parameter = _record(
                f"{name}{number + 1} communication parameter",
                communication + number,
                (_U32, _U8, _U16, _U8, _U16),
                "rw",
            )
            parameter.subindices[1].default = cob
            parameter.subindices[1].relative = True
            dictionary.add_object(parameter)
            mapped = _record(
                f"{name}{number + 1} mapping parameter", mapping + number, (_U32,) * _MAPPED, "rw"
            )
            mapped.subindices[0].access_type = "rw"
            dictionary.add_object(mapped)
    return dictionary


def _variable(name: str, index: int, subindex: int, kind: int, access: str) -> ODVariable:
    variable = ODVariable(name, index, subindex)
    variable.data_type = kind
    variable.access_type = access
    variable.pdo_mappable = index >= 0x6000
    return variable


def _record(name: str, index: int, kinds: tuple[int, ...], access: str) -> ODRecord:
    record = ODRecord(name, index)
    number = _variable(f"{name}: highest subindex", index, 0, _U8, "ro")
    number.default = len(kinds)
    record.add_member(number)
    for subindex, kind in enumerate(kinds, 1):
        record.add_member(_variable(f"{name}: {subindex}", index, subindex, kind, access))
    return record
