"""The queue: what waits with its time, what has ended, and the buttons for both."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from mcserver.web.actions import Actions
from mcserver.web.formatting import clock_text, current_program, is_live
from mcserver.web.jobs import Job
from mcserver.web.machine_words import program_name
from mcserver.web.panels.kept_rows import KeptRows
from mcserver.web.translation import t

ENDED_SHOWN = 5


class QueuePanel:
    """A part of the card of programs."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._total = ui.label("").classes("font-bold")
        self._waiting = KeptRows(self._row)
        self._go_on = ui.button(t("Start the queue again"), on_click=self._start_again).props("color=warning")
        self._ended = ui.label("").classes("w-full text-sm break-words whitespace-pre-line")

    def update(self) -> None:
        """Show the jobs as they are now."""
        jobs = self._actions.link.jobs
        self._go_on.set_visibility(jobs.stopped and bool(jobs.waiting))
        self._total.set_visibility(bool(jobs.waiting))
        self._total.set_text(self._total_text())
        self._waiting.show({job.number: waiting_text(job) for job in jobs.waiting})
        ended = [ended_text(job) for job in list(jobs.ended)[:ENDED_SHOWN]]
        self._ended.set_text("\n".join([t("Ended:"), *ended]) if ended else "")

    def _row(self, number: int) -> ui.label:
        job = next(job for job in self._actions.link.jobs.waiting if job.number == number)
        with ui.row().classes("w-full items-center no-wrap gap-2 mc-row"):
            text = ui.label("").classes("grow break-words min-w-0")
            ui.button(t("Remove"), on_click=partial(self._remove, number)).props("flat dense no-caps").props[
                "aria-label"
            ] = t("remove {name} from the queue", name=program_name(job.name))
        return text

    def _total_text(self) -> str:
        jobs = self._actions.link.jobs
        program = current_program(self._actions.link.status)
        eta = program.eta_s if program is not None and is_live(program) else 0.0
        waiting = jobs.remaining_s()
        everything = None if waiting is None or eta is None else waiting + eta
        return t(
            "{count} waiting: {time}; all done in {total}",
            count=len(jobs.waiting),
            time=clock_text(waiting),
            total=clock_text(everything),
        )

    def _remove(self, number: int) -> None:
        if self._actions.allowed("open"):
            self._actions.link.jobs.remove(number)

    def _start_again(self) -> None:
        if self._actions.allowed("open"):
            self._actions.link.jobs.start_again()


def waiting_text(job: Job) -> str:
    """Return what waits, for how long it will run, and for whom."""
    name = program_name(job.name)
    if job.from_line > 1:
        name = t("{name} from line {line}", name=name, line=job.from_line)
    return f"{name} · {clock_text(job.duration_s)} · " + t("by {name}", name=job.user)


def ended_text(job: Job) -> str:
    """Return how a job went."""
    return f"{program_name(job.name)} · {t(job.state.value)}" + (
        f" · {t(job.message)}" if job.message else ""
    )
