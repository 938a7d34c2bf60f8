"""Errors of axes as functions of where axes are: value and rate of change in a cycle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from mcserver.executor.entries import Array
from mcserver.machine.coupled_errors import Mesh


class ErrorTable(Protocol):
    """An error of one axis.

    Attributes:
        column: whose error it is. sources: columns that it depends on.
    """

    column: int
    sources: list[int]

    def at(self, position: Array, velocity: Array) -> tuple[float, float]:
        """Return the error and its rate of change at positions, shape (K,) [m or rad, per second]."""


class PitchErrors:
    """Of an axis's own positions; beyond the table's ends they stay what they are there."""

    def __init__(self, column: int, places: Array, errors: Array) -> None:
        self.column, self.sources = column, [column]
        self._places, self._errors = places, errors

    def at(self, position: Array, velocity: Array) -> tuple[float, float]:
        cell, share, slope = step(float(position[self.column]), self._places)
        here, there = float(self._errors[cell]), float(self._errors[cell + 1])
        return here + share * (there - here), slope * (there - here) * float(velocity[self.column])


class SquareErrors:
    """Of axes that stand not square to each other: slopes by column [m/m]."""

    def __init__(self, column: int, slopes: dict[int, float]) -> None:
        self.column, self.sources = column, list(slopes)
        self._slopes = np.array(list(slopes.values()))

    def at(self, position: Array, velocity: Array) -> tuple[float, float]:
        return float(position[self.sources] @ self._slopes), float(velocity[self.sources] @ self._slopes)


class MeshErrors:
    """Over two or three axes; beyond the mesh they stay what they are at its edge."""

    def __init__(self, column: int, sources: list[int], mesh: Mesh) -> None:
        self.column, self.sources = column, sources
        self._places = [np.array(each) for each in mesh.places]
        self._errors = mesh.heights

    def at(self, position: Array, velocity: Array) -> tuple[float, float]:
        cells, steps = [], []
        for source, places in zip(self.sources, self._places, strict=True):
            cell, share, slope = step(float(position[source]), places)
            cells.append(slice(cell, cell + 2))
            steps.append((share, slope * float(velocity[source])))
        return _between(self._errors[tuple(cells)].tolist(), steps)


def _between(corners: Any, steps: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return value and rate in a cell: nested pairs, one for each direction; of that its share and rate."""
    if not steps:
        return corners, 0.0
    (share, rate), rest = steps[0], steps[1:]
    low, low_rate = _between(corners[0], rest)
    high, high_rate = _between(corners[1], rest)
    return low + share * (high - low), low_rate + share * (high_rate - low_rate) + rate * (high - low)


def step(place: float, places: Array) -> tuple[int, float, float]:
    """Return the interval of a table that a place is in, the quintic share of it, and that one's slope."""
    cell = min(max(int(np.searchsorted(places, place, side="right")) - 1, 0), len(places) - 2)
    width = float(places[cell + 1] - places[cell])
    u = (place - float(places[cell])) / width
    if not 0.0 <= u <= 1.0:
        return cell, min(max(u, 0.0), 1.0), 0.0
    return cell, u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * u**2 * (1.0 - u) ** 2 / width
