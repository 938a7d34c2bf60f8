"""Values for each field of a message, from its type and its bounds: plain ones, and those at the edges."""

from __future__ import annotations

import struct
import sys
from enum import Enum
from typing import Any, cast

import msgspec
from msgspec import inspect

# what unbounded counters and line numbers reach at most: every language holds it exactly
MOST_COUNTED = 2**53
TEXT = 'Fräse "数控" ß€𝄞\\ \u00a0'


class Edge(Enum):
    """Which of the values that a field may have."""

    PLAIN = "plain"
    LEAST = "least"
    GREATEST = "greatest"
    # the smallest float, negative zero, texts beyond ASCII
    ODD = "odd"


def sample(kind: inspect.Type, edge: Edge, name: str = "") -> Any:
    """Make a value of a type, as the builtins that are encoded.

    Raises:
        NotImplementedError: no message of the wire has used this type so far.
    """
    match kind:
        case inspect.BoolType():
            return edge is not Edge.LEAST
        case inspect.IntType():
            return _integer(kind, edge)
        case inspect.FloatType():
            return _number(kind, edge)
        case inspect.StrType():
            return _text(kind, edge, name)
        case inspect.BytesType():
            return b"" if edge is Edge.LEAST else float32_rows(edge)
        case inspect.NoneType():
            return None
        case inspect.LiteralType():
            return kind.values[-1 if edge is Edge.GREATEST else 0]
        case inspect.UnionType():
            return _of_union(kind, edge, name)
        case inspect.ListType():
            return _list(kind, edge, name)
        case inspect.DictType():
            return {} if edge is Edge.LEAST else {"0": sample(kind.value_type, edge, name)}
        case inspect.AnyType() | inspect.RawType():
            return {"accepted": 3, "expected": 4}
        case inspect.StructType():
            return message(kind, edge)
        case _:
            raise NotImplementedError(f"a sample of {kind}")


def message(kind: inspect.StructType, edge: Edge) -> Any:
    """Make a whole message, every field of it given: a map, or an array where the message is one."""
    values = {field.encode_name: sample(field.type, edge, field.encode_name) for field in kind.fields}
    return list(values.values()) if kind.array_like else _tagged(kind, values)


def required(kind: inspect.StructType) -> Any:
    """Make a message of its required fields alone."""
    values = {
        field.encode_name: _required_sample(field.type, field.encode_name)
        for field in kind.fields
        if field.required
    }
    return list(values.values()) if kind.array_like else _tagged(kind, values)


def struct_type(kind: type[msgspec.Struct]) -> inspect.StructType:
    """Return a message's fields and bounds."""
    return cast(inspect.StructType, inspect.type_info(kind))


def float32_rows(edge: Edge) -> bytes:
    """Make a `bin` of the wire: float32, little endian."""
    numbers = {
        Edge.PLAIN: (1.0, -2.5, 0.125, 0.0),
        Edge.GREATEST: (3.4028234663852886e38, -3.4028234663852886e38, 1.401298464324817e-45, -0.0),
        Edge.ODD: (-0.0, 1e-38, 16777216.0, 0.1),
        Edge.LEAST: (),
    }
    return struct.pack(f"<{len(numbers[edge])}f", *numbers[edge])


def _required_sample(kind: inspect.Type, name: str) -> Any:
    if isinstance(kind, inspect.StructType):
        return required(kind)
    if isinstance(kind, inspect.ListType) and isinstance(kind.item_type, inspect.StructType):
        return [required(kind.item_type)]
    return sample(kind, Edge.PLAIN, name)


def _tagged(kind: inspect.StructType, values: dict[str, Any]) -> dict[str, Any]:
    return values if kind.tag_field is None else {kind.tag_field: kind.tag, **values}


def _integer(kind: inspect.IntType, edge: Edge) -> int:
    least = kind.ge if kind.ge is not None else 0
    greatest = kind.le if kind.le is not None else MOST_COUNTED
    chosen = {Edge.PLAIN: 7, Edge.LEAST: least, Edge.GREATEST: greatest, Edge.ODD: 65_536}[edge]
    return int(min(max(chosen, least), greatest))


def _number(kind: inspect.FloatType, edge: Edge) -> float:
    exclusive = kind.gt is not None
    least = kind.gt if exclusive else kind.ge if kind.ge is not None else -sys.float_info.max
    greatest = kind.le if kind.le is not None else sys.float_info.max
    assert least is not None
    smallest = 5e-324
    chosen = {
        Edge.PLAIN: 2.5,
        Edge.LEAST: smallest if exclusive else least,
        Edge.GREATEST: greatest,
        Edge.ODD: smallest if exclusive else -0.0,
    }[edge]
    return float(min(max(chosen, smallest if exclusive else least), greatest))


def _text(kind: inspect.StrType, edge: Edge, name: str) -> str:
    if kind.pattern is not None:
        # ids and hashes: the patterns of the wire take hexadecimal digits
        return "0" * 8 if edge is not Edge.GREATEST else "f" * 63
    longest = kind.max_length or 80
    return {
        Edge.PLAIN: name.replace("_", " ")[:longest],
        Edge.LEAST: "",
        Edge.GREATEST: ("x" * 80)[:longest],
        Edge.ODD: TEXT[:longest],
    }[edge]


def _of_union(kind: inspect.UnionType, edge: Edge, name: str) -> Any:
    """Nil is the least of an optional value; of several types the last one is the odd one."""
    chosen = [each for each in kind.types if not isinstance(each, inspect.NoneType)]
    if edge is Edge.LEAST and len(chosen) < len(kind.types):
        return None
    return sample(chosen[-1 if edge is Edge.ODD else 0], edge, name)


def _list(kind: inspect.ListType, edge: Edge, name: str) -> list[Any]:
    least = kind.min_length or 0
    count = {Edge.PLAIN: 2, Edge.LEAST: least, Edge.GREATEST: 3, Edge.ODD: 1}[edge]
    return [sample(kind.item_type, edge, name) for _ in range(max(count, least))]
