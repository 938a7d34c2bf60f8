"""Paths that lie in a few parallel planes, seen square: the feet of a walking robot from its side.

Nothing is lost by the projection, and heights and lengths can be read off, which a view in space does not
allow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from mcserver.plot.scene import PathTrace, WorkZero
from mcserver.plot.strokes import moving_strokes
from mcserver.plot.surroundings import Surroundings, draw_surroundings
from mcserver.plot.theme import ACTUAL, INK, PAPER
from mcserver.plot.work_zeros import draw_zeros

MAX_VIEWS = 3
# a path this flat, as a share of the largest extent of all, counts as plane
FLATNESS = 2e-3


class SideView(msgspec.Struct, frozen=True):
    """One plane and the paths in it.

    Attributes:
        depth: column of the coordinate that is constant. at: its value [mm].
        across, up: columns of the coordinates drawn to the right and upwards.
    """

    depth: int
    at: float
    across: int
    up: int
    paths: tuple[PathTrace, ...]


def side_views(paths: Sequence[PathTrace]) -> tuple[SideView, ...]:
    """Return the planes that hold all paths in space; empty where that takes more than a few, or there are
    none.
    """
    if not paths or len(paths[0].names) != 3:
        return ()
    points = np.concatenate([path.setpoint for path in paths])
    span = np.ptp(points, axis=0)
    allowed = FLATNESS * float(span.max())
    flat = np.array([np.ptp(path.setpoint, axis=0) for path in paths]).max(axis=0) <= allowed
    if not flat.any():
        return ()
    depth = int(np.flatnonzero(flat)[-1])
    across, up = (column for column in range(3) if column != depth)
    if depth == 0 and span[up] > span[across]:
        # either may be upright in a robot's frame, and what is long lies down: feet walk along Z
        across, up = up, across
    planes: dict[float, list[PathTrace]] = {}
    for path in paths:
        at = float(path.setpoint[0, depth])
        near = next((known for known in planes if abs(known - at) <= allowed), at)
        planes.setdefault(near, []).append(path)
    if len(planes) > MAX_VIEWS:
        return ()
    return tuple(SideView(depth, at, across, up, tuple(planes[at])) for at in sorted(planes))


def draw_side_views(
    figure: Figure,
    place: SubplotSpec,
    views: Sequence[SideView],
    colours: Mapping[int, str],
    zeros: Sequence[WorkZero] = (),
    around: Surroundings | None = None,
) -> None:
    """The views one above the other, to one scale; ``zeros``: of work coordinate systems."""
    grid = place.subgridspec(len(views), 1)
    points = np.concatenate([path.setpoint for view in views for path in view.paths])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float((high - low).max())
    for row, view in enumerate(views):
        axes = figure.add_subplot(grid[row])
        for path in view.paths:
            _draw(axes, view, path, colours)
        seen = [view.across, view.up]
        axes.update_datalim([low[seen] - margin, high[seen] + margin])
        axes.autoscale_view()
        axes.set_aspect("equal", adjustable="datalim")
        draw_zeros(axes, zeros, (view.across, view.up))
        if around is not None:
            draw_surroundings(axes, around, (view.across, view.up), view.paths)
        names = view.paths[0].names
        labels = ", ".join(path.label for path in view.paths if path.label)
        key = ": colour = line of the program, thin = encoders, ○ start" if row == 0 else ""
        axes.set_title(f"Path of {labels or 'the axes'} at {names[view.depth]} {view.at:.6g} mm{key}")
        axes.set_ylabel(f"{names[view.up]} [mm]")
        if row == len(views) - 1:
            axes.set_xlabel(f"{names[view.across]} [mm]")


def _draw(axes: Any, view: SideView, path: PathTrace, colours: Mapping[int, str]) -> None:
    seen = [view.across, view.up]
    strokes = moving_strokes(path)
    axes.add_collection(
        LineCollection(
            [points[:, seen] for _, points in strokes],
            colors=[colours[number] for number, _ in strokes],
            linewidths=4.5,
            alpha=0.75,
        )
    )
    axes.plot(*path.actual[:, seen].T, color=ACTUAL, linewidth=0.9)
    start = path.setpoint[0, seen]
    look = {"markersize": 9, "color": PAPER, "markeredgecolor": INK, "markeredgewidth": 1.6}
    axes.plot(*start, "o", **look, zorder=5)
    if path.label:
        axes.annotate(
            path.label,
            start,
            xytext=(0, -19),
            textcoords="offset points",
            ha="center",
            fontsize=10,
            fontweight="bold",
            color=INK,
            zorder=6,
        )
