"""What keeps the rig from running."""

from __future__ import annotations


class RigError(Exception):
    """Something is missing; the remedy says what to do about it."""

    def __init__(self, what: str, remedy: str) -> None:
        super().__init__(f"{what}\n  = help: {remedy}")
