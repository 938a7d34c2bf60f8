"""A recording as a browser plays it: thinned rows, with what is said beside them."""

from __future__ import annotations

import math

import msgspec


class Tip(msgspec.Struct, frozen=True):
    """Where one tool was, shape (n, 3) [mm]; None: the axes 0, 1 and 2."""

    tool: int | None
    points: list[list[float]]

    @property
    def label(self) -> str:
        """As pictures have it: ``T3``, empty for the axes' own."""
        return "" if self.tool is None else f"T{self.tool}"


class ReplayAxis(msgspec.Struct, frozen=True):
    """An axis: what it is called, its unit, ``mm`` or ``°``, and its travel in it; None: no end."""

    number: int
    name: str
    unit: str
    low: float | None = None
    high: float | None = None

    @classmethod
    def of(cls, number: int, name: str, *, rotary: bool, low: float, high: float) -> ReplayAxis:
        """Return an axis whose travel may be infinite [mm, deg]."""
        ends = (each if math.isfinite(each) else None for each in (low, high))
        return cls(number, name, "°" if rotary else "mm", *ends)


class Replay(msgspec.Struct, frozen=True):
    """Rows of a recording.

    Attributes:
        time_s, line: shape (n,). position: shape (n, k), of the axes [mm, deg].
        text: of lines, by number from 1. zeros: of work coordinate systems and of the machine [mm], by name.
    """

    time_s: list[float]
    line: list[int]
    axes: list[ReplayAxis]
    position: list[list[float]]
    tips: list[Tip]
    text: dict[int, str] = {}
    zeros: dict[str, list[float]] = {}
