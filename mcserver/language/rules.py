"""The rules of the dialect (D-nn) as data, for the documentation, editors and agents."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib import resources
from types import MappingProxyType

import msgspec

_HEADING = re.compile(r"^## (D-[0-9]{2,3}[a-z]?) (.+)$", re.MULTILINE)


class Rule(msgspec.Struct, frozen=True):
    """One rule.

    Attributes:
        name: such as ``D-22``.
        title: a few words.
        text: Markdown.
    """

    name: str
    title: str
    text: str

    @property
    def anchor(self) -> str:
        """Return its anchor in docs/dialect.md."""
        return self.name.lower()


@cache
def rules() -> Mapping[str, Rule]:
    """Return every rule by its name, in the order of the document."""
    source = resources.files("mcserver.language").joinpath("rules.md").read_text("utf-8")
    headings = list(_HEADING.finditer(source))
    ends = [heading.start() for heading in headings[1:]] + [len(source)]
    found = {
        heading[1]: Rule(heading[1], heading[2].strip(), source[heading.end() : end].strip())
        for heading, end in zip(headings, ends, strict=True)
    }
    return MappingProxyType(found)
