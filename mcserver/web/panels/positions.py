"""Where the axes and tools are, and buttons that make the work coordinate system read zero there."""

from __future__ import annotations

import html
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType

from mcclient import AxisInfo, Info, Machine, MachineStatus
from mcclient.broken_off import WORK_OFFSET
from mcclient.work_tables import work_places
from nicegui import ui

from mcserver.machine.work_systems import WORK_SYSTEMS
from mcserver.web.actions import Actions
from mcserver.web.dialogs import NamedDialog, answer_to, answers
from mcserver.web.formatting import MOST, axis_name, position_text, velocity_text
from mcserver.web.open_programs import refusal_of, refusal_text, run_at_rest
from mcserver.web.panels.card import card, scrolled
from mcserver.web.translation import mark, t

# Axes with a button: those with a letter.
LETTERED = 6
NO_JOINTS: Mapping[int, str] = MappingProxyType({})
WHY = mark("zero is set where the axes stand")
MESHES: Mapping[str, str] = MappingProxyType(
    {
        "off": mark("Bed mesh: none counts"),
        "file": mark("Bed mesh: that of the machine file counts"),
        "probed": mark("Bed mesh: the one that G29 has probed counts"),
    }
)


class PositionsPanel:
    """A table of axes: position, target, velocity, state; below it the tools' poses, and the zero buttons."""

    def __init__(self, actions: Actions) -> None:
        self._actions = actions
        self._axes: tuple[AxisInfo, ...] = ()
        self._buttons: list[ui.button] = []
        with card(t("Position")):
            self._table = scrolled(t("Positions"))
            self._offsets = ui.html("", sanitize=False).classes("w-full text-sm mc-offsets")
            self._mesh = ui.label("").classes("text-sm")
            self._zero = ui.element("div").classes("mc-buttons")
            self._waits_for = ui.label("").classes("text-sm").props("aria-live=polite")

    def update(self, info: Info) -> None:
        lettered = tuple(axis for axis in info.axes if axis.index < LETTERED)
        link = self._actions.link
        shown = lettered if link.has_work_offsets else ()
        if shown != self._axes:
            self._axes = shown
            self._build()
        content = link.once(
            "positions",
            lambda status: positions_html(status, info, work=link.has_work_offsets, joints=link.joints),
        )
        self._table.set_content(content)
        status = link.status
        if status is not None:
            self._mesh.set_text(mesh_text(status))
        if status is not None and shown:
            self._offsets.set_content(offsets_html(status, info))
            refusal = refusal_of(link, status.programs, WHY)
            self._waits_for.set_text(refusal_text(refusal))
            for button in self._buttons:
                button.set_enabled(refusal is None)

    def _build(self) -> None:
        self._zero.clear()
        self._buttons = []
        with self._zero:
            for axis in self._axes:
                name = axis_name(axis.index)
                button = ui.button(t("Zero {name}", name=name), on_click=partial(self._set_zero, name))
                self._buttons.append(button.props("outline dense"))
            if self._axes:
                button = ui.button(t("Set …"), on_click=self._ask)
                self._buttons.append(button.props(f'outline dense aria-label="{t("set a work offset")}"'))

    async def _set_zero(self, axis: str, value: float = 0.0, system: int = 0) -> bool:
        """Have programs read ``value`` where the axis is, which nothing moves for; whether it was set."""

        async def send(machine: Machine) -> None:
            name = f"{WORK_OFFSET} by {self._actions.visitor.name}"
            line = f"G21 G90 G10 L20 P{system} {axis}{value:.6f}"
            await run_at_rest(self._actions.link, machine, name, line, WHY)

        where = mark("the work coordinate system in force") if system == 0 else system_name(system)
        done = await self._actions.do(
            "open", mark("{axis} reads {value:g} in {where}", axis=axis, value=value, where=where), send
        )
        if done:
            ui.notify(t("{axis} reads {value:g} here now", axis=axis, value=value), position="bottom")
        return done

    async def _ask(self) -> None:
        if not self._actions.allowed("open"):
            return
        names = [axis_name(axis.index) for axis in self._axes]
        with NamedDialog(t("Set a work offset")) as dialog, ui.card():
            ui.label(t("What an axis reads where it is now:"))
            axis = ui.select(names, value=names[0], label=t("Axis")).classes("min-w-24")
            number = ui.number(t("reads [mm, deg]"), value=0.0, min=-MOST, max=MOST, format="%.4f")
            system = ui.select(
                {each: system_name(each) for each in range(1, 10)}, value=1, label=t("System")
            ).classes("min-w-24")
            answers(dialog, t("Set"))

        async def set_it(_: bool) -> bool:
            return number.value is not None and await self._set_zero(
                axis.value, float(number.value), system.value
            )

        await answer_to(dialog, set_it)


