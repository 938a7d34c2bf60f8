"""One message's vectors: bytes and the value that they stand for, and bytes that have to be refused."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect

from mcserver.contract.samples import Edge, message, required, struct_type
from mcserver.contract.wide import encode_wide
from mcserver.errors import ServiceError
from mcserver.net.decoding import MessageDecoder

# what no field of any message takes
WRONG_TYPE = {"no": {"such": "type"}}
LATER_WORD = "a.later-word"
NEW_FIELD = "a field of a later version"
BYTES_THAT_ARE_NO_MESSAGE = {
    "nothing": b"",
    "nil": b"\xc0",
    "a text": b"\xa3abc",
    "a byte that MessagePack never uses": b"\xc1",
    "an array that claims 4294967295 elements": b"\xdd\xff\xff\xff\xff",
    "a text that claims 4294967295 bytes": b"\xdb\xff\xff\xff\xff",
    "maps, 3000 deep": b"\x81\xa1a" * 3000 + b"\xc0",
}


def vectors(kind: type[msgspec.Struct]) -> list[dict[str, Any]]:
    """Bytes with their value, every default filled in."""
    made = []
    for name, payload in _payloads(struct_type(kind)).items():
        decoded = msgspec.msgpack.decode(payload, type=kind)
        made.append({"name": name, "bytes": payload.hex(), "value": plain(decoded)})
    return made


def later_words(kind: type[msgspec.Struct]) -> list[dict[str, Any]]:
    """Messages with a word that this version does not know, where it knows a set of words: clients keep it.

    A later server may say it (a new kind of event, a new state of an axis); this server's decoder refuses it.
    """
    made = []
    structure = struct_type(kind)
    for field in structure.fields:
        if isinstance(field.type, inspect.LiteralType):
            value = {**message(structure, Edge.PLAIN), field.encode_name: LATER_WORD}
            payload = msgspec.msgpack.encode(value)
            made.append(
                {"name": f"{field.encode_name} is new", "bytes": payload.hex(), "value": plain(value)}
            )
    return made


def refusals(kind: type[msgspec.Struct], *, sent_by_clients: bool) -> list[dict[str, Any]]:
    """Bytes that are no such message; each is refused by the server's own decoder as MC500 or MC511.

    Of what the server sends, bounds and numbers that are not finite are not among them: it sends none.
    """
    structure = struct_type(kind)
    payloads = {
        **_garbage(structure),
        **_with_defects(structure),
        **(_beyond_bounds(structure) if sent_by_clients else {}),
    }
    decode = MessageDecoder(kind)
    made = []
    for name, payload in payloads.items():
        try:
            decode(payload)
        except ServiceError as error:
            made.append({"name": name, "bytes": payload.hex(), "code": error.code})
        else:
            raise AssertionError(f"{kind.__name__}: {name} is not refused")
    return made


def garbage() -> list[dict[str, Any]]:
    """Bytes that are no message of any kind."""
    return [
        {"name": name, "bytes": payload.hex(), "code": "MC500"}
        for name, payload in BYTES_THAT_ARE_NO_MESSAGE.items()
    ]


def defaults(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """Return what a field holds that is left out."""
    return {
        field.encode_name: plain(
            field.default_factory() if field.default is msgspec.NODEFAULT else field.default
        )
        for field in struct_type(kind).fields
        if not field.required
    }


def plain(value: Any) -> Any:
    """Return a value as JSON has it: every field of a message given, bytes in base64."""
    if isinstance(value, msgspec.Struct):
        fields = {
            encoded: plain(getattr(value, name))
            for name, encoded in zip(value.__struct_fields__, value.__struct_encode_fields__, strict=True)
        }
        config = value.__struct_config__
        if config.array_like:
            return list(fields.values())
        return fields if config.tag is None else {config.tag_field: config.tag, **fields}
    if isinstance(value, msgspec.Raw):
        return msgspec.msgpack.decode(value)
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    return value


def _payloads(structure: inspect.StructType) -> dict[str, bytes]:
    whole = message(structure, Edge.PLAIN)
    payloads = {
        "required fields alone": msgspec.msgpack.encode(required(structure)),
        "every field": msgspec.msgpack.encode(whole),
        "least values": msgspec.msgpack.encode(message(structure, Edge.LEAST)),
        "greatest values": msgspec.msgpack.encode(message(structure, Edge.GREATEST)),
        "negative zero, texts beyond ASCII": msgspec.msgpack.encode(message(structure, Edge.ODD)),
        "the widest forms of MessagePack": encode_wide(whole),
        "fields that are not known": msgspec.msgpack.encode(_with_unknown(whole)),
        "whole numbers as integers": msgspec.msgpack.encode(_whole_numbers(whole)),
    }
    first: dict[bytes, str] = {}
    for name, payload in payloads.items():
        # a message without fields has one form
        first.setdefault(payload, name)
    return {name: payload for payload, name in first.items()}


def _with_unknown(value: Any) -> Any:
    """Fields of a later version in every map, and one more element in an array that is a message."""
    if isinstance(value, dict):
        known = {key: _with_unknown_inside(each) for key, each in value.items()}
        return {"": 1.5, **known, NEW_FIELD: {"nested": [None, -1, b"\x00\xff"]}, "µ": 2**64 - 1}
    return [*value, NEW_FIELD]


def _with_unknown_inside(value: Any) -> Any:
    if isinstance(value, list):
        return [_with_unknown(each) if isinstance(each, dict) else each for each in value]
    # the maps of the wire whose keys are no fields stay as they are
    return _with_unknown(value) if isinstance(value, dict) and _is_message(value) else value


def _is_message(value: dict[str, Any]) -> bool:
    return "0" not in value and set(value) != {"accepted", "expected"}


def _whole_numbers(value: Any) -> Any:
    """A float may come as an integer where it is whole: 2.5 → 3.0 → 3."""
    if isinstance(value, float):
        return round(value + 0.5)
    if isinstance(value, dict):
        return {key: _whole_numbers(each) for key, each in value.items()}
    return [_whole_numbers(each) for each in value] if isinstance(value, list) else value


def _garbage(structure: inspect.StructType) -> dict[str, bytes]:
    whole = msgspec.msgpack.encode(message(structure, Edge.PLAIN))
    cut = {"cut off": whole[:-1]} if len(whole) > 1 else {}
    other = {"a map": b"\x80"} if structure.array_like else {"an array": b"\x90"}
    return {**cut, **other, "two messages": whole + whole}


def _with_defects(structure: inspect.StructType) -> dict[str, bytes]:
    """One required field missing, or one field of a type that it cannot have."""
    if structure.array_like:
        values = message(structure, Edge.PLAIN)
        least = sum(field.required for field in structure.fields)
        found = {"an element is missing": values[: least - 1]}
        for index, field in enumerate(structure.fields):
            wrong = [*values[:index], WRONG_TYPE, *values[index + 1 :]]
            found[f"{field.encode_name} is of another type"] = wrong
    else:
        whole = message(structure, Edge.PLAIN)
        found = {}
        for field in structure.fields:
            name = field.encode_name
            if field.required:
                found[f"{name} is missing"] = {key: each for key, each in whole.items() if key != name}
            if not isinstance(field.type, inspect.AnyType | inspect.RawType | inspect.DictType):
                found[f"{name} is of another type"] = {**whole, name: WRONG_TYPE}
        texts = [field.encode_name for field in structure.fields if isinstance(field.type, inspect.StrType)]
        for name in texts[:1]:
            encoded = msgspec.msgpack.encode({**whole, name: "\x01\x02"})
            found[f"{name} is no UTF-8"] = encoded.replace(b"\xa2\x01\x02", b"\xa2\xff\xfe")
    return {
        name: value if isinstance(value, bytes) else msgspec.msgpack.encode(value)
        for name, value in found.items()
    }


def _beyond_bounds(structure: inspect.StructType) -> dict[str, bytes]:
    whole = message(structure, Edge.PLAIN)
    found = {}
    for index, field in enumerate(structure.fields):
        for what, value in _outside(field.type):
            wrong = (
                [*whole[:index], value, *whole[index + 1 :]]
                if structure.array_like
                else {**whole, field.encode_name: value}
            )
            found[f"{field.encode_name} is {what}"] = msgspec.msgpack.encode(wrong)
    return found


def _outside(kind: inspect.Type) -> Iterator[tuple[str, Any]]:
    """Values just beyond each bound of a type, and those that pass every comparison."""
    match kind:
        case inspect.UnionType():
            numbers = [each for each in kind.types if isinstance(each, inspect.IntType | inspect.FloatType)]
            texts = [each for each in kind.types if isinstance(each, inspect.StrType)]
            for each in numbers or texts:
                yield from _outside(each)
        case inspect.IntType():
            if kind.ge is not None:
                yield f"{kind.ge - 1}", kind.ge - 1
            if kind.le is not None:
                yield f"{kind.le + 1}", kind.le + 1
            if kind.ge is not None:
                yield "a fraction", kind.ge + 0.5
        case inspect.FloatType():
            yield "not a number", float("nan")
            yield "infinite", float("inf")
            if kind.gt is not None:
                yield f"{kind.gt:g}", kind.gt
            if kind.ge is not None:
                yield "just below its bound", kind.ge - 1e-9
            if kind.le is not None:
                yield "just above its bound", kind.le * (1 + 1e-12) + 1e-12
        case inspect.StrType():
            if kind.pattern is not None:
                yield "a wildcard", "*"
            if kind.max_length is not None and kind.max_length <= 1000:
                yield "too long", "x" * (kind.max_length + 1)
        case inspect.LiteralType():
            yield "another word", "no such word"
        case inspect.ListType():
            if kind.min_length:
                yield "empty", []
