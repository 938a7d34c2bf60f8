"""The path that the machine travels, in three dimensions, and charts of any signal over the last minutes."""

from __future__ import annotations

from collections.abc import Iterable

from mcclient import Info, MachineStatus
from nicegui import ui

from mcserver.web.formatting import axis_name
from mcserver.web.link import MachineLink

WINDOW_S = 30.0
CHART_POINTS = 300
SIGNALS = ("position", "setpoint", "velocity", "torque", "following error")
# A point is drawn when it lies this far from the one before [mm, deg].
TRAIL_STEP = 0.05


class TrailPanel:
    """The first three axes, or the first tool's tip, as a line in space."""

    def __init__(self, link: MachineLink) -> None:
        self._link = link
        self._last: list[float] | None = None
        self._shown_until: tuple[str, float] = ("", 0.0)
        with ui.card().classes("mc-card"):
            with ui.row().classes("items-center w-full justify-between"):
                ui.html("<h2>Path travelled</h2>", sanitize=False)
                ui.button("Clear", on_click=self._clear).props("flat dense")
            axis = {
                "type": "value",
                "scale": True,
                "axisLabel": {"fontSize": 10},
                "nameTextStyle": {"fontSize": 12},
            }
            self._chart = ui.echart(
                {
                    "animation": False,
                    "grid3D": {
                        "viewControl": {"projection": "orthographic", "alpha": 35, "beta": 30},
                        "boxDepth": 80,
                    },
                    "xAxis3D": {**axis, "name": "X"},
                    "yAxis3D": {**axis, "name": "Y"},
                    "zAxis3D": {**axis, "name": "Z"},
                    "series": [
                        {
                            "type": "line3D",
                            "id": "done",
                            "data": [],
                            "lineStyle": {"width": 3, "color": "#1565c0"},
                        },
                        {
                            "type": "scatter3D",
                            "id": "tip",
                            "data": [],
                            "symbolSize": 10,
                            "itemStyle": {"color": "#e53935"},
                        },
                    ],
                },
                enable_3d=True,
            ).classes("mc-trail")

    def update(self, status: MachineStatus) -> None:
        since, self._shown_until = self._shown_until, (status.instance, status.t)
        states = []
        for state in reversed(self._link.history):
            if (state.instance, state.t) == since:
                break
            states.append(state)
        points = _thinned(reversed(states), self._last)
        if points:
            # the first time: what was travelled before this page was opened
            restart = "true" if self._last is None else "false"
            ui.run_javascript(f"mcTrail({self._chart.id}, {points}, {restart})")
            self._last = points[-1]

    def _clear(self) -> None:
        ui.run_javascript(f"mcTrail({self._chart.id}, [], true)")
        self._last = None


class ChartPanel:
    """Signals of some axes over the last `WINDOW_S`."""

    def __init__(self, link: MachineLink) -> None:
        self._link = link
        self._axes: dict[int, str] = {}
        with ui.card().classes("mc-card"):
            ui.html("<h2>Signals</h2>", sanitize=False)
            with ui.row().classes("w-full"):
                self._signal = ui.select(list(SIGNALS), value="velocity", label="Signal").classes("min-w-36")
                self._choice = ui.select({}, value=[], multiple=True, label="Axes").classes("grow min-w-32")
            self._chart = ui.echart(
                {
                    "animation": False,
                    "tooltip": {"trigger": "axis"},
                    "legend": {"top": 0},
                    "grid": {"left": 60, "right": 12, "top": 30, "bottom": 24},
                    "xAxis": {"type": "value", "min": -WINDOW_S, "max": 0, "name": "s"},
                    "yAxis": {"type": "value", "scale": True},
                    "series": [],
                }
            ).classes("mc-chart")

    def update(self, status: MachineStatus, info: Info) -> None:
        names = {axis.index: f"{axis_name(axis.index)} [{axis.unit}]" for axis in info.axes}
        if names != self._axes:
            self._axes = names
            self._choice.set_options(names, value=list(names)[:3])
        wanted = [index for index in self._choice.value if index in status.axes.index]
        states = [
            each
            for each in self._link.history
            if each.t > status.t - WINDOW_S and each.instance == status.instance
        ]
        states = states[:: max(1, len(states) // CHART_POINTS)]
        series = []
        for index in wanted:
            column = status.axes.index.index(index)
            points = [
                [round(each.t - status.t, 2), round(_signal(each, self._signal.value, column), 4)]
                for each in states
            ]
            series.append({"type": "line", "name": axis_name(index), "showSymbol": False, "data": points})
        self._chart.run_chart_method("setOption", {"series": series}, {"replaceMerge": ["series"]})


def _place(status: MachineStatus) -> tuple[float, ...]:
    if status.tools:
        return tuple(round(value, 3) for value in status.tools[0].position)
    found = dict(zip(status.axes.index, status.axes.position, strict=True))
    return tuple(round(found.get(index, 0.0), 3) for index in range(3))


def _thinned(states: Iterable[MachineStatus], last: list[float] | None) -> list[list[float]]:
    """The places that lie `TRAIL_STEP` from the one before, the first of them from ``last``."""
    kept: list[list[float]] = []
    for state in states:
        place = list(_place(state))
        if last is None or max(abs(a - b) for a, b in zip(place, last, strict=True)) >= TRAIL_STEP:
            kept.append(place)
            last = place
    return kept


def _signal(status: MachineStatus, name: str, column: int) -> float:
    axes = status.axes
    if name == "following error":
        return axes.setpoint[column] - axes.position[column]
    values: tuple[float, ...] = getattr(axes, name)
    return values[column]
