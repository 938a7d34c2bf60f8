"""One joint position at a time, in plain numbers.

Following a path takes one position after the other, and numpy's calls cost ten times their arithmetic there.
Everything that can be evaluated together is done by `mckinematics.chain`; the tests hold the two against each
other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from mckinematics.pose import Array

Floats = Sequence[float]

# what is left of a pivot after elimination is below this where a matrix is singular [m, rad]
SMALLEST_PIVOT = 1e-14


class Linearised(NamedTuple):
    """A chain at one joint position.

    Attributes:
        position: 3 numbers [m]. rotation: 9 numbers, row by row.
        columns: for each joint the velocity of the tool's point and its angular velocity, 6 numbers.
    """

    position: tuple[float, float, float]
    rotation: tuple[float, ...]
    columns: list[tuple[float, ...]]


class SingleChain:
    """A chain for single positions, read-only.

    Args:
        steps: shape (K + 1, 4, 4), as in `mckinematics.chain.Chain`. turning: of K joints.
    """

    def __init__(self, steps: Array, turning: Sequence[bool]) -> None:
        self._first = _by_columns(steps[0])
        self._joints = tuple(zip(turning, [_by_columns(step) for step in steps[1:]], strict=True))

    def linearise(self, joints: Floats) -> Linearised:
        """Return where the tool is, and how it moves with each joint; ``joints`` (K,) [rad or m]."""
        x0, x1, x2, y0, y1, y2, z0, z1, z2, p0, p1, p2 = self._first
        frames = []
        for (turning, step), joint in zip(self._joints, joints, strict=True):
            frames.append((turning, z0, z1, z2, p0, p1, p2))
            if turning:
                cos, sin = math.cos(joint), math.sin(joint)
                x0, y0 = cos * x0 + sin * y0, cos * y0 - sin * x0
                x1, y1 = cos * x1 + sin * y1, cos * y1 - sin * x1
                x2, y2 = cos * x2 + sin * y2, cos * y2 - sin * x2
            else:
                p0, p1, p2 = p0 + joint * z0, p1 + joint * z1, p2 + joint * z2
            a0, a1, a2, b0, b1, b2, c0, c1, c2, d0, d1, d2 = step
            p0, p1, p2 = (
                p0 + x0 * d0 + y0 * d1 + z0 * d2,
                p1 + x1 * d0 + y1 * d1 + z1 * d2,
                p2 + x2 * d0 + y2 * d1 + z2 * d2,
            )
            x0, y0, z0 = (
                x0 * a0 + y0 * a1 + z0 * a2,
                x0 * b0 + y0 * b1 + z0 * b2,
                x0 * c0 + y0 * c1 + z0 * c2,
            )
            x1, y1, z1 = (
                x1 * a0 + y1 * a1 + z1 * a2,
                x1 * b0 + y1 * b1 + z1 * b2,
                x1 * c0 + y1 * c1 + z1 * c2,
            )
            x2, y2, z2 = (
                x2 * a0 + y2 * a1 + z2 * a2,
                x2 * b0 + y2 * b1 + z2 * b2,
                x2 * c0 + y2 * c1 + z2 * c2,
            )
        columns: list[tuple[float, ...]] = []
        for turning, k0, k1, k2, o0, o1, o2 in frames:
            if turning:
                r0, r1, r2 = p0 - o0, p1 - o1, p2 - o2
                columns.append((k1 * r2 - k2 * r1, k2 * r0 - k0 * r2, k0 * r1 - k1 * r0, k0, k1, k2))
            else:
                columns.append((k0, k1, k2, 0.0, 0.0, 0.0))
        return Linearised((p0, p1, p2), (x0, y0, z0, x1, y1, z1, x2, y2, z2), columns)


def small_turn(target: Floats, rotation: Floats) -> tuple[float, float, float] | None:
    """Axis times angle of the turn from ``rotation`` to ``target``, 9 numbers each [rad]; None beyond 90°."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    t00, t01, t02, t10, t11, t12, t20, t21, t22 = target
    s0 = 0.5 * ((t20 * r10 + t21 * r11 + t22 * r12) - (t10 * r20 + t11 * r21 + t12 * r22))
    s1 = 0.5 * ((t00 * r20 + t01 * r21 + t02 * r22) - (t20 * r00 + t21 * r01 + t22 * r02))
    s2 = 0.5 * ((t10 * r00 + t11 * r01 + t12 * r02) - (t00 * r10 + t01 * r11 + t02 * r12))
    trace = t00 * r00 + t01 * r01 + t02 * r02 + t10 * r10 + t11 * r11 + t12 * r12
    trace += t20 * r20 + t21 * r21 + t22 * r22
    if trace < 1.0:
        return None
    sine = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
    angle = math.atan2(sine, 0.5 * (trace - 1.0))
    scale = 1.0 + angle * angle / 6.0 if sine < 1e-4 else angle / sine
    return scale * s0, scale * s1, scale * s2


def solve_two(
    columns: Sequence[Floats], first: Floats, second: Floats
) -> tuple[list[float], list[float]] | None:
    """x and y of A·x = first and A·y = second; None where A is singular.

    Gauss's elimination with partial pivoting.

    Args:
        columns: N of A, of which the first N numbers count. first, second: N numbers.
    """
    size = len(columns)
    rows = [[*[column[row] for column in columns], first[row], second[row]] for row in range(size)]
    for place in range(size):
        best = place
        for row in range(place + 1, size):
            if abs(rows[row][place]) > abs(rows[best][place]):
                best = row
        pivot = rows[best]
        rows[best] = rows[place]
        rows[place] = pivot
        head = pivot[place]
        if not abs(head) > SMALLEST_PIVOT:
            return None
        for row in range(place + 1, size):
            now = rows[row]
            share = now[place] / head
            if share != 0.0:
                for column in range(place + 1, size + 2):
                    now[column] -= share * pivot[column]
    x, y = [0.0] * size, [0.0] * size
    for place in range(size - 1, -1, -1):
        row_here = rows[place]
        a, b = row_here[size], row_here[size + 1]
        for column in range(place + 1, size):
            a -= row_here[column] * x[column]
            b -= row_here[column] * y[column]
        x[place], y[place] = a / row_here[place], b / row_here[place]
    return x, y


def _by_columns(step: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in step[:3].T.ravel())
