"""Axes of a machine as joints of ROS: names as in its URDF, in metres and radians."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mcclient.types import AxisKind, Info, ModelReply
from numpy.typing import NDArray

from mcserver.units import AxisType

Array = NDArray[np.float64]


class Joint(NamedTuple):
    """An axis.

    Attributes:
        si_per_unit: metres per mm, or radians per degree.
        low, high: of its travel, infinite where it is not limited [m or rad].
        max_velocity, in_position: as of the machine file [m or rad, per s].
    """

    name: str
    axis: int
    rotary: bool
    si_per_unit: float
    low: float
    high: float
    max_velocity: float
    in_position: float


def joints_of(info: Info, model: ModelReply) -> tuple[Joint, ...]:
    """Return a joint for each axis; one that the URDF does not have is ``axis_N``."""
    found = []
    for axis in info.axes:
        kind = AxisType.ROTARY if axis.type is AxisKind.ROTARY else AxisType.LINEAR
        unit = kind.si_per_unit
        found.append(
            Joint(
                name=model.joints.get(str(axis.index), f"axis_{axis.index}"),
                axis=axis.index,
                rotary=kind is AxisType.ROTARY,
                si_per_unit=unit,
                low=-np.inf if axis.min_position is None else unit * axis.min_position,
                high=np.inf if axis.max_position is None else unit * axis.max_position,
                max_velocity=unit * axis.max_velocity,
                in_position=unit * axis.in_position,
            )
        )
    return tuple(found)


def units_of(joints: Sequence[Joint]) -> Array:
    """Return metres or radians per unit of the wire, shape (n,)."""
    return np.array([joint.si_per_unit for joint in joints])
