"""What stands around a path, and where the run touched it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.clearance.outlines import Outline, standing_outlines
from mcserver.machine.machine_file import Machine
from mcserver.plot.theme import FAINT_INK

if TYPE_CHECKING:
    from mcserver.plot.scene import PathTrace

CONTACT = "#cc3311"
ZONE = "#aa3377"
# Outlines are cut off this share of the path's extent beyond it, and at least so far [mm].
BEYOND = 0.35
LEAST_BEYOND = 10.0


class Surroundings(msgspec.Struct, frozen=True):
    """Boxes, and the times of contacts [s]; ``columns``: the coordinates X, Y, Z that the path has."""

    outlines: tuple[Outline, ...] = ()
    contacts: tuple[float, ...] = ()
    columns: tuple[int, ...] = (0, 1, 2)


def surroundings_of(machine: Machine, report: Mapping[str, Any], axes: Sequence[int]) -> Surroundings:
    """Return what stands around a run's path.

    Args:
        axes: numbers of the axes that are the path's coordinates; none: it is in the base's frame.
    """
    clearance = machine.clearance
    if clearance is None or not set(axes) <= clearance.letters.keys():
        return Surroundings()
    # a recording has none
    found = report.get("clearance", {"pairs": (), "margin_mm": 0.0})
    contacts = (each["time_s"] for each in found["pairs"] if each["least_mm"] < found["margin_mm"])
    return Surroundings(
        outlines=tuple(standing_outlines(clearance)),
        contacts=tuple(contacts),
        columns=tuple(clearance.letters[axis] for axis in axes) or (0, 1, 2),
    )


def draw_surroundings(
    axes: Any, around: Surroundings, shown: tuple[int, ...], paths: Sequence[PathTrace]
) -> None:
    """Draw the edges of each box, and a cross where a path was as the run touched something.

    Args:
        axes: of matplotlib, in as many dimensions as ``shown`` has: coordinates of the paths.
    """
    points = np.concatenate([path.setpoint for path in paths])
    low, high = points.min(axis=0), points.max(axis=0)
    beyond = max(LEAST_BEYOND, BEYOND * float((high - low).max()))
    for outline in around.outlines:
        corners = outline.corners[:, list(around.columns)]
        if np.any(corners.max(axis=0) < low - beyond) or np.any(corners.min(axis=0) > high + beyond):
            continue
        near = np.clip(corners, low - beyond, high + beyond)
        colour = ZONE if outline.zone else FAINT_INK
        for edge in [(one, one | bit) for one in range(8) for bit in (1, 2, 4) if not one & bit]:
            if _along(corners[edge[1]] - corners[edge[0]], near[[*edge]] - corners[[*edge]]):
                axes.plot(*near[[*edge]][:, list(shown)].T, color=colour, linewidth=1.0, zorder=2)
        named = near[:, list(shown)].max(axis=0)
        axes.text(*named, f" {outline.name}", fontsize=8.0, color=colour, zorder=2)
    for time in around.contacts:
        for path in paths:
            row = min(len(path.time) - 1, int(np.searchsorted(path.time, time)))
            at = path.setpoint[row, list(shown)]
            axes.plot(
                *([each] for each in at), "x", markersize=13, color=CONTACT, markeredgewidth=3.0, zorder=9
            )


def _along(edge: NDArray[np.float64], cut: NDArray[np.float64]) -> bool:
    """Return whether an edge was only shortened by what is cut off its ends, shape (2, d), and not moved."""
    length = max(float(np.linalg.norm(edge)), 1e-12)
    across = cut - np.outer(cut @ edge / length, edge / length)
    return bool(np.abs(across).max() < 1e-9)
