"""Errors of an axis that depend on where others are: squareness, and a mesh over two of them.

Between the points of a mesh the error goes by quintic steps in both directions, so that its third derivative
is bounded, as that of a table of pitch errors is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import msgspec
import numpy as np
from msgspec import Meta

from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path
from mcserver.units import MM, AxisType

if TYPE_CHECKING:
    from mcserver.machine.machine_file import Axis

# The greatest slope, curvature and third derivative of the quintic step 6u⁵ - 15u⁴ + 10u³ on 0 … 1.
SLOPE, CURVATURE, THIRD = 1.875, 10.0 / math.sqrt(3.0), 60.0

_Numbers = Annotated[list[float], Meta(min_length=2, max_length=200, description="2 to 200 numbers")]


class Mesh(msgspec.Struct, frozen=True):
    """``mesh``: as written in mm, or in SI.

    Attributes:
        axes: the two that it lies over. first, second: where its points are on them, ascending.
        errors: how much further than programmed the load is there: of each point on the second axis a row
            over the first.
    """

    axes: Annotated[list[int], Meta(min_length=2, max_length=2, description="two axes, such as [0, 1]")]
    first: _Numbers
    second: _Numbers
    errors: list[list[float]]

    def scaled(self, factor: float) -> Mesh:
        """Return the mesh in another unit."""
        return Mesh(
            self.axes,
            [factor * each for each in self.first],
            [factor * each for each in self.second],
            [[factor * each for each in row] for row in self.errors],
        )

    @property
    def wrong(self) -> str:
        """What does not fit in it; empty: nothing."""
        if any(values != sorted(set(values)) for values in (self.first, self.second)):
            return "the positions do not ascend"
        if [len(row) for row in self.errors] != [len(self.first)] * len(self.second):
            return f"it needs {len(self.second)} rows of {len(self.first)} errors"
        return ""


class Motion(msgspec.Struct, frozen=True):
    """The greatest velocity, acceleration and jerk of an axis by programs [SI]; infinite: not limited."""

    velocity: float
    acceleration: float
    jerk: float


def square_need(slope: float, source: Motion) -> Motion:
    """Return what an error of ``slope`` [m/m] needs of its axis at the greatest motion of another one."""
    return Motion(*(abs(slope) * each for each in msgspec.structs.astuple(source)))


def mesh_need(mesh: Mesh, x: Motion, y: Motion) -> Motion:
    """Return what a mesh in SI needs of its axis at the greatest motion of the two that it lies over."""
    heights = np.array(mesh.errors)
    wide, deep = np.diff(mesh.first), np.diff(mesh.second)[:, None]
    along, across = np.abs(np.diff(heights, axis=1)), np.abs(np.diff(heights, axis=0))
    twist = np.abs(np.diff(np.diff(heights, axis=0), axis=1))

    def greatest(values: np.ndarray) -> float:
        return float(values.max())

    zx, zxx, zxxx = (greatest(c * along / wide**n) for n, c in ((1, SLOPE), (2, CURVATURE), (3, THIRD)))
    zy, zyy, zyyy = (greatest(c * across / deep**n) for n, c in ((1, SLOPE), (2, CURVATURE), (3, THIRD)))
    zxy = greatest(SLOPE * SLOPE * twist / (wide * deep))
    zxxy = greatest(CURVATURE * SLOPE * twist / (wide**2 * deep))
    zxyy = greatest(SLOPE * CURVATURE * twist / (wide * deep**2))
    vx, vy, ax, ay = x.velocity, y.velocity, x.acceleration, y.acceleration
    bends = zxxx * vx**3 + 3.0 * (zxxy * vx**2 * vy + zxyy * vx * vy**2) + zyyy * vy**3
    turns = 3.0 * (zxx * vx * ax + zxy * (vx * ay + vy * ax) + zyy * vy * ay)
    return Motion(
        zx * vx + zy * vy,
        zxx * vx**2 + 2.0 * zxy * vx * vy + zyy * vy**2 + zx * ax + zy * ay,
        bends + turns + (zx * x.jerk if zx else 0.0) + (zy * y.jerk if zy else 0.0),
    )


def check_coupled(axes: Mapping[Path, Axis], mistakes: Mistakes, least: float) -> dict[int, float]:
    """Return the shares that backlash and jumps of a correction have behind errors that other axes cause.

    Args:
        axes: by the paths of their sections. least: share that has to be left.

    Returns:
        By number of the axis; of those without such errors nothing.
    """
    numbers = {axis.index: axis for axis in axes.values()}
    left: dict[int, float] = {}
    for path, axis in axes.items():
        found = axis.compensation
        if found is None or not (found.square_errors or found.mesh):
            continue
        key = (*path, "compensation")
        sources = [each for each, _ in found.square_errors] + (found.mesh.axes if found.mesh else [])
        wrong = found.mesh.wrong if found.mesh else ""
        if wrong:
            mistakes.add((*key, "mesh"), wrong, "one position for each column and each row", "MC092")
            continue
        named = [numbers.get(each) for each in sources]
        linear = all(each is not None and each.type is AxisType.LINEAR for each in (axis, *named))
        if not linear or axis.index in sources or len(set(found.mesh.axes if found.mesh else ())) == 1:
            mistakes.add(
                key, "square_errors and mesh are of linear axes over others", "name these by number", "MC092"
            )
            continue
        motions = {
            each.index: Motion(each.max_velocity, each.max_acceleration, each.max_jerk)
            for each in named
            if each is not None
        }
        needs = [square_need(slope, motions[each]) for each, slope in found.square_errors]
        if found.mesh is not None:
            needs.append(mesh_need(found.mesh, *(motions[each] for each in found.mesh.axes)))
        kept = 1.0 - found.reserve
        shares = (
            math.fsum(need.velocity for need in needs) * kept / axis.max_velocity,
            math.fsum(need.acceleration for need in needs) * kept / axis.max_acceleration,
            # an axis without a limit of jerk takes any
            math.fsum(need.jerk for need in needs) * kept / axis.max_jerk
            if axis.max_jerk < math.inf
            else 0.0,
        )
        left[axis.index] = found.share - max(shares)
        if not left[axis.index] >= least:
            of = ", ".join(map(str, sorted(set(sources))))
            needed, kept_for_it = 100.0 * max(shares), 100.0 * (found.share - least)
            mistakes.add(
                key,
                f"at the limits of axes {of} square_errors and mesh take {needed:.1f} % of this one's",
                f"{kept_for_it:.3g} % are kept for them: raise reserve, give the other axes a max_jerk, "
                "or put the points of the mesh further apart",
                "MC092",
            )
    return left


def square_errors_in_si(rows: list[list[float]]) -> tuple[tuple[int, float], ...]:
    """Return axis numbers and slopes [m/m] of ``[axis, error for 1000 mm]``."""
    return tuple((int(axis), error * MM) for axis, error in rows)
