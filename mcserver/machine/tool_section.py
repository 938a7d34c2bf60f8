"""The tools of a machine, in SI, and what fits together in ``[[tool]]``."""

from __future__ import annotations

from collections.abc import Container, Iterable

import msgspec

from mcserver.machine.section_reader import Mistakes
from mcserver.machine.sections import ToolSection
from mcserver.units import MM


class Tool(msgspec.Struct, frozen=True):
    """One end effector; ``offset`` in m in the frame's own axes."""

    number: int
    frame: str
    axes: tuple[int, ...]
    orientation: bool
    euler: str
    offset: tuple[float, float, float]


def read_tools(
    sections: Iterable[ToolSection | None], axes: Container[int], mistakes: Mistakes
) -> tuple[Tool, ...]:
    """Return the tools in SI, by number.

    Args:
        sections: None where one has a mistake of its own. axes: numbers of the machine's axes.
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
        x, y, z = (value * MM for value in tool.offset_mm)
        tools[tool.number] = Tool(
            tool.number, tool.frame, tuple(tool.axes), tool.orientation, tool.euler, (x, y, z)
        )
    return tuple(tools[number] for number in sorted(tools))
