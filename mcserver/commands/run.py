"""``mcserver run``: the server."""

from __future__ import annotations


def run() -> None:
    """Run the server."""
