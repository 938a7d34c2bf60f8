"""What the panel beside the picture says, as HTML: the line, the axes' values, dials of rotary axes."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence

from mckinematics.solver import MachineKinematics

from mcserver.machine.machine_file import Axis, Machine
from mcserver.machine.plausibility import axis_name
from mcserver.plot.theme import colours_of
from mcserver.units import AxisType

TABLE = "width:100%;border-collapse:collapse;font-size:0.8em;font-variant-numeric:tabular-nums"
MOST_AXES = 24


def line_html(number: int, source: str, colour: str) -> str:
    """The line under way, with the colour of its path."""
    shown = html.escape(source.strip()) if number else "no line runs"
    head = f"line {number}" if number else "&nbsp;"
    return (
        f'<div style="padding:0.4em 0.8em;font-size:0.85em"><span style="display:inline-block;width:0.8em;'
        f'height:0.8em;border-radius:50%;background:{colour};margin-right:0.5em"></span><b>{head}</b>'
        f'<div style="font-family:monospace;margin-top:0.3em;min-height:2.6em;overflow-wrap:anywhere">{shown}'
        "</div></div>"
    )


def axis_names(machine: Machine, kinematics: MachineKinematics | None) -> dict[int, str]:
    """What each axis is called: its joint where it has one, else as in the G-code."""
    names = {axis.index: axis_name(axis.index) for axis in machine.axes}
    chains = [] if kinematics is None else [kinematics.tool(tool).chain for tool in kinematics.tools]
    for chain in chains:
        for axis, joint in zip(chain.axes, chain.joint_names, strict=True):
            names[axis] = f"{axis} {joint.removesuffix('_joint').replace('_', ' ')}"
    return names


def axes_html(axes: Sequence[Axis], positions: Mapping[int, float], names: Mapping[int, str]) -> str:
    """A row for each axis: its value [mm, deg], and where that is within its travel or on its dial.

    ``positions`` by axis number [m or rad], ``names`` of `axis_names`.
    """
    rows = []
    for axis in axes[:MOST_AXES]:
        value = positions[axis.index]
        shown = value / axis.type.si_per_unit
        unit = "mm" if axis.type is AxisType.LINEAR else "°"
        rows.append(
            f'<tr><td style="white-space:nowrap">{html.escape(names[axis.index])}</td>'
            f'<td style="text-align:right">{shown:.2f}&nbsp;{unit}</td>'
            f'<td style="width:38%;padding-left:0.6em">{_gauge(axis, value)}</td></tr>'
        )
    more = len(axes) - MOST_AXES
    note = f'<div style="font-size:0.8em">and {more} more</div>' if more > 0 else ""
    return f'<div style="padding:0 0.8em"><table style="{TABLE}">{"".join(rows)}</table>{note}</div>'


def line_colours(lines: Sequence[int]) -> dict[int, tuple[int, int, int]]:
    """Red, green, blue of each line, the same as in the pictures of ``mcserver plot``."""
    return {number: _rgb(colour) for number, colour in colours_of(lines).items()}


def css(colour: tuple[int, int, int]) -> str:
    """A colour as the browser writes it."""
    return f"rgb({colour[0]},{colour[1]},{colour[2]})"


def _gauge(axis: Axis, value: float) -> str:
    low, high = axis.min_position, axis.max_position
    if axis.type is AxisType.ROTARY and not (math.isfinite(low) and math.isfinite(high)):
        return _dial(value)
    if not (math.isfinite(low) and math.isfinite(high) and high > low):
        return ""
    share = 100.0 * min(max((value - low) / (high - low), 0.0), 1.0)
    return (
        '<div style="position:relative;height:0.5em;border-radius:0.25em;background:#dfe4ea">'
        f'<div style="position:absolute;left:calc({share:.2f}% - 0.25em);top:-0.1em;width:0.5em;height:0.7em;'
        'border-radius:0.2em;background:#44749e"></div></div>'
    )


def _dial(angle: float) -> str:
    x, y = 12.0 + 8.0 * math.cos(angle), 12.0 - 8.0 * math.sin(angle)
    return (
        '<svg width="24" height="24" style="display:block"><circle cx="12" cy="12" r="10" fill="none"'
        ' stroke="#c3cad3" stroke-width="2"/><line x1="12" y1="12" '
        f'x2="{x:.1f}" y2="{y:.1f}" stroke="#44749e" stroke-width="2.5" stroke-linecap="round"/></svg>'
    )


def _rgb(colour: str) -> tuple[int, int, int]:
    digits = colour.removeprefix("#")
    return int(digits[:2], 16), int(digits[2:4], 16), int(digits[4:], 16)
