"""Latched faults with their remedies and what led to them, and events."""

from __future__ import annotations

import html
import time
from urllib.parse import quote

from mcclient import Event, MachineStatus
from nicegui import ui

from mcserver.web.actions import Actions
from mcserver.web.formatting import axis_name, page_hint
from mcserver.web.link import MachineLink
from mcserver.web.panels.card import card
from mcserver.web.panels.replay import show_replay
from mcserver.web.translation import mark, t

SHOWN = 60


class FaultPanel:
    """Shown while something is latched: what, where, and what helps."""

    def __init__(self, actions: Actions) -> None:
        self._link = actions.link
        self._card = ui.card().classes("mc-card")
        self._box = ""
        with self._card:
            self._list = ui.html("", sanitize=False).classes("w-full").props("role=alert")
            ui.button(
                t("Reset"),
                on_click=lambda: actions.do("reset", mark("reset"), lambda machine: machine.reset()),
            ).props("color=warning")
            self._play = ui.button(t("Play what led to it"), on_click=self._play_box).props(
                "outline data-look"
            )
        self._card.set_visibility(False)

    async def _play_box(self) -> None:
        await show_replay(self._link, self._box)

    def update(self, status: MachineStatus) -> None:
        self._card.set_visibility(bool(status.faults))
        box = self._box = black_box_of(self._link, status)
        self._play.set_visibility(bool(box))
        rows = []
        # the emergency stop before what it has caused
        for fault in sorted(status.faults, key=lambda each: each.code != "MC400"):
            joint = self._link.joints.get(-1 if fault.axis is None else fault.axis, "")
            named = html.escape(f"{axis_name(fault.axis)} {joint}".rstrip()) if fault.axis is not None else ""
            where = t("axis {name}: ", name=named) if named else ""
            line = t(" (line {line})", line=fault.line) if fault.line else ""
            rows.append(
                f"<li><b>{fault.code}</b> {where}{html.escape(t(fault.message))}{line}"
                + (f"<br>= {html.escape(page_hint(fault.hint))}" if fault.hint else "")
                + "</li>"
            )
        recorded = ""
        if box:
            root = f"/machine/{quote(self._link.name)}/recordings/{quote(box)}"
            plot = f'<a href="{root}/plot" target="_blank">{t("plot of the black box")}</a>'
            file = f'<a href="{root}/file">{t("download")}</a>'
            recorded = f"<p>{t('What led to it:')} {plot}, {file}</p>"
        self._list.set_content(f'<div class="mc-faults"><ul>{"".join(rows)}</ul>{recorded}</div>')


def black_box_of(link: MachineLink, status: MachineStatus) -> str:
    """Return the name of the black box that was written for the oldest latched fault; empty: not yet."""
    since = min((fault.t for fault in status.faults if fault.t > 0.0), default=None)
    if since is None:
        return ""
    return next(
        (
            event.message
            for event in link.events
            # times of an earlier start are by a clock of its own
            if event.kind == "recording"
            and event.instance == status.instance
            and event.t >= since
            and event.message.startswith("blackbox-")
        ),
        "",
    )


class EventPanel:
    """The newest events."""

    def __init__(self, link: MachineLink) -> None:
        self._link = link
        self._count = -1
        with card(t("Events")):
            self._list = (
                ui.html("", sanitize=False)
                .classes("mc-events")
                .props(f'tabindex=0 aria-label="{t("Events")}"')
            )

    def update(self) -> None:
        if self._link.event_count == self._count:
            return
        self._count = self._link.event_count
        rows = [event_row(event) for event in list(self._link.events)[-SHOWN:]]
        self._list.set_content("".join(reversed(rows)))


def event_row(event: Event) -> str:
    """Return an event as HTML, at the time of the server's clock when it happened."""
    parts = [event.program, event.client, event.state, event.reason, event.message]
    if event.fault is not None:
        parts.append(f"{event.fault.code} {t(event.fault.message)}")
    if event.percent is not None:
        parts.append(f"{event.percent:g} %")
    when = time.strftime("%H:%M:%S", time.localtime(event.wall))
    rest = html.escape(" · ".join(part for part in parts if part))
    return f"<div>{when} <b>{html.escape(event.kind)}</b> {rest}</div>"
