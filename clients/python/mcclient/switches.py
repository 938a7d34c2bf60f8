"""The operator's switches of a program in words."""

from __future__ import annotations


def switches_said(block_delete: bool | None, optional_stop: bool | None) -> list[str]:
    """Return what an operator has switched otherwise than it is by default; None: not known."""
    return ["block delete on"] * (block_delete is True) + ["optional stop off"] * (optional_stop is False)
