"""The limits of axes in every cycle, by differences of setpoints at the cycle rate (D-36)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from mcserver.machine.coupled_errors import Limits
from mcserver.machine.machine_file import Machine

# what velocity, acceleration and jerk may be of their limits
SLACK = (1.001, 1.01, 1.05)
EXACTLY = (1.0 + 1e-6,) * 3


def limits_of(machine: Machine, *, whole: bool = False) -> list[list[float]]:
    """Velocity, acceleration and jerk of each axis; ``whole``: with what is kept from programs."""
    none = Limits(0.0, 0.0, 0.0)
    axes = [(axis, axis.reserved if whole and axis.reserved else none) for axis in machine.axes]
    return [
        [getattr(axis, f"max_{name}") + getattr(kept, name) for axis, kept in axes] for name in none._fields
    ]


def broken_limits(
    points: ArrayLike,
    limits: Sequence[ArrayLike | None],
    cycle_s: float = 1e-3,
    most: Sequence[float] = SLACK,
) -> list[str]:
    """Name the limits that setpoints from rest break, each with its share.

    Args:
        points: shape (n,) or (n, K).
        limits: of velocity, acceleration and jerk, for all columns or each one; None: no limit.
    """
    rows = np.asarray(points)
    rows, broken = np.concatenate((np.repeat(rows[:1], 3, axis=0), rows)), []
    for order, (name, limit) in enumerate(zip(("velocity", "acceleration", "jerk"), limits, strict=False), 1):
        if limit is not None:
            share = (np.abs(np.diff(rows, order, axis=0)) / cycle_s**order / limit).max()
            if not share <= most[order - 1]:
                broken.append(f"{name} {share:.6g} > {most[order - 1]:.6g}")
    return broken


def assert_keeps(
    points: ArrayLike,
    limits: Sequence[ArrayLike | None],
    cycle_s: float = 1e-3,
    most: Sequence[float] = SLACK,
) -> None:
    """Setpoints from rest keep velocity, acceleration and jerk."""
    broken = broken_limits(points, limits, cycle_s, most)
    assert not broken, broken
