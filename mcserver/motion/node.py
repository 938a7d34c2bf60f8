"""Nodes of a run: segments with what is known of each alone."""

from __future__ import annotations

from dataclasses import dataclass

from mcserver.motion.limits import SpeedLimit
from mcserver.motion.path import Array
from mcserver.motion.segment import Segment


@dataclass(slots=True)
class Node:
    """A segment with what is known of it alone.

    Attributes:
        cap: greatest speed at its start, from the joint with the segment before.
        limit: greatest speed by the axes, and which one binds. top: with the feed too.
        samples: of the segment, rows of `mcserver.motion.kernels.limits`.
        vertex_before, vertex_after: the sample (1, 5 K + 2) of the vertex at its start and its end, where
            there is one.
        key: a plan had to bind its start; the next one begins with that.
    """

    segment: Segment
    cap: float
    limit: SpeedLimit
    top: float
    samples: Array
    key: bool = False
    vertex_before: Array | None = None
    vertex_after: Array | None = None

    @property
    def rows(self) -> list[Array]:
        """All its samples; a vertex at its start stands before one at its end."""
        return [each for each in (self.samples, self.vertex_before, self.vertex_after) if each is not None]


@dataclass(frozen=True)
class Bound:
    """What stretched a segment: column and kind of limit."""

    column: int
    kind: str


class PlanningError(Exception):
    """No time law was found that keeps the limits: the line is refused rather than moved wrongly."""

    def __init__(self, line: int) -> None:
        super().__init__(f"no time law for line {line}")
        self.line = line
