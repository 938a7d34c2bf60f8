"""The TypeScript SDK's types and calls."""

from __future__ import annotations

from textwrap import wrap

from mcserver.contract.sdk.model import (
    Call,
    Field,
    Message,
    Model,
    Words,
    camel,
    is_repeatable,
    named,
    plain_doc,
)
from mcserver.contract.sdk.spelling import Spelling

MADE = "// Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.\n"
TS = Spelling(
    scalars={
        "bool": "boolean",
        "int": "number",
        "float": "number",
        "str": "string",
        "bytes": "Uint8Array",
        "any": "unknown",
        "level": "boolean | number",
        "value": "boolean | number | string",
    },
    list_of="{}[]",
    map_of="Record<string, {}>",
    maybe="{} | null",
    # a browser's own type has that name
    renamed={"Event": "MotionEvent"},
)
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
        {TS.name(each.request.name) for each in model.calls if len(each.request.fields) > 1}
        | {TS.name(each.reply.name) for each in model.calls}
        | {TS.name(found.name) for each in model.calls if each.result for found in named(each.result.type)}
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
    return f"{_comment(message.doc)}export interface {TS.name(message.name)} {{\n{fields}}}\n"


def _field(field: Field, sent: bool) -> str:
    optional = "" if field.required else "?"
    kind = TS.type(field.type)
    if not field.required and sent:
        # undefined: as if it were left out
        kind += " | undefined"
    return f"{_comment(field.doc, '  ')}  {field.name}{optional}: {kind};\n"


def _call(call: Call) -> str:
    fields = call.request.fields
    argument, params = "", ""
    if len(fields) == 1:
        optional = "" if fields[0].required else "?"
        argument = f"{camel(fields[0].name)}{optional}: {TS.type(fields[0].type)}"
        key = "" if camel(fields[0].name) == fields[0].name else f"{fields[0].name}: "
        params = f", {{ {key}{camel(fields[0].name)} }}"
    elif fields:
        default = " = {}" if not any(each.required for each in fields) else ""
        argument, params = f"request: {TS.name(call.request.name)}{default}", ", request"
    reply = TS.name(call.reply.name)
    head = f"{_comment(call.method.doc, '  ')}  "
    if call.result is None:
        return (
            f"{head}{camel(call.name)}({argument}): Promise<{reply}> {{\n"
            f'    return this.call("{call.method.name}"{params});\n  }}\n'
        )
    return (
        f"{head}async {camel(call.name)}({argument}): Promise<{TS.type(call.result.type)}> {{\n"
        f'    return (await this.call<{reply}>("{call.method.name}"{params})).{call.result.name};\n  }}\n'
    )


def _comment(text: str, indent: str = "") -> str:
    if not text:
        return ""
    lines = wrap(plain_doc(text, "null"), WIDTH - len(indent) - 7)
    if len(lines) == 1:
        return f"{indent}/** {lines[0]} */\n"
    return f"{indent}/**\n" + "".join(f"{indent} * {line}\n" for line in lines) + f"{indent} */\n"
