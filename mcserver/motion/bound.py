"""The limit that a segment's time is due to, and the error for a path without a velocity profile."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Bound:
    """Limit that a segment's time is due to: column of the axis, kind of the limit."""

    column: int
    kind: str


class PlanningError(Exception):
    """No velocity profile keeps the limits: the motion stops as planned before, the line is refused."""

    def __init__(self, line: int) -> None:
        super().__init__(f"no velocity profile for line {line}")
        self.line = line
