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
    return parse_machine(
        written_machine(
            axes=axes,
            velocity=velocity,
            acceleration=acceleration,
            jerk=jerk,
            tolerance_mm=tolerance_mm,
            kind=kind,
        )
    )


def written_machine(
    *, axes: int, velocity: float, acceleration: float, jerk: float | None, tolerance_mm: float, kind: str
) -> str:
    """The machine file of such a machine."""
    keys = "" if jerk is None else f"max_jerk = {jerk}"
    sections = axes_text(range(axes), velocity=velocity, acceleration=acceleration, keys=keys, drive=kind)
    return f'[machine]\nname = "bench"\n[motion]\npath_tolerance_mm = {tolerance_mm}\n{sections}'
