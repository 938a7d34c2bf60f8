"""Directions of a program's X, Y and Z along the machine's axes, as a rotation matrix (D-110, D-111)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

Vector = tuple[float, float, float]
# rows: the axes X, Y, Z; columns: directions of the program's X, Y and Z
Directions = tuple[Vector, Vector, Vector]
UNTURNED: Directions = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
# rounding error of the cosine of a right angle
_NOTHING = 1e-13
# deviation from a right angle at which two vectors do not define a plane (Fanuc) [deg]
OFF_SQUARE = 5.0
# sine of the angle at the first of three points below which they define no plane
_ON_ONE_LINE = 1e-4


def about(axis: int, degrees: float) -> Directions:
    """Return directions turned counter-clockwise about X, Y or Z [deg], exact at quarter turns."""
    cosine, sine = cosine_and_sine(degrees)
    rows = [[float(row == column) for column in range(3)] for row in range(3)]
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rows[first][first] = rows[second][second] = cosine
    rows[first][second], rows[second][first] = -sine, sine
    x, y, z = ((row[0], row[1], row[2]) for row in rows)
    return x, y, z


def by_euler_angles(first: float, second: float, third: float) -> Directions:
    """Return directions turned about Z, about the X that results, and about the Z that results [deg]."""
    return product(product(about(2, first), about(0, second)), about(2, third)) or UNTURNED


def by_roll_pitch_yaw(angles: Vector, order: Sequence[int]) -> Directions:
    """Return directions turned about the fixed axes X, Y and Z [deg] in a given order."""
    found = UNTURNED
    for axis in order:
        found = product(about(axis, angles[axis]), found) or UNTURNED
    return found


def by_three_points(first: Vector, second: Vector, third: Vector) -> Directions | None:
    """Return directions with X from the first point to the second, and positive Y at the third.

    Returns:
        None: they lie on one line.
    """
    x, other = (_unit(_less(each, first)) for each in (second, third))
    normal = None if x is None or other is None else _cross(x, other)
    if x is None or normal is None or math.hypot(*normal) < _ON_ONE_LINE:
        return None
    return _by_x_and_z(x, normal)


def by_two_vectors(x: Vector, z: Vector) -> Directions | None:
    """Return directions with X along one vector, and Z as close to the other one as possible (Fanuc).

    Returns:
        None: one of them is 0, or they deviate from a right angle by `OFF_SQUARE` or more.
    """
    first, second = _unit(x), _unit(z)
    if first is None or second is None:
        return None
    askew = abs(math.fsum(a * b for a, b in zip(first, second, strict=True)))
    return None if askew >= math.sin(math.radians(OFF_SQUARE)) else _by_x_and_z(first, second)


def _by_x_and_z(x: Vector, near_z: Vector) -> Directions:
    """Return directions with this X, and Z in the plane of X and a vector not parallel to it."""
    y = _unit(_cross(near_z, x))
    assert y is not None
    rows = tuple(zip(x, y, _cross(x, y), strict=True))
    return product(UNTURNED, (rows[0], rows[1], rows[2])) or UNTURNED


def _less(end: Vector, start: Vector) -> Vector:
    return end[0] - start[0], end[1] - start[1], end[2] - start[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _unit(vector: Vector) -> Vector | None:
    """Return the unit vector; None for a vector of length 0."""
    length = math.hypot(*vector)
    return None if length == 0.0 else (vector[0] / length, vector[1] / length, vector[2] / length)


def product(outer: Directions | None, inner: Directions | None) -> Directions | None:
    """Return directions given within others, as directions along the axes of the outer ones."""
    if outer is None or inner is None:
        return inner if outer is None else outer
    a, b, c = zip(*inner, strict=True)
    x, y, z = ((_cosine(row, a), _cosine(row, b), _cosine(row, c)) for row in outer)
    return x, y, z


def _cosine(first: Iterable[float], second: Iterable[float]) -> float:
    """Return the cosine of the angle between unit vectors, exactly 0 at a right angle."""
    cosine = math.fsum(a * b for a, b in zip(first, second, strict=True))
    nearest = float(round(cosine))
    return nearest if abs(cosine - nearest) < _NOTHING else cosine


def along(directions: Directions | None, place: Mapping[int, float]) -> dict[int, float]:
    """Convert a program's vector to the axes; missing components are 0, other axes are kept."""
    return _turned(directions, place, transposed=False)


def back(directions: Directions | None, place: Mapping[int, float]) -> dict[int, float]:
    """Convert a vector along the axes to the program's directions; as `along`."""
    return _turned(directions, place, transposed=True)


def coupled(directions: Directions | None, axes: frozenset[int]) -> frozenset[int]:
    """Return the axes that move together with these, including these."""
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
    """Return cosine and sine of an angle, exact at multiples of 90 degrees."""
    quarters = degrees / 90.0
    if abs(quarters - round(quarters)) < _NOTHING:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    angle = math.radians(degrees)
    return math.cos(angle), math.sin(angle)
