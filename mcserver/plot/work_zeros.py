"""The zeros of work coordinate systems in a picture of the path, which is in the machine's coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mcserver.plot.scene import WorkZero
from mcserver.plot.theme import INK, PAPER


def draw_zeros(axes: Any, zeros: Sequence[WorkZero], columns: tuple[int, ...]) -> None:
    """Draw each zero as a cross with the name of its system, and that of the machine if there is one.

    Args:
        axes: of matplotlib, in two or three dimensions. columns: coordinates that it shows.
    """
    if not zeros:
        return
    machine = WorkZero("machine", (0.0,) * len(zeros[0].at))
    for zero in (machine, *zeros):
        at = [zero.at[column] for column in columns]
        colour = INK if zero is machine else "#aa3377"
        axes.plot(*([each] for each in at), "+", markersize=15, color=colour, markeredgewidth=1.8, zorder=7)
        box = {"boxstyle": "round,pad=0.2", "facecolor": PAPER, "edgecolor": "none", "alpha": 0.7}
        axes.text(*at, f"  {zero.name}", fontsize=8.5, fontweight="bold", color=colour, bbox=box, zorder=7)
