"""``[[button]]``: the machine's own programs that operators start from the page, with numbers to enter."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from mcserver.machine.section_reader import Mistakes

MAX_BUTTONS = 50
MAX_ARGUMENTS = 10
PLACE = re.compile(r"\{([^{}\n]*)\}")


class ButtonArgument(msgspec.Struct, frozen=True):
    """``[[button.argument]]``: a number to enter, in the units of the text.

    Attributes:
        name: replaced in the text where it is ``{name}``. low, high: limits. default: shown first; None: low.
        unit: for people, such as ``mm``.
    """

    name: Annotated[str, Meta(pattern="^[a-z][a-z0-9_]{0,30}$", description="a word such as depth")]
    low: float
    high: float
    default: float | None = None
    unit: Annotated[str, Meta(max_length=12, description="a short word, such as mm")] = ""

    @property
    def first(self) -> float:
        """Number that is shown first."""
        return self.low if self.default is None else self.default


class Button(msgspec.Struct, frozen=True):
    """``[[button]]``.

    Attributes:
        text: lines of G-code, run as a program. role: lowest role that may press it.
        confirm: sentence to confirm before it runs; empty: its text is shown, as always.
        group: heading on the page.
    """

    name: Annotated[str, Meta(pattern="^[^\\x00-\\x1f]{1,40}$", description="1 to 40 characters")]
    text: Annotated[str, Meta(min_length=1, max_length=20_000, description="lines of G-code")]
    role: Literal["operator", "engineer"] = "operator"
    confirm: Annotated[str, Meta(max_length=200, description="one sentence")] = ""
    argument: list[ButtonArgument] = []
    group: Annotated[str, Meta(max_length=40, description="a heading")] = ""


def read_buttons(sections: Sequence[Button | None], mistakes: Mistakes) -> tuple[Button, ...]:
    """Return the buttons of a file, with names and places checked; G-code is not read here."""
    if len(sections) > MAX_BUTTONS:
        mistakes.add(("button",), f"{len(sections)} buttons", f"{MAX_BUTTONS} at most")
    names: set[str] = set()
    found = []
    for position, button in enumerate(sections):
        if button is None:
            continue
        path = ("button", position)
        if button.name in names:
            mistakes.add((*path, "name"), f'"{button.name}" is there twice', "name each button once")
        names.add(button.name)
        if len(button.argument) > MAX_ARGUMENTS:
            mistakes.add((*path, "argument"), "asks for too much", f"ask for {MAX_ARGUMENTS} at most")
        asked: set[str] = set()
        for index, each in enumerate(button.argument):
            where = (*path, "argument", index)
            if each.name in asked:
                mistakes.add((*where, "name"), f"{each.name} is asked for twice", "name each once")
            asked.add(each.name)
            if not each.low <= each.first <= each.high:
                mistakes.add(where, "low, default and high are not in order", "give low ≤ default ≤ high")
            if f"{{{each.name}}}" not in button.text:
                mistakes.add(
                    (*where, "name"), f"the text has no {{{each.name}}}", "write it where the number goes"
                )
        for unknown in sorted(set(PLACE.findall(button.text)) - asked):
            known = ", ".join(sorted(asked)) or "none"
            mistakes.add(
                (*path, "text"),
                f"{{{unknown}}} is not asked for",
                f"add a [[button.argument]]; there is {known}",
            )
        found.append(button)
    return tuple(found)


def filled(text: str, values: Mapping[str, float]) -> str:
    """Return a button's text with the numbers filled in, without exponents, as programs write them."""
    return PLACE.sub(lambda place: f"{values[place[1]]:.6f}".rstrip("0").rstrip("."), text)
