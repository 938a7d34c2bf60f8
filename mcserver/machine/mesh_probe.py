"""``probe`` of a mesh: how G29 of a printer probes its points (D-144)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import msgspec
from msgspec import Meta

from mcserver.machine.constraints import Positive
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.dialect_section import Dialect


class MeshProbe(msgspec.Struct, frozen=True):
    """As written in mm, or in SI.

    Attributes:
        speed: towards the bed [mm/s]. clear: height of the ways between points, above ``at``.
        greatest: by which the bed is off at the most.
        at: where the axis reads as the probe meets a bed that is right.
        offset: where the probe is beside the nozzle, along the two axes of the mesh.
    """

    speed: Positive
    clear: Positive
    greatest: Annotated[float, Meta(gt=0.0, le=5.0, description="0.5 is usual")]
    at: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)

    def scaled(self, factor: float) -> MeshProbe:
        """Return the same in another unit."""
        return MeshProbe(
            factor * self.speed,
            factor * self.clear,
            factor * self.greatest,
            factor * self.at,
            (factor * self.offset[0], factor * self.offset[1]),
        )

    @property
    def above(self) -> float:
        """Where the axis is between points."""
        return self.at + self.clear

    @property
    def deepest(self) -> float:
        """How far it goes for contact: the mesh that counts meanwhile is off by as much as the bed."""
        return self.at - 2.0 * self.greatest


def check_mesh_probe(
    axes: Mapping[Path, Axis], dialect: Dialect, mistakes: Mistakes, *, probes: bool
) -> int | None:
    """Return the axis whose mesh G29 probes; None: there is none, or it cannot be (MC092).

    Args:
        axes: by the paths of their sections. probes: the machine has a probe.
    """
    numbers = {axis.index: axis for axis in axes.values()}
    found: int | None = None
    for path, axis in axes.items():
        mesh = None if axis.compensation is None else axis.compensation.mesh
        if mesh is None or mesh.probe is None:
            continue
        probe, wrong = mesh.probe, ""
        others = [numbers[each] for each in mesh.axes if each in numbers]
        if dialect.profile != "printer" or not probes:
            wrong = 'G29 is for [dialect] profile = "printer" on a machine with [probe]'
        elif found is not None or len(mesh.axes) != 2 or len(others) != 2:
            wrong = "one axis is probed, over two others"
        elif not probe.clear > 2.0 * probe.greatest:
            wrong = "clear has to be more than twice greatest"
        elif axis.max_jerk < math.inf and any(each.max_jerk == math.inf for each in others):
            wrong = "the axes that it lies over need a max_jerk, as this one has one"
        else:
            ends = [(axis, (probe.deepest, probe.above))]
            for each, places, beside in zip(others, mesh.places, probe.offset, strict=True):
                ends.append((each, (places[0] - beside, places[-1] - beside)))
            for each, (low, high) in ends:
                if low < each.min_position or high > each.max_position:
                    wrong = f"it is beyond the travel of axis {each.index}"
        if wrong:
            hint = "see the page of compensation, or leave probe out"
            mistakes.add((*path, "compensation", "mesh", "probe"), wrong, hint, "MC092")
        found = axis.index
    return found
