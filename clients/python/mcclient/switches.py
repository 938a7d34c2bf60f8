"""The operator's switches of a program in words."""

from __future__ import annotations


def switches_said(block_delete: bool, optional_stop: bool) -> list[str]:
    """Return what an operator has switched otherwise than it is by default."""
    return ["block delete on"] * block_delete + ["optional stop off"] * (not optional_stop)
