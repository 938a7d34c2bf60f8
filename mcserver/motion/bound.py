"""What planning reports of a segment: the limit that stretched it, or that no velocity profile exists."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Bound:
    """The limit that stretched a segment: machine column and kind of limit."""

    column: int
    kind: str


class PlanningError(Exception):
    """No velocity profile keeps the limits: the line is refused rather than moved wrongly."""

    def __init__(self, line: int) -> None:
        super().__init__(f"no time law for line {line}")
        self.line = line
