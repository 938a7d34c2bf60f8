"""Axes of machine files of tests, as text."""

from __future__ import annotations

from collections.abc import Iterable


def axes_text(
    indices: Iterable[int] = (0,),
    *,
    rotary: bool = False,
    velocity: float = 200.0,
    acceleration: float = 2000.0,
    keys: str = "",
    drive: str = "ideal",
    drive_keys: str = "",
) -> str:
    """Return axes, all alike [mm or deg]; ``keys`` and ``drive_keys`` are further lines of each."""
    return "".join(
        f'[[axis]]\nindex = {index}\ntype = "{"rotary" if rotary else "linear"}"\n'
        f"max_velocity = {velocity}\nmax_acceleration = {acceleration}\n{keys}\n"
        f'[axis.drive]\nkind = "{drive}"\n{drive_keys}\n'
        for index in indices
    )
