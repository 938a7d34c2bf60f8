"""Texts of the page in the language of who reads it, by gettext catalogues (``locale``)."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

LOCALE = Path(__file__).parent / "locale"
# as Quasar names them, and by themselves
LANGUAGES = {"en-US": "English", "de": "Deutsch", "zh-CN": "中文"}
ENGLISH = "en-US"
# of the browser, which keeps the choice
COOKIE = "mc-language"
_ENTRY = re.compile(r'^msgid (".*"(?:\n".*")*)\nmsgstr (".*"(?:\n".*")*)', re.M)
_FUZZY = re.compile(r"^#,.*\bfuzzy\b", re.M)


class Message(str):
    """A text in English, as it is logged and kept, that `t` says in the language of who reads it."""

    template: str
    values: dict[str, object]

    def removeprefix(self, prefix: str, /) -> str:
        # errors take their code away from a text: one that does not have it stays a message
        return super().removeprefix(prefix) if self.startswith(prefix) else self


def mark(template: str, **values: object) -> Message:
    """Return a text that is shown to several, or later.

    Args:
        values: of the template's fields; those that are messages are translated, too.
    """
    made = Message(template.format(**values) if values else template)
    made.template, made.values = template, values
    return made


def t(text: str, **values: object) -> str:
    """Return a text in the language of the page that is being built or changed.

    Args:
        text: English, a message, or a template whose fields are ``values``.
    """
    return t_in(language(), text, **values)


def t_in(language: str, text: str, **values: object) -> str:
    """Return a text in a language, as `t` does."""
    if isinstance(text, Message):
        values, text = {**text.values, **values}, text.template
    shown = catalogue(language).get(text, text)
    if not values:
        return shown
    said = {
        name: t_in(language, each) if isinstance(each, Message) else each for name, each in values.items()
    }
    try:
        return shown.format(**said)
    except (LookupError, ValueError):
        # of a catalogue that somebody has corrected: other fields must not take the page away
        return text.format(**said)


def language() -> str:
    """Return the language of the page that is being built or changed; English where there is none."""
    # what only computes and keeps marks its texts without loading NiceGUI
    from nicegui.slot import Slot

    stack = Slot.get_stack()
    chosen = stack[-1].parent.client.page.language if stack else ENGLISH
    return chosen if chosen in LANGUAGES else ENGLISH


@cache
def catalogue(language: str) -> dict[str, str]:
    """Return the texts of a language by the English ones; empty for English."""
    if language == ENGLISH:
        return {}
    return texts_of((LOCALE / f"{language}.po").read_text("utf-8"))


def texts_of(po: str) -> dict[str, str]:
    """Return the translations of a gettext catalogue (a PO file without contexts and plurals).

    Entries that are empty, marked ``fuzzy``, commented out or spoilt are none: these texts stay English.
    """
    found = {}
    for entry in re.split(r"\n\s*\n", po):
        match = _ENTRY.search(entry)
        if match is None or _FUZZY.search(entry):
            continue
        with contextlib.suppress(ValueError):
            # PO escapes as C does; JSON knows what of it texts need
            text, said = ("".join(map(json.loads, part.splitlines())) for part in match.groups())
            found[text] = said
    return {text: said for text, said in found.items() if text and said}


def language_for(chosen: str, accepted: str) -> str:
    """Return the language of a page.

    Args:
        chosen: on a page before; empty: none was. accepted: the browser's header ``Accept-Language``.
    """
    if chosen in LANGUAGES:
        return chosen
    return next((found for tag in _by_preference(accepted) if (found := _known(tag)) is not None), ENGLISH)


def _by_preference(accepted: str) -> Iterable[str]:
    weighed = []
    for part in accepted.split(","):
        tag, _, weight = part.partition(";")
        try:
            quality = float(weight.strip().removeprefix("q=") or 1.0)
        except ValueError:
            continue
        if quality > 0.0:
            weighed.append((quality, tag.strip().lower()))
    return [tag for _, tag in sorted(weighed, key=lambda each: -each[0])]


def _known(tag: str) -> str | None:
    base = tag.partition("-")[0]
    return next((each for each in LANGUAGES if each.lower().partition("-")[0] == base), None)
