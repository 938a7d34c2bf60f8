"""The Rust SDK's types and calls."""

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
    Scalar,
    Type,
    Words,
    named,
    pascal,
    plain_doc,
)
from mcserver.contract.sdk.spelling import Spelling

MADE = "// Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.\n"
MESSAGES = f"""{MADE}
use std::collections::BTreeMap;

use serde::{{Deserialize, Serialize}};

use super::binary::Bytes;
use super::words::words;

/// A value of a drive's dictionary.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {{
    /// A truth value.
    Bool(bool),
    /// A signed number.
    Integer(i64),
    /// A number beyond them.
    Unsigned(u64),
    /// A float.
    Float(f64),
    /// A text, or bytes as hexadecimal.
    Text(String),
}}
"""
RUST = Spelling(
    scalars={
        "bool": "bool",
        "int": "u64",
        "float": "f64",
        "str": "String",
        "bytes": "Bytes",
        "any": "serde_json::Value",
        "level": "f64",
        "value": "Value",
    },
    list_of="Vec<{}>",
    map_of="BTreeMap<String, {}>",
    maybe="Option<{}>",
    # words of the language
    renamed={"override": "override_percent", "type": "kind"},
    nothing="None",
    empty_list="Vec::new()",
    empty_map="BTreeMap::new()",
    text='"{}".to_owned()',
    empty_text="String::new()",
    number="{:_}",
    word=lambda name, word: f"{name}::{pascal(word)}",
)
CALLS = {"override": "set_override"}
DOC = "    /// All that may be left out is as the server has it.\n"
WIDTH = 110
# What Rust's own defaults are.
EMPTY = {"None", "0", "0.0", "false", "Vec::new()", "BTreeMap::new()", "String::new()"}


def files(model: Model) -> dict[str, str]:
    """Return the files by their path below the SDK."""
    types = [MESSAGES, *map(_enum, model.words), *map(_struct, model.messages)]
    used = sorted(
        {each.reply.name for each in model.calls}
        | {each.request.name for each in model.calls if each.request.fields}
        | {found.name for each in model.calls if each.result for found in named(each.result.type)}
    )
    imports = "".join(f"    {line}\n" for line in wrap(", ".join(used) + ",", WIDTH - 4))
    head = (
        f"{MADE}#![allow(clippy::missing_errors_doc)]\n\nuse std::collections::BTreeMap;\n\n"
        f"use crate::calls::Nothing;\nuse crate::error::Result;\n"
        f"use crate::machine::Machine;\nuse crate::messages::{{\n{imports}}};\n\n"
        "/// Every remote method of a machine (docs/wire/calls.md); each fails as "
        "[`Machine::refresh_info`].\nimpl Machine {\n"
    )
    return {
        "src/messages/made.rs": "\n".join(types),
        "src/machine_calls.rs": head + "\n".join(map(_call, model.calls)) + "}\n",
        "src/contract_readers.rs": _readers(model),
    }


def _readers(model: Model) -> str:
    received = [each for each in model.messages if not each.sent]
    arms = "".join(f'        "{each.wire_name}" => reader::<messages::{each.name}>,\n' for each in received)
    return (
        f"{MADE}\nuse crate::contract_tests::{{Read, reader}};\nuse crate::messages;\n\n"
        "/// The reader of a message that a server sends as a map.\n"
        "#[allow(clippy::too_many_lines)] // a row a message\n"
        f"pub fn reader_of(message: &str) -> Option<Read> {{\n    Some(match message {{\n{arms}"
        "        _ => return None,\n    })\n}\n"
    )


def _enum(words: Words) -> str:
    # a line breaks between words only
    members = ", ".join(f'{pascal(each)}~=~"{each}"' for each in words.words)
    lines = [line.replace("~", " ") for line in wrap(f"{members},", WIDTH - 4)]
    return f"words!({words.name} {{\n" + "".join(f"    {line}\n" for line in lines) + "});\n"


def _struct(message: Message) -> str:
    fields = "".join(_field(message, each) for each in message.fields)
    body = f" {{\n{fields}}}" if fields else " {}"
    derived = "Debug, Clone, PartialEq, Serialize, Deserialize"
    derived += ", Default" if _is_empty_by_default(message) else ""
    made = f"{_comment(message.doc)}#[derive({derived})]\npub struct {message.name}{body}\n"
    defaults = "".join(
        f"\nfn {_default_name(message, each)}() -> {RUST.type(each.type)} {{\n    {RUST.default(each)}\n}}\n"
        for each in message.fields
        if _has_default(each) and not message.sent
    )
    made += defaults
    if not message.sent or not message.fields or _is_empty_by_default(message):
        return made
    return made + _constructor(message)


