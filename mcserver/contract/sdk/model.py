"""The messages and methods as SDKs have them: one model, read from the server's types, for every language."""

from __future__ import annotations

import re
import typing
from collections.abc import Iterator
from functools import cache
from textwrap import dedent
from typing import Any, Literal, NamedTuple

import msgspec
from msgspec import inspect

from mcserver.errors import Severity
from mcserver.net import method_table, schemas

# what a machine of an SDK calls otherwise: its own feeds, programs and connection have the plain name
METHOD_NAMES = {
    "info": "ask_info",
    "open": "open_program",
    "continue_program": "open_continuation",
    "submit": "submit_lines",
    "close": "close_program",
    "events": "past_events",
    "estop": "call_estop",
    "put_text": "put_text_part",
}
# these change something, and never more than once asked
STOPPING = frozenset({"hold", "abort", "estop"})
TYPE_NAMES = {"WireDiagnostic": "Diagnostic"}


class Scalar(NamedTuple):
    """``bool``, ``int``, ``float``, ``str``, ``bytes``, ``any``; ``level``: a number or a truth value;
    ``value``: any of the first four.
    """

    name: str


class NamedType(NamedTuple):
    """A message, or the words of a `Words`."""

    name: str
    words: bool


class ListOf(NamedTuple):
    """A list."""

    item: Type


class MapOf(NamedTuple):
    """A map with text keys."""

    value: Type


class Maybe(NamedTuple):
    """A type or nil."""

    inner: Type


Type = Scalar | NamedType | ListOf | MapOf | Maybe


class Words(NamedTuple):
    """A type of a few words; a later server may know further ones."""

    name: str
    words: tuple[str, ...]


class Field(NamedTuple):
    """A field of a message. ``default``: None, a plain value, or an empty list or map; see ``required``."""

    name: str
    type: Type
    required: bool
    default: Any
    doc: str


class Message(NamedTuple):
    """A message that is a map. ``sent``: by clients."""

    wire_name: str
    name: str
    doc: str
    fields: tuple[Field, ...]
    sent: bool


class Call(NamedTuple):
    """A method. ``result``: the only field of its reply, which SDKs return alone; None: the whole reply."""

    method: method_table.Method
    name: str
    request: Message
    reply: Message
    result: Field | None


class Model(NamedTuple):
    """All that an SDK is made from."""

    words: tuple[Words, ...]
    messages: tuple[Message, ...]
    calls: tuple[Call, ...]


@cache
def model() -> Model:
    """Read the server's messages and methods."""
    names = _named_words()
    messages = {
        name: _message(kind, names)
        for name, kind in schemas.message_types().items()
        # those that are arrays belong to the streams, which are written by hand
        if name != "Request" and not kind.__struct_config__.array_like
    }
    calls = tuple(_call(method, messages) for method in method_table.METHODS)
    used = {found.name for each in messages.values() for field in each.fields for found in named(field.type)}
    words = tuple(each for each in names.values() if each.name in used)
    return Model(words, tuple(messages.values()), calls)


def parts(text: str) -> list[str]:
    """Return the words of a name of the wire."""
    return [part for part in re.split(r"[_.]", text) if part]


def camel(text: str) -> str:
    """Return ``line_times`` as ``lineTimes``."""
    first, *rest = parts(text)
    return first + "".join(part.capitalize() for part in rest)


def pascal(text: str) -> str:
    """Return ``line_times`` as ``LineTimes``."""
    return "".join(part.capitalize() for part in parts(text))


def constant(text: str) -> str:
    """Return ``probe.found`` as ``PROBE_FOUND``."""
    return "_".join(parts(text)).upper()


def named(kind: Type) -> list[NamedType]:
    """Return the message, or the words, that a type is made of; none where it is of scalars."""
    match kind:
        case NamedType():
            return [kind]
        case ListOf(inner) | MapOf(inner) | Maybe(inner):
            return named(inner)
    return []


def is_repeatable(call: Call) -> bool:
    """Return whether a call may be sent again under any circumstances: it changes nothing, or stops."""
    return not call.method.changes or call.method.name in STOPPING


def plain_doc(text: str, nothing: str) -> str:
    """Return a description for a language that is not Python: ``nothing`` is its None."""
    return re.sub(r"\bNone\b", nothing, text.replace("``", "`")).replace("*/", "* /")


