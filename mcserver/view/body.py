"""A machine to be drawn: rigid parts, and where each of them is for the axes' positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from mcserver.view.solids import Array, Solid


@dataclass(frozen=True)
class Part:
    """Solids that move together, in a frame of their own [m]."""

    name: str
    solids: tuple[Solid, ...]


class Body(Protocol):
    """What can be drawn and moved."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """Its rigid parts."""

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the parts whose frames tell something: joints, not fixtures."""

    @property
    def missing_meshes(self) -> tuple[str, ...]:
        """Meshes that could not be had, as their file names them."""

    def poses(self, positions: Mapping[int, float]) -> dict[str, Array]:
        """The frame of each part, shape (4, 4); ``positions`` by axis number [m or rad]."""


class NoBody:
    """A `Body` of a machine of which nothing is known but its axes' values."""

    @property
    def parts(self) -> tuple[Part, ...]:
        """None."""
        return ()

    @property
    def frames(self) -> tuple[str, ...]:
        """None."""
        return ()

    @property
    def missing_meshes(self) -> tuple[str, ...]:
        """None."""
        return ()

    def poses(self, positions: Mapping[int, float]) -> dict[str, Array]:  # noqa: ARG002
        """None."""
        return {}
