"""The drive that a commissioning desk is at: chosen by its axis, with the parameters of its EDS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from mcclient import Machine, MotionError, NobodyAnswers
from mcclient.types import DriveParameters
from nicegui import events, ui

from mcserver.canopen.canopen_errors import Stopped
from mcserver.canopen.desk import Desk
from mcserver.canopen.parameters import Parameter
from mcserver.errors import McError
from mcserver.web.actions import Actions, show_error, show_refusal
from mcserver.web.choice import Choice
from mcserver.web.desk import DeskThread, parameters_from
from mcserver.web.formatting import axis_name
from mcserver.web.translation import mark, t

T = TypeVar("T")
CIA_402 = "cia402"


class DeskDrive:
    """Which drive is chosen, and the way to its desk.

    Attributes:
        actions: of the visitor. drive: as the server describes it; None: none is chosen. parameters: its own.
        others: axes with another such drive.
    """

    def __init__(self, actions: Actions) -> None:
        self.actions = actions
        self.drive: DriveParameters | None = None
        self.parameters: Sequence[Parameter] = ()
        self._thread = DeskThread(actions.link)
        self._axes: tuple[int, ...] = ()
        # whose drive was not described in time: it is asked for again
        self._owed: int | None = None
        self._listeners: list[Callable[[], None]] = []

    @property
    def others(self) -> list[int]:
        chosen = None if self.drive is None else self.drive.axis
        return [axis for axis in self._axes if axis != chosen]

    def build(self) -> None:
        """Add the choice of a drive, and how far a desk at work is."""
        self._choice = Choice({}, label=t("Drive"), on_change=self._choose).classes("w-full")
        self._remark = ui.label(t("no CiA 402 drive")).classes("text-xs break-words").props("role=status")
        with ui.row().classes("items-center w-full gap-2") as self._work:
            ui.spinner(size="sm")
            self._count = ui.label("")
            ui.button(t("Stop"), on_click=self._thread.stop).props("outline dense")
        self._work.set_visibility(False)

    def chosen(self) -> DriveParameters | None:
        """Return the drive; None: none is chosen, which is said."""
        if self.drive is None:
            show_refusal(t("no drive is chosen"), t("choose one"))
        return self.drive

    def on_change(self, listener: Callable[[], None]) -> None:
        """Call when another drive is chosen, or others are there."""
        self._listeners.append(listener)

    def update(self) -> None:
        """Show how far a desk at work is."""
        self._work.set_visibility(self._thread.is_busy)
        self._count.set_text(t("{count} objects", count=self._thread.transfers))

    async def look(self, machine: Machine) -> None:
        """See which drives there are; ask again for a description that did not come."""
        axes = tuple(each.index for each in machine.info.axes if each.drive == CIA_402)
        if axes == self._axes:
            if self._owed is not None:
                await self._describe(self._owed)
            return
        self._axes = axes
        self._remark.set_text("" if axes else t("no CiA 402 drive"))
        before = self._choice.value
        self._choice.set_options(
            {axis: axis_name(axis) for axis in axes},
            value=before if before in axes else next(iter(axes), None),
        )
        self._tell()

    async def _choose(self, event: events.ValueChangeEventArguments[int | None]) -> None:
        self.drive, self.parameters, self._owed = None, (), None
        self._tell()
        if event.value is not None:
            await self._describe(event.value)

    async def _describe(self, axis: int) -> None:
        self._owed = None
        try:
            drive = await self.described(axis)
        except MotionError as error:
            if self._choice.value == axis:
                self._remark.set_text(f"{t(error.message)} [{error.code}]")
                self._owed = axis if isinstance(error, NobodyAnswers) else None
            return
        if self._choice.value != axis:
            # another one was chosen meanwhile, and may be there already
            return
        self.drive, self.parameters = drive, parameters_from(drive)
        source = "" if drive.eds_sha256 else t("no EDS: the standard's objects")
        self._remark.set_text("; ".join(filter(None, [_place(drive), source, *drive.unreadable[:3]])))
        self._tell()

    async def described(self, axis: int) -> DriveParameters:
        """Return a drive as the server describes it; MotionError: as the server says."""
        return await self.actions.link.connected().drive_parameters(axis)

    async def read(self, work: Callable[[Desk], T], drive: DriveParameters | None = None) -> T | None:
        """Return what reading at a desk gives; None: it was refused, which is said, or stopped.

        Args:
            drive: None: the chosen one.
        """
        if not self.actions.has_role("sdo_read"):
            return None
        try:
            return await self._at_desk(work, drive)
        except (MotionError, McError) as error:
            show_error(error)
        return None

    async def write(self, name: str, work: Callable[[Desk], T]) -> T | None:
        """As `read`, for what writes: who has control may, and it is written down who did."""
        found: T | None = None

        async def act(_machine: Machine) -> None:
            nonlocal found
            found = await self._at_desk(work, None)

        await self.actions.do("sdo_write", name, act)
        return found

    async def _at_desk(self, work: Callable[[Desk], T], drive: DriveParameters | None) -> T | None:
        at = drive or self.chosen()
        if at is None:
            return None
        if self._thread.is_busy:
            raise MotionError("MC559", mark("this desk is at work"), mark("wait for its end, or stop it"))
        try:
            return await self._thread.work(at, work)
        except Stopped:
            ui.notify(t("stopped"), position="bottom")
            return None

    def stop(self) -> None:
        """Have a desk at work end: nobody looks any more."""
        self._thread.stop()

    def _tell(self) -> None:
        for listener in self._listeners:
            listener()


def _place(drive: DriveParameters) -> str:
    if drive.fieldbus == "ethercat":
        return t("position {position} on {bus}", position=drive.node, bus=drive.bus)
    return t("node {node} on {bus}", node=drive.node, bus=drive.bus)
