"""What an operator has to know before anything else: the machine is away, or a program waits for somebody."""

from __future__ import annotations

import time

from mcclient import MachineStatus
from nicegui import ui

from mcserver.web.formatting import is_live
from mcserver.web.link import MachineLink
from mcserver.web.machine_words import program_name
from mcserver.web.translation import t


class NoticePanel:
    """A card of one sentence each, above all others; hidden while there is nothing to say."""

    def __init__(self, link: MachineLink) -> None:
        self._link = link
        self._shown: tuple[tuple[str, str], ...] = ()
        self._card = ui.card().classes("mc-card").props(f'role=alert aria-label="{t("Notices")}"')
        self._card.set_visibility(False)

    def update(self, status: MachineStatus | None) -> None:
        found = notices_of(status, online=self._link.online, failure=self._link.failure)
        if found == self._shown:
            return
        self._shown = found
        self._card.set_visibility(bool(found))
        self._card.clear()
        with self._card:
            for kind, text in found:
                ui.label(text).classes(f"w-full {kind}")


def notices_of(status: MachineStatus | None, *, online: bool, failure: str) -> tuple[tuple[str, str], ...]:
    """Return what there is to say: the class of the label, and the sentence."""
    if not online:
        shown = t("What is shown is old.") if status is not None else t("It has not been seen yet.")
        away = (
            t("The machine does not answer: {why}.", why=failure)
            if failure
            else t("The machine does not answer.")
        )
        return (("mc-faults", f"{away} {shown}"),)
    if status is None:
        return ()
    found = []
    names = {each.program: program_name(each.name or each.program) for each in status.programs}
    for program in status.programs:
        if not is_live(program):
            continue
        name = program_name(program.name or program.program)
        if program.state == "paused":
            what = program.notice or t("it has come to a stop that it asks for")
            found.append(
                (
                    "mc-notice",
                    t(
                        "{name} waits at line {line}: {what}. Then press Resume.",
                        name=name,
                        line=program.line,
                        what=what,
                    ),
                )
            )
        elif program.waits_for in names:
            found.append(
                (
                    "mc-note",
                    t(
                        "{name} waits at line {line} until {other} has left its way.",
                        name=name,
                        line=program.line,
                        other=names[program.waits_for],
                    ),
                )
            )
        elif program.waits_for:
            found.append(
                (
                    "mc-note",
                    t(
                        "{name} waits at line {line} for the input {input}.",
                        name=name,
                        line=program.line,
                        input=program.waits_for,
                    ),
                )
            )
        elif program.notice:
            found.append(("mc-note", f"{name}: {program.notice}"))
    if status.disk is not None:
        # the time of day, so that the sentence stays as it is
        since = time.strftime("%H:%M:%S", time.gmtime(status.disk.since))
        text = t(
            "The disk of the journal is slow since {since} UTC: what has ended is shown later (MC524).",
            since=since,
        )
        found.append(("mc-note", text))
    return tuple(found)
