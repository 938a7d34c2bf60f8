"""A drive's parameters as a file: kept, compared with the drive or with another one, and brought back."""

from __future__ import annotations

import html
from collections.abc import Sequence
from datetime import UTC, datetime

from mcclient import MotionError
from mcclient.types import DriveParameters
from nicegui import events, ui

from mcserver.canopen import parameter_backup
from mcserver.canopen.desk import Desk
from mcserver.canopen.parameter_file import (
    MAX_BYTES,
    ParameterFile,
    differences,
    read_parameters,
    write_parameters,
)
from mcserver.canopen.parameters import Parameter
from mcserver.errors import UsageFault
from mcserver.web.actions import show_error, show_refusal
from mcserver.web.choice import Choice
from mcserver.web.desk import parameters_from
from mcserver.web.dialogs import ask
from mcserver.web.formatting import axis_name
from mcserver.web.panels.card import card, scrolled
from mcserver.web.panels.desk_bus import table_html
from mcserver.web.panels.desk_drive import DeskDrive
from mcserver.web.translation import mark, t

# of what is not in a backup
SHOWN = 8


class FilesPanel:
    """Backup to a file of the browser's computer; what differs from one, or from another drive; restore."""

    def __init__(self, drive: DeskDrive) -> None:
        self._drive = drive
        self._file: ParameterFile | None = None
        self._name = ""
        with card(t("Backup and restore")):
            ui.button(t("Download a backup"), on_click=self._backup).props("outline")
            self._uploader = ui.upload(
                label=t("Parameter file"),
                auto_upload=True,
                max_file_size=MAX_BYTES,
                on_upload=self._on_upload,
                on_rejected=lambda: show_refusal(
                    t("The file is too large"), t("give a file of a drive's backup")
                ),
            )
            self._uploader.props('accept=".toml" flat bordered').classes("w-full")
            self._kept = ui.label(t("no file")).classes("text-sm break-words")
            with ui.element("div").classes("mc-buttons"):
                self._with_file = [
                    ui.button(t("Compare with the file"), on_click=self._compare_file).props("outline"),
                    ui.button(t("Restore the file"), on_click=self._restore).props("color=warning"),
                ]
            with ui.row().classes("w-full items-center gap-2"):
                self._other = Choice({}, label=t("Other drive")).props("dense").classes("grow min-w-24")
                ui.button(t("Compare"), on_click=self._compare_other).props("outline")
            self._report = scrolled(t("What differs")).props("aria-live=polite")
        self._show_file(None, "")
        drive.on_change(self._on_drive)

    def _on_drive(self) -> None:
        self._report.set_content("")
        others = {axis: axis_name(axis) for axis in self._drive.others}
        self._other.set_options(others, value=next(iter(others), None))

    def _show_file(self, file: ParameterFile | None, name: str) -> None:
        self._file, self._name = file, name
        for button in self._with_file:
            button.set_enabled(file is not None)
        self._kept.set_text(
            t("no file")
            if file is None
            else t(
                "{name}: {count} parameters of {taken}",
                name=name,
                count=len(file.parameters),
                taken=file.taken,
            )
        )

    async def _on_upload(self, event: events.UploadEventArguments) -> None:
        raw = await event.file.read()
        self._uploader.reset()
        try:
            self._show_file(read_parameters(raw, event.file.name), event.file.name)
        except UsageFault as error:
            self._show_file(None, "")
            show_error(error)

    async def _backup(self) -> None:
        drive = self._drive.chosen()
        if drive is None:
            return
        file = await self._drive.read(lambda desk: taken(desk, drive))
        if file is None:
            return
        name = f"{self._drive.actions.link.name}-axis-{drive.axis}.toml"
        ui.download.content(write_parameters(file).encode(), name, "application/toml")
        self._report.set_content(
            f"<p>{html.escape(t('{count} parameters are in the file', count=len(file.parameters)))}</p>"
            + unread_html(file.unread)
        )

    async def _compare_file(self) -> None:
        file = self._file
        if file is not None:
            await self._compare(file, self._name)

    async def _compare_other(self) -> None:
        if self._other.value is None:
            return
        try:
            other = await self._drive.described(self._other.value)
        except MotionError as error:
            show_error(error)
            return
        file = await self._drive.read(lambda desk: taken(desk, other), other)
        if file is not None:
            await self._compare(file, axis_name(other.axis))

    async def _compare(self, file: ParameterFile, name: str) -> bool:
        """Show how the drive differs from a file, or from another one's parameters; whether it was read."""
        drive = self._drive.chosen()
        now = None if drive is None else await self._drive.read(lambda desk: taken(desk, drive))
        if now is None or drive is None:
            return False
        self._report.set_content(differences_html(now, file, axis_name(drive.axis), name))
        return True

    async def _restore(self) -> None:
        file, name, drive = self._file, self._name, self._drive.drive
        if file is None or drive is None or not await self._compare(file, name):
            return
        parameters = self._drive.parameters
        content = self._report.content
        written: list[str] = []

        def restore(desk: Desk) -> Sequence[Parameter]:
            return parameter_backup.restore(
                desk,
                parameters,
                file,
                lambda each, was, now: written.append(f"{each.title}: {was} → {now}"),
            )

        done: Sequence[Parameter] | None = None

        async def write() -> bool:
            nonlocal done
            done = await self._drive.write(mark("restore {name}", name=name), restore)
            # where it was refused as a whole, which is said, what differs still does
            return done is not None or bool(written)

        if not await ask(
            t(
                "Write what differs from {name} into the drive of {axis}?",
                name=name,
                axis=axis_name(drive.axis),
            ),
            t("Restore"),
            colour="warning",
            act=write,
            stop=self._drive.stop,
            details=lambda: ui.html(content, sanitize=False).classes("w-full overflow-auto max-h-[50vh]"),
        ):
            return
        shown = "".join(f"<li>{html.escape(each)}</li>" for each in written)
        said = (
            t("not all of it was written; what was:")
            if done is None
            else t("all verified; kept until the drive is switched off, unless it is saved")
        )
        self._report.set_content(f"<p>{html.escape(said)}</p><ul>{shown}</ul>")


def taken(desk: Desk, drive: DriveParameters) -> ParameterFile:
    """Read what a drive keeps, as `mcserver drives backup` does."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return parameter_backup.take_backup(desk, parameters_from(drive), now, drive.eds_sha256)


def differences_html(left: ParameterFile, right: ParameterFile, *titles: str) -> str:
    """Return what differs between two, with a warning where they are of different devices or files."""
    rows = differences(left, right)
    count = len({*left.values, *right.values})
    notes = []
    if reason := left.drive.difference(right.drive):
        notes.append(t("they are of different devices: {reason}", reason=reason))
    if left.drive.eds_sha256 != right.drive.eds_sha256:
        notes.append(t("they were taken with different EDS files"))
    notes.append(t("{differing} of {count} parameters differ", differing=len(rows), count=count))
    said = "".join(f"<p>{html.escape(each)}</p>" for each in notes)
    if rows:
        cells = [["–" if cell is None else str(cell) for cell in row] for row in rows]
        said += table_html((t("Object"), t("Name"), *titles), cells)
    return said + unread_html(left.unread)


def unread_html(unread: Sequence[str]) -> str:
    """Return what a drive has not given."""
    shown = "".join(f"<li>{html.escape(each)}</li>" for each in unread[:SHOWN])
    title = html.escape(t("{count} parameters could not be read:", count=len(unread)))
    return f"<p>{title}</p><ul>{shown}</ul>" if unread else ""
