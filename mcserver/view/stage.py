"""How a machine stands: which way is up, where the floor is, how large it is and from where it is seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mcserver.view.body import Part
from mcserver.view.solids import Array

DIRECTIONS: Mapping[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
# distance of the camera from the middle, in sizes of what is seen
DISTANCE = 0.9


@dataclass(frozen=True)
class Stage:
    """How a machine stands.

    Attributes:
        up: shape (3,). floor: its height along ``up`` [m].
        middle: shape (3,), size: of what is seen [m]. camera: shape (3,), where it is seen from.
    """

    up: Array
    floor: float
    middle: Array
    size: float
    camera: Array


def up_of(wanted: str, tips: Sequence[Array], hips: Sequence[Array]) -> Array:
    """Which way is up.

    Args:
        wanted: a key of `DIRECTIONS`, or ``auto``: a machine of several tools stands on them, one with
            a single tool has Z up.
        tips: points of the tools, shape (3,). hips: points where their chains begin.
    """
    if wanted != "auto":
        return np.array(DIRECTIONS[wanted])
    if len(tips) < 2:
        return np.array(DIRECTIONS["z"])
    upwards = np.mean(np.array(hips) - np.array(tips), axis=0)
    axis = int(np.argmax(np.abs(upwards)))
    up: Array = np.eye(3)[axis] * np.sign(upwards[axis])
    return up


def stage(parts: Sequence[Part], poses: Mapping[str, Array], points: Sequence[Array], up: Array) -> Stage:
    """The stage of a machine in one posture, with the points (n, 3) that its tools come to [m]."""
    seen = [*points]
    for part in parts:
        pose = poses[part.name]
        seen += [solid.vertices @ pose[:3, :3].T + pose[:3, 3] for solid in part.solids]
    cloud = np.concatenate(seen) if seen else np.zeros((1, 3))
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    middle, size = 0.5 * (low + high), max(float(np.linalg.norm(high - low)), 0.1)
    ahead = np.roll(np.abs(up), 1)
    aside = np.cross(up, ahead)
    direction = 0.55 * up + 1.0 * ahead + 0.75 * aside
    camera = middle + DISTANCE * size * direction / np.linalg.norm(direction)
    return Stage(up, float((cloud @ up).min()), middle, size, camera)
