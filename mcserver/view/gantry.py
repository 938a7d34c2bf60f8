"""A machine without a URDF: a portal whose axes 0, 1 and 2 are X, Y and Z."""

from __future__ import annotations

import numpy as np

from mcserver.view.solids import Array, Colour, Part, Solid, box, capsule, cylinder

FRAME: Colour = (122, 132, 145)
BRIDGE: Colour = (196, 201, 208)
CARRIAGE: Colour = (242, 140, 40)
SPINDLE: Colour = (52, 60, 72)

# of what the tip travels at most, where an axis hardly moves
LEAST_SHARE = 0.3
LEAST_SPACE = 1e-3


def gantry_space(points: Array) -> tuple[Array, Array]:
    """Return two corners (3,) of the space that points (N, 3) use, widened where it is flat [m]."""
    low, high = points.min(axis=0), points.max(axis=0)
    least = LEAST_SHARE * max(float((high - low).max()), LEAST_SPACE)
    wider = np.maximum(0.5 * (least - (high - low)), 0.0)
    return low - wider, high + wider


def gantry_parts(low: Array, high: Array) -> tuple[Part, ...]:
    """Return rails along Y, a bridge along X, a carriage, and a quill along Z whose tip is its origin.

    Args:
        low, high: shape (3,), the space that the tip uses [m].
    """
    size = max(float(np.max(high - low)), 1e-3)
    beam = 0.035 * size
    margin = 3.0 * beam
    top = float(high[2]) + 0.35 * size
    rails = []
    for x in (float(low[0]) - margin, float(high[0]) + margin):
        start, end = float(low[1]) - margin, float(high[1]) + margin
        rails.append(_beam((x, start, top), (x, end, top), beam, FRAME))
        rails += [_beam((x, y, float(low[2])), (x, y, top), 0.7 * beam, FRAME) for y in (start, end)]
    across = float(low[0]) - margin, float(high[0]) + margin
    bridge = _beam((across[0], 0.0, top + beam), (across[1], 0.0, top + beam), beam, BRIDGE)
    block = box(np.array([3.0, 2.6, 2.6]) * beam, CARRIAGE).moved(_at(0.0, 0.0, top + beam))
    length = top - float(low[2]) + 2.0 * beam
    quill = (
        cylinder(0.45 * beam, length, BRIDGE).moved(_at(0.0, 0.0, 0.5 * length + 2.0 * beam)),
        cylinder(0.75 * beam, 2.0 * beam, SPINDLE).moved(_at(0.0, 0.0, 2.0 * beam)),
        capsule(np.array([0.0, 0.0, beam]), np.array([0.0, 0.0, 0.0]), 0.12 * beam, SPINDLE),
    )
    return (
        Part("rails", tuple(rails)),
        Part("bridge", (bridge,)),
        Part("carriage", (block,)),
        Part("quill", quill),
    )


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
