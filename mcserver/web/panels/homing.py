"""Homing: which axes know where they are, and a button for each that has to find out."""

from __future__ import annotations

from functools import partial

from mcclient import AxisInfo, Event, Info, MachineStatus
from nicegui import ui

from mcserver.web.actions import Actions
from mcserver.web.dialogs import NamedDialog, answer_to, answers
from mcserver.web.formatting import MOST, axis_name
from mcserver.web.link import MachineLink
from mcserver.web.machine_words import HOMING_METHODS
from mcserver.web.panels.card import heading
from mcserver.web.translation import mark, t

# Methods that find nothing by themselves: somebody says where the axis is.
BY_HAND = frozenset({"absolute", "manual"})


class HomingPanel:
    """A row for each axis with ``[axis.homing]``; hidden on machines without."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._axes: tuple[AxisInfo, ...] = ()
        self._states: dict[int, ui.label] = {}
        self._card = ui.card().classes("mc-card")
        with self._card:
            with ui.row().classes("items-center w-full justify-between"):
                heading(t("Homing"))
                self._all = ui.button(t("Home all"), on_click=partial(self._home, None)).props(
                    "outline dense"
                )
            self._rows = ui.element("div").classes(
                "w-full grid grid-cols-[3rem_1fr_auto] gap-x-3 gap-y-1 items-center"
            )
        self._card.set_visibility(False)

    def update(self, status: MachineStatus, info: Info) -> None:
        axes = tuple(axis for axis in info.axes if axis.homing is not None)
        if axes != self._axes:
            self._build(axes)
        homed = dict(zip(status.axes.index, status.axes.homed, strict=False))
        for axis in axes:
            text = phase_of(self._actions.link, axis.index, homed=homed.get(axis.index, True))
            self._states[axis.index].set_text(f"{t(HOMING_METHODS[str(axis.homing)])}: {text}")

    def _build(self, axes: tuple[AxisInfo, ...]) -> None:
        self._axes, self._states = axes, {}
        self._card.set_visibility(bool(axes))
        self._all.set_visibility(any(axis.homing not in BY_HAND for axis in axes))
        self._rows.clear()
        with self._rows:
            for axis in axes:
                name = axis_name(axis.index)
                ui.label(name).classes("font-bold")
                self._states[axis.index] = ui.label("").classes("text-sm")
                if axis.homing in BY_HAND:
                    ui.button(t("Reference"), on_click=partial(self._reference, axis)).props(
                        f'outline dense aria-label="{t("reference axis {name}", name=name)}"'
                    )
                else:
                    ui.button(t("Home"), on_click=partial(self._home, axis.index)).props(
                        f'outline dense aria-label="{t("home axis {axis}", axis=name)}"'
                    )

    async def _home(self, axis: int | None) -> None:
        what = mark("home all axes") if axis is None else mark("home axis {axis}", axis=axis_name(axis))
        axes = None if axis is None else [axis]
        await self._actions.do("home", what, lambda machine: machine.home(axes))

    async def _reference(self, axis: AxisInfo) -> None:
        """Ask where the axis is: a wrong number makes its limits wrong, so it is written, not clicked."""
        if not self._actions.allowed("reference"):
            return
        name = axis_name(axis.index)
        with NamedDialog(t("Reference of axis {name}", name=name)) as dialog, ui.card():
            ui.label(t("Where is axis {name} now? Its limits count from this number on.", name=name))
            number = ui.number(f"{name} [{axis.unit}]", min=-MOST, max=MOST, format="%.4f").props("autofocus")
            answers(dialog, t("Set the reference"), "warning")

        async def reference(_: bool) -> bool:
            position = number.value
            return position is not None and await self._actions.do(
                "reference",
                mark(
                    "reference axis {name} at {position:g} {unit}",
                    name=name,
                    position=position,
                    unit=axis.unit,
                ),
                lambda machine: machine.reference({axis.index: float(position)}),
            )

        await answer_to(dialog, reference)


def phase_of(link: MachineLink, axis: int, *, homed: bool) -> str:
    """Return how an axis stands: homed, not homed, or what its homing is at, by its newest event."""
    newest: Event | None = next(
        (
            event
            for event in reversed(link.events)
            if event.axis == axis and event.kind in ("axis.homing", "axis.homed", "axis.unhomed")
        ),
        None,
    )
    busy = newest is not None and newest.kind == "axis.homing" and newest.message != "done"
    status = link.status
    if busy and newest is not None and status is not None:
        under_way = {program.program for program in status.programs if not program.ended_at}
        if newest.program in under_way:
            return t(newest.message) or t("searching")
    return t("homed") if homed else t("not homed")
