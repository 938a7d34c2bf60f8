"""The path, in the plane or in space, coloured by the line of the program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import NDArray

from mcserver.plot.scene import AxisTrace, PathTrace, Scene
from mcserver.plot.side_views import draw_side_views, side_views
from mcserver.plot.strokes import moving_strokes
from mcserver.plot.surroundings import draw_surroundings
from mcserver.plot.theme import ACTUAL, FAINT_INK, INK, PAPER
from mcserver.plot.work_zeros import draw_zeros

MAX_LABELS = 24


def draw_path(figure: Figure, place: SubplotSpec, scene: Scene, colours: Mapping[int, str]) -> None:
    """The path panel: setpoints coloured by line, the encoders' path as a thin dark line upon them."""
    if not scene.paths:
        _draw_positions(figure.add_subplot(place), scene)
        return
    views = side_views(scene.paths)
    if len(scene.paths[0].names) == 2:
        plane = figure.add_subplot(place)
        _draw_plane(plane, scene.paths[0], colours)
        draw_zeros(plane, scene.zeros, (0, 1))
        draw_surroundings(plane, scene.around, (0, 1), scene.paths)
    elif views:
        draw_side_views(figure, place, views, colours, scene.zeros, scene.around)
    else:
        space = figure.add_subplot(place, projection="3d", computed_zorder=False)
        _draw_space(space, scene.paths, colours)
        draw_zeros(space, scene.zeros, (0, 1, 2))
        draw_surroundings(space, scene.around, (0, 1, 2), scene.paths)


def _draw_plane(axes: Any, path: PathTrace, colours: Mapping[int, str]) -> None:
    strokes = moving_strokes(path)
    axes.add_collection(
        LineCollection(
            [points for _, points in strokes],
            colors=[colours[number] for number, _ in strokes],
            linewidths=4.5,
            alpha=0.75,
        )
    )
    axes.plot(path.actual[:, 0], path.actual[:, 1], color=ACTUAL, linewidth=0.9)
    if len(strokes) <= MAX_LABELS:
        for number, points in strokes:
            _label_line(axes, number, points, colours[number])
    axes.plot(
        *path.setpoint[0],
        marker="o",
        markersize=8,
        color=PAPER,
        markeredgecolor=INK,
        markeredgewidth=1.6,
        zorder=5,
    )
    axes.plot(*path.setpoint[-1], marker="s", markersize=6, color=INK, zorder=5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)
    axes.set_xlabel(f"{path.names[0]} [mm]")
    axes.set_ylabel(f"{path.names[1]} [mm]")
    axes.set_title("Path: colour = line of the program, thin = encoders, ○ start, ■ end")


def _label_line(axes: Any, number: int, points: NDArray[np.float64], colour: str) -> None:
    if number == 0:
        return
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    middle = int(np.searchsorted(travelled, travelled[-1] / 2.0))
    axes.annotate(
        str(number),
        points[middle],
        ha="center",
        va="center",
        fontsize=7.5,
        fontweight="bold",
        color=PAPER,
        bbox={"boxstyle": "round,pad=0.28", "facecolor": colour, "edgecolor": PAPER, "linewidth": 1.0},
        zorder=6,
    )


def _draw_space(axes: Any, paths: Sequence[PathTrace], colours: Mapping[int, str]) -> None:
    for path in paths:
        strokes = moving_strokes(path)
        axes.add_collection3d(
            Line3DCollection(
                [points for _, points in strokes],
                colors=[colours[number] for number, _ in strokes],
                linewidths=3.2,
                alpha=0.75,
            )
        )
        axes.plot(*path.actual.T, color=ACTUAL, linewidth=0.8, zorder=3)
        axes.plot(
            *path.setpoint[:1].T,
            "o",
            markersize=8,
            color=PAPER,
            markeredgecolor=INK,
            markeredgewidth=1.5,
            zorder=4,
        )
        axes.plot(*path.setpoint[-1:].T, "s", markersize=6, color=INK, zorder=4)
        if path.label:
            axes.text(*path.setpoint[0], f"  {path.label}", fontsize=9, fontweight="bold", color=INK)
    for artist in (*axes.lines, *axes.collections):
        # they may pass the panel's edge, and must not move it
        artist.set_clip_on(False)
        artist.set_in_layout(False)
    points = np.concatenate([path.setpoint for path in paths])
    low, high = points.min(axis=0), points.max(axis=0)
    # a flat direction keeps some thickness, so that the box stays a box
    span = np.maximum(high - low, 0.15 * (high - low).max())
    middle = (low + high) / 2.0
    for axis, centre, width in zip("xyz", middle, span, strict=True):
        getattr(axes, f"set_{axis}lim")(centre - width / 2.0, centre + width / 2.0)
        getattr(axes, f"{axis}axis").set_pane_color((0.965, 0.973, 0.98, 1.0))
    # what is long lies down: the feet of a robot walk along Z
    upright = "y" if span[2] > 2.0 * max(span[0], span[1]) else "z"
    axes.view_init(elev=24, azim=-56, vertical_axis=upright)
    flat = float(np.sort(span)[1]) < 0.4 * float(span.max())
    axes.set_box_aspect(span, zoom=1.35 if flat else 1.1)
    for axis, name in zip("xyz", paths[0].names, strict=True):
        getattr(axes, f"set_{axis}label")(f"{name} [mm]", labelpad=8)
        getattr(axes, f"{axis}axis").set_major_locator(MaxNLocator(nbins=4))
    axes.set_title("Path: colour = line of the program, thin = encoders, ○ start, ■ end")


def _draw_positions(axes: Any, scene: Scene) -> None:
    """Where there is no path in space: positions over time."""
    shades = ("#4477aa", "#ee6677", "#228833", "#aa3377", "#66ccee", "#ccbb44")
    for order, trace in enumerate(scene.axes):
        shade = shades[order % len(shades)]
        axes.plot(scene.time, trace.setpoint, color=shade, linewidth=2.6, alpha=0.7, label=_legend(trace))
        axes.plot(scene.time, trace.actual, color=ACTUAL, linewidth=0.7)
    axes.set_xlabel("time [s]")
    axes.set_title("Positions: colour = setpoint, thin = encoders")
    if scene.axes:
        axes.legend(loc="best", ncols=1 + len(scene.axes) // 8)
    else:
        axes.text(
            0.5, 0.5, "nothing moved", ha="center", va="center", color=FAINT_INK, transform=axes.transAxes
        )


def _legend(trace: AxisTrace) -> str:
    return f"{trace.name} [{trace.unit}]"
