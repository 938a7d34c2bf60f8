"""From an ESI file (EtherCAT Slave Information, ETG.2000) to the object dictionary of one drive."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import Element

from canopen.objectdictionary import ODRecord, ODVariable, datatypes

from mcserver.can.pdo import MappedObject
from mcserver.canopen.dictionary import (
    CoeDevice,
    Description,
    DeviceDictionary,
    FixedPdo,
    generic_dictionary,
)
from mcserver.canopen.eds_text import fault
from mcserver.canopen.esi_xml import esi_root
from mcserver.errors import ConfigurationError

# ETG.1020, table 3: names of base types.
_TYPES = MappingProxyType(
    {
        "BOOL": datatypes.BOOLEAN,
        "BIT": datatypes.BOOLEAN,
        "SINT": datatypes.INTEGER8,
        "INT": datatypes.INTEGER16,
        "INT24": datatypes.INTEGER24,
        "DINT": datatypes.INTEGER32,
        "LINT": datatypes.INTEGER64,
        "USINT": datatypes.UNSIGNED8,
        "BYTE": datatypes.UNSIGNED8,
        "BITARR8": datatypes.UNSIGNED8,
        "UINT": datatypes.UNSIGNED16,
        "WORD": datatypes.UNSIGNED16,
        "BITARR16": datatypes.UNSIGNED16,
        "UINT24": datatypes.UNSIGNED24,
        "UDINT": datatypes.UNSIGNED32,
        "DWORD": datatypes.UNSIGNED32,
        "BITARR32": datatypes.UNSIGNED32,
        "ULINT": datatypes.UNSIGNED64,
        "REAL": datatypes.REAL32,
        "LREAL": datatypes.REAL64,
        "STRING": datatypes.VISIBLE_STRING,
        "UNICODE_STRING": datatypes.UNICODE_STRING,
    }
)
_BITS = re.compile(r"BIT[1-8]")
_ACCESS = ("ro", "wo", "rw")
# A type's own name may stand for another one's; a chain that is longer is a circle.
_MOST_NAMES = 8
_MAX_MEMBERS = 255
# AssignActivate: the clock's unit is on and makes SYNC0; it makes SYNC1 too (ETG.1000.4, register 980h).
_SYNC0, _SYNC1 = 0x0300, 0x0400
# PDOs that a master maps (CiA 301).
_OUTPUTS, _INPUTS = range(0x1600, 0x1800), range(0x1A00, 0x1C00)


@dataclass(frozen=True)
class _Member:
    """A member of a record as its type has it."""

    subindex: int
    name: str
    kind: int
    flags: Element | None


def parse_esi(raw: bytes, node: int, source: str, vendor_id: int = 0, product_code: int = 0) -> Description:
    """Read the drive that an ESI file describes.

    Args:
        vendor_id, product_code: of the drive; 0: the file has but one.

    Raises:
        ConfigurationError: MC008 it cannot be read; MC036 which of its devices is meant is not certain.
    """
    root = esi_root(raw, source)
    device, identity = _chosen(root, source, vendor_id, product_code)
    listed = device.find("Profile/Dictionary/Objects")
    ignored: list[str] = []
    if listed is None:
        dictionary = generic_dictionary(node)
    else:
        dictionary = DeviceDictionary()
        dictionary.node_id = node
        _Reader(device, dictionary, ignored).read(listed)
    dictionary.coe = CoeDevice(
        *identity,
        outputs=_mappable(device, "RxPdo", _OUTPUTS),
        inputs=_mappable(device, "TxPdo", _INPUTS),
        fixed_outputs=tuple(_fixed(device, "RxPdo", _OUTPUTS)),
        fixed_inputs=tuple(_fixed(device, "TxPdo", _INPUTS)),
        sync0=any(_makes_sync0(mode) for mode in device.findall("Dc/OpMode")),
    )
    for entry in device.iterfind("./*/Entry"):
        _note_mapped(dictionary, entry)
    return Description(dictionary, ignored=tuple(ignored))


def _chosen(
    root: Element, source: str, vendor_id: int, product_code: int
) -> tuple[Element, tuple[int, int, int]]:
    """Return the newest revision of the one product that is meant, with vendor, product and revision."""
    vendor = _number(root.findtext("Vendor/Id"))
    if vendor_id and vendor not in (None, vendor_id):
        raise _uncertain(
            source,
            f"is of the vendor 0x{vendor:08X}, and the drive's is 0x{vendor_id:08X}",
            "give the file of this drive's maker, or correct vendor_id",
        )
    products: dict[int, tuple[int, Element]] = {}
    names: dict[int, str] = {}
    for device in root.iterfind("Descriptions/Devices/Device"):
        kind = device.find("Type")
        product = None if kind is None else _number(kind.get("ProductCode"))
        if kind is None or product is None:
            continue
        revision = _number(kind.get("RevisionNo")) or 0
        names.setdefault(product, (kind.text or "").strip() or _name(device, "unnamed"))
        if product not in products or revision > products[product][0]:
            products[product] = revision, device
    if not products:
        raise fault(source, "", "", "describes no device with a ProductCode", "is it the drive's ESI file?")
    wanted = product_code or (next(iter(products)) if len(products) == 1 else 0)
    if wanted not in products:
        shown = ", ".join(f"0x{each:08X} {names[each]}" for each in list(products)[:6])
        more = f" and {len(products) - 6} more" if len(products) > 6 else ""
        which = f"none of them 0x{wanted:08X}" if wanted else "and product_code does not say which is meant"
        raise _uncertain(
            source,
            f"describes {len(products)} devices, {which}: {shown}{more}",
            "give product_code in [axis.drive]; 1018h:02 of the drive has it",
        )
    revision, device = products[wanted]
    return device, (vendor or 0, wanted, revision)


def _uncertain(source: str, what: str, remedy: str) -> ConfigurationError:
    return ConfigurationError("MC036", f"{source}: {what}", remedy)


def _mappable(device: Element, tag: str, usual: range) -> int | None:
    """Return the first PDO whose mapping a master may write; None: all that there are are fixed."""
    listed = device.findall(tag)
    for pdo in listed:
        index = _number(pdo.findtext("Index"))
        if index in usual and not _is_fixed(pdo):
            return index
    return None if listed else usual.start


def _fixed(device: Element, tag: str, usual: range) -> Iterator[FixedPdo]:
    for pdo in device.findall(tag):
        index = _number(pdo.findtext("Index"))
        objects = tuple(
            MappedObject(*(_number(each.findtext(key)) or 0 for key in ("Index", "SubIndex", "BitLen")))
            for each in pdo.findall("Entry")
        )
        if index is None or index not in usual or not _is_fixed(pdo):
            continue
        if all(each.bits and each.bits % 8 == 0 for each in objects):
            excludes = (_number(each.text) for each in pdo.findall("Exclude"))
            yield FixedPdo(index, objects, frozenset(each for each in excludes if each is not None))


def _is_fixed(pdo: Element) -> bool:
    return (pdo.get("Fixed") or "0").strip().lower() not in ("0", "false")


def _makes_sync0(mode: Element) -> bool:
    activate = _number(mode.findtext("AssignActivate")) or 0
    return activate & (_SYNC0 | _SYNC1) == _SYNC0


def _note_mapped(dictionary: DeviceDictionary, entry: Element) -> None:
    """What a PDO of the file carries can be mapped, whatever the object's own flags say."""
    index, subindex = _number(entry.findtext("Index")), _number(entry.findtext("SubIndex")) or 0
    found = dictionary.indices.get(index or 0)
    variable = found if isinstance(found, ODVariable) else found and found.subindices.get(subindex)
    if isinstance(variable, ODVariable):
        variable.pdo_mappable = True


