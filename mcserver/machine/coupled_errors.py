"""Errors of an axis that depend on where others are: squareness, a mesh over two of them, a grid over three.

Between the points of a mesh the error goes by quintic steps in each direction, so that its third derivative
is bounded, as that of a table of pitch errors is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta

from mcserver.machine.constraints import LEAST_STEP, ascending
from mcserver.machine.mesh_probe import MeshProbe
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path
from mcserver.units import MM, AxisType

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis

# The greatest slope, curvature and third derivative of the quintic step 6u⁵ - 15u⁴ + 10u³ on 0 … 1.
SLOPE, CURVATURE, THIRD = 1.875, 10.0 / math.sqrt(3.0), 60.0

# More is no mechanics but a mistake of units [mm, deg].
Error = Annotated[float, Meta(ge=-10.0, le=10.0)]
_Numbers = Annotated[list[float], Meta(min_length=2, max_length=200, description="2 to 200 numbers")]


class Mesh(msgspec.Struct, frozen=True):
    """``mesh``: as written in mm, or in SI.

    Attributes:
        axes: the two or three that it lies over. first, second, third: where its points are on them,
            ascending; ``third`` is empty over two.
        errors: how much further than programmed the load is there: of each point on the second axis a row
            over the first, and all these again for each point on the third; none where it is probed: all 0.
        probe: how programs of a printer probe it.
    """

    axes: Annotated[
        list[int], Meta(min_length=2, max_length=3, description="two or three axes, such as [0, 1]")
    ]
    first: _Numbers
    second: _Numbers
    errors: Annotated[list[list[Error]], Meta(description="rows of errors, of 10 mm at most")] = []
    third: Annotated[list[float], Meta(max_length=200, description="2 to 200 numbers")] = []
    probe: MeshProbe | None = None

    def scaled(self, factor: float) -> Mesh:
        """Return the mesh in another unit."""
        first, second, third = (
            [factor * each for each in along] for along in (self.first, self.second, self.third)
        )
        errors = [[factor * each for each in row] for row in self.errors]
        probe = None if self.probe is None else self.probe.scaled(factor)
        return Mesh(self.axes, first, second, errors, third, probe)

    @property
    def places(self) -> list[list[float]]:
        """Where the points are, by axis."""
        return [self.first, self.second, self.third][: len(self.axes)]

    @property
    def heights(self) -> np.ndarray:
        """The errors by their points on the first axis, the second, and the third."""
        counts = [len(each) for each in reversed(self.places)]
        return (np.array(self.errors) if self.errors else np.zeros(counts)).reshape(counts).T

    @property
    def wrong(self) -> str:
        """What does not fit in it, as it is written in mm; empty: nothing."""
        if len(self.third) == 1 or bool(self.third) is not (len(self.axes) == 3):
            return "third is for a mesh over three axes, and has two points or more"
        if not all(map(ascending, self.places)):
            return f"the positions do not ascend by {LEAST_STEP} or more"
        rows = len(self.second) * max(1, len(self.third))
        if self.probe is not None and not self.errors:
            return ""
        if [len(row) for row in self.errors] != [len(self.first)] * rows:
            return f"it needs {rows} rows of {len(self.first)} errors"
        return ""


class Limits(NamedTuple):
    """Velocity, acceleration and jerk of an axis [SI]; infinite where not limited."""

    velocity: float
    acceleration: float
    jerk: float

    def scaled(self, share: float) -> Limits:
        """Return a share of each."""
        return Limits(*(share * each for each in self))


def _mesh_need(mesh: Mesh, limits: Sequence[Limits]) -> Limits:
    """Return what a mesh in SI needs of its axis at the limits of those that it lies over.

    By the chain rule: the error is linear in the quintic step of each direction, so its derivatives by time
    are sums of those of one step, of products of two, and of three.
    """
    heights = mesh.heights
    # of each direction the greatest first, second and third derivative of the step by time, by its cells
    steps = []
    for along, (places, (v, a, j)) in enumerate(zip(mesh.places, limits, strict=True)):
        width = np.diff(places).reshape([-1 if each == along else 1 for each in range(heights.ndim)])
        curvature = CURVATURE / width**2
        steps.append(
            (
                SLOPE * v / width,
                curvature * v**2 + SLOPE * a / width,
                THIRD * v**3 / width**3 + 3.0 * curvature * v * a + SLOPE * j / width,
            )
        )

    def greatest(directions: tuple[int, ...], *factors: np.ndarray) -> float:
        """Return the greatest difference in these directions, times factors."""
        product = heights
        for along in directions:
            product = np.diff(product, axis=along)
        # what is flat needs nothing, also over an axis without a limit
        return float(np.abs(math.prod(factors, start=product)).max()) if product.any() else 0.0

    velocity = acceleration = jerk = 0.0
    for i, (first, second, third) in enumerate(steps):
        velocity += greatest((i,), first)
        acceleration += greatest((i,), second)
        jerk += greatest((i,), third)
        for k, (other, _, _) in enumerate(steps):
            if k != i:
                acceleration += greatest((i, k), first, other)
                jerk += 3.0 * greatest((i, k), second, other)
    if heights.ndim == 3:
        jerk += 6.0 * greatest((0, 1, 2), *(first for first, _, _ in steps))
    return Limits(velocity, acceleration, jerk)


def share_needed(axis: Axis, others: Iterable[Axis], mesh: Mesh | None) -> float:
    """Return which share of its limits in the file an axis needs for its square errors and a mesh in SI.

    Args:
        others: the axes that these lie over, at the least.
    """
    found = axis.compensation
    assert found is not None
    limits = {each.index: each.limits for each in others}
    needs = [limits[each].scaled(abs(slope)) for each, slope in found.square_errors]
    if mesh is not None:
        needs.append(_mesh_need(mesh, [limits[each] for each in mesh.axes]))
    kept = 1.0 - found.reserve
    return max(
        math.fsum(need.velocity for need in needs) * kept / axis.max_velocity,
        math.fsum(need.acceleration for need in needs) * kept / axis.max_acceleration,
        # an axis without a limit of jerk takes any
        math.fsum(need.jerk for need in needs) * kept / axis.max_jerk if axis.max_jerk < math.inf else 0.0,
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
        named = [numbers.get(each) for each in sources]
        linear = all(each is not None and each.type is AxisType.LINEAR for each in (axis, *named))
        over = [] if found.mesh is None else found.mesh.axes
        square = {each for each, _ in found.square_errors}
        # over three axes one may be its own: the errors of its pitch are then others at each place
        own = axis.index in square or (len(over) < 3 and axis.index in over)
        if not linear or own or len(set(over)) < len(over):
            mistakes.add(
                key, "square_errors and mesh are of linear axes over others", "name these by number", "MC092"
            )
            continue
        needed = share_needed(axis, filter(None, named), found.mesh)
        left[axis.index] = found.share - needed
        if not left[axis.index] >= least:
            of = ", ".join(map(str, sorted(set(sources))))
            taken, kept_for_it = 100.0 * needed, 100.0 * (found.share - least)
            mistakes.add(
                key,
                f"at the limits of axes {of} square_errors and mesh take {taken:.1f} % of this one's",
                f"{kept_for_it:.3g} % are kept for them: raise reserve, give the other axes a max_jerk, "
                "or put the points of the mesh further apart",
                "MC092",
            )
    return left


def square_errors_in_si(rows: list[tuple[int, float]]) -> tuple[tuple[int, float], ...]:
    """Return axis numbers and slopes [m/m] of ``[axis, error for 1000 mm]``."""
    return tuple((axis, error * MM) for axis, error in rows)
