"""The pages say every code that people are given, and every key of a machine file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import msgspec

from deploy.site.references import codes_of, codes_page, keys_page
from mcserver.machine.sections import MachineFile

ROOT = Path(__file__).parents[2]
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
    codes = codes_of(ROOT)
    assert len(codes) > 250
    assert set(codes) - set(re.findall(r"MC\d{3}", pages())) == set()


def test_the_site_s_page_of_codes_has_what_pages_say_of_each() -> None:
    texts = {
        "docs/a.md": "# A\n\n| `MC101` | a [link](b.md) | mend it |\n",
        "docs/wire/b.md": "# B\n\nMC103\n",
    }
    assert codes_page(["MC101", "MC103"], texts, "docs/codes.md").splitlines()[4:] == [
        "## MC101",
        "",
        "- a link · mend it ([A](a.md))",
        "",
        "## MC103",
        "",
        "- see [B](wire/b.md)",
    ]
    spans = {"docs/a.md": "# A\n\n| MC030 … MC032, MC035 | homing |\n"}
    assert codes_page(["MC031", "MC035"], spans, "docs/codes.md").count("- homing ([A](a.md))") == 2


def test_the_site_s_page_of_keys_has_each_with_what_it_takes() -> None:
    page = keys_page()
    # a heading each, as of codes: the search puts these first
    assert {key for key in keys_of(MachineFile) if f"\n#### `{key}`\n" not in page} == set()
    assert (
        "#### `cycle_hz`\n\nnumber ≥ 10, ≤ 10000 · default `1000.0` · 1000 is usual · of `[machine]`\n"
        in page
    )
    assert "#### `axis`\n\nlist of [AxisSection](#AxisSection) · needed · of A whole machine file\n" in page


def test_every_key_of_a_machine_file_stands_in_a_page() -> None:
    keys = set(keys_of(MachineFile))
    assert len(keys) > 150
    assert keys - set(re.findall(r"\w+", pages())) == set()
