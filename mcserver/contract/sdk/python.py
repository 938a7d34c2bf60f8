"""The Python SDK's types and calls."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from textwrap import fill, indent

from mcserver.contract.sdk.model import (
    Call,
    Field,
    ListOf,
    MapOf,
    Maybe,
    Message,
    Model,
    NamedType,
    Scalar,
    Words,
    constant,
    named,
)
from mcserver.contract.sdk.spelling import Spelling

MADE = "# Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead."
TYPES = f'''{MADE}
"""What the server tells, as plain values (docs/keyspace.md).

Positions are in mm (linear axes) or deg (rotary axes), velocities in mm/s or deg/s, torques in N·m, times in
seconds since the executor's start, percentages in %.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from mcclient.words import Word

ENDED: frozenset[str] = frozenset({{"finished", "aborted", "rejected", "faulted", "interrupted"}})
Value = bool | int | float | str

'''
CALLS = f'''{MADE}
"""Every remote method of a machine (docs/wire/calls.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mcclient import types as wire
from mcclient.calls import Caller


class MachineCalls:
    """The calls of a machine, each repeated under one number until it is answered or ``deadline_s`` is over.

    Raises, each of them: NobodyAnswers (MC530, MC532), RequestRefused with the server's code, ProtocolError.
    """

    _caller: Caller

    def _declare_token(self) -> None:
        """Let the server notice when this client goes."""
        raise NotImplementedError

'''
BLOCKING = f'''{MADE}
"""Every remote method of a machine, for callers that wait."""

from __future__ import annotations

from mcclient.blocking import Blocking, T, waited
from mcclient.machine_calls import MachineCalls


class BlockingCalls(Blocking[T]):
    """As `mcclient.machine_calls.MachineCalls`."""

'''
READ = Spelling(
    scalars={
        "bool": "bool",
        "int": "int",
        "float": "float",
        "str": "str",
        "bytes": "bytes",
        "any": "Any",
        "level": "bool | float",
        "value": "Value",
    },
    list_of="tuple[{}, ...]",
    map_of="dict[str, {}]",
    maybe="{} | None",
    nothing="None",
    empty_list="()",
    empty_map="field(default_factory=dict)",
    flags=("False", "True"),
    word=lambda name, word: f"{name}.{constant(word)}",
)
RETURNED = replace(READ, named="wire.{}")
# an argument; maps that clients send have a value for each axis
TAKEN = replace(
    READ,
    scalars={**READ.scalars, "value": "wire.Value"},
    named="wire.{}Word",
    message="wire.{}",
    list_of="Sequence[{}]",
    map_of="Mapping[int, {}]",
    word=lambda _, word: repr(word),
)
WIDTH = 110


def files(model: Model) -> dict[str, str]:
    """Return the files by their path below the SDK."""
    types = TYPES + "\n\n".join(
        [
            *(_words(each, model) for each in model.words),
            *(_dataclass(each) for each in in_order(model.messages) if not each.sent),
        ]
    )
    calls = CALLS + "\n".join(indent(_call(each), "    ") for each in model.calls)
    blocking = BLOCKING + "\n".join(
        f"    {each.name} = waited(MachineCalls.{each.name})" for each in model.calls
    )
    return {
        "mcclient/types.py": _formatted(types),
        "mcclient/machine_calls.py": _formatted(calls),
        "mcclient/blocking_calls.py": _formatted(blocking),
    }


def in_order(messages: tuple[Message, ...]) -> list[Message]:
    """Return messages so that each stands behind those that it holds."""
    by_name = {each.name: each for each in messages}
    ordered: dict[str, Message] = {}

    def place(message: Message) -> None:
        if message.name not in ordered:
            for field in message.fields:
                for found in named(field.type):
                    if not found.words:
                        place(by_name[found.name])
            ordered[message.name] = message

    for each in messages:
        place(each)
    return list(ordered.values())


def _words(words: Words, model: Model) -> str:
    members = "\n".join(f"    {constant(each)} = {each!r}" for each in words.words)
    made = f'class {words.name}(Word):\n    """One of the words of the wire."""\n\n{members}\n\n'
    sent = [field.type for each in model.messages if each.sent for field in each.fields]
    if not {NamedType(words.name, words=True), Maybe(NamedType(words.name, words=True))} & set(sent):
        return made
    # an argument may be given as a plain text
    return f"{made}\n{words.name}Word = {words.name} | Literal[{', '.join(map(repr, words.words))}]\n\n"


def _dataclass(message: Message) -> str:
    fields = "\n".join(
        f"    {each.name}: {READ.type(each.type)}" + ("" if each.required else f" = {READ.default(each)}")
        for each in message.fields
    )
    return (
        f"@dataclass(frozen=True, slots=True)\nclass {message.name}:\n"
        f"{_docstring(message.doc, message.fields, 'Attributes')}\n{fields}\n\n"
    )


def _call(call: Call) -> str:
    arguments, optional = ["self"], 0
    for field in sorted(call.request.fields, key=lambda field: not field.required):
        if not field.required:
            optional += 1
            if "*" not in arguments and (optional == 2 or field.type == Scalar("bool")):
                arguments.append("*")
        default = "" if field.required else f" = {TAKEN.default(field)}"
        arguments.append(f"{field.name}: {TAKEN.type(field.type)}{default}")
    if "*" not in arguments:
        arguments.append("*")
    arguments.append(f"deadline_s: float = {call.method.deadline_s}")
    fields = ", ".join(f"{each.name!r}: {_written(each)}" for each in call.request.fields)
    ask = f"await self._caller.ask(wire.{call.reply.name}, {call.method.name!r}, {{{fields}}}, deadline_s)"
    result = f"wire.{call.reply.name}" if call.result is None else RETURNED.type(call.result.type)
    declare = "self._declare_token()\n    " if call.method.held else ""
    taken = "" if call.result is None else f".{call.result.name}"
    body = f"{declare}return ({ask}){taken}"
    return (
        f"async def {call.name}({', '.join(arguments)}) -> {result}:\n"
        f"{_docstring(call.method.doc, call.request.fields, 'Args')}\n    {body}\n"
    )


def _written(field: Field) -> str:
    match field.type:
        case MapOf():
            return f"{{str(key): each for key, each in {field.name}.items()}}"
        case Maybe(MapOf()):
            return (
                f"None if {field.name} is None else {_written(field._replace(type=MapOf(Scalar('float'))))}"
            )
        case ListOf():
            return f"list({field.name})"
        case Maybe(ListOf()):
            return f"None if {field.name} is None else list({field.name})"
    return field.name


def _docstring(doc: str, fields: tuple[Field, ...], title: str) -> str:
    described = [(each.name, each.doc) for each in fields if each.doc]
    summary, _, rest = doc.partition(". ")
    lines = [fill(summary.removesuffix(".") + ".", WIDTH - 8)]
    if rest:
        lines += ["", fill(rest, WIDTH - 4)]
    if described:
        lines += ["", f"{title}:"]
        lines += [
            fill(f"{name}: {text}", WIDTH - 8, initial_indent="    ", subsequent_indent="        ")
            for name, text in described
        ]
    text = "\n".join(lines)
    closing = "\n" if "\n" in text else ""
    return indent(f'"""{text}{closing}"""', "    ").replace("[mm, deg]; None", "[mm, deg]; None")


def _formatted(text: str) -> str:
    command = [
        sys.executable,
        "-m",
        "ruff",
        "format",
        "--stdin-filename",
        "clients/python/mcclient/types.py",
        "-",
    ]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout
