"""The Java SDK's types and calls."""

from __future__ import annotations

from dataclasses import replace
from textwrap import indent, wrap

from mcserver.contract.sdk.model import (
    Call,
    Field,
    Maybe,
    Message,
    Model,
    Words,
    camel,
    constant,
    is_repeatable,
    plain_doc,
)
from mcserver.contract.sdk.spelling import Spelling

MADE = "// Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.\n"
FOLDER = "src/main/java/org/mcserver/client"
MESSAGES = f"""{MADE}package org.mcserver.client;

import java.lang.annotation.ElementType;
import java.lang.annotation.Retention;
import java.lang.annotation.RetentionPolicy;
import java.lang.annotation.Target;
import java.util.List;
import java.util.Locale;
import java.util.Map;

/**
 * The messages of the key space, as plain values (docs/keyspace.md): positions in mm or deg, velocities
 * in mm/s or deg/s, torques in N·m, times in seconds since the executor's start, percentages in %. What may
 * be left out and has no value is null, and {{@code withX}} gives the same request with another X. An
 * {{@code Object}} is a Boolean, a Long, a Double or a String.
 */
public final class Messages {{
    private Messages() {{}}

    /** It may be left out: then it is 0, false or empty (boxed, a record or "null": null), or this. */
    @Retention(RetentionPolicy.RUNTIME)
    @Target(ElementType.RECORD_COMPONENT)
    @interface Sparse {{
        String value() default "";
    }}

    /** The field is there, and may be nil. */
    @Retention(RetentionPolicy.RUNTIME)
    @Target(ElementType.RECORD_COMPONENT)
    @interface Nil {{}}

    /** A text of a few known values, UNKNOWN for those of a later version. */
    public interface Word {{
        /** The constant. */
        String name();

        /** As the wire has it. */
        default String word() {{
            return name().equals("UNKNOWN") ? "" : name().toLowerCase(Locale.ROOT);
        }}
    }}

"""
CALLS = f"""{MADE}package org.mcserver.client;

import java.time.Duration;
import java.util.List;
import java.util.Map;
import java.util.Set;
import java.util.concurrent.CompletableFuture;

/** Every remote method of a machine (docs/wire/calls.md). */
public abstract class MachineCalls {{
    MachineCalls() {{}}

    abstract <T extends Record> CompletableFuture<T> ask(
            String method, Map<String, Object> params, Class<T> reply);

"""
JAVA = Spelling(
    scalars={
        "bool": "boolean",
        "int": "long",
        "float": "double",
        "level": "double",
        "str": "String",
        "bytes": "byte[]",
        "any": "Object",
        "value": "Object",
    },
    boxed={"bool": "Boolean", "int": "Long", "float": "Double", "level": "Double"},
    list_of="List<{}>",
    map_of="Map<String, {}>",
    maybe="{}",
    empty_list="List.of()",
    empty_map="Map.of()",
    word=lambda name, word: f"{name}.{constant(word)}",
)
# outside of `Messages`
OUTSIDE = replace(JAVA, named="Messages.{}")
WIDTH = 120


def files(model: Model) -> dict[str, str]:
    """Return the files by their path below the SDK."""
    types = [*map(_enum, model.words), *map(_record, model.messages)]
    calls = [_facts(model), *map(_call, model.calls)]
    return {
        f"{FOLDER}/Messages.java": MESSAGES + "\n".join(types) + "}\n",
        f"{FOLDER}/MachineCalls.java": CALLS + "\n".join(calls) + "}\n",
    }


def _enum(words: Words) -> str:
    if all(constant(each).lower() == each for each in words.words):
        constants = ", ".join([*map(constant, words.words), "UNKNOWN"])
        body = indent("\n".join(wrap(constants, WIDTH - 8)), "        ")
        head = f"    /** A word of the wire. */\n    public enum {words.name} implements Word {{"
        return f"{head}\n{body}\n    }}\n"
    members = "\n".join(f'        {constant(each)}("{each}"),' for each in words.words)
    return f"""    /** A word of the wire. */
    public enum {words.name} implements Word {{
{members}
        /** A word of a later version. */
        UNKNOWN("");

        private final String word;

        {words.name}(String word) {{
            this.word = word;
        }}

        @Override
        public String word() {{
            return word;
        }}
    }}
"""


def _record(message: Message) -> str:
    notes = [(camel(each.name), each.doc) for each in message.fields if each.doc]
    components = ", ".join(
        f"{_rule(each, message.sent)}{JAVA.type(each.type)} {camel(each.name)}" for each in message.fields
    )
    lines = "\n".join(wrap(components, WIDTH - 12, break_long_words=False))
    head = f"public record {message.name}("
    text = (
        f"{head}{components}) {{"
        if len(head + components) < WIDTH - 8
        else f"{head}\n{indent(lines, '        ')}) {{"
    )
    body = _constructors(message) if message.sent else ""
    closing = f"\n{body}}}\n" if body else "}\n"
    return indent(f"{_doc(message.doc, notes)}{text}{closing}", "    ")


def _constructors(message: Message) -> str:
    optional = [each for each in message.fields if not each.required]
    if not optional:
        return ""
    required = [each for each in message.fields if each.required]
    arguments = ", ".join(f"{JAVA.type(each.type)} {camel(each.name)}" for each in required)
    values = ", ".join(camel(each.name) if each.required else JAVA.default(each) for each in message.fields)
    made = (
        "    /** All that may be left out as the server has it. */\n"
        f"    public {message.name}({arguments}) {{\n        this({values});\n    }}\n"
    )
    if len(message.fields) == 1:
        return made
    for field in optional:
        kind, name = JAVA.type(field.type), camel(field.name)
        values = ", ".join(camel(each.name) for each in message.fields)
        made += (
            f"\n    public {message.name} with{name[0].upper()}{name[1:]}({kind} {name}) {{\n"
            f"        return new {message.name}({values});\n    }}\n"
        )
    return made


def _rule(field: Field, sent: bool) -> str:
    if sent:
        return ""
    if field.required:
        return "@Nil " if isinstance(field.type, Maybe) else ""
    if isinstance(field.type, Maybe) and JAVA.type(field.type) == "String":
        return '@Sparse("null") '
    if isinstance(field.default, str | float) and field.default:
        default = f"{field.default:g}" if isinstance(field.default, float) else field.default
        return f'@Sparse("{default}") '
    return "@Sparse "


def _facts(model: Model) -> str:
    repeatable = ", ".join(f'"{each.method.name}"' for each in model.calls if is_repeatable(each))
    limits = ",\n            ".join(
        f'Map.entry("{each.method.name}", Duration.ofSeconds({each.method.deadline_s:g}))'
        for each in model.calls
    )
    lines = "\n            ".join(wrap(repeatable, WIDTH - 14))
    return (
        "    /** Calls that change nothing, or stop: they may be sent again under any circumstances. */\n"
        f"    static final Set<String> REPEATABLE = Set.of(\n            {lines});\n\n"
        "    /** How long a server may take for an answer. */\n"
        f"    static final Map<String, Duration> DEADLINES = Map.ofEntries(\n            {limits});\n"
    )


def _call(call: Call) -> str:
    fields, request = call.request.fields, call.request.name
    argument, params, notes = "", "Map.of()", []
    if len(fields) == 1:
        name = camel(fields[0].name)
        argument, params = (
            f"{OUTSIDE.type(fields[0].type)} {name}",
            f"Wire.params(new Messages.{request}({name}))",
        )
        notes = [(name, fields[0].doc)] if fields[0].doc else []
    elif fields:
        argument, params = f"Messages.{request} request", "Wire.params(request)"
    reply = f"Messages.{call.reply.name}"
    ask = f'ask("{call.method.name}", {params}, {reply}.class)'
    result, then = reply, ""
    if call.result is not None:
        result = OUTSIDE.type(call.result.type, inside=True)
        then = f".thenApply({reply}::{camel(call.result.name)})"
    return indent(
        f"{_doc(call.method.doc, notes)}"
        f"public CompletableFuture<{result}> {camel(call.name)}({argument}) {{\n"
        f"    return {ask}{then};\n}}\n",
        "    ",
    )


def _doc(text: str, notes: list[tuple[str, str]]) -> str:
    def plain(each: str) -> str:
        return (
            plain_doc(each, "null")
            .replace("&", "&amp;")
            .replace("<", "&lt;")
            .replace(">", "&gt;")
            .replace("@", "&#64;")
        )

    lines = wrap(plain(text), WIDTH - 12)
    for name, doc in notes:
        lines += wrap(f"@param {name} {plain(doc)}", WIDTH - 12, subsequent_indent="    ")
    if len(lines) == 1:
        return f"/** {lines[0]} */\n"
    return "/**\n" + "".join(f" * {line}\n" for line in lines) + " */\n"
