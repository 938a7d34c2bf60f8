"""The program under way, and the programs that are kept."""

from __future__ import annotations

import html
import json
import time
import zlib
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from urllib.parse import quote

from mcclient import MotionError
from mcclient.switches import switches_said
from mcclient.types import SimulateReply
from nicegui import events, ui

from mcserver.errors import McError
from mcserver.web.actions import Actions, show_error, show_refusal
from mcserver.web.choice import Choice
from mcserver.web.dialogs import ask
from mcserver.web.formatting import (
    clock_text,
    current_program,
    diagnostics_html,
    is_live,
    page_hint,
    program_excerpt,
    remaining_text,
)
from mcserver.web.jobs import WHOLE, Job, JobState, Middle, Switches
from mcserver.web.last_runs import LastRun
from mcserver.web.machine_words import program_name
from mcserver.web.open_programs import who
from mcserver.web.panels.card import card
from mcserver.web.panels.dry_run import show_dry_run
from mcserver.web.panels.queue import QueuePanel
from mcserver.web.panels.run_from import RecoveryPanel, ask_run_from
from mcserver.web.store import MAX_PROGRAM_BYTES, is_folder
from mcserver.web.thumbnails import Thumbnail
from mcserver.web.translation import mark, t

_SWITCHED: Mapping[tuple[str, bool], str] = MappingProxyType(
    {
        ("block_delete", True): mark("block delete on"),
        ("block_delete", False): mark("block delete off"),
        ("optional_stop", True): mark("optional stop on"),
        ("optional_stop", False): mark("optional stop off"),
    }
)


# an option of the list, with the picture of its program where it has one
OPTION = """
<q-item v-bind="props.itemProps">
  <q-item-section side><img class="mc-icon" alt="" loading="lazy"
    :src='%s + encodeURIComponent(props.opt.label) + "/picture"'></q-item-section>
  <q-item-section><q-item-label>{{ props.opt.label }}</q-item-label></q-item-section>
</q-item>
"""


class Picture:
    """The picture that a slicer has put into a program, beside its name; hidden where there is none."""

    def __init__(self) -> None:
        self._image = ui.element("img").classes("mc-thumbnail").props('alt=""')
        self._image.set_visibility(False)

    def show(self, found: Thumbnail | None, address: str) -> None:
        """Show a picture that the page serves at ``address``."""
        source = "" if found is None else f"{address}/picture?{zlib.crc32(found.content):08x}"
        if self._image.props.get("src", "") != source:
            self._image.props["src"] = source
            self._image.set_visibility(bool(source))
            self._image.update()


