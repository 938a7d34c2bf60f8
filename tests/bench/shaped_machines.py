"""Machines of the laws of motion with random shapers, and what shaped setpoints have to keep besides."""

from __future__ import annotations

from typing import get_args

import msgspec
import numpy as np

from mcserver.machine.machine_file import Machine
from mcserver.machine.shaper_section import ACCELERATION_SLACK, Shaper, ShaperType, Shaping
from tests.executor.rig import Rig

# What rounding may add [m or rad].
EXACT = 1e-9


def shaped(machine: Machine, seed: int) -> Machine:
    """Return the same with random shapers, at least one, some of them by tools 1 and 2."""
    rng = np.random.default_rng((seed, 7))

    def drawn() -> Shaper:
        kind = str(rng.choice(get_args(ShaperType)))
        return Shaper(kind, float(rng.uniform(8.0, 150.0)), float(rng.uniform(0.0, 0.3)))

    axes = []
    for number, axis in enumerate(machine.axes):
        kept = drawn() if not number or rng.random() < 0.6 else None
        by_tool = {tool: drawn() for tool in (1, 2) if rng.random() < 0.4}
        axes.append(msgspec.structs.replace(axis, shaper=kept, tool_shapers=by_tool))
    shaping = Shaping.of(axes, machine.cycle_s)
    assert shaping is not None
    # corners as on the machine without: their limits are judged, and the deviation by itself
    shaping = msgspec.structs.replace(shaping, path_deviation=0.0)
    return msgspec.structs.replace(machine, axes=tuple(axes), shaping=shaping)


def broken_by_shapers(rig: Rig) -> list[str]:
    """Name what shaped setpoints break: the bound of their distance from the delayed path, and its end."""
    shaping = rig.machine.shaping
    if shaping is None:
        return []
    ordered, points, delay = rig.ordered, rig.setpoint, shaping.delay
    most = np.array([axis.max_acceleration for axis in rig.machine.axes]) * rig.machine.cycle_s**2
    # of vertices and changes of rates, as the path itself has them
    most = np.maximum(np.abs(np.diff(ordered, 2, axis=0)).max(axis=0) / most / ACCELERATION_SLACK, 1.0)
    beside = np.abs(points[delay:] - ordered[: len(ordered) - delay]).max(axis=0)
    broken = []
    if not (beside <= np.array(shaping.deviations) * most + EXACT).all():
        broken.append(f"beside the delayed path by {beside} > {shaping.deviations}")
    low, high = ordered.min(axis=0) - EXACT, ordered.max(axis=0) + EXACT
    if not ((points >= low) & (points <= high)).all():
        broken.append("shaped beyond what was ordered")
    if not np.array_equal(ordered[-1], points[-1]):
        broken.append("at rest before the shaped end")
    return broken
