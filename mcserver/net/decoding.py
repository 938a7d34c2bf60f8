"""Bytes from the network to typed messages: the one place where a message may be anything."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Generic, TypeVar

import msgspec

from mcserver.errors import ServiceError

T = TypeVar("T", bound=msgspec.Struct)


class MessageDecoder(Generic[T]):
    """Decodes MessagePack payloads of one type.

    Args:
        kind: the message's type; its name is that of its schema in docs/schemas.
    """

    def __init__(self, kind: type[T]) -> None:
        self._kind = kind
        self._decode = msgspec.msgpack.Decoder(kind).decode

    def __call__(self, payload: bytes) -> T:
        """The message.

        Raises:
            ServiceError: MC500, and nothing else, whatever the bytes are.
        """
        try:
            message = self._decode(payload)
        # not only msgspec's errors: invalid UTF-8 is a UnicodeDecodeError, deep nesting a RecursionError
        except Exception as error:
            raise self._refusal(str(error)) from error
        name = _not_finite(message)
        if name:
            raise self._refusal(f"{name} is not a finite number")
        return message

    def _refusal(self, why: str) -> ServiceError:
        name = self._kind.__name__
        return ServiceError("MC500", f"the payload is not a {name}: {why}", f"see docs/schemas/{name}.json")


def _not_finite(message: msgspec.Struct) -> str:
    """The first field that holds NaN or an infinity, which pass every comparison with a bound; or ""."""
    for name in message.__struct_fields__:
        value = getattr(message, name)
        values = value.values() if isinstance(value, Mapping) else (value,)
        if any(isinstance(each, float) and not math.isfinite(each) for each in values):
            return name
    return ""
