"""The tools of a machine, in SI, and what fits together in ``[[tool]]``."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping

import msgspec

from mcserver.machine.follow_section import Follow
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.sections import PayloadSection, ToolSection
from mcserver.units import MM


class Payload(msgspec.Struct, frozen=True):
    """What a tool carries: mass [kg], ``center`` in the frame's own axes [m], and the inertia about it, ixx,
    iyy, izz, ixy, ixz, iyz [kg·m²].
    """

    mass: float
    center: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]


class Tool(msgspec.Struct, frozen=True):
    """One end effector.

    ``offset`` is in m in the frame's own axes, ``posture`` of its axes in rad or m, ``work`` the frame in
    which its poses are, None: the URDF's base, ``follow`` what its tip can go along with, None: nothing.
    """

    number: int
    frame: str
    axes: tuple[int, ...]
    orientation: bool
    euler: str
    offset: tuple[float, float, float]
    payload: Payload | None = None
    posture: tuple[float, ...] | None = None
    work: str | None = None
    follow: Follow | None = None


def read_tools(
    sections: Iterable[ToolSection | None],
    axes: Container[int],
    scales: Mapping[int, float],
    mistakes: Mistakes,
) -> tuple[Tool, ...]:
    """Return the tools in SI, by number.

    Args:
        sections: None where one has a mistake of its own. axes: numbers of the machine's axes. scales:
            SI for a unit of those that are known.
    """
    tools: dict[int, Tool] = {}
    for position, tool in enumerate(sections):
        if tool is None:
            continue
        path = ("tool", position)
        if tool.number in tools:
            mistakes.add((*path, "number"), f"T{tool.number} is there twice", "number each tool once, from 0")
        if len(set(tool.axes)) != len(tool.axes):
            mistakes.add((*path, "axes"), "names an axis twice", "list the chain's joints once each")
        for index in tool.axes:
            if index not in axes:
                mistakes.add((*path, "axes"), f"the machine has no axis {index}", "name axes of this file")
        if tool.posture is not None and len(tool.posture) != len(tool.axes):
            mistakes.add((*path, "posture"), "has not one position for each axis", "list them as in axes")
        x, y, z = (value * MM for value in tool.offset_mm)
        tools[tool.number] = Tool(
            tool.number,
            tool.frame,
            tuple(tool.axes),
            tool.orientation,
            tool.euler,
            (x, y, z),
            _payload(tool.payload),
            _posture(tool, scales),
            tool.work,
        )
    return tuple(tools[number] for number in sorted(tools))


def _payload(section: PayloadSection | None) -> Payload | None:
    if section is None:
        return None
    x, y, z = (value * MM for value in section.center_mm)
    return Payload(section.mass, (x, y, z), section.inertia)


def _posture(tool: ToolSection, scales: Mapping[int, float]) -> tuple[float, ...] | None:
    if tool.posture is None:
        return None
    units = (scales.get(axis, 1.0) for axis in tool.axes)
    return tuple(value * unit for value, unit in zip(tool.posture, units, strict=False))
