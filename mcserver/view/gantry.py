"""A machine without a URDF: a portal whose axes 0, 1 and 2 are X, Y and Z."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mcserver.view.body import Part
from mcserver.view.solids import Array, Colour, Solid, box, capsule, cylinder

FRAME: Colour = (122, 132, 145)
BRIDGE: Colour = (196, 201, 208)
CARRIAGE: Colour = (242, 140, 40)
SPINDLE: Colour = (52, 60, 72)


class Gantry:
    """A `Body`: rails along Y, a bridge along X, a quill along Z whose tip is the programmed point.

    Args:
        axes: which of the axes 0, 1, 2 there are; those missing stay at 0.
        low, high: shape (3,), the space that the tip uses [m].
    """

    def __init__(self, axes: tuple[int, ...], low: Array, high: Array) -> None:
        self._axes = axes
        size = max(float(np.max(high - low)), 1e-3)
        beam = 0.035 * size
        margin = 3.0 * beam
        top = float(high[2]) + 0.35 * size
        self._beam = beam
        rails = []
        for x in (float(low[0]) - margin, float(high[0]) + margin):
            start, end = float(low[1]) - margin, float(high[1]) + margin
            rails.append(_beam((x, start, top), (x, end, top), beam, FRAME))
            rails += [_beam((x, y, float(low[2])), (x, y, top), 0.7 * beam, FRAME) for y in (start, end)]
        across = float(low[0]) - margin, float(high[0]) + margin
        bridge = _beam((across[0], 0.0, top + beam), (across[1], 0.0, top + beam), beam, BRIDGE)
        block = box(np.array([3.0, 2.6, 2.6]) * beam, CARRIAGE).moved(_at(0.0, 0.0, top + beam))
        length = top - float(low[2]) + 2.0 * beam
        quill = [
            cylinder(0.45 * beam, length, BRIDGE).moved(_at(0.0, 0.0, 0.5 * length + 2.0 * beam)),
            cylinder(0.75 * beam, 2.0 * beam, SPINDLE).moved(_at(0.0, 0.0, 2.0 * beam)),
            capsule(np.array([0.0, 0.0, beam]), np.array([0.0, 0.0, 0.0]), 0.12 * beam, SPINDLE),
        ]
        self._parts = (
            Part("rails", tuple(rails)),
            Part("bridge", (bridge,)),
            Part("carriage", (block,)),
            Part("quill", tuple(quill)),
        )

    @property
    def parts(self) -> tuple[Part, ...]:
        """Rails, bridge, carriage and quill."""
        return self._parts

    @property
    def frames(self) -> tuple[str, ...]:
        """The quill, whose frame is the programmed point."""
        return ("quill",)

    @property
    def missing_meshes(self) -> tuple[str, ...]:
        """None."""
        return ()

    def poses(self, positions: Mapping[int, float]) -> dict[str, Array]:
        """Each part's frame, shape (4, 4)."""
        x, y, z = (positions.get(axis, 0.0) if axis in self._axes else 0.0 for axis in range(3))
        return {
            "rails": np.eye(4),
            "bridge": _at(0.0, y, 0.0),
            "carriage": _at(x, y, 0.0),
            "quill": _at(x, y, z),
        }


def _beam(
    start: tuple[float, float, float], end: tuple[float, float, float], width: float, colour: Colour
) -> Solid:
    a, b = np.array(start), np.array(end)
    size = np.abs(b - a) + width
    middle = 0.5 * (a + b)
    return box(size, colour).moved(_at(*(float(value) for value in middle)))


def _at(x: float, y: float, z: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose
