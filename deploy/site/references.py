"""Pages made from the source: keys of a machine file, and every code with what the pages say of it."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from mcserver.machine.sections import MachineFile

Schema = dict[str, Any]

SOURCES = ("mcserver", "clients/python/mcclient")
CODE = re.compile(r"MC\d{3}")
SPAN = re.compile(r"MC(\d{3})`? *… *`?MC(\d{3})")
LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
BOUNDS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}


def codes_of(root: Path) -> list[str]:
    """Return every code that people are given."""
    texts = (file.read_text("utf-8") for top in SOURCES for file in root.joinpath(top).rglob("*.py"))
    return sorted({code for text in texts for code in re.findall(r'"(MC\d{3})"', text)})


def codes_page(codes: Iterable[str], pages: Mapping[str, str], place: str) -> str:
    """Return a heading for each code, and below it what the pages say of it.

    Args:
        pages: their texts by their paths.
        place: path of the page that is made.
    """
    said: dict[str, list[str]] = {}
    for page, text in pages.items():
        there = os.path.relpath(page, Path(place).parent)
        title = text.partition("\n")[0].removeprefix("# ")
        mentioned = set()
        for line in text.splitlines():
            cells = [LINK.sub(r"\1", cell).strip() for cell in line.strip().strip("|").split(" | ")]
            if line.startswith("|"):
                row = " · ".join(cell for cell in cells[1:] if cell)
                for code in _codes_in(cells[0]):
                    said.setdefault(code, []).append(f"- {row} ([{title}]({there}))")
            mentioned |= _codes_in(line)
        for code in mentioned:
            said.setdefault(code, []).append(f"- see [{title}]({there})")
    parts = ["# Codes\n\nEvery code, and what the pages say of it.\n"]
    for code in codes:
        rows = said[code]
        explained = [row for row in rows if not row.startswith("- see ")]
        parts.append(f"## {code}\n\n" + "\n".join(dict.fromkeys(explained or rows)) + "\n")
    return "\n".join(parts)


def _codes_in(text: str) -> set[str]:
    spans = (range(int(first), int(last) + 1) for first, last in SPAN.findall(text))
    return {*CODE.findall(text), *(f"MC{number:03}" for span in spans for number in span)}


def keys_page() -> str:
    """Return every key of a machine file: what it takes, its default, and the hint that a mistake shows."""
    parts = [
        "# Keys of a machine file\n\nMade from what the server reads such a file by. What they are for, "
        "with an example: [machine files](README.md#machine-files).\n"
    ]
    for name, section in msgspec.json.schema(MachineFile)["$defs"].items():
        title = section.get("description", name).splitlines()[0].rstrip(".").replace("``", "`")
        # a heading each, which the search ranks above the pages that mention a key
        keys = []
        for key, value in section["properties"].items():
            needed = key in section.get("required", ())
            default = "" if needed or value.get("default", ()) in ({}, [], None, ()) else value["default"]
            shown = "" if default == "" or isinstance(default, dict) else f"`{json.dumps(default)}`"
            default = "needed" if needed else shown and f"default {shown}"
            cells = [_value(value), default, _hint(value), f"of {title}"]
            keys.append(f"#### `{key}`\n\n" + " · ".join(cell for cell in cells if cell) + "\n")
        parts.append(f'<a id="{name}"></a>\n## {title}\n\n' + "\n".join(keys))
    return "\n".join(parts)


def _value(schema: Schema) -> str:
    """Say what a key takes."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name})"
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(each)}`" for each in schema["enum"])
    if "anyOf" in schema:
        return " or ".join(_value(each) for each in schema["anyOf"] if each.get("type") != "null")
    if schema.get("type") == "array":
        items = schema.get("items") or {"type": "any"}
        return f"list of {_value(items) if items else 'any'}"
    if schema.get("type") == "object":
        return f"table of {_value(schema.get('additionalProperties') or {})}"
    bounds = [f"{sign} {schema[name]:g}" for name, sign in BOUNDS.items() if name in schema]
    return " ".join([str(schema.get("type", "any")), ", ".join(bounds)]).strip()


def _hint(schema: Schema) -> str:
    inner = [schema, *schema.get("anyOf", ())]
    return next((each["description"] for each in inner if "description" in each and "$ref" not in each), "")