def _field(message: Message, field: Field) -> str:
    name = RUST.name(field.name)
    rules = [f'rename = "{field.name}"'] if name != field.name else []
    if not message.sent and not field.required:
        named = f' = "{_default_name(message, field)}"' if _has_default(field) else ""
        rules.append(f"default{named}")
    elif not message.sent and isinstance(field.type, Maybe):
        # nil, but not left out
        rules.append('deserialize_with = "Option::deserialize"')
    rule = f"    #[serde({', '.join(rules)})]\n" if rules else ""
    return f"{_comment(field.doc, '    ')}{rule}    pub {name}: {RUST.type(field.type)},\n"


def _has_default(field: Field) -> bool:
    return not field.required and bool(field.default)


def _default_name(message: Message, field: Field) -> str:
    return f"{''.join(f'_{c.lower()}' if c.isupper() else c for c in message.name).lstrip('_')}_{field.name}"


def _is_empty_by_default(message: Message) -> bool:
    defaults = [each.required or RUST.default(each) for each in message.fields]
    return message.sent and bool(defaults) and EMPTY.issuperset(defaults)


def _constructor(message: Message) -> str:
    required = [each for each in message.fields if each.required]
    arguments = ", ".join(
        f"{RUST.name(each.name)}: "
        + ("impl Into<String>" if each.type == Scalar("str") else RUST.type(each.type))
        for each in required
    )
    values = "".join(
        f"            {RUST.name(each.name)}"
        + (
            f": {RUST.name(each.name)}.into(),\n"
            if each.required and each.type == Scalar("str")
            else ",\n"
            if each.required
            else f": {RUST.default(each)},\n"
        )
        for each in message.fields
    )
    body = f" -> Self {{\n        Self {{\n{values}        }}\n    }}\n}}\n"
    if not required:
        return f"\nimpl Default for {message.name} {{\n{DOC}    fn default(){body}"
    return f"\nimpl {message.name} {{\n{DOC}    #[must_use]\n    pub fn new({arguments}){body}"


def _argument(kind: Type, name: str) -> tuple[str, str]:
    """Return the type of an argument, and what is made of it."""
    match kind:
        case Scalar("str"):
            return "&str", f"{name}.to_owned()"
        case ListOf(inner):
            return f"&[{RUST.type(inner)}]", f"{name}.to_vec()"
        case MapOf(inner):
            return f"&BTreeMap<String, {RUST.type(inner)}>", f"{name}.clone()"
        case Maybe(Scalar("str")):
            return "Option<&str>", f"{name}.map(str::to_owned)"
        case Maybe(ListOf(inner)):
            return f"Option<&[{RUST.type(inner)}]>", f"{name}.map(<[_]>::to_vec)"
    return RUST.type(kind), name


def _call(call: Call) -> str:
    fields, request = call.request.fields, call.request.name
    argument, value = "", "&Nothing {}"
    if len(fields) == 1:
        name = RUST.name(fields[0].name)
        kind, made = _argument(fields[0].type, name)
        argument = f", {name}: {kind}"
        value = f"&{request} {{ {name}: {made} }}" if made != name else f"&{request} {{ {name} }}"
    elif fields:
        argument, value = f", request: &{request}", "request"
    ask = f'self.ask_within("{call.method.name}", {value}, {call.method.deadline_s:g}).await'
    declare = "        self.declare_token().await?;\n" if call.method.held else ""
    if call.result is None:
        result, body = call.reply.name, f"        {ask}\n"
    else:
        result = RUST.type(call.result.type)
        body = f"        let reply: {call.reply.name} = {ask}?;\n        Ok(reply.{call.result.name})\n"
    return (
        _comment(call.method.doc, "    ")
        + f"    pub async fn {CALLS.get(call.name, call.name)}(&self{argument}) -> Result<{result}> {{\n"
        f"{declare}{body}    }}\n"
    )


def _comment(text: str, indent: str = "") -> str:
    # links of rustdoc
    plain = plain_doc(text, "none").replace("[", "\\[").replace("]", "\\]").replace("<", "\\<")
    return "".join(f"{indent}/// {line}\n" for line in wrap(plain, WIDTH - 4 - len(indent)))