class _Reader:
    def __init__(self, device: Element, dictionary: DeviceDictionary, ignored: list[str]) -> None:
        self._dictionary = dictionary
        self._ignored = ignored
        self._types: dict[str, Element] = {}
        for each in device.iterfind("Profile/Dictionary/DataTypes/DataType"):
            self._types.setdefault((each.findtext("Name") or "").strip(), each)

    def read(self, objects: Element) -> None:
        for entry in objects.iterfind("Object"):
            index = _number(entry.findtext("Index"))
            if index is None or not 0 < index <= 0xFFFF:
                self._ignored.append(f"an object with the index {entry.findtext('Index')!r}")
            elif index in self._dictionary.indices:
                self._ignored.append(f"{index:04X}h is there twice; the first one counts")
            else:
                self._add(index, entry)

    def _add(self, index: int, entry: Element) -> None:
        name, written = _name(entry, f"{index:04X}"), (entry.findtext("Type") or "").strip()
        found = self._definition(written)
        members = list(self._members(found)) if found is not None else []
        if not members:
            kind = self._basic(written)
            self._dictionary.add_object(
                self._variable(name, index, 0, kind, entry.find("Flags"), entry.find("Info"))
            )
            return
        record = ODRecord(name, index)
        infos = [each.find("Info") for each in entry.findall("Info/SubItem")]
        # an object's values stand in the order of its members
        infos = infos if len(infos) == len(members) else [None] * len(members)
        for member, info in zip(members, infos, strict=True):
            flags = entry.find("Flags") if member.flags is None else member.flags
            record.add_member(self._variable(member.name, index, member.subindex, member.kind, flags, info))
        self._dictionary.add_object(record)

    def _members(self, found: Element) -> Iterator[_Member]:
        """Members in order; those of an array are all alike."""
        following = 0
        for item in found.findall("SubItem"):
            flags, written = item.find("Flags"), (item.findtext("Type") or "").strip()
            definition = self._definition(written)
            array = definition.find("ArrayInfo") if definition is not None else None
            said = _number(item.findtext("SubIdx"))
            if array is None:
                following = following if said is None else said
                if following <= _MAX_MEMBERS:
                    name = _name(item, f"SubIndex {following:03d}")
                    yield _Member(following, name, self._basic(written), flags)
                following += 1
                continue
            assert definition is not None
            kind = self._basic((definition.findtext("BaseType") or "").strip())
            first = _number(array.findtext("LBound"))
            first = following if first is None else first
            count = max(0, min(_number(array.findtext("Elements")) or 0, _MAX_MEMBERS - first + 1))
            for subindex in range(first, first + count):
                yield _Member(subindex, f"SubIndex {subindex:03d}", kind, flags)
            following = first + count

    def _definition(self, name: str) -> Element | None:
        """Return the type of the file's own, through the names that stand for it."""
        for _ in range(_MOST_NAMES):
            found = self._types.get(name)
            base = (found.findtext("BaseType") or "").strip() if found is not None else ""
            if found is None or base not in self._types or _is_made_of(found):
                return found
            name = base
        return None

    def _basic(self, name: str) -> int:
        """Return the data type of CiA 301; bytes where the name has none."""
        for _ in range(_MOST_NAMES):
            plain = name.split("(")[0].split("[")[0].strip().upper()
            if plain in _TYPES:
                return _TYPES[plain]
            if _BITS.fullmatch(plain):
                return int(datatypes.UNSIGNED8)
            found = self._types.get(name)
            base = (found.findtext("BaseType") or "").strip() if found is not None else ""
            if found is None or not base or _is_made_of(found):
                break
            name = base
        return int(datatypes.DOMAIN)

    def _variable(
        self, name: str, index: int, subindex: int, kind: int, flags: Element | None, info: Element | None
    ) -> ODVariable:
        variable = ODVariable(name, index, subindex)
        variable.data_type = kind
        access = ((flags.findtext("Access") if flags is not None else None) or "rw").strip().lower()
        variable.access_type = access if access in _ACCESS else "ro"
        variable.pdo_mappable = bool(flags is not None and (flags.findtext("PdoMapping") or "").strip())
        if info is not None:
            variable.default = self._value(variable, info, "Default")
            if kind in datatypes.INTEGER_TYPES:
                least, greatest = self._value(variable, info, "Min"), self._value(variable, info, "Max")
                # what is filled with zeros has no limits
                if isinstance(least, int) and isinstance(greatest, int) and least < greatest:
                    variable.min = least
                    variable.max = greatest
        return variable

    def _value(self, variable: ODVariable, info: Element, which: str) -> Any:
        """Return a default or a limit; None where the file has none, or one that makes no sense."""
        raw, plain = info.findtext(f"{which}Data"), info.findtext(f"{which}Value")
        try:
            if variable.data_type in (datatypes.VISIBLE_STRING, datatypes.UNICODE_STRING):
                return info.findtext(f"{which}String") or None
            if raw:
                return _of_bytes(variable, bytes.fromhex(raw.strip()))
            number = _number(plain)
            return number if number is None or _fits(variable, number) else None
        except (ValueError, struct.error) as error:
            place = f"{variable.index:04X}h:{variable.subindex:02X}"
            self._ignored.append(f"{which}Data of {place} ({error})")
            return None


