"""Drives: what kind each axis has, and of those on buses how they are."""

from __future__ import annotations

import html

from mcclient import DriveInfo, Info, MotionError
from nicegui import ui

from mcserver.web.formatting import axis_name
from mcserver.web.link import MachineLink

PERIOD_S = 2.0


class DrivesPanel:
    """Closed until somebody opens it: drives are asked for their details only then."""

    def __init__(self, link: MachineLink) -> None:
        self._link = link
        self._shown = ""
        with ui.card().classes("mc-card"), ui.expansion("Drives").classes("w-full mc-fold") as self._fold:
            self._table = ui.html("", sanitize=False).classes("w-full overflow-x-auto")
            self._table.props('tabindex=0 role=region aria-label="Drives"')

    async def update(self, info: Info) -> None:
        machine = self._link.machine
        if not self._fold.value or machine is None:
            return
        try:
            found = await self._link.answers.get("drives", PERIOD_S, machine.drives)
        except MotionError as error:
            self._set(f"<p>{html.escape(error.message)} [{error.code}]</p>")
            return
        drives = {drive.axis: drive for drive in found}
        rows = [
            f"<tr><td>{axis_name(axis.index)}</td><td>{html.escape(axis.drive)}</td>"
            f"{_cells(drives.get(axis.index))}</tr>"
            for axis in info.axes
        ]
        head = (
            "<tr><th>Axis</th><th>Drive</th><th>Bus, node</th><th>State</th><th>Heartbeat</th>"
            "<th>Details</th></tr>"
        )
        self._set(f'<table class="mc-positions"><thead>{head}</thead><tbody>{"".join(rows)}</tbody></table>')

    def _set(self, content: str) -> None:
        if content != self._shown:
            self._shown = content
            self._table.set_content(content)


def _cells(drive: DriveInfo | None) -> str:
    if drive is None:
        return "<td>–</td><td>–</td><td>–</td><td></td>"
    age = "–" if drive.heartbeat_age_s is None else f"{drive.heartbeat_age_s:.1f} s ago"
    details = [drive.status, drive.message]
    if drive.emergency:
        since = "" if drive.emergency_age_s is None else f", {drive.emergency_age_s:.0f} s ago"
        details.append(f"emergency: {drive.emergency}{since}")
    if drive.boot_ups > 1:
        details.append(f"{drive.boot_ups} boot-ups")
    details += [f"{each.name} {'–' if each.value is None else each.value}" for each in drive.monitor]
    cells = [f"{drive.bus}, {drive.node}", drive.state, age, "; ".join(each for each in details if each)]
    return "".join(f"<td>{html.escape(cell)}</td>" for cell in cells)
