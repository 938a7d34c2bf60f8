"""Bodies as triangles: boxes, cylinders, balls and capsules. Lengths in m."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Faces = NDArray[np.int64]
Colour = tuple[int, int, int]

AROUND = 32
ALONG = 12


@dataclass(frozen=True)
class Solid:
    """A triangle mesh of one colour.

    Attributes:
        vertices: shape (V, 3) [m]. faces: shape (F, 3), rows of ``vertices``, anticlockwise from outside.
            Vertices at sharp edges are there once for each side, so that shading breaks there.
        colour: red, green, blue, 0 … 255.
    """

    vertices: Array
    faces: Faces
    colour: Colour

    def moved(self, pose: Array) -> Solid:
        """Return the same body elsewhere; ``pose`` of shape (4, 4)."""
        return replace(self, vertices=self.vertices @ pose[:3, :3].T + pose[:3, 3])


@dataclass(frozen=True)
class Part:
    """Solids that move together, in a frame of their own [m]."""

    name: str
    solids: tuple[Solid, ...]


def box(size: Array, colour: Colour) -> Solid:
    """Return a box about the origin; ``size`` (3,) is its whole extent."""
    vertices: list[Array] = []
    faces: list[tuple[int, int, int]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = np.zeros(3)
            normal[axis] = sign
            across = np.roll(np.abs(normal), 1)
            other = np.cross(normal, across)
            first = 4 * len(faces) // 2
            corners = [normal + a * across + b * other for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            vertices += [0.5 * corner * size for corner in corners]
            faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return Solid(np.array(vertices), np.array(faces), colour)


def cylinder(radius: float, length: float, colour: Colour) -> Solid:
    """Return a cylinder about Z, its middle in the origin."""
    half = 0.5 * length
    profile = [[0.0, -half], [radius, -half], [radius, -half], [radius, half], [radius, half], [0.0, half]]
    return _revolved(np.array(profile), colour, gaps=(1, 3))


def ball(radius: float, colour: Colour) -> Solid:
    """Return a ball about the origin."""
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ALONG + 1)
    return _revolved(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), colour)


def capsule(start: Array, end: Array, radius: float, colour: Colour) -> Solid:
    """Return a rod with round ends from point to point, shape (3,) each."""
    length = float(np.linalg.norm(end - start))
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ALONG + 2)
    profile = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile[len(angle) // 2 :, 1] += length
    pose = np.eye(4)
    pose[:3, 3] = start
    if length > 0.0:
        pose[:3, :3] = _frame_along((end - start) / length)
    return _revolved(profile, colour).moved(pose)


def _revolved(profile: Array, colour: Colour, gaps: tuple[int, ...] = ()) -> Solid:
    """Return a body of revolution about Z; ``profile`` (P, 2) is radius and height from below to above.

    ``gaps``: rows after which the next one is the same place again, for a sharp edge.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = np.empty((len(profile), AROUND, 3))
    rings[..., :2] = profile[:, :1, None] * circle
    rings[..., 2] = profile[:, 1:]
    here = np.arange(AROUND)
    after = (here + 1) % AROUND
    faces = []
    for row in range(len(profile) - 1):
        if row in gaps:
            continue
        low, high = row * AROUND, (row + 1) * AROUND
        if profile[row, 0] > 0.0:
            faces.append(np.stack([low + here, low + after, high + after], axis=1))
        if profile[row + 1, 0] > 0.0:
            faces.append(np.stack([low + here, high + after, high + here], axis=1))
    return Solid(rings.reshape(-1, 3), np.concatenate(faces), colour)


def _frame_along(direction: Array) -> Array:
    across = np.cross(np.eye(3)[int(np.argmin(np.abs(direction)))], direction)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(direction, across), direction], axis=1)