def _is_made_of(definition: Element) -> bool:
    """Return whether a type has members, or is an array."""
    return definition.find("SubItem") is not None or definition.find("ArrayInfo") is not None


def _of_bytes(variable: ODVariable, raw: bytes) -> int | float | None:
    """Return a number that is written as its bytes, the least one first."""
    kind = variable.data_type
    if kind in datatypes.FLOAT_TYPES:
        (real,) = struct.unpack("<f" if kind == datatypes.REAL32 else "<d", raw)
        return float(real)
    if kind not in datatypes.INTEGER_TYPES and kind != datatypes.BOOLEAN:
        return None
    number = int.from_bytes(raw, "little")
    if 8 * len(raw) == len(variable) and kind in datatypes.SIGNED_TYPES:
        return int.from_bytes(raw, "little", signed=True)
    # some leave the greater bytes out
    if not _fits(variable, number):
        raise ValueError(f"{raw.hex()} is no value of {len(variable)} bits")
    return number


def _fits(variable: ODVariable, number: int) -> bool:
    bits, signed = len(variable), variable.data_type in datatypes.SIGNED_TYPES
    return -(1 << bits - 1) <= number < 1 << bits - 1 if signed else 0 <= number < 1 << bits


def _name(entry: Element, otherwise: str) -> str:
    """Its English name (LcId 1033), or the first one."""
    names = [each for each in entry.findall("Name") if (each.text or "").strip()]
    english = [each for each in names if each.get("LcId", "1033") == "1033"]
    return ((english or names)[0].text or "").strip() if names else otherwise


def _number(text: str | None) -> int | None:
    """Return a number as ETG.2000 writes it, ``#x1A00`` or decimal; None where it is none."""
    plain = (text or "").strip().lower()
    found = re.fullmatch(r"(?:#x|0x)([0-9a-f]{1,16})|(-?[0-9]{1,20})", plain)
    if found is None:
        return None
    return int(found[1], 16) if found[1] else int(found[2])
