"""Where the axes and tools are."""

from __future__ import annotations

import html

from mcclient import Info, MachineStatus
from nicegui import ui

from mcserver.web.formatting import axis_name, position_text

HEAD = (
    "<tr><th>Axis</th><th class=n>Position</th><th class=n>Setpoint</th><th class=n>Velocity</th>"
    "<th>State</th></tr>"
)


class PositionsPanel:
    """A table of axes: position, target, velocity, state; below it the tools' poses."""

    def __init__(self) -> None:
        with ui.card().classes("mc-card"):
            ui.html("<h2>Position</h2>", sanitize=False)
            self._table = ui.html("", sanitize=False).classes("w-full overflow-x-auto")

    def update(self, status: MachineStatus, info: Info) -> None:
        units = {axis.index: axis.unit for axis in info.axes}
        axes = status.axes
        rows = []
        columns = zip(axes.index, axes.position, axes.setpoint, axes.velocity, axes.state, strict=True)
        homed = dict(zip(axes.index, axes.homed, strict=False))
        for index, position, setpoint, velocity, state in columns:
            unit = units.get(index, "")
            if not homed.get(index, True):
                state = f"{state}, not homed"
            rows.append(
                f"<tr><td>{axis_name(index)}</td><td class=n>{position_text(position)} {unit}</td>"
                f"<td class=n>{position_text(setpoint)}</td><td class=n>{velocity:.1f} {unit}/s</td>"
                f"<td>{html.escape(state)}</td></tr>"
            )
        for tool in status.tools:
            place = "  ".join(
                f"{letter}{position_text(value)}" for letter, value in zip("XYZ", tool.position, strict=False)
            )
            rows.append(f"<tr><td>T{tool.number}</td><td colspan=4>{place} mm</td></tr>")
        self._table.set_content(
            f'<table class="mc-positions"><thead>{HEAD}</thead><tbody>{"".join(rows)}</tbody></table>'
        )
