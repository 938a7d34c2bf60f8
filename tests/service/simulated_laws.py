"""What has to hold in a simulated cell."""

from __future__ import annotations


class Violation(AssertionError):
    """Something that has to hold did not."""


def require(holds: bool, what: str) -> None:
    if not holds:
        raise Violation(what)
