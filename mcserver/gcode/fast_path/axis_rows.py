"""Tables of a program's usable axes and of the planes of its arcs, as lines in columns need them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from mcserver.gcode.semantics.arc_geometry import plane_extrema
from mcserver.gcode.semantics.arc_plane import PLANES, NoPlane, choose_plane
from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.program_units import axis_scale
from mcserver.gcode.semantics.travel_limits import ROUNDING
from mcserver.motion.geometry.curves import ArcCurve
from mcserver.units import AxisType


class AxisRow(NamedTuple):
    """An axis for columns: its scales to SI, and its travel widened by `ROUNDING` [m or rad]."""

    metric: float
    inch: float
    least: float
    greatest: float
    linear: bool


def axis_rows(setup: Setup) -> dict[int, AxisRow]:
    """Build a row for each usable axis whose words alone determine where it goes."""
    return {
        index: AxisRow(
            metric=axis_scale(axis.type, inch=False),
            inch=axis_scale(axis.type, inch=True),
            least=axis.min_position - ROUNDING,
            greatest=axis.max_position + ROUNDING,
            linear=axis.type is AxisType.LINEAR,
        )
        for index, axis in setup.axes.items()
        if index in setup.leased and not axis.profiled and axis.rollover is None
    }


class ArcFrame(NamedTuple):
    """An arc's axes, the plane's two first, with the column of each axis word and of each of I J K."""

    axes: tuple[int, ...]
    columns: tuple[int, ...]
    offsets: tuple[int, ...]
    rows: tuple[AxisRow, ...]


def inside_travels(curve: ArcCurve, rows: tuple[AxisRow, ...]) -> bool:
    """Return whether the arc stays within the axes' travels."""
    low, high = plane_extrema(curve)
    for column, row in enumerate(rows):
        ends = curve.start[column], curve.end[column]
        ordered = (low[column], high[column]) if column < 2 else (min(ends), max(ends))
        if ordered[0] < row.least or ordered[1] > row.greatest:
            return False
    return True


def arc_frame(
    usable: Mapping[int, AxisRow],
    chosen: int | None,
    axes: tuple[int, ...],
    offsets: tuple[int, ...],
    *,
    further: bool,
) -> ArcFrame | None:
    """Choose an arc's axes by the letters of its words; None if they need the block interpreter.

    Args:
        usable: rows by axis. chosen: the plane in force. axes: of the words. offsets: 0 1 2 for I J K.
        further: axes beyond X Y Z may go along, without a part in the length (D-66).
    """
    if axes and max(axes) > 2 and not further:
        return None
    try:
        plane = PLANES[choose_plane(chosen, frozenset(offsets), frozenset(axes) & {0, 1, 2})]
    except NoPlane:
        return None
    ordered = plane + tuple([index for index in axes if index not in plane])
    rows = [row for row in map(usable.get, ordered) if row is not None and row.linear]
    if len(rows) < len(ordered) or not set(offsets) <= set(plane):
        return None
    columns = tuple([ordered.index(index) for index in axes])
    return ArcFrame(ordered, columns, tuple([plane.index(offset) for offset in offsets]), tuple(rows))
