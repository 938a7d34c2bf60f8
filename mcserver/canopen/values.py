"""Values of objects as bytes, by the short names of types that operators use."""

from __future__ import annotations

import struct
from types import MappingProxyType

from canopen.objectdictionary import ODVariable, datatypes

Value = int | float | str | bool

# Name → data type (CiA 301, table 44).
TYPES = MappingProxyType(
    {
        "bool": datatypes.BOOLEAN,
        "i8": datatypes.INTEGER8,
        "i16": datatypes.INTEGER16,
        "i24": datatypes.INTEGER24,
        "i32": datatypes.INTEGER32,
        "i64": datatypes.INTEGER64,
        "u8": datatypes.UNSIGNED8,
        "u16": datatypes.UNSIGNED16,
        "u24": datatypes.UNSIGNED24,
        "u32": datatypes.UNSIGNED32,
        "u64": datatypes.UNSIGNED64,
        "f32": datatypes.REAL32,
        "f64": datatypes.REAL64,
        "str": datatypes.VISIBLE_STRING,
        "utf16": datatypes.UNICODE_STRING,
        "bytes": datatypes.DOMAIN,
    }
)


def type_name(data_type: int | None) -> str:
    """Return the short name; ``bytes`` for types without one."""
    return next((name for name, kind in TYPES.items() if kind == data_type), "bytes")


def decode_value(name: str, payload: bytes) -> Value:
    """Return the value that bytes stand for; ``bytes`` gives hexadecimal text.

    Raises:
        ValueError: the bytes have another length than the type, or are no text of it.
    """
    kind = TYPES[name]
    if name == "bytes":
        return payload.hex(" ")
    if name == "str":
        return payload.decode("latin-1").rstrip("\x00")
    if name == "utf16":
        return payload.decode("utf-16-le").rstrip("\x00")
    packing = ODVariable.STRUCT_TYPES[kind]
    if len(payload) != packing.size:
        raise ValueError(f"{name} has {packing.size} bytes, the drive gave {len(payload)}")
    value: Value = packing.unpack(payload)[0]
    return value


def encode_value(name: str, value: Value) -> bytes:
    """Return the bytes of a value; texts of ``bytes`` are hexadecimal.

    Raises:
        ValueError: the value does not fit the type.
    """
    kind = TYPES[name]
    if name == "bytes":
        return bytes.fromhex(str(value).removeprefix("0x"))
    if name == "str":
        # no transfer is without a byte: an empty text is its end alone
        return str(value).encode("latin-1") or b"\0"
    if name == "utf16":
        return str(value).encode("utf-16-le") or b"\0\0"
    if isinstance(value, str):
        value = float(value) if name.startswith("f") else int(value, 0)
    if isinstance(value, float) and not name.startswith("f"):
        if not value.is_integer():
            raise ValueError(f"{value} is no whole number")
        value = int(value)
    return pack_number(kind, value)


def pack_number(data_type: int, value: int | float) -> bytes:
    """Return the bytes of a number.

    Raises:
        ValueError: it does not fit.
    """
    packing = ODVariable.STRUCT_TYPES[data_type]
    bits = packing.size * 8
    if data_type in datatypes.INTEGER_TYPES:
        signed = data_type in datatypes.SIGNED_TYPES
        lowest, highest = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
        if not lowest <= value <= highest:
            raise ValueError(f"{value} is outside {lowest} … {highest}")
    try:
        packed: bytes = packing.pack(value)
    except (struct.error, OverflowError) as error:
        raise ValueError(f"{value} does not fit: {error}") from error
    return packed
