"""From an EDS or DCF file to the object dictionary of one node."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from canopen.objectdictionary import ODArray, ODRecord, ODVariable, datatypes

from mcserver.canopen.dictionary import Description, DeviceDictionary
from mcserver.canopen.eds_text import Section, fault, number_of, sections_of
from mcserver.errors import ConfigurationError

# Object codes (CiA 301, table 42).
_DOMAIN, _DEFTYPE, _DEFSTRUCT, _VARIABLE, _ARRAY, _RECORD = 0x2, 0x5, 0x6, 0x7, 0x8, 0x9
_ACCESS = ("ro", "wo", "rw", "rwr", "rww", "const")
_OBJECT = re.compile(r"[0-9a-f]{4}")
_MEMBER = re.compile(r"([0-9a-f]{4})sub([0-9a-f]{1,2})")
_MAX_MEMBERS = 255


def parse_description(text: str, node: int, source: str = "EDS") -> Description:
    """Read the device that an EDS or DCF file describes.

    Args:
        node: what ``$NODEID`` stands for.

    Raises:
        ConfigurationError: MC008 it is no EDS file.
    """
    sections = sections_of(text, source)
    dictionary = DeviceDictionary()
    dictionary.node_id = node
    reader = _Reader(sections, node, source, dictionary)
    for name, section in sections.items():
        if _OBJECT.fullmatch(name):
            with reader.keeping(int(name, 16), 0, section):
                reader.add_object(int(name, 16), section)
    for name, section in sections.items():
        member = _MEMBER.fullmatch(name)
        if member is not None:
            place = int(member[1], 16), int(member[2], 16)
            with reader.keeping(*place, section):
                reader.add_member(*place, section)
    if len(dictionary) == 0 and not dictionary.unreadable:
        raise fault(
            source, "", "", "holds no object: there is no section such as [1000]", "is it an EDS file?"
        )
    commissioning = sections.get("devicecomissioning", sections.get("devicecommissioning"))
    made_for = reader.number(commissioning, "NodeID") if commissioning is not None else None
    return Description(dictionary, made_for, tuple(reader.ignored))


class _Reader:
    def __init__(
        self, sections: dict[str, Section], node: int, source: str, dictionary: DeviceDictionary
    ) -> None:
        self._sections = sections
        self._node = node
        self._source = source
        self._dictionary = dictionary
        self.ignored: list[str] = []

    @contextmanager
    def keeping(self, index: int, subindex: int, section: Section) -> Iterator[None]:
        """Keep what is wrong with one object, so that the others are read.

        Raises:
            ConfigurationError: MC008 the object has a value of a DCF, which would be written.
        """
        try:
            yield
        except ConfigurationError as error:
            if section.text("ParameterValue"):
                raise
            self._dictionary.unreadable.setdefault((index, subindex), error)

    def add_object(self, index: int, section: Section) -> None:
        code = self.number(section, "ObjectType")
        if code is None:
            # CiA 306, 4.6.3.2: without the keyword it is a variable
            code = _VARIABLE
        name = section.text("ParameterName") or f"{index:04X}"
        compact = self.number(section, "CompactSubObj") or 0
        if code in (_DEFTYPE, _DEFSTRUCT):
            return
        if code not in (_ARRAY, _RECORD):
            self._dictionary.add_object(self._variable(section, index, 0, domain=code == _DOMAIN))
            return
        entry: ODArray | ODRecord = (ODArray if code == _ARRAY else ODRecord)(name, index)
        self._dictionary.add_object(entry)
        if compact:
            self._add_compact(entry, section, min(compact, _MAX_MEMBERS))

    def add_member(self, index: int, subindex: int, section: Section) -> None:
        entry = self._dictionary.indices.get(index)
        if entry is None:
            if f"{index:04x}" in self._sections:
                # members of a type's definition, or of an object that cannot be read
                return
            entry = ODRecord(f"{index:04X}", index)
            self._dictionary.add_object(entry)
        if isinstance(entry, ODVariable):
            self.ignored.append(f"[{section.name}] is a member of a variable")
            return
        entry.add_member(self._variable(section, index, subindex, domain=False))

    def _add_compact(self, entry: ODArray | ODRecord, section: Section, count: int) -> None:
        """CiA 306, 4.6.3.3: all members are alike; names and values may stand in sections of their own."""
        names = self._sections.get(f"{entry.index:04x}name")
        values = self._sections.get(f"{entry.index:04x}value")
        number = ODVariable("Number of entries", entry.index, 0)
        number.data_type = datatypes.UNSIGNED8
        number.access_type = "ro"
        number.default = count
        entry.add_member(number)
        for subindex in range(1, count + 1):
            member = self._variable(section, entry.index, subindex, domain=False)
            written = names.text(str(subindex)) if names is not None else ""
            member.name = written or f"{entry.name}_{subindex:x}"
            if values is not None and values.text(str(subindex)):
                member.value = self._value(member, values, str(subindex))
            entry.add_member(member)

    def _variable(self, section: Section, index: int, subindex: int, *, domain: bool) -> ODVariable:
        place = f"{index:04X}" + (f"sub{subindex:X}" if subindex else "")
        variable = ODVariable(section.text("ParameterName") or place, index, subindex)
        kind = self.number(section, "DataType")
        if kind is None:
            if not (domain or self.number(section, "ObjectType") == _DOMAIN):
                raise self._fault(
                    section, "DataType", "is missing", "write the object's type, such as DataType=0x0007"
                )
            kind = datatypes.DOMAIN
        variable.data_type = self._basic_type(kind)
        access = section.text("AccessType").lower() or "rw"
        if access not in _ACCESS:
            raise self._fault(
                section, "AccessType", f"{access!r} is unknown", f"use one of {', '.join(_ACCESS)}"
            )
        variable.access_type = access
        variable.pdo_mappable = bool(self.number(section, "PDOMapping"))
        variable.relative = "$NODEID" in section.text("DefaultValue").upper()
        variable.min = self._limit(variable, section, "LowLimit")
        variable.max = self._limit(variable, section, "HighLimit")
        variable.default = self._value(variable, section, "DefaultValue")
        variable.value = self._value(variable, section, "ParameterValue")
        return variable

    def _basic_type(self, kind: int) -> int:
        """Types of the file's own (CANfestival's ``[A0]``) stand for what their sub 1 says."""
        if kind <= datatypes.UNSIGNED64:
            return kind
        own = self._sections.get(f"{kind:x}sub1", self._sections.get(f"{kind:04x}sub1"))
        if own is not None:
            basic = self.number(own, "DefaultValue")
            if basic is not None and 0 < basic <= datatypes.UNSIGNED64:
                return basic
        return datatypes.DOMAIN

    def _limit(self, variable: ODVariable, section: Section, key: str) -> int | None:
        if variable.data_type not in datatypes.INTEGER_TYPES:
            return None
        try:
            value: int | None = self._value(variable, section, key)
        except ConfigurationError:
            # the device keeps its own limits
            self.ignored.append(f"[{section.name}] {key} is no value of its type")
            return None
        return value

    def _value(self, variable: ODVariable, section: Section, key: str) -> Any:
        """Return a number, text or bytes as the type says; None where the key is missing or empty."""
        text = section.text(key)
        kind = variable.data_type
        if not text:
            return None
        try:
            if kind in (datatypes.VISIBLE_STRING, datatypes.UNICODE_STRING):
                return text.strip('"')
            if kind in datatypes.FLOAT_TYPES:
                return _real(text, 4 if kind == datatypes.REAL32 else 8)
            if kind in datatypes.INTEGER_TYPES:
                return self._integer(variable, number_of(text, self._node))
            if kind == datatypes.BOOLEAN:
                return int(text.lower() == "true" or (text.lower() != "false" and number_of(text, 0) != 0))
            return bytes.fromhex(re.sub(r"^0[xX]", "", text).replace(" ", ""))
        except ValueError as error:
            if kind in datatypes.INTEGER_TYPES or kind in datatypes.FLOAT_TYPES or key == "ParameterValue":
                raise self._fault(
                    section, key, f"{text!r} is no value of its type ({error})", "correct the value there"
                ) from error
            # what a default of a string of bytes means is the writer's secret
            return None

    def _integer(self, variable: ODVariable, number: int) -> int:
        bits = len(variable)
        signed = variable.data_type in datatypes.SIGNED_TYPES
        if signed and 1 << (bits - 1) <= number < 1 << bits:
            # written as the hexadecimal of its two's complement
            number -= 1 << bits
        lowest, highest = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
        if not signed and -(1 << (bits - 1)) <= number < 0:
            number += 1 << bits
        if not lowest <= number <= highest:
            raise ValueError(f"{number} does not fit into {bits} bits")
        return number

    def number(self, section: Section, key: str) -> int | None:
        """Return a whole number; None where the key is missing or empty."""
        text = section.text(key)
        if not text:
            return None
        try:
            return number_of(text, self._node)
        except ValueError as error:
            raise self._fault(section, key, f"{text!r} is no number", "write such as 7 or 0x7") from error

    def _fault(self, section: Section, key: str, what: str, remedy: str) -> ConfigurationError:
        shown = section.entries[key.lower()][0] if key.lower() in section.entries else key
        return fault(self._source, section.name, shown, f"{what} (section at line {section.line})", remedy)


def _real(text: str, length: int) -> float:
    """Read a floating-point number, also written as the hexadecimal of its IEEE 754 bits.

    Raises:
        ValueError: it is neither.
    """
    if re.fullmatch(r"0[xX][0-9a-fA-F]+", text):
        bits = int(text, 16)
        if bits >> 8 * length:
            raise ValueError(f"{text} does not fit into {length} bytes")
        (value,) = struct.unpack("<f" if length == 4 else "<d", bits.to_bytes(length, "little"))
        return float(value)
    return float(text.replace(",", "."))
