"""Segments that stand in columns and have been asked for as objects."""

from __future__ import annotations

from collections.abc import Callable

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import Segment


class MadeSegments:
    """Keeps the object that was made of each, which whoever has it may change."""

    __slots__ = ("_made",)

    def __init__(self) -> None:
        self._made: dict[int, Segment] = {}

    def get(self, index: int, make: Callable[[int], Segment]) -> Segment:
        """Return one of them, always the same object."""
        found = self._made.get(index)
        if found is None:
            found = self._made[index] = make(index)
        return found

    def set_scales(self, first: int, scales: Array) -> None:
        """Set the scales of those from ``first`` on that have been made, shape (n,)."""
        for index, segment in self._made.items():
            if first <= index < first + len(scales):
                segment.scale = float(scales[index - first])
