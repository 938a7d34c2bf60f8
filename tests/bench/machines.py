"""Machines of the comparisons: ideal drives, so that only the motion's own time counts."""

from __future__ import annotations

from mcserver.machine.machine_file import Machine, parse_machine
from tests.machine_text import axes_text


def ideal(
    *,
    axes: int = 3,
    velocity: float = 200.0,
    acceleration: float = 1000.0,
    jerk: float | None = 50_000.0,
    tolerance_mm: float = 0.0,
    kind: str = "ideal",
) -> Machine:
    """A machine of alike linear axes [mm, s]."""
    keys = "" if jerk is None else f"max_jerk = {jerk}"
    sections = axes_text(range(axes), velocity=velocity, acceleration=acceleration, keys=keys, drive=kind)
    text = f'[machine]\nname = "bench"\n[motion]\npath_tolerance_mm = {tolerance_mm}\n{sections}'
    return parse_machine(text)