def _call(method: method_table.Method, messages: dict[str, Message]) -> Call:
    request, reply = messages[method.request.__name__], messages[method.reply.__name__]
    result = reply.fields[0] if len(reply.fields) == 1 else None
    return Call(method, METHOD_NAMES.get(method.name, method.name), request, reply, result)


def _message(kind: type[msgspec.Struct], names: dict[frozenset[str], Words]) -> Message:
    info = typing.cast(inspect.StructType, inspect.type_info(kind))
    summary, docs = _read_doc(dedent(" " * 4 + (kind.__doc__ or "")), [each.name for each in info.fields])
    fields = tuple(
        Field(
            each.encode_name,
            _type(each.type, names),
            each.required,
            _default(each),
            docs.get(each.name, ""),
        )
        for each in info.fields
        # the line cores number the requests
        if each.name != "request"
    )
    name = TYPE_NAMES.get(kind.__name__, kind.__name__)
    sent = kind.__name__.endswith("Request")
    for each in fields:
        # Go and Java have one value for "no list" and "an empty list"
        if not sent and isinstance(each.type, Maybe) and isinstance(each.type.inner, ListOf | MapOf):
            raise NotImplementedError(f"{name}.{each.name}: say in a field of its own that there is none")
    return Message(kind.__name__, name, summary, fields, sent)


def _default(field: inspect.Field) -> Any:
    if field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory()
    return None if field.default is msgspec.NODEFAULT else field.default


def _type(kind: inspect.Type, names: dict[frozenset[str], Words]) -> Type:
    match kind:
        case inspect.BoolType():
            return Scalar("bool")
        case inspect.IntType():
            return Scalar("int")
        case inspect.FloatType():
            return Scalar("float")
        case inspect.StrType():
            return Scalar("str")
        case inspect.BytesType():
            return Scalar("bytes")
        case inspect.AnyType():
            return Scalar("any")
        case inspect.ListType() | inspect.VarTupleType():
            return ListOf(_type(kind.item_type, names))
        case inspect.DictType():
            return MapOf(_type(kind.value_type, names))
        case inspect.StructType():
            return NamedType(TYPE_NAMES.get(kind.cls.__name__, kind.cls.__name__), words=False)
        case inspect.LiteralType():
            return NamedType(names[frozenset(map(str, kind.values))].name, words=True)
        case inspect.UnionType():
            return _union(kind, names)
        case _:
            raise NotImplementedError(f"no SDK has a type for {kind}")


def _union(kind: inspect.UnionType, names: dict[frozenset[str], Words]) -> Type:
    some = [each for each in kind.types if not isinstance(each, inspect.NoneType)]
    if len(some) == 1:
        inner = _type(some[0], names)
    elif {type(each) for each in some} == {inspect.BoolType, inspect.FloatType}:
        inner = Scalar("level")
    else:
        inner = Scalar("value")
    return Maybe(inner) if len(some) < len(kind.types) else inner


def _named_words() -> dict[frozenset[str], Words]:
    """Return the literal types of the wire that have a name, by their words."""
    aliases = {
        name: value
        for module in schemas.MODULES
        for name, value in vars(module).items()
        if typing.get_origin(value) is Literal
    }
    found = {"Severity": _words_of(typing.get_args(Severity))}
    found |= {name: _words_of(typing.get_args(value)) for name, value in aliases.items()}
    return {frozenset(words): Words(name, words) for name, words in sorted(found.items())}


def _words_of(values: tuple[Any, ...]) -> tuple[str, ...]:
    flat: list[str] = []
    for each in values:
        flat += [each] if isinstance(each, str) else _words_of(typing.get_args(each))
    return tuple(flat)


def _read_doc(text: str, fields: list[str]) -> tuple[str, dict[str, str]]:
    """Split a message's description into what it is and what its fields are."""
    summary, _, attributes = text.partition("Attributes:")
    docs = {}
    for names, doc in _entries(" ".join(attributes.split()), fields):
        for name in names:
            docs[name] = doc
    return " ".join(summary.split()), docs


def _entries(text: str, fields: list[str]) -> Iterator[tuple[list[str], str]]:
    """Yield ``name: what it is`` for the names that are fields; several may share one."""
    one = "|".join(map(re.escape, fields)) or "$^"
    starts = list(re.finditer(rf"(?:(?<=[.;] )|^)((?:{one})(?:, (?:{one}))*): ", text))
    for index, found in enumerate(starts):
        end = starts[index + 1].start() if index + 1 < len(starts) else len(text)
        yield found[1].split(", "), text[found.end() : end].strip().rstrip(";")
