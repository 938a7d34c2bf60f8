"""Decode bytes from the network to typed messages: the one place where input is arbitrary."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Generic, TypeVar

import msgspec

from mcserver.errors import ServiceError

# place in a message in msgspec's errors: `$.lines[...]`
_PLACE = re.compile(r" - at `\$\.?(.*?)`")
# msgspec's errors about a value of the right type that is out of bounds
_BEYOND = re.compile(r"Expected `\w+` (?:of length )?[<>]=? |matching regex|Invalid enum value")

# descriptions of fields with a pattern
_IN_WORDS = {
    "sha256": "the hexadecimal SHA-256 of the text; of a run that waits at least its first 8 (mcctl arm)",
    "program": "the id of a program: mcctl programs lists them",
}

T = TypeVar("T", bound=msgspec.Struct)


class MessageDecoder(Generic[T]):
    """Decodes MessagePack payloads of one type."""

    def __init__(self, kind: type[T]) -> None:
        self._kind = kind
        self._decode = msgspec.msgpack.Decoder(kind).decode
        self._numbers = _fields_with_floats(kind)

    def __call__(self, payload: bytes) -> T:
        """Decode a message.

        Raises:
            ServiceError: MC500 or MC511, and nothing else, for any bytes.
        """
        try:
            message = self._decode(payload)
        # msgspec raises others, too: UnicodeDecodeError for invalid UTF-8, RecursionError for deep nesting
        except Exception as error:
            raise ServiceError(*refusal_of(self._kind, str(error))) from error
        if self._numbers:
            name = _not_finite(message, self._numbers)
            if name:
                raise ServiceError("MC511", f"{name} is not a finite number", "give a number")
        return message


def refusal_of(kind: type[msgspec.Struct], why: str) -> tuple[str, str, str]:
    """Return code, message and remedy for a payload that msgspec has refused.

    Args:
        kind: expected message. why: msgspec's error text.

    Returns:
        MC511 for a value out of its field's bounds, else MC500.
    """
    place = _PLACE.search(why)
    what = _PLACE.sub(lambda found: f" in {found[1]}" if found[1] else "", why)
    if place is None or not place[1] or not _BEYOND.search(why):
        return (
            "MC500",
            f"the message is no {kind.__name__}: {what}",
            "give each field as docs/wire describes it; client and server may be of different versions",
        )
    name = re.split(r"[.\[]", place[1])[0]
    wanted = _wanted(kind, name)
    if wanted:
        return "MC511", f"{place[1]} is beyond what it may be", f"give {wanted}"
    return "MC511", f"a value beyond its bounds: {what}", f"{kind.__name__} of docs/wire has them"


def _wanted(kind: type[msgspec.Struct], name: str) -> str:
    """Describe a field's allowed values, if it is an enumeration or in `_IN_WORDS`; else empty."""
    described = msgspec.inspect.type_info(kind)
    assert isinstance(described, msgspec.inspect.StructType)
    types = [field.type for field in described.fields if field.encode_name == name]
    for each in types:
        match each:
            case msgspec.inspect.UnionType(types=parts):
                types += parts
            case msgspec.inspect.LiteralType(values=values):
                return " or ".join(repr(value) for value in values)
            case msgspec.inspect.StrType(pattern=str()):
                return _IN_WORDS.get(name, "")
    return ""


def _fields_with_floats(kind: type[msgspec.Struct]) -> tuple[str, ...]:
    """Return the names of fields that are, or whose mappings have, floating-point numbers."""
    described = msgspec.inspect.type_info(kind)
    assert isinstance(described, msgspec.inspect.StructType)
    return tuple(field.name for field in described.fields if _may_be_float(field.type))


def _may_be_float(described: msgspec.inspect.Type) -> bool:
    match described:
        case msgspec.inspect.FloatType() | msgspec.inspect.AnyType():
            return True
        case msgspec.inspect.UnionType(types=types):
            return any(_may_be_float(each) for each in types)
        case msgspec.inspect.DictType(value_type=values):
            return _may_be_float(values)
        case msgspec.inspect.Metadata(type=inner):
            return _may_be_float(inner)
    return False


def _not_finite(message: msgspec.Struct, names: Iterable[str]) -> str:
    """Return the first field with NaN or infinity, which bounds do not exclude; or ""."""
    for name in names:
        value = getattr(message, name)
        values = value.values() if isinstance(value, Mapping) else (value,)
        if any(isinstance(each, float) and not math.isfinite(each) for each in values):
            return name
    return ""