def system_name(system: int) -> str:
    """Return ``G54`` to ``G59.3`` for 1 to 9."""
    return WORK_SYSTEMS[system - 1]


def mesh_text(status: MachineStatus) -> str:
    """Return which mesh of the bed counts; empty: programs probe none on this machine."""
    return "" if status.bed_mesh is None else t(MESHES[status.bed_mesh])


def offsets_html(status: MachineStatus, info: Info) -> str:
    """Return the work coordinate systems that were set, and where each reads zero, as HTML."""
    units = {axis.index: axis.unit for axis in info.axes}
    rows = []
    for each in status.work_offsets:
        places = ", ".join(
            f"{axis_name(int(axis))} {position_text(value)} {units.get(int(axis), '')}".rstrip()
            for axis, value in each.origin.items()
        )
        if each.rotation:
            places += f", R {position_text(each.rotation)} deg"
        system = f"<b>{html.escape(each.system)}</b>"
        reads = t("{system} reads zero at {places}", system=system, places=html.escape(places))
        rows.append(f"<li>{reads}</li>")
    return f"<ul aria-label='{t('Work offsets')}'>{''.join(rows)}</ul>" if rows else ""


def joint_html(joints: Mapping[int, str], index: int) -> str:
    """Return the name of an axis's joint behind the axis's own, as HTML; empty: it has none."""
    return f" <span class=mc-joint>{html.escape(joints[index])}</span>" if index in joints else ""


def positions_html(
    status: MachineStatus, info: Info, *, work: bool, joints: Mapping[int, str] = NO_JOINTS
) -> str:
    """Return the table as HTML.

    Args:
        work: with a column of what programs read in G54. joints: of the robot, by axis number.
    """
    in_g54 = work_places(status.work_offsets, dict(zip(status.axes.index, status.axes.position, strict=True)))
    # a phone has no room for all: what is wide there gives way to the state
    less = ' class="n mc-wide"'
    titles = [
        (t("Position"), " class=n"),
        (t("Setpoint"), less),
        (t("Velocity"), less if work else " class=n"),
    ]
    if work:
        titles.insert(1, (t("In G54"), " class=n"))
    head = "".join(f"<th{kind}>{title}</th>" for title, kind in titles)
    units = {axis.index: axis.unit for axis in info.axes}
    axes = status.axes
    rows = []
    columns = zip(axes.index, axes.position, axes.setpoint, axes.velocity, axes.state, strict=True)
    homed = dict(zip(axes.index, axes.homed, strict=False))
    skew = dict(zip(axes.index, axes.skew, strict=False))
    silent = dict(zip(axes.index, axes.silent, strict=False))
    for index, position, setpoint, velocity, state in columns:
        unit = units.get(index, "")
        shown_state = t(state)
        if not homed.get(index, True):
            shown_state = f"{shown_state}, {t('not homed')}"
        if skew.get(index):
            shown_state += f", {t('skew')} {position_text(skew[index])} {unit}"
        if silent.get(index):
            shown_state += f", {t('its drive is silent: old values')}"
        row = "<tr class=mc-old>" if silent.get(index) else "<tr>"
        in_work = f"<td class=n>{position_text(in_g54[index])}</td>" if work else ""
        rows.append(
            f"{row}<td>{axis_name(index)}{joint_html(joints, index)}</td>"
            f"<td class=n>{position_text(position)} {unit}</td>{in_work}"
            f"<td{less}>{position_text(setpoint)}</td>"
            f"<td{titles[-1][1]}>{velocity_text(velocity)}<span class=mc-wide> {unit}/s</span></td>"
            f"<td>{html.escape(shown_state)}</td></tr>"
        )
    for tool in status.tools:
        values = (*tool.position, *tool.orientation)
        place = "  ".join(
            f"{letter}{position_text(value)}" for letter, value in zip("XYZABC", values, strict=False)
        )
        unit = "mm, deg" if tool.orientation else "mm"
        rows.append(
            f"<tr><td>T{tool.number}</td><td class=mc-pose colspan={len(titles) + 1}>{place} {unit}</td></tr>"
        )
    head = f"<thead><tr><th>{t('Axis')}</th>{head}<th>{t('State')}</th></tr></thead>"
    return f'<table class="mc-positions">{head}<tbody>{"".join(rows)}</tbody></table>'
