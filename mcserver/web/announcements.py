"""What is worth a message while nobody looks: a program has ended or waits, or the machine is in alarm."""

from __future__ import annotations

from collections.abc import Container
from typing import Literal, NamedTuple

from mcclient import MachineStatus, ProgramStatus

from mcserver.web.formatting import clock_text, is_live
from mcserver.web.machine_words import program_name
from mcserver.web.translation import t

# What another client ran for a shorter time is no job, but a jog, a line or a search [s].
SHORT_S = 10.0


class Announcement(NamedTuple):
    """``kind``: as notifications are coloured. ``is_alarm``: latched, so that the page shows it anyway."""

    kind: Literal["positive", "negative"]
    title: str
    text: str
    is_alarm: bool = False


class Announcer:
    """Compares each state with the one before.

    Args:
        machine: its name.
    """

    def __init__(self, machine: str) -> None:
        self._machine = machine
        self._live: dict[str, str] = {}
        self._faults: frozenset[tuple[str, int | None]] | None = None

    def update(self, status: MachineStatus, jobs: Container[str]) -> list[Announcement]:
        """Return what is new; nothing for the first state, which a page begins with.

        Args:
            jobs: ids of programs that are announced however short they were.
        """
        found = []
        for program in status.programs:
            before = self._live.get(program.program)
            if before is not None and before != program.state:
                found += self._change(program, program.program in jobs)
        self._live = {program.program: program.state for program in status.programs if is_live(program)}
        faults = frozenset((fault.code, fault.axis) for fault in status.faults)
        for fault in status.faults if self._faults is not None else ():
            if (fault.code, fault.axis) not in (self._faults or ()):
                found.append(
                    Announcement(
                        "negative",
                        t("{machine}: alarm", machine=self._machine),
                        f"{t(fault.message)} [{fault.code}]",
                        True,
                    )
                )
        self._faults = faults
        return found

    def _change(self, program: ProgramStatus, is_job: bool) -> list[Announcement]:
        name = program_name(program.name or program.program)
        if program.state == "paused":
            return [
                Announcement(
                    "positive",
                    t("{machine}: {name} waits", machine=self._machine, name=name),
                    program.notice or t("for Resume"),
                )
            ]
        if is_live(program):
            return []
        lasted = (program.ended_at or 0.0) - program.opened_at
        if not is_job and lasted < SHORT_S:
            return []
        kind: Literal["positive", "negative"] = "positive" if program.state == "finished" else "negative"
        why = "" if program.fault is None else f": {t(program.fault.message)} [{program.fault.code}]"
        text = t("{name} is {state} after {time}", name=name, state=t(program.state), time=clock_text(lasted))
        return [Announcement(kind, f"{self._machine}: {name}", text + why)]


def title_of(machine: str, word: str, program: ProgramStatus | None) -> str:
    """Return what a tab of a browser says: how far a program is, else the state unless all is well."""
    if program is not None and is_live(program) and program.state != "queued":
        return f"{100 * program.progress:.0f} % {t(word)} · {machine}"
    return machine if word == "ready" else f"{t(word)} · {machine}"
