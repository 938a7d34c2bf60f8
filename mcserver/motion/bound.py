"""What planning says of a segment: which limit stretched it, or that no time law was found."""

from __future__ import annotations

from dataclasses import dataclass


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
