"""A reader of grammars written rule by rule, so that what `mcserver grammar` prints is what is tested.

It turns EBNF or GBNF text into one regular expression; neither may have recursion.
"""

from __future__ import annotations

import re

from mcserver.language.grammar.expressions import Grammar
from mcserver.language.grammar.notations import write_regex

TOKEN = re.compile(
    r"""\s*(?:(?P<name>[A-Za-z][\w-]*)(?=\s*::=)|(?P<ref>[A-Za-z][\w-]*)|::=|"(?P<text>[^"]*)"|(?P<set>\[[^\]]*\])
    |(?P<code>\#x[0-9A-F]+)|(?P<count>\{\d+,\d*\}|[?*+])|(?P<mark>[()|]))""",
    re.VERBOSE,
)


def read_grammar(written: str) -> tuple[str, dict[str, str]]:
    """The start rule's name, and each rule as a regular expression with ``<name>`` for references."""
    rules: dict[str, str] = {}
    for line in written.splitlines():
        if not line or line.startswith(("#", "/*")):
            continue
        pieces: list[str] = []
        position, name = 0, ""
        while position < len(line):
            found = TOKEN.match(line, position)
            assert found is not None, line[position:]
            position = found.end()
            if found["name"]:
                name = found["name"]
            elif found["ref"]:
                pieces.append(f"(?:<{found['ref']}>)")
            elif found["text"] is not None:
                pieces.append(f"(?:{re.escape(found['text'])})")
            elif found["set"]:
                pieces.append(as_class(found["set"]))
            elif found["code"]:
                pieces.append(re.escape(chr(int(found["code"][2:], 16))))
            elif found["count"]:
                pieces.append(found["count"])
            elif found["mark"]:
                pieces.append("(?:" if found["mark"] == "(" else found["mark"])
        assert name, line
        assert name not in rules, line
        rules[name] = "".join(pieces)
    return next(iter(rules)), rules


def as_class(written: str) -> str:
    """A set of either notation as one of Python's."""
    return re.sub(
        r"#x([0-9A-F]+)|\\x([0-9A-F]{2})", lambda hit: re.escape(chr(int(hit[1] or hit[2], 16))), written
    )


def pattern_of(rules: dict[str, str], rule: str) -> str:
    """One rule with every reference replaced."""
    return re.sub(r"<([\w-]+)>", lambda hit: pattern_of(rules, hit[1]), rules[rule])


class Recognizer:
    """Decides whether texts can be derived from a rule, with the regular expression of the grammar."""

    def __init__(self, grammar: Grammar, rule: str = "line") -> None:
        self._pattern = re.compile(write_regex(grammar, rule))

    def accepts(self, text: str) -> bool:
        """Return True if the whole text can be derived."""
        return self._pattern.fullmatch(text) is not None
