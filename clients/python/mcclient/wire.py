"""MessagePack to and from the values of `mcclient.types`: unknown keys are skipped, missing ones get the
default.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from typing import Any, TypeVar, cast

import msgspec

from mcclient.errors import ProtocolError, RequestRefused

T = TypeVar("T")

ENCODING = "application/msgpack"

_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder()


def encode(value: object) -> bytes:
    """Encode a value of maps, lists, numbers, text and bytes.

    Raises:
        RequestRefused: MC500 MessagePack has no form for it, such as an integer beyond 64 bits.
    """
    try:
        return _encoder.encode(value)
    # each has an error of its own: integers too large, lone surrogates, deep nesting, other types
    except Exception as error:
        raise RequestRefused(
            "MC500", f"the value cannot be sent: {error}", "send what the method takes"
        ) from error


def decode(kind: type[T], payload: bytes) -> T:
    """Return a map as one of the dataclasses of `mcclient.types`.

    Raises:
        ProtocolError: MC533 it is no such message.
    """
    try:
        return cast(T, _decoder_of(cast(Hashable, kind))(payload))
    # whatever the bytes are: invalid UTF-8, deep nesting and huge lengths each have an error of their own
    except Exception as error:
        raise _not_understood(kind, error) from error


def unpack(payload: bytes) -> Any:
    """Raises ProtocolError (MC533) where the bytes are no MessagePack."""
    try:
        return _decoder.decode(payload)
    except Exception as error:
        raise ProtocolError(
            "MC533", f"the payload is no MessagePack: {error}", "is it a motion server?"
        ) from error


def from_wire(kind: type[T], value: object) -> T:
    """Raises ProtocolError (MC533) where a field is missing or of another shape."""
    try:
        return msgspec.convert(value, kind)
    except Exception as error:
        raise _not_understood(kind, error) from error


def _not_understood(kind: type, error: Exception) -> ProtocolError:
    return ProtocolError(
        "MC533", f"the message is no {kind.__name__}: {error}", "client and server differ in version"
    )


@functools.cache
def _decoder_of(kind: Hashable) -> Callable[[bytes], Any]:
    return msgspec.msgpack.Decoder(cast(type, kind)).decode
