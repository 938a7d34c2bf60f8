"""Who is connected, who holds which axes, and who did what of late."""

from __future__ import annotations

import html
import time

from mcclient import Event, MachineStatus
from nicegui import ui

from mcserver.web.formatting import axis_name, is_live
from mcserver.web.link import MachineLink
from mcserver.web.machine_words import program_name
from mcserver.web.panels.card import card
from mcserver.web.translation import mark, t

COMMANDS = 8


class PeoplePanel:
    """Clients that can move something, the visitors of this page, and the newest commands."""

    def __init__(self, link: MachineLink) -> None:
        self._link = link
        with card(t("Who is here")):
            self._content = ui.html("", sanitize=False).classes("w-full mc-people")

    def update(self) -> None:
        self._content.set_content(self._link.once("people", lambda status: people_html(self._link, status)))


def people_html(link: MachineLink, status: MachineStatus) -> str:
    """Return the lists as HTML."""
    holding: dict[str, list[str]] = {}
    for program in status.programs:
        if is_live(program):
            axes = ", ".join(axis_name(axis) for axis in program.axes)
            text = (
                mark("{name} waits for {axes}") if program.state == "queued" else mark("{name} holds {axes}")
            )
            said = t(text, name=program_name(program.name or program.program), axes=axes)
            holding.setdefault(program.client, []).append(f"{said} ({t(program.state)})")
    own = None if link.machine is None else link.machine.client
    clients = sorted({*link.clients, *holding, *([own] if own else [])})
    rows = []
    for client in clients:
        name = f"<b>{html.escape(client)}</b>" + (f" ({t('this page')})" if client == own else "")
        what = "; ".join(html.escape(each) for each in holding.get(client, ())) or t("holds no axis")
        rows.append(f"<li>{name}: {what}</li>")
    visitors = ", ".join(
        html.escape(name) + (f" ({count})" if count > 1 else "")
        for name, count in sorted(link.visitors.items())
    )
    done = [(when, name, what) for when, name, what in link.acts]
    # those that this page has given are named by who sat there
    done += [
        (event.wall, event.client or "", _command(event))
        for event in link.events
        if event.kind == "command" and event.client != own
    ]
    lines = "".join(
        f"<div>{time.strftime('%H:%M:%S', time.localtime(when))} "
        f"<b>{html.escape(name)}</b> {html.escape(t(what))}</div>"
        for when, name, what in sorted(done, reverse=True)[:COMMANDS]
    )
    driver = link.control.driver
    drives = f"<p>{t('Drives:')} <b>{html.escape(driver.name)}</b></p>" if driver is not None else ""
    nobody = t("nobody")
    commands = f'<p>{t("Commands:")}</p><div class="text-sm">{lines}</div>' if lines else ""
    return (
        f"{drives}<p>{t('Clients:')}</p><ul>{''.join(rows) or f'<li>{nobody}</li>'}</ul>"
        f"<p>{t('At this page:')} {visitors or nobody}</p>{commands}"
    )


def _command(event: Event) -> str:
    return " · ".join(part for part in (event.reason, event.program, event.message) if part)
