"""Drives: what kind each axis has, and of those on buses how they are."""

from __future__ import annotations

import html
from urllib.parse import quote

from mcclient import DriveInfo, Info, MotionError
from nicegui import ui

from mcserver.web.formatting import axis_name
from mcserver.web.link import MachineLink
from mcserver.web.panels.card import scrolled
from mcserver.web.translation import t

PERIOD_S = 2.0


class DrivesPanel:
    """Closed until somebody opens it: drives are asked for their details only then.

    Args:
        desk: whether it leads to the commissioning desk.
    """

    def __init__(self, link: MachineLink, *, desk: bool = False) -> None:
        self._link = link
        with ui.card().classes("mc-card"), ui.expansion(t("Drives")).classes("w-full mc-fold") as self._fold:
            self._table = scrolled(t("Drives"))
            if desk:
                ui.link(t("Commissioning desk"), f"/machine/{quote(link.name)}/drives")

    async def update(self, info: Info) -> None:
        machine = self._link.machine
        if not self._fold.value or machine is None:
            return
        try:
            found = await self._link.answers.get("drives", PERIOD_S, machine.drives)
        except MotionError as error:
            self._table.set_content(f"<p>{html.escape(t(error.message))} [{error.code}]</p>")
            return
        drives = {drive.axis: drive for drive in found}
        rows = [
            f"<tr><td>{axis_name(axis.index)}</td><td>{html.escape(axis.drive)}</td>"
            f"{_cells(drives.get(axis.index))}</tr>"
            for axis in info.axes
        ]
        titles = (t("Axis"), t("Drive"), t("Bus, node"), t("State"), t("Heartbeat"), t("Details"))
        head = f"<tr>{''.join(f'<th>{title}</th>' for title in titles)}</tr>"
        self._table.set_content(
            f'<table class="mc-positions"><thead>{head}</thead><tbody>{"".join(rows)}</tbody></table>'
        )


def _cells(drive: DriveInfo | None) -> str:
    if drive is None:
        return "<td>–</td><td>–</td><td>–</td><td></td>"
    heartbeat = "–" if drive.heartbeat_age_s is None else t("{age:.1f} s ago", age=drive.heartbeat_age_s)
    details = [drive.status, drive.message]
    if drive.emergency:
        age = drive.emergency_age_s
        since = "" if age is None else ", " + t("{age:.0f} s ago", age=age)
        details.append(t("emergency: {what}", what=drive.emergency) + since)
    if drive.boot_ups > 1:
        details.append(t("{count} boot-ups", count=drive.boot_ups))
    details += [f"{each.name} {'–' if each.value is None else each.value}" for each in drive.monitor]
    cells = [
        f"{drive.bus}, {drive.node}",
        t(drive.state),
        heartbeat,
        "; ".join(each for each in details if each),
    ]
    return "".join(f"<td>{html.escape(cell)}</td>" for cell in cells)
