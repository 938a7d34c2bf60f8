"""MessagePack to and from the values of `mcclient.types`: unknown keys are skipped, missing ones get the
default.
"""

from __future__ import annotations

import dataclasses
import functools
import types
import typing
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeVar

import msgpack  # type: ignore[import-untyped]

from mcclient.errors import ProtocolError

T = TypeVar("T")
Convert = Callable[[Any], Any]

ENCODING = "application/msgpack"


def encode(value: object) -> bytes:
    """Any value of maps, lists, numbers, text and bytes."""
    return typing.cast(bytes, msgpack.packb(value))


def decode(kind: type[T], payload: bytes) -> T:
    """A map as one of the dataclasses of `mcclient.types`.

    Raises:
        ProtocolError: MC533 it is no such message.
    """
    return from_wire(kind, unpack(payload))


def unpack(payload: bytes) -> Any:
    """Raises ProtocolError (MC533) where the bytes are no MessagePack."""
    try:
        return msgpack.unpackb(payload)
    # whatever the bytes are: invalid UTF-8, deep nesting and huge lengths each have an error of their own
    except Exception as error:
        raise ProtocolError(
            "MC533", f"the payload is no MessagePack: {error}", "is it a motion server?"
        ) from error


def from_wire(kind: type[T], value: object) -> T:
    """Raises ProtocolError (MC533) where a field is missing or of another shape."""
    try:
        return typing.cast(T, _converter(typing.cast(Hashable, kind))(value))
    # int() of an infinity is an OverflowError, for one
    except Exception as error:
        raise ProtocolError(
            "MC533", f"the message is no {kind.__name__}: {error}", "client and server differ in version"
        ) from error


@functools.cache
def _converter(kind: Hashable) -> Convert:
    """What makes a value of this type from its wire form."""
    if dataclasses.is_dataclass(kind):
        return _message(typing.cast(type, kind))
    origin = typing.get_origin(kind)
    arguments = typing.get_args(kind)
    if origin is tuple:
        each = _converter(arguments[0])
        return lambda value: tuple([each(item) for item in value])
    if origin in (types.UnionType, typing.Union):
        inner = _converter(next(argument for argument in arguments if argument is not type(None)))
        return lambda value: None if value is None else inner(value)
    if kind in (int, float):
        return typing.cast(Convert, kind)
    if kind in (str, bool):
        return _exactly(kind)
    return lambda value: value


def _exactly(kind: type) -> Convert:
    def convert(value: Any) -> Any:
        if not isinstance(value, kind):
            raise TypeError(f"{value!r} is no {kind.__name__}")
        return value

    return convert


def _message(kind: type) -> Convert:
    hints = typing.get_type_hints(kind)
    converters = {each.name: _converter(hints[each.name]) for each in dataclasses.fields(kind)}

    def convert(value: Any) -> Any:
        if not isinstance(value, Mapping):
            raise TypeError(f"{type(value).__name__} is no map")
        known = {
            name: convert_field(value[name]) for name, convert_field in converters.items() if name in value
        }
        return kind(**known)

    return convert
