"""What a machine's states say over time: every quantity of every axis, its tools, inputs and outputs."""

from __future__ import annotations

import re

from mcclient import Info, MachineStatus
from mcclient.work_tables import work_places

from mcserver.web.formatting import axis_name
from mcserver.web.translation import mark, t

AXIS_QUANTITIES = (
    mark("position"),
    mark("setpoint"),
    mark("velocity"),
    mark("torque"),
    mark("following error"),
)
_UNITS = {"velocity": "{}/s", "torque": "N·m"}
_AXIS = re.compile(r"axis (\d+) (.+)")
_TOOL = re.compile(r"tool (\d+) ([xyzabc])")


def signals_of(info: Info) -> dict[str, tuple[str, str]]:
    """Return every signal of a machine by its key: what it is called, and its unit."""
    found: dict[str, tuple[str, str]] = {}
    for quantity in AXIS_QUANTITIES:
        for axis in info.axes:
            unit = _UNITS.get(quantity, "{}").format(axis.unit)
            found[f"axis {axis.index} {quantity}"] = (f"{axis_name(axis.index)} {t(quantity)}", unit)
    for axis in info.axes:
        found[f"axis {axis.index} in G54"] = (t("{axis} in G54", axis=axis_name(axis.index)), axis.unit)
    for tool in info.tools:
        for letter in "xyzabc":
            unit = "mm" if letter in "xyz" else "deg"
            found[f"tool {tool.number} {letter}"] = (f"T{tool.number} {letter.upper()}", unit)
    for each in info.inputs:
        found[f"input {each.name}"] = (t("input {name}", name=each.name), each.unit or t("on/off"))
    for output in info.outputs:
        found[f"output {output.name}"] = (t("output {name}", name=output.name), output.unit or t("on/off"))
    return found | {
        "override": (t("feed override"), "%"),
        "line": (t("program line"), t("line")),
        "late": (t("late cycles"), t("cycles")),
    }


def value_of(status: MachineStatus, signal: str) -> float | None:
    """Return a signal's value in one state; None where the state does not have it."""
    if signal == "override":
        return status.override
    if signal == "late":
        return float(status.late_cycles)
    if signal == "line":
        return float(max((program.line for program in status.programs if not program.ended_at), default=0))
    if (axis := _AXIS.fullmatch(signal)) is not None:
        return _of_axis(status, int(axis[1]), axis[2])
    if (tool := _TOOL.fullmatch(signal)) is not None:
        for pose in status.tools:
            if pose.number == int(tool[1]):
                values = (*pose.position, *pose.orientation)
                place = "xyzabc".index(tool[2])
                return values[place] if place < len(values) else None
        return None
    kind, _, name = signal.partition(" ")
    channels = status.inputs if kind == "input" else status.outputs
    return next((float(each.value) for each in channels if each.name == name), None)


def _of_axis(status: MachineStatus, axis: int, quantity: str) -> float | None:
    axes = status.axes
    if axis not in axes.index:
        return None
    column = axes.index.index(axis)
    if quantity == "in G54":
        return work_places(status.work_offsets, dict(zip(axes.index, axes.position, strict=True)))[axis]
    if quantity == "following error":
        return axes.setpoint[column] - axes.position[column]
    values: tuple[float, ...] = getattr(axes, quantity)
    return values[column]
