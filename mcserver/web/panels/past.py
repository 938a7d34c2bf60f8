"""The machine's past: runs, faults and recordings from the folder of ``mcserver history``."""

from __future__ import annotations

import html
from datetime import datetime
from functools import partial
from typing import Any

from mcclient import MotionError
from nicegui import ui

from mcserver.web.actions import show_error
from mcserver.web.link import MachineLink
from mcserver.web.panels.card import card
from mcserver.web.panels.replay import show_replay
from mcserver.web.past import WHATS, WHENS, Answer, Past
from mcserver.web.translation import t

SHOWN = 100
# an answer is kept so long [s], whoever asks
KEPT_S = 10.0
RECORDING = "recording"
# columns that are drawn as bars, as percentages are
COUNTS = frozenset({"times", "finished", "broken_off"})


class PastPanel:
    """One ready question at a time, answered when it is asked; recordings are played from their rows."""

    def __init__(self, link: MachineLink, past: Past) -> None:
        self._link = link
        self._past = past
        with card(t("History")):
            with ui.row().classes("items-center w-full gap-4"):
                self._what = ui.select(
                    {each: t(each) for each in WHATS}, value=WHATS[0], label=t("What")
                ).classes("min-w-32")
                self._when = ui.select(
                    {each: t(each) for each in WHENS}, value=WHENS[0], label=t("When")
                ).classes("min-w-28")
                ui.button(t("Look up"), on_click=self._look_up).props("outline data-look")
            self._state = ui.label("").classes("text-xs").props("aria-live=polite")
            self._table = ui.html("", sanitize=False).classes("mc-events")
            self._table.props(f'tabindex=0 aria-label="{t("History")}"')
            self._recordings = ui.element("div").classes("w-full")

    async def _look_up(self) -> None:
        what, when, link = str(self._what.value), str(self._when.value), self._link
        self._state.set_text("…")
        try:
            names, rows = await link.answers.get(
                f"past {what} {when}", KEPT_S, partial(self._past.ask, what, when, link.name)
            )
        except MotionError as error:
            self._state.set_text("")
            show_error(error)
            return
        more = t(", the newest {count} are shown", count=SHOWN) if len(rows) > SHOWN else ""
        self._state.set_text(t("{count} rows{more}; times are UTC", count=len(rows), more=more))
        self._table.set_content(table_html((names, rows)))
        self._recordings.clear()
        with self._recordings:
            for name in recordings_of((names, rows)):
                ui.button(t("Play {name}", name=name), on_click=partial(show_replay, link, name)).props(
                    "flat dense no-caps data-look"
                )


def table_html(answer: Answer) -> str:
    """Return an answer as a table; the machine's own column is left out, for it is its page."""
    names, rows = answer
    columns = [at for at, name in enumerate(names) if name != "machine"]
    most = {at: _most(names[at], [row[at] for row in rows[:SHOWN]]) for at in columns}
    head = "".join(f"<th scope=col>{html.escape(t(names[at].replace('_', ' ')))}</th>" for at in columns)
    body = "".join(
        "<tr>" + "".join(f"<td>{_cell(_word(names[at], row[at]), most[at])}</td>" for at in columns) + "</tr>"
        for row in rows[:SHOWN]
    )
    return f"<table class='mc-table'><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def recordings_of(answer: Answer) -> list[str]:
    """Return the recordings that an answer's rows name, the newest first, each once."""
    names, rows = answer
    if RECORDING not in names:
        return []
    at = names.index(RECORDING)
    return list(dict.fromkeys(str(row[at]) for row in rows[:SHOWN] if row[at]))


def _word(column: str, value: Any) -> Any:
    """Return a value, a state in the language of the page."""
    return t(value) if column == "state" and value else value


def _most(column: str, values: list[Any]) -> float:
    """Return which value the longest bar of a column stands for; 0: it has no bars."""
    if column.endswith("_percent"):
        return 100.0
    return max(values, default=0) if column in COUNTS else 0.0


def _cell(value: Any, most: float) -> str:
    """Return a cell as HTML, beside its bar where the column has some."""
    text = html.escape(_shown(value))
    bar = isinstance(value, float | int) and most > 0.0
    return f'<meter max={most:g} value="{value:.1f}" aria-hidden=true></meter> {text}' if bar else text


def _shown(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6g}"
    return f"{value:%Y-%m-%d %H:%M:%S}" if isinstance(value, datetime) else str(value)
