"""The pages say every code that people are given, and every key of a machine file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import msgspec

from mcserver.machine.sections import MachineFile

ROOT = Path(__file__).parents[2]
SOURCES = ("mcserver", "clients/python/mcclient")
# agreed with a drive at boot-up, not written in a file
NOT_IN_FILES = frozenset({"process_data"})


def pages() -> str:
    return "\n".join(
        page.read_text("utf-8") for top in ("docs", "deploy") for page in ROOT.joinpath(top).rglob("*.md")
    )


def keys_of(kind: object) -> Iterator[str]:
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        for field in msgspec.structs.fields(kind):
            if field.name not in NOT_IN_FILES:
                yield field.encode_name
                yield from keys_of(field.type)
    for inner in get_args(kind):
        yield from keys_of(inner)


def test_every_code_stands_in_a_page_as_it_is_searched_for() -> None:
    texts = (file.read_text("utf-8") for top in SOURCES for file in ROOT.joinpath(top).rglob("*.py"))
    codes = {code for text in texts for code in re.findall(r'"(MC\d{3})"', text)}
    assert len(codes) > 250
    assert codes - set(re.findall(r"MC\d{3}", pages())) == set()


def test_every_key_of_a_machine_file_stands_in_a_page() -> None:
    keys = set(keys_of(MachineFile))
    assert len(keys) > 150
    assert keys - set(re.findall(r"\w+", pages())) == set()
