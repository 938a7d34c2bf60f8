"""The TypeScript SDK's types and calls."""

from __future__ import annotations

from textwrap import wrap

from mcserver.contract.sdk.model import (
    Call,
    Field,
    ListOf,
    MapOf,
    Maybe,
    Message,
    Model,
    Named,
    Scalar,
    Type,
    Words,
    camel,
    is_repeatable,
    plain_doc,
)

MADE = "// Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.\n"
SCALARS = {
    "bool": "boolean",
    "int": "number",
    "float": "number",
    "str": "string",
    "bytes": "Uint8Array",
    "any": "unknown",
    "level": "boolean | number",
    "value": "boolean | number | string",
}
# a browser's own type has that name
NAMES = {"Event": "MotionEvent"}
WIDTH = 118


def files(model: Model) -> dict[str, str]:
    """Return the files by their path below the SDK."""
    types = [
        MADE,
        "/**\n * The messages of the key space (docs/schemas), as the gateway hands them on.\n"
        " * Positions are in mm or deg. What may be left out has its default there; null: none.\n */\n",
        "export const ENDED: ReadonlySet<string> =\n"
        '  new Set(["finished", "aborted", "rejected", "faulted", "interrupted"]);\n',
        *map(_words, model.words),
        *map(_interface, model.messages),
    ]
    used = sorted(
        {_name(each.request) for each in model.calls if len(each.request.fields) > 1}
        | {_name(each.reply) for each in model.calls}
        | {name for each in model.calls if each.result for name in _names(each.result.type)}
    )
    calls = [
        MADE,
        f'import type {{\n{"".join(f"  {name},{chr(10)}" for name in used)}}} from "./messages.js";\n',
        "/** How long a server may take for an answer [s], and whether a call may be sent again under any\n"
        " * circumstances: it changes nothing, or stops. */\n"
        "export const METHODS: Readonly<Record<string, { deadlineS: number; repeatable: boolean }>> = {\n"
        + "".join(
            f"  {each.method.name}: {{ deadlineS: {each.method.deadline_s:g}, "
            f"repeatable: {'true' if is_repeatable(each) else 'false'} }},\n"
            for each in model.calls
        )
        + "};\n",
        "/** Every remote method of a machine (docs/wire/calls.md). */\n"
        "export abstract class MachineCalls {\n"
        "  /** Any remote method by its name. */\n"
        "  abstract call<T>(method: string, params?: object): Promise<T>;\n\n"
        + "\n".join(map(_call, model.calls))
        + "}\n",
    ]
    return {"src/messages.ts": "\n".join(types), "src/calls.ts": "\n".join(calls)}


def _words(words: Words) -> str:
    lines = wrap(" | ".join(f'"{each}"' for each in words.words), WIDTH - 4, break_long_words=False)
    listed = "\n".join(f"  {'| ' if not line.startswith('|') else ''}{line}".rstrip() for line in lines)
    listed = listed.replace(" |\n  | ", "\n  | ")
    return f"export type {words.name} =\n{listed};\n"


def _interface(message: Message) -> str:
    fields = "".join(_field(each, message.sent) for each in message.fields)
    return f"{_comment(message.doc)}export interface {_name(message)} {{\n{fields}}}\n"


def _field(field: Field, sent: bool) -> str:
    optional = "" if field.required else "?"
    kind = _ts(field.type)
    if not field.required and sent:
        # undefined: as if it were left out
        kind += " | undefined"
    return f"{_comment(field.doc, '  ')}  {field.name}{optional}: {kind};\n"


def _ts(kind: Type) -> str:
    match kind:
        case Scalar(name):
            return SCALARS[name]
        case Named(name):
            return NAMES.get(name, name)
        case ListOf(inner):
            return f"{_ts(inner)}[]"
        case MapOf(inner):
            return f"Record<string, {_ts(inner)}>"
        case Maybe(inner):
            return f"{_ts(inner)} | null"


def _call(call: Call) -> str:
    fields = call.request.fields
    argument, params = "", ""
    if len(fields) == 1:
        optional = "" if fields[0].required else "?"
        argument = f"{camel(fields[0].name)}{optional}: {_ts(fields[0].type)}"
        key = "" if camel(fields[0].name) == fields[0].name else f"{fields[0].name}: "
        params = f", {{ {key}{camel(fields[0].name)} }}"
    elif fields:
        default = " = {}" if not any(each.required for each in fields) else ""
        argument, params = f"request: {_name(call.request)}{default}", ", request"
    reply = _name(call.reply)
    head = f"{_comment(call.method.doc, '  ')}  "
    if call.result is None:
        return (
            f"{head}{camel(call.name)}({argument}): Promise<{reply}> {{\n"
            f'    return this.call("{call.method.name}"{params});\n  }}\n'
        )
    return (
        f"{head}async {camel(call.name)}({argument}): Promise<{_ts(call.result.type)}> {{\n"
        f'    return (await this.call<{reply}>("{call.method.name}"{params})).{call.result.name};\n  }}\n'
    )


def _name(message: Message) -> str:
    return NAMES.get(message.name, message.name)


def _names(kind: Type) -> list[str]:
    match kind:
        case Named(name):
            return [NAMES.get(name, name)]
        case ListOf(inner) | MapOf(inner) | Maybe(inner):
            return _names(inner)
    return []


def _comment(text: str, indent: str = "") -> str:
    if not text:
        return ""
    lines = wrap(plain_doc(text, "null"), WIDTH - len(indent) - 7)
    if len(lines) == 1:
        return f"{indent}/** {lines[0]} */\n"
    return f"{indent}/**\n" + "".join(f"{indent} * {line}\n" for line in lines) + f"{indent} */\n"
