"""``[[tool]]`` of the machine file."""

from __future__ import annotations

from collections.abc import Container, Iterable

import msgspec

from mcserver.machine.drive_section import Refusal
from mcserver.units import MM


class ToolFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """``[[tool]]``: one end effector of the URDF."""

    number: int
    frame: str
    axes: list[int]
    orientation: bool = False
    euler: str = "ZYX"
    offset_mm: tuple[float, ...] = (0.0, 0.0, 0.0)


class Tool(msgspec.Struct, frozen=True):
    """One end effector; ``offset`` in m in the frame's own axes."""

    number: int
    frame: str
    axes: tuple[int, ...]
    orientation: bool
    euler: str
    offset: tuple[float, float, float]


def read_tools(sections: Iterable[ToolFile], axes: Container[int], bad: Refusal) -> tuple[Tool, ...]:
    """The tools in SI, by number; ``axes``: numbers of the machine's axes."""
    tools: dict[int, Tool] = {}
    for position, tool in enumerate(sections):
        where = f"tool[{position}]"
        if tool.number < 0 or tool.number in tools:
            raise bad(
                f"{where}.number",
                f"{tool.number} is negative or there twice",
                "number each tool once, from 0",
            )
        if tool.euler not in ("ZYX", "XYZ", "XZY", "YXZ", "YZX", "ZXY"):
            raise bad(f"{where}.euler", f"{tool.euler!r} is not an order of X, Y and Z", "ZYX is usual")
        if not tool.axes or len(set(tool.axes)) != len(tool.axes):
            raise bad(f"{where}.axes", "names no axis, or one twice", "list the chain's joints once each")
        for index in tool.axes:
            if index not in axes:
                raise bad(f"{where}.axes", f"the machine has no axis {index}", "name axes of this file")
        if len(tool.offset_mm) != 3:
            raise bad(f"{where}.offset_mm", "needs three numbers", "give X, Y, Z in mm")
        x, y, z = (value * MM for value in tool.offset_mm)
        tools[tool.number] = Tool(
            number=tool.number,
            frame=tool.frame,
            axes=tuple(tool.axes),
            orientation=tool.orientation,
            euler=tool.euler,
            offset=(x, y, z),
        )
    return tuple(tools[number] for number in sorted(tools))
