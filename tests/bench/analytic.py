"""The least time for a curve that is known as a formula, under velocity, acceleration and jerk of each axis.

Speed squared b(s) on a fine grid, from rest to rest, by a sequence of linear programs (HiGHS): the jerk
√b·(q'''b + 3/2 q''b' + 1/2 q'b'') is held below its limit by a tangent that lies within it, so every result
keeps all limits at the grid, and each is quicker than the one before. Nothing of the planner's is used.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.optimize import linprog
from scipy.sparse import csr_array, diags_array, vstack

Array = NDArray[np.float64]

ROUNDS, TRUST = 14, 0.5
# Share of the path at either end on which the rise from rest is bounded in closed form.
RISE = 0.01
NODES = 700


def least_time(points: Array, speed: float | Array, acceleration: float, jerk: float) -> float:
    """Return the least time from rest to rest [s].

    Args:
        points: many of the curve, dense and exact, shape (n, K) [mm]. speed: along it [mm/s], or at each
            point, shape (n,). acceleration, jerk: of each axis [mm/s², mm/s³].
    """
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    curve = make_interp_spline(along, points, k=5)
    # closer together at both ends, where the speed rises from nothing
    share = np.linspace(0.0, 1.0, NODES)
    s = along[-1] * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    slopes = [curve.derivative(order)(s) for order in (1, 2, 3)]
    speeds: Array = np.interp(s, along, np.broadcast_to(speed, along.shape))
    first, second = _stencils(s)
    # slow enough to keep all: a fraction of the speed, from rest and to rest
    b = _start(s, slopes, first, second, float(speeds.min()), acceleration, jerk)
    for _ in range(ROUNDS):
        new = _round(s, slopes, first, second, b, speeds, acceleration, jerk)
        done = new is None or _time(s, new) > _time(s, b) * (1.0 - 1e-4)
        b = b if new is None else new
        if done:
            break
    return _time(s, b)


def _stencils(s: Array) -> tuple[csr_array, csr_array]:
    """Return b' and b'' at the inner nodes, as matrices (n - 2, n)."""
    before, after = np.diff(s)[:-1], np.diff(s)[1:]
    both = before + after
    low, high = -after / (before * both), before / (after * both)
    first = diags_array([low, -low - high, high], offsets=[0, 1, 2], shape=(len(s) - 2, len(s)))
    low, high = 2.0 / (before * both), 2.0 / (after * both)
    second = diags_array([low, -low - high, high], offsets=[0, 1, 2], shape=(len(s) - 2, len(s)))
    return csr_array(first), csr_array(second)


def _start(
    s: Array, slopes: list[Array], first: csr_array, second: csr_array, speed: float, most: float, jerk: float
) -> Array:
    """Return a profile within the limits: that of a smooth rise and fall in time, as slow as it takes."""
    share = np.linspace(0.0, 1.0, 4001)
    gone = share - np.sin(2.0 * math.pi * share) / (2.0 * math.pi)
    shape = (1.0 - np.cos(2.0 * math.pi * share)) ** 2
    unit: Array = np.asarray(CubicSpline(gone, shape)(s / s[-1])).clip(0.0)
    unit[0] = unit[-1] = 0.0
    scale = speed**2 / unit.max()
    for _ in range(200):
        b = unit * scale
        root = np.sqrt(b[1:-1])
        change, bend = first @ b, second @ b
        worst = 0.0
        for q1, q2, q3 in zip(*(each[1:-1].T for each in slopes), strict=True):
            worst = max(worst, float(np.abs(q1 * change / 2.0 + q2 * b[1:-1]).max()) / most)
            asked = root * (q3 * b[1:-1] + 1.5 * q2 * change + 0.5 * q1 * bend)
            worst = max(worst, float(np.abs(asked).max()) / jerk)
        if worst <= 1.0:
            break
        scale *= 0.8
    return unit * scale


def _rise(s: Array, slope: Array, jerk: float) -> Array:
    """Return the greatest b after a distance from rest, where the path is straight: v = J t²/2, s = J t³/6.

    A grid does not see the jerk of the very first step.
    """
    along = jerk / float(np.abs(slope[0]).max())
    rise: Array = 0.25 * along**2 * (6.0 * s / along) ** (4.0 / 3.0)
    return np.where(s <= RISE * s[-1], 1.2 * rise, math.inf)


def _round(
    s: Array,
    slopes: list[Array],
    first: csr_array,
    second: csr_array,
    b: Array,
    speed: Array,
    acceleration: float,
    jerk: float,
) -> Array | None:
    """Return the best profile about one that keeps the limits; None without one."""
    inner = b[1:-1]
    eye = csr_array(diags_array([np.ones(len(inner))], offsets=[1], shape=(len(inner), len(b))))
    rows, bounds = [], []
    allowed = jerk * inner**-0.5
    falls = diags_array(0.5 * jerk * inner**-1.5)
    for q1, q2, q3 in zip(*(each[1:-1].T for each in slopes), strict=True):
        taken = diags_array(0.5 * q1) @ first + diags_array(q2) @ eye
        asked = diags_array(q3) @ eye + diags_array(1.5 * q2) @ first + diags_array(0.5 * q1) @ second
        rows += [taken, -taken, asked + falls @ eye, falls @ eye - asked]
        bounds += [np.full(len(inner), acceleration)] * 2 + [allowed + falls @ inner] * 2
    scale = np.concatenate([np.full(len(inner), 1.0 / acceleration)] * 2 + [1.0 / allowed] * 2)
    scale = np.tile(scale, len(slopes[0].T))
    apart = 0.5 * (s[2:] - s[:-2])
    weights = np.zeros(len(b))
    weights[1:-1] = -0.5 * apart * inner**-1.5
    most = np.minimum(_rise(s, slopes[0], jerk), _rise(s[-1] - s[::-1], slopes[0][::-1], jerk)[::-1])
    limits = np.column_stack(
        (b * (1.0 - TRUST), np.minimum(np.minimum(b * (1.0 + 2.0 * TRUST), speed**2), most))
    )
    limits[:, 0] = np.minimum(limits[:, 0], limits[:, 1])
    unit = np.maximum(b, 1e-9 * b.max())
    found = linprog(
        weights * unit,
        A_ub=csr_array(diags_array(scale) @ vstack(rows) @ diags_array(unit)),
        b_ub=scale * np.concatenate(bounds),
        bounds=limits / unit[:, None],
        method="highs-ipm",
    )
    return None if found.x is None else np.asarray(found.x * unit)


def _time(s: Array, b: Array) -> float:
    """Return the time, with a constant acceleration between nodes [s]."""
    root = np.sqrt(np.maximum(b, 0.0))
    return float((2.0 * np.diff(s) / np.maximum(root[1:] + root[:-1], 1e-30)).sum())
