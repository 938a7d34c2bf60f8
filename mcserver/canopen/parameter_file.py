"""A drive's parameters as a file: TOML that people read and change, with the drive's identity.

Codes::

    MC565  a parameter file that cannot be read, or has what is no parameter of the drive
    MC566  parameters of another device
    MC567  parameters that the drive did not take
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping

import msgspec

from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.configuration import is_own_parameter, of_first_axis
from mcserver.canopen.parameters import Parameter
from mcserver.canopen.settings import AXIS_OFFSET
from mcserver.canopen.values import TYPES, Value, decode_value, encode_value
from mcserver.errors import UsageFault

MAX_BYTES = 4 * 1024 * 1024
# Values and commands of a moment: error history, offsets, outputs.
_MOMENTARY = frozenset({0x1003, 0x60B0, 0x60B1, 0x60B2, 0x60FE})
_OBJECT = re.compile(r"([0-9A-F]{4})h:([0-9A-F]{2})", re.I)
Place = tuple[int, int]


class DriveIdentity(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """1018h; None: the drive does not say. ``eds_sha256``: of its file, empty for the standard's objects."""

    vendor_id: int | None = None
    product_code: int | None = None
    revision: int | None = None
    serial: int | None = None
    eds_sha256: str = ""

    def difference(self, other: DriveIdentity) -> str:
        """Why parameters of this device are not for another one, in words; empty: they may be.

        Vendor, product and the greater half of the revision decide: that half says what the device does on
        CANopen (CiA 301, 7.5.2.21). The lesser half and the serial number may differ.
        """
        for name, own, theirs in (
            ("vendor", self.vendor_id, other.vendor_id),
            ("product", self.product_code, other.product_code),
            ("major revision", _major(self.revision), _major(other.revision)),
        ):
            if own != theirs:
                return f"{name} {_hex(own)}, not {_hex(theirs)}"
        return ""


class StoredParameter(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One parameter; ``object`` as ``6065h:00``, of a further axis of a node as that of its first one."""

    object: str
    value: Value
    type: str
    name: str = ""


class ParameterFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The parameters of one drive.

    Attributes:
        taken: when, ISO 8601. unread: parameters that the drive did not give, each with why.
    """

    drive: DriveIdentity
    parameters: list[StoredParameter]
    taken: str = ""
    unread: list[str] = []

    @property
    def values(self) -> dict[Place, StoredParameter]:
        """By index and subindex."""
        return {_place(each.object): each for each in self.parameters}


def is_stored(parameter: Parameter) -> bool:
    """Return whether a file has a parameter: what the drive keeps, can be read and written, and is its own.

    What the machine file decides at each start (process data, heartbeats, scaling, mode) is not, nor what
    commands, nor the node's number and bit rate.
    """
    index = of_first_axis(parameter.index)
    return (
        parameter.readable
        and parameter.writable
        and parameter.type != "bytes"
        and index not in _MOMENTARY
        and is_own_parameter(index, parameter.name)
    )


def place_in_file(parameter: Parameter) -> Place:
    """Return where a file has a drive's parameter."""
    return of_first_axis(parameter.index), parameter.subindex


def in_drive(place: Place, node_axis: int) -> Place:
    """Return the object of a node's axis that a file's place stands for."""
    index, subindex = place
    return (index + AXIS_OFFSET * node_axis if 0x6000 <= index < 0xA000 else index), subindex


def write_parameters(file: ParameterFile) -> str:
    """Return the file's text."""
    identity = msgspec.structs.asdict(file.drive)
    numbers = [f"{name} = 0x{value:08X}" for name, value in identity.items() if isinstance(value, int)]
    lines = [
        "# parameters of a drive: mcserver drives compare | restore",
        f"taken = {_text(file.taken)}",
        f"unread = [{', '.join(map(_text, file.unread))}]",
        "parameters = [",
        *(
            f"  {{ object = {_text(each.object)}, value = {_toml(each.value)}, type = {_text(each.type)}, "
            f"name = {_text(each.name)} }},"
            for each in file.parameters
        ),
        "]",
        "",
        "[drive]",
        *numbers,
        f"eds_sha256 = {_text(file.drive.eds_sha256)}",
    ]
    return "\n".join(lines) + "\n"


def read_parameters(raw: bytes, source: str) -> ParameterFile:
    """From a file's bytes.

    Raises:
        UsageFault: MC565 they are no parameter file; what is wrong with it.
    """
    try:
        if len(raw) > MAX_BYTES:
            raise ValueError(f"it has more than {MAX_BYTES} bytes")
        file = msgspec.convert(tomllib.loads(raw.decode()), ParameterFile)
        values = []
        for each in file.parameters:
            if _OBJECT.fullmatch(each.object) is None:
                raise ValueError(f"{each.object!r} is no object such as 6065h:00")
            if each.type not in TYPES:
                raise ValueError(f"{each.object}: {each.type!r} is no type; there is {', '.join(TYPES)}")
            # 5 of a floating-point number is 5.0
            value = decode_value(each.type, encode_value(each.type, each.value))
            values.append(msgspec.structs.replace(each, value=value))
        file = msgspec.structs.replace(file, parameters=values)
        if len(file.values) < len(file.parameters):
            raise ValueError("it has an object twice")
    except (ValueError, RecursionError) as error:
        raise UsageFault(
            "MC565",
            f"{source} is no parameter file: {str(error)[:200]}",
            "`mcserver drives backup` writes one",
        ) from error
    return file


def differing(left: Mapping[Place, StoredParameter], right: Mapping[Place, StoredParameter]) -> list[Place]:
    """Places of what both have with another value or type, and of what only one has, by number."""

    def content(side: Mapping[Place, StoredParameter], place: Place) -> object:
        each = side.get(place)
        # not a number is equal to itself here; True is not 1
        return None if each is None else (each.type, repr(each.value))

    return sorted(place for place in {*left, *right} if content(left, place) != content(right, place))


def differences(
    left: ParameterFile, right: ParameterFile
) -> list[tuple[str, str, Value | None, Value | None]]:
    """Return object, name and both values of what differs, by number; None: one does not have it."""
    one, other = left.values, right.values
    rows = []
    for place in differing(one, other):
        both = one.get(place), other.get(place)
        named = both[0] or both[1]
        assert named is not None
        first, second = (None if each is None else each.value for each in both)
        rows.append((named.object, named.name, first, second))
    return rows


def stored(parameter: Parameter, kind: str, value: Value) -> StoredParameter:
    """Return a parameter as a file has it."""
    return StoredParameter(object_text(*place_in_file(parameter)), value, kind, parameter.name)


def _place(text: str) -> Place:
    found = _OBJECT.fullmatch(text)
    assert found is not None, text
    return int(found[1], 16), int(found[2], 16)


def _major(revision: int | None) -> int | None:
    return None if revision is None else revision >> 16


def _hex(number: int | None) -> str:
    return "unknown" if number is None else f"0x{number:X}"


def _toml(value: Value) -> str:
    return _text(value) if isinstance(value, str) else str(value).lower()


def _text(text: str) -> str:
    # a JSON text is one of TOML but for DEL
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
