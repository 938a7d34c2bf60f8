"""The payload of Sparkplug B (version 3.0, section 6.4), in Protobuf: the fields that are used here."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any, NamedTuple

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from mcserver.mqtt.metrics import Value

_FIELD = descriptor_pb2.FieldDescriptorProto
_PACKAGE = "org.eclipse.tahu.protobuf"
# name, number, type of the fields of a message; a type with a dot is a message's
_PAYLOAD = (
    ("timestamp", 1, _FIELD.TYPE_UINT64),
    ("metrics", 2, f".{_PACKAGE}.Payload.Metric"),
    ("seq", 3, _FIELD.TYPE_UINT64),
)
_METRIC = (
    ("name", 1, _FIELD.TYPE_STRING),
    ("alias", 2, _FIELD.TYPE_UINT64),
    ("timestamp", 3, _FIELD.TYPE_UINT64),
    ("datatype", 4, _FIELD.TYPE_UINT32),
    ("is_historical", 5, _FIELD.TYPE_BOOL),
    ("int_value", 10, _FIELD.TYPE_UINT32),
    ("long_value", 11, _FIELD.TYPE_UINT64),
    ("double_value", 13, _FIELD.TYPE_DOUBLE),
    ("boolean_value", 14, _FIELD.TYPE_BOOL),
    ("string_value", 15, _FIELD.TYPE_STRING),
)
# data types (section 6.4.16), and the field that has the value
INT64, UINT64, DOUBLE, BOOLEAN, STRING = 4, 8, 10, 11, 12
_VALUES = {
    INT64: "long_value",
    UINT64: "long_value",
    DOUBLE: "double_value",
    BOOLEAN: "boolean_value",
    STRING: "string_value",
}


class Metric(NamedTuple):
    """A value of a payload.

    Attributes:
        name: empty where the alias alone says which it is. alias: 0: none. wall: Unix time [s].
    """

    name: str
    alias: int
    datatype: int
    value: Value
    wall: float
    historical: bool = False


def datatype_of(value: Value) -> int:
    """Return the data type of a value."""
    if isinstance(value, bool):
        return BOOLEAN
    return STRING if isinstance(value, str) else INT64 if isinstance(value, int) else DOUBLE


def encoded(metrics: Iterable[Metric], *, wall: float, seq: int | None) -> bytes:
    """Return a payload; ``seq`` None: a certificate of death, which has none."""
    payload = _payload_type()()
    payload.timestamp = round(wall * 1000.0)
    if seq is not None:
        payload.seq = seq
    for each in metrics:
        metric = payload.metrics.add()
        if each.name:
            metric.name = each.name
        if each.alias:
            metric.alias = each.alias
        metric.timestamp = round(each.wall * 1000.0)
        metric.datatype = each.datatype
        if each.historical:
            metric.is_historical = True
        # integers are sent as two's complement
        value = each.value % 2**64 if each.datatype == INT64 and isinstance(each.value, int) else each.value
        setattr(metric, _VALUES[each.datatype], value)
    written: bytes = payload.SerializeToString()
    return written


def decoded(data: bytes) -> Any:
    """Return a payload as a message; fields that are not used here are left out.

    Raises:
        google.protobuf.message.DecodeError: it is none.
    """
    payload = _payload_type()()
    payload.ParseFromString(data)
    return payload


@cache
def _payload_type() -> Any:
    """Return the class of payloads, in a pool of its own: other packages may have the same names."""
    file = descriptor_pb2.FileDescriptorProto(name="sparkplug_b.proto", package=_PACKAGE, syntax="proto2")
    payload = file.message_type.add(name="Payload")
    _add_fields(payload, _PAYLOAD)
    _add_fields(payload.nested_type.add(name="Metric"), _METRIC)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{_PACKAGE}.Payload"))


def _add_fields(message: Any, fields: Iterable[tuple[str, int, Any]]) -> None:
    for name, number, kind in fields:
        field = message.field.add(name=name, number=number, label=_FIELD.LABEL_OPTIONAL)
        if isinstance(kind, str):
            field.type, field.type_name, field.label = _FIELD.TYPE_MESSAGE, kind, _FIELD.LABEL_REPEATED
        else:
            field.type = kind
