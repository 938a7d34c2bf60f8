"""Where a program's X, Y and Z point along the machine's axes: a rotation matrix (D-110, D-111)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

Vector = tuple[float, float, float]
# rows: the axes X, Y, Z; columns: where the program's X, Y and Z point
Directions = tuple[Vector, Vector, Vector]
UNTURNED: Directions = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
# what rounding leaves of a right angle
_NOTHING = 1e-13


def about_z(angle: float) -> Directions:
    """Return directions turned counter-clockwise about Z [rad], exact at quarter turns."""
    cosine, sine = cosine_and_sine(math.degrees(angle))
    return (cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)


def by_euler_angles(first: float, second: float, third: float) -> Directions:
    """Return directions turned about Z, about the X that results, and about the Z that results [deg]."""
    cosine, sine = cosine_and_sine(second)
    about_x = (1.0, 0.0, 0.0), (0.0, cosine, -sine), (0.0, sine, cosine)
    turned = (about_z(math.radians(each)) for each in (first, third))
    return product(product(next(turned), about_x), next(turned)) or UNTURNED


def product(outer: Directions | None, inner: Directions | None) -> Directions | None:
    """Return directions within others, along the axes that the outer ones are along."""
    if outer is None or inner is None:
        return inner if outer is None else outer
    a, b, c = zip(*inner, strict=True)
    x, y, z = ((_cosine(row, a), _cosine(row, b), _cosine(row, c)) for row in outer)
    return x, y, z


def _cosine(first: Iterable[float], second: Iterable[float]) -> float:
    """Return that of the angle between unit vectors, without what rounding leaves of a right one."""
    cosine = math.fsum(a * b for a, b in zip(first, second, strict=True))
    nearest = float(round(cosine))
    return nearest if abs(cosine - nearest) < _NOTHING else cosine


def along(directions: Directions | None, place: Mapping[int, float]) -> dict[int, float]:
    """Return a vector of the program along the axes; other axes stay, components left out are 0."""
    return _turned(directions, place, transposed=False)


def back(directions: Directions | None, place: Mapping[int, float]) -> dict[int, float]:
    """Return a vector along the axes in the program's directions; as `along`."""
    return _turned(directions, place, transposed=True)


def coupled(directions: Directions | None, axes: frozenset[int]) -> frozenset[int]:
    """Return the axes that go along with these ones, themselves among them."""
    if directions is None:
        return axes
    found = set(axes)
    for _ in range(2):
        for row, values in enumerate(directions):
            for column, value in enumerate(values):
                if value and row != column and found & {row, column}:
                    found |= {row, column}
    return frozenset(found)


def _turned(
    directions: Directions | None, place: Mapping[int, float], *, transposed: bool
) -> dict[int, float]:
    found = dict(place)
    if directions is None:
        return found
    rows = tuple(zip(*directions, strict=True)) if transposed else directions
    named = frozenset(axis for axis in place if 0 <= axis <= 2)
    for axis in coupled(directions, named) if named else ():
        if 0 <= axis <= 2:
            found[axis] = math.fsum(
                factor * place.get(column, 0.0) for column, factor in enumerate(rows[axis]) if factor
            )
    return found


def cosine_and_sine(degrees: float) -> tuple[float, float]:
    """Return both of an angle, exact at multiples of 90 degrees."""
    quarters = degrees / 90.0
    if abs(quarters - round(quarters)) < _NOTHING:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    angle = math.radians(degrees)
    return math.cos(angle), math.sin(angle)
