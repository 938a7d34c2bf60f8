"""Recordings on the server: what is there, starting and stopping one, and looking at them."""

from __future__ import annotations

from functools import partial
from urllib.parse import quote

from mcclient import MotionError
from nicegui import ui

from mcserver.web.actions import Action, Actions
from mcserver.web.formatting import clock_text, size_text
from mcserver.web.panels.card import card
from mcserver.web.panels.kept_rows import KeptRows
from mcserver.web.panels.replay import show_replay
from mcserver.web.translation import mark, t

# Rows that are shown, and how often the list is asked for [s].
SHOWN = 8
PERIOD_S = 3.0


class RecordingsPanel:
    """The newest recordings, each to be plotted, played or downloaded; the black box on demand."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._all = False
        with card(t("Recordings")):
            with ui.row().classes("w-full items-center gap-2"):
                self._name = (
                    ui.input(t("Name"), placeholder=t("the time")).props("dense").classes("grow min-w-24")
                )
                ui.button(t("Record"), on_click=self._start).props("color=primary")
                ui.button(t("Save black box"), on_click=self._save).props("outline")
            self._state = ui.label("").classes("text-xs")
            self._rows = KeptRows(self._row)
            self._more = ui.button("", on_click=self._toggle).props("flat dense data-look")
            self._none = ui.label(t("nothing has been recorded yet"))
            self._more.set_visibility(False)
            self._none.set_visibility(False)

    async def update(self) -> None:
        """Ask for the list now and then; a server without recorder says so."""
        link = self._actions.link
        if link.machine is None:
            return
        try:
            found = await link.answers.get("recordings", PERIOD_S, link.machine.recordings)
        except MotionError as error:
            self._state.set_text(f"{t(error.message)} [{error.code}]")
            return
        recorder = found.recorder
        self._state.set_text(
            t("no recorder runs on the server")
            if recorder is None
            else t(
                "black box: the last {time}, {size}",
                time=clock_text(recorder.held_s),
                size=size_text(recorder.held_bytes),
            )
        )
        recordings = found.recordings if self._all else found.recordings[:SHOWN]
        self._rows.show({(each.name, each.state): size_text(each.size) for each in recordings})
        count = len(found.recordings)
        self._more.set_visibility(count > SHOWN)
        self._more.set_text(t("Show fewer") if self._all else t("Show all {count}", count=count))
        self._none.set_visibility(not count)

    def _row(self, recording: tuple[str, str]) -> ui.label:
        name, state = recording
        root = f"/machine/{quote(self._actions.link.name)}/recordings/{quote(name)}"
        with ui.row().classes("w-full items-center gap-2 mc-row"):
            ui.label(name).classes("grow break-all")
            size = ui.label("").classes("text-xs")
            if state == "writing":
                ui.button(t("Stop"), on_click=partial(self._stop, name)).props(
                    f'dense color=negative aria-label="{t("stop recording {name}", name=name)}"'
                )
            elif state == "done":
                ui.link(t("plot"), f"{root}/plot", new_tab=True).props(
                    f'aria-label="{t("plot {name}", name=name)}"'
                )
                ui.button(t("play"), on_click=partial(show_replay, self._actions.link, name)).props(
                    f'flat dense no-caps data-look aria-label="{t("play {name}", name=name)}"'
                )
                ui.link(t("download"), f"{root}/file").props(
                    f'aria-label="{t("download {name}", name=name)}"'
                )
            else:
                ui.label(t("unfinished")).classes("text-xs")
        return size

    def _toggle(self) -> None:
        self._all = not self._all

    async def _start(self) -> None:
        name = (self._name.value or "").strip()
        if await self._do("record_start", mark("record"), lambda machine: machine.record_start(name)):
            self._name.set_value("")

    async def _stop(self, name: str) -> None:
        await self._do("record_stop", mark("stop recording"), lambda machine: machine.record_stop(name))

    async def _save(self) -> None:
        if await self._do("record_save", mark("save the black box"), lambda machine: machine.record_save()):
            ui.notify(t("the black box is saved"), position="bottom")

    async def _do(self, method: str, name: str, action: Action) -> bool:
        done = await self._actions.do(method, name, action)
        self._actions.link.answers.forget("recordings")
        return done
