"""The whole picture, drawn by matplotlib without a screen."""

from __future__ import annotations

from typing import Any, BinaryIO

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mcserver.plot.path_panel import draw_path
from mcserver.plot.scene import AxisTrace, Scene
from mcserver.plot.theme import FAINT_INK, INK, STYLE, colours_of
from mcserver.plot.time_panels import (
    draw_derivative,
    draw_deviation,
    draw_following_errors,
    draw_speed,
    draw_times,
)

MAX_AXIS_ROWS = 16
WIDTH = 13.0
HEAD, TOP, SPEED, ERRORS, AXIS_ROW = 0.75, 6.6, 2.3, 1.9, 1.75
DOTS_PER_INCH = 110


def draw_png(scene: Scene, stream: BinaryIO, *, axes: bool = True, limits: bool = False) -> None:
    """The picture as PNG: path, times, speed, errors, and (``axes``) each moving axis.

    Args:
        limits: scale the axes to their limits, not to the motion.
    """
    compose(scene, axes=axes, limits=limits).savefig(
        stream, format="png", dpi=DOTS_PER_INCH, metadata={"Software": "mcserver plot"}
    )


def compose(scene: Scene, *, axes: bool = True, limits: bool = False) -> Figure:
    """Return the figure with all its panels; see `draw_png`."""
    style: Any = dict(STYLE)
    with mpl.rc_context(style):
        return _compose(scene, scene.axes[:MAX_AXIS_ROWS] if axes else (), limits)


def _compose(scene: Scene, shown: tuple[AxisTrace, ...], limits: bool) -> Figure:
    heights = [TOP, SPEED, ERRORS, *[AXIS_ROW] * len(shown)]
    height = HEAD + sum(heights)
    figure = Figure(figsize=(WIDTH, height))
    FigureCanvasAgg(figure)
    figure.set_layout_engine(
        "constrained", rect=(0.005, 0.005, 0.99, 1.0 - HEAD / height), h_pad=0.08, w_pad=0.08
    )
    grid = figure.add_gridspec(len(heights), 6, height_ratios=heights)
    colours = colours_of(scene.line.tolist() + [each.line for each in scene.timed_lines])

    draw_path(figure, grid[0, :4], scene, colours)
    draw_times(figure.add_subplot(grid[0, 4:]), scene, colours)
    draw_speed(figure.add_subplot(grid[1, :]), scene, colours)
    if scene.paths:
        draw_following_errors(figure.add_subplot(grid[2, :3]), scene)
        draw_deviation(figure.add_subplot(grid[2, 3:]), scene, colours)
    else:
        draw_following_errors(figure.add_subplot(grid[2, :]), scene)
    for row, trace in enumerate(shown, start=3):
        for order in range(3):
            panel = figure.add_subplot(grid[row, 2 * order : 2 * order + 2])
            draw_derivative(panel, scene, trace, order, to_limit=limits)

    left, top = 0.014, 1.0 - 0.28 / height
    figure.text(left, top, scene.title, fontsize=15, fontweight="bold", color=INK, va="center")
    figure.text(
        left, top - 0.27 / height, _summary(scene, len(shown)), fontsize=9.5, color=FAINT_INK, va="center"
    )
    return figure


def _summary(scene: Scene, shown: int) -> str:
    said = [f"{scene.duration_s:.3f} s", f"feed path {scene.feed_length_mm:,.1f} mm".replace(",", "\u2009")]
    said.append(f"{len(scene.timed_lines)} timed lines")
    if 0 < shown < len(scene.axes):
        said.append(f"the first {shown} of {len(scene.axes)} moving axes are shown")
    return "  ·  ".join(said)
