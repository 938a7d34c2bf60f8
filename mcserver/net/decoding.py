"""Bytes from the network to typed messages: the one place where a message may be anything."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Generic, TypeVar

import msgspec

from mcserver.errors import ServiceError

# where in a message, as msgspec says it: `$.lines[...]`
_PLACE = re.compile(r" - at `\$\.?(.*?)`")

T = TypeVar("T", bound=msgspec.Struct)


class MessageDecoder(Generic[T]):
    """Decodes MessagePack payloads of one type.

    Args:
        kind: the message's type; its name is that of its schema in docs/schemas.
    """

    def __init__(self, kind: type[T]) -> None:
        self._kind = kind
        self._decode = msgspec.msgpack.Decoder(kind).decode
        self._numbers = _fields_with_floats(kind)

    def __call__(self, payload: bytes) -> T:
        """Decode a message.

        Raises:
            ServiceError: MC500, and nothing else, whatever the bytes are.
        """
        try:
            message = self._decode(payload)
        # not only msgspec's errors: invalid UTF-8 is a UnicodeDecodeError, deep nesting a RecursionError
        except Exception as error:
            raise self._refusal(str(error)) from error
        if self._numbers:
            name = _not_finite(message, self._numbers)
            if name:
                raise self._refusal(f"{name} is not a finite number")
        return message

    def _refusal(self, why: str) -> ServiceError:
        name = self._kind.__name__
        what = _PLACE.sub(lambda found: f" in {found[1]}" if found[1] else "", why)
        return ServiceError(
            "MC500",
            f"the message is no {name}: {what}",
            "client and server may be of different versions; docs/wire describes each message",
        )


def _fields_with_floats(kind: type[msgspec.Struct]) -> tuple[str, ...]:
    """Return the names of fields whose value, or whose mapping's values, may be floating-point numbers."""
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
    """Return the first field with NaN or an infinity, which pass every comparison with a bound; or ""."""
    for name in names:
        value = getattr(message, name)
        values = value.values() if isinstance(value, Mapping) else (value,)
        if any(isinstance(each, float) and not math.isfinite(each) for each in values):
            return name
    return ""
