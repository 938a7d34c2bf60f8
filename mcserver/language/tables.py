"""Write the generated parts of docs/dialect.md: the tables of codes and words, and the rules.

``python -m mcserver.language.tables docs/dialect.md`` rewrites the page; a test holds it to be current.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from mcserver.gcode.text.command_table import COMMANDS, CommandSpec
from mcserver.gcode.text.word_table import WORDS
from mcserver.language.rules import rules

_PART = re.compile(r"<!-- generated: (?P<name>[a-z]+) -->\n.*?<!-- end -->", re.DOTALL)


def words_of(spec: CommandSpec) -> str:
    """List the words that a code takes."""
    return ", ".join((["axis words"] if spec.takes_axes else []) + list(spec.words)) or "–"


def links(names: Sequence[str]) -> str:
    """List rules as links within the page."""
    return " ".join(f"[{name}](#{name.lower()})" for name in names)


def command_rows() -> str:
    """Write the table of codes."""
    rows = [
        f"| `{spec.name}` | {spec.title} | {words_of(spec)} | `{spec.example}` | {links(spec.rules)} |"
        for spec in COMMANDS
    ]
    return "\n".join(["| code | what it does | words | example | rules |", "|---|---|---|---|---|", *rows])


def word_rows() -> str:
    """Write the table of words."""
    rows = [
        f"| {' '.join(f'`{letter}`' for letter in spec.letters)} | {spec.title} | {spec.unit or '–'} "
        f"| {links(spec.rules)} |"
        for spec in WORDS
    ]
    return "\n".join(["| word | meaning | unit | rules |", "|---|---|---|---|", *rows])


def rule_sections() -> str:
    """Write the rules, each under its anchor."""
    return "\n\n".join(
        f'<a id="{rule.anchor}"></a>\n### {rule.name} {rule.title}\n\n{rule.text}'
        for rule in rules().values()
    )


def parts() -> Mapping[str, str]:
    """Return each generated part by its name."""
    return MappingProxyType({"codes": command_rows(), "words": word_rows(), "rules": rule_sections()})


def renew(page: str) -> str:
    """Replace every generated part of a page.

    Raises:
        KeyError: the page asks for a part that does not exist.
    """
    made = parts()
    return _PART.sub(
        lambda found: f"<!-- generated: {found['name']} -->\n{made[found['name']]}\n<!-- end -->", page
    )


if __name__ == "__main__":
    for name in sys.argv[1:]:
        path = Path(name)
        path.write_text(renew(path.read_text("utf-8")), "utf-8")
