"""Nodes of a run: segments with what is known of each alone."""

from __future__ import annotations

from dataclasses import dataclass

from mcserver.motion.limits import Demand, SpeedLimit
from mcserver.motion.segment import Segment


@dataclass
class Node:
    """A segment with what is known of it alone.

    Attributes:
        cap: greatest speed at its start, from the joint with the segment before.
        limit: greatest speed by the axes, and which one binds. top: with the feed too.
        demand: samples; the last ones are the vertices at its start and its end, where there are such.
        key: a plan had to bind its start; the next one begins with that.
    """

    segment: Segment
    cap: float
    limit: SpeedLimit
    top: float
    demand: Demand
    key: bool = False
    vertex_before: bool = False
    vertex_after: bool = False


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