class ProgramPanel:
    """Shows one program; starts, queues, checks and removes the kept ones.

    Args:
        recovery: the card that goes on with what was broken off.
    """

    def __init__(self, actions: Actions, recovery: RecoveryPanel) -> None:
        self._actions = actions
        self._recovery = recovery
        self._address = f"/machine/{quote(actions.link.name, safe='')}"
        self._shown: tuple[object, ...] = ()
        self._listed: tuple[str, ...] = ()
        # the program that the last upload has replaced, and its text
        self._before: tuple[str, str] | None = None
        with card(t("Program")):
            self._title = ui.label(t("no program")).classes("font-bold")
            self._picture = Picture()
            self._bar = ui.linear_progress(0.0, show_value=False, size="1.2rem").props(
                f'aria-label="{t("progress")}"'
            )
            self._times = ui.label("")
            self._next = ui.button(t("Next line"), on_click=self._step).props("color=positive data-often")
            self._next.set_visibility(False)
            self._text = ui.html("", sanitize=False).classes("w-full")
        with card(t("Programs and queue")):
            self._uploader = ui.upload(
                label=t("Upload G-code"),
                auto_upload=True,
                max_file_size=MAX_PROGRAM_BYTES,
                on_upload=self._on_upload,
                on_rejected=lambda: show_refusal(t("The file is too large"), t("split the program")),
            )
            self._uploader.props('accept=".gcode,.nc,.ngc,.tap,.txt,.g,text/plain" flat bordered')
            self._uploader.classes("w-full")
            self._folder = Choice(
                [],
                label=t("Folder"),
                new_value_mode="add-unique",
                clearable=True,
                on_change=self._look_into,
            ).classes("w-full")
            with ui.row().classes("items-center w-full"):
                self._choice = Choice([], label=t("Program"), with_input=True).classes("grow min-w-40")
                self._from_line = ui.number(t("From line"), value=1, min=1, format="%d").classes("w-24")
                # empty is the whole program
                self._from_line.props("placeholder=1 stack-label")
            self._choice.add_slot("option", OPTION % json.dumps(f"{self._address}/programs/"))
            self._chosen = Picture()
            self._last_run = ui.label("").classes("text-sm")
            with ui.row().classes("items-center w-full gap-2 mc-warnings") as self._replaced:
                self._replaced_name = ui.label("").classes("grow min-w-0 break-words").props("role=alert")
                ui.button(t("Bring the one before back"), on_click=self._bring_back).props("outline no-caps")
            self._replaced.set_visibility(False)
            with ui.element("div").classes("mc-buttons"):
                ui.button(t("Run"), on_click=self._run).props("color=positive")
                ui.button(t("Dry run"), on_click=self._dry_run).props("outline")
                ui.button(t("Delete"), on_click=self._delete).props("outline color=negative")
                jobs = actions.link.jobs
                self._single_step = ui.switch(
                    t("Single step"), value=jobs.single_step, on_change=self._switch_single_step
                )
                self._switches = {
                    name: ui.switch(
                        t(label), value=getattr(jobs.switches, name), on_change=partial(self._switch, name)
                    )
                    for name, label in (
                        ("block_delete", mark("Block delete")),
                        ("optional_stop", mark("Optional stop")),
                    )
                }
            self._jobs = QueuePanel(actions)
            self._report = ui.html("", sanitize=False).classes("w-full").props("aria-live=polite")
            # of the newest check: answers may come in another order than they were asked for
            self._checked: object = None

    def update(self) -> None:
        self._update_program()
        self._update_store()

    def _update_program(self) -> None:
        status = self._actions.link.status
        program = current_program(status)
        job = self._job(program.program if program is not None else "")
        self._show_single_step()
        self._show_switches()
        running = self._actions.link.jobs.running
        if running is not None and running.state is JobState.CHECKING:
            self._show_picture(running)
            self._title.set_text(f"{program_name(running.name)} · {t(running.state.value)}")
            return
        failed = self._actions.link.jobs.failed(program)
        if failed is not None:
            self._show_picture(failed)
            self._show_ended(failed)
        if failed is not None or program is None:
            return
        self._show_picture(job)
        total = len(job.lines) if job is not None else program.accepted
        line = program.line or program.done
        share = min(1.0, line / total) if total else 0.0
        if program.duration_s is not None:
            share = program.progress
        name, person = program_name(program.name or program.program), who(self._actions.link, program)
        self._title.set_text(
            f"{name} · {t(program.state)}"
            + ("" if name.endswith(f" {person}") else f" · {t('by {name}', name=person)}")
            + (f" · {t('Single step')}" if job is not None and job.single_step else "")
            + "".join(f" · {t(each)}" for each in switches_said(program.block_delete, program.optional_stop))
        )
        self._bar.set_value(1.0 if program.state == "finished" else share)
        remaining = remaining_text(program) if is_live(program) else "0:00"
        self._times.set_text(
            t(
                "line {line} of {total} · {percent:.0f} % · remaining {time} · override {override:.0f} %",
                line=line,
                total=total,
                percent=100 * self._bar.value,
                time=remaining,
                override=program.override,
            )
        )
        faulty = {each.line: each.message for each in program.diagnostics}
        if program.fault is not None and program.fault.line:
            faulty[program.fault.line] = program.fault.message
        shown = (program.program, line, tuple(faulty))
        if shown != self._shown:
            self._shown = shown
            self._text.set_content("" if job is None else program_excerpt(job.lines, line, faulty))

    def _show_picture(self, job: Job | None) -> None:
        """Show the picture of a job's text; of another client's program nothing is known."""
        if job is None:
            self._picture.show(None, "")
        else:
            self._picture.show(job.thumbnail, f"{self._address}/jobs/{job.number}")

    def _show_single_step(self) -> None:
        self._single_step.set_value(self._actions.link.jobs.single_step)
        stepping = self._stepping()
        self._next.set_visibility(stepping is not None)
        if stepping is not None:
            job, done = stepping
            self._next.set_enabled(done >= job.stepped)

    def _stepping(self) -> tuple[Job, int] | None:
        """Return the job that runs in single step, and its last line that is done."""
        job, status = self._actions.link.jobs.running, self._actions.link.status
        if job is None or not job.single_step or status is None:
            return None
        return next(((job, each.done) for each in status.programs if each.program == job.program), None)

    def _switch_single_step(self) -> None:
        jobs, wanted = self._actions.link.jobs, bool(self._single_step.value)
        if wanted == jobs.single_step:
            return
        if self._actions.allowed("step"):
            jobs.single_step = wanted
            self._actions.note(mark("single step on") if wanted else mark("single step off"))
        else:
            self._single_step.set_value(jobs.single_step)

    def _show_switches(self) -> None:
        for name, value in self._actions.link.jobs.switches._asdict().items():
            self._switches[name].set_value(value)

    def _switch(self, name: str) -> None:
        jobs, on = self._actions.link.jobs, bool(self._switches[name].value)
        wanted = jobs.switches._replace(**{name: on})
        if wanted == jobs.switches:
            return
        if self._actions.allowed("open"):
            jobs.switches = wanted
            self._actions.note(_SWITCHED[name, on])
        else:
            self._show_switches()

    async def _step(self) -> None:
        stepping = self._stepping()
        done = 0 if stepping is None else stepping[1]
        self._next.set_enabled(False)
        await self._actions.do("step", mark("next line"), lambda _: self._actions.link.jobs.step(done))

    def _show_ended(self, job: Job) -> None:
        broken = self._recovery.program
        at = broken.done + 1 if broken is not None and broken.program == job.program else None
        if self._shown == ("ended", job.number, at):
            return
        self._shown = ("ended", job.number, at)
        self._title.set_text(f"{program_name(job.name)} · {t(job.state.value)}")
        self._bar.set_value(0.0)
        self._times.set_text("")
        faulty = {each.line: each.message for each in job.diagnostics if each.severity == "error"}
        remedy = f"<br>= {html.escape(page_hint(job.hint))}" if job.hint else ""
        if faulty:
            back = (
                t("To go on: correct the file and upload it again.")
                if job.is_file
                else t("To go on: correct what is wrong, then run it again.")
            )
        elif at is None:
            back = t("To go on: remove the cause, then run it again.")
        else:
            back = t("To go on: remove the cause, then Continue at line {line}, or run it again.", line=at)
        said = f"<p><b>{html.escape(t(job.message))}</b>{remedy}<br>{back}</p>"
        excerpt = program_excerpt(job.lines, min(faulty, default=at or 0), faulty) if job.lines else ""
        self._text.set_content(f'<div class="mc-faults" role="alert">{said}</div>{excerpt}')

    def _update_store(self) -> None:
        self._jobs.update()
        chosen, store = self._choice.value or "", self._actions.link.store
        self._chosen.show(
            store.thumbnail(chosen) if chosen else None, f"{self._address}/programs/{quote(chosen, safe='')}"
        )
        run = self._actions.link.last_runs.runs.get(chosen)
        self._last_run.set_text("" if run is None else last_run_text(run))
        every = [each.name for each in store.list()]
        folder = self._in_folder()
        names = tuple(each for each in every if each.startswith(f"{folder}/" if folder else ""))
        if (folder, *names) == self._listed:
            return
        self._listed = (folder, *names)
        # a new one has no file yet
        folders = {name.rpartition("/")[0] for name in every} - {""} | ({folder} - {""})
        self._folder.set_options(sorted(folders), value=self._folder.value)
        self._choice.set_options(
            list(names), value=self._choice.value if self._choice.value in names else None
        )

    def _look_into(self) -> None:
        folder = self._in_folder()
        if folder and not is_folder(folder):
            show_refusal(
                t("{name!r} cannot be a folder's name", name=folder),
                t("four folders in each other at most, and no name that begins with a dot"),
            )
            self._folder.set_value(None)
            # the browser's value has not changed, what is typed there stays
            self._folder.run_method("updateInputValue", "", True)
        elif folder != (self._folder.value or ""):
            self._folder.set_options(sorted({*self._folder.options, folder}), value=folder)

    def _in_folder(self) -> str:
        """Return the folder that is looked at, and uploaded to; empty: all, and the outermost."""
        return str(self._folder.value or "").strip("/ ")

    def _job(self, program: str) -> Job | None:
        jobs = self._actions.link.jobs
        return next((job for job in jobs.begun if job.program == program), None)

    async def _on_upload(self, event: events.UploadEventArguments) -> None:
        # its list would show each file once more, without names on its buttons, and a refused one as done
        self._uploader.reset()
        # a file moves nothing: it may come while somebody else drives
        if not self._actions.has_role("open"):
            return
        store, folder = self._actions.link.store, self._in_folder()
        name = f"{folder}/{event.file.name}" if folder else event.file.name
        content = await event.file.read()
        try:
            before = store.read(name) if store.has(name) else None
            store.write(name, content)
            text = store.read(name)
        except McError as error:
            show_error(error)
            return
        self._show_replaced(None if before is None or before == text else (name, before))
        self._update_store()
        self._choice.set_value(name)
        await self._check(name, text)

    def _show_replaced(self, before: tuple[str, str] | None) -> None:
        """Say that an upload has replaced another text, with the way back; None: it has not."""
        self._before = before
        self._replaced.set_visibility(before is not None)
        if before is not None:
            self._replaced_name.set_text(
                t("{name} was kept already with another text, which is replaced.", name=before[0])
            )

    async def _bring_back(self) -> None:
        if self._before is None or not self._actions.has_role("open"):
            return
        name, text = self._before
        try:
            self._actions.link.store.write(name, text.encode("utf-8"))
        except McError as error:
            show_error(error)
            return
        self._show_replaced(None)
        self._choice.set_value(name)
        await self._check(name, text)

    async def _check(self, name: str, text: str) -> None:
        """Show every fault of a text at its place, unless another text has come meanwhile."""
        self._checked = asked = object()
        self._report.set_content("")
        try:
            switches = self._actions.link.jobs.switches
            found = await self._actions.link.connected().check(text, **switches._asdict())
        except MotionError as error:
            show_error(error)
            return
        if self._checked is not asked:
            return
        if not found.diagnostics:
            self._report.set_content(f"<p>{html.escape(name)}: {t('no faults')}</p>")
            return
        faulty = {each.line: each.message for each in found.diagnostics if each.severity == "error"}
        excerpt = program_excerpt(text.split("\n"), min(faulty), faulty) if faulty else ""
        self._report.set_content(
            diagnostics_html(found.diagnostics, f"<p>{html.escape(name)}:</p>") + excerpt
        )

    def _chosen_name(self) -> str:
        """Return the name of the chosen program; empty: there is none, which is said."""
        name = str(self._choice.value or "")
        if not name:
            show_refusal(t("No program is chosen"), t("choose one, or upload it"))
        return name

    def _chosen_program(self) -> tuple[str, str, int] | None:
        """Return name, text and first line of the chosen program; None: there is none, which is said."""
        name, line = self._chosen_name(), int(self._from_line.value or 1)
        if not name:
            return None
        try:
            return name, self._actions.link.store.read(name), line
        except McError as error:
            show_error(error)
        return None

    def _queue(
        self,
        name: str,
        text: str,
        from_line: int,
        switches: Switches,
        middle: Middle = WHOLE,
        report: SimulateReply | None = None,
    ) -> bool:
        """Queue a program that somebody has looked at; whether it was."""
        if not self._actions.allowed("open"):
            return False
        try:
            self._actions.link.jobs.add(
                name,
                self._actions.visitor.name,
                from_line,
                seen=text,
                report=report,
                middle=middle,
                switches=switches,
            )
        except (MotionError, McError) as error:
            show_error(error)
            return False
        return True

    async def _run(self) -> None:
        if not self._actions.allowed("open"):
            return
        chosen, switches = self._chosen_program(), self._actions.link.jobs.switches
        if chosen is None:
            return
        run = partial(self._queue, *chosen, switches)
        # what begins in the middle begins somewhere else than where the axes are
        if chosen[2] > 1:
            await ask_run_from(self._actions, *chosen, switches, run)
        else:
            run()

    async def _delete(self) -> None:
        name = self._chosen_name()
        if not name or not self._actions.allowed("open"):
            return

        async def delete() -> bool:
            # the role, or control, may have been taken away while the dialog was open
            if not self._actions.allowed("open"):
                return False
            self._actions.link.store.delete(name)
            return True

        await ask(t("Delete {name}?", name=name), t("Delete"), colour="negative", act=delete)

    async def _dry_run(self) -> None:
        chosen, switches = self._chosen_program(), self._actions.link.jobs.switches
        if chosen is not None:
            run = partial(self._queue, *chosen, switches, WHOLE)
            await show_dry_run(self._actions, *chosen, switches, run)


def last_run_text(run: LastRun) -> str:
    """Return how and when a program ran last."""
    when = time.strftime("%d.%m. %H:%M", time.localtime(run.ended_at))
    return t(
        "last run {when} by {user}: {state} after {time}",
        when=when,
        user=run.user,
        state=t(run.state),
        time=clock_text(run.seconds),
    )
