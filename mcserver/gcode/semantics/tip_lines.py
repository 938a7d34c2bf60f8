"""Straight lines of a tool on which all joints may go evenly: lines for the planner, which smooths chords."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mckinematics.even_path import EvenPaths, leading

from mcserver.gcode.semantics.block_state import BlockState
from mcserver.machine.axis import Axis
from mcserver.motion.geometry.curves import Array, TipColumns, TipLine, ToolRates
from mcserver.units import DEGREE, MM

# Share of the tool's own tolerance by which it may be off its path while all joints move evenly.
OWN_SHARE = 0.8
# Share of the path tolerance by which it may be off in addition; corners get the rest.
BEND_SHARE = 0.2
# Greatest ratio of the rates beside the path to those sampled on it.
LEVER_CHANGE = 1.02
# Greatest ratio of the rates between samples to those at samples.
FASTER_BETWEEN = 1.0005


def tip_columns(
    axes: Sequence[Axis],
    found: EvenPaths,
    own: tuple[float, float],
    tolerance: float,
    rates: ToolRates,
    *,
    exact_stop: bool,
) -> tuple[TipColumns, Array]:
    """Return lines of joints ``axes`` for the planner, up to the first that would bow too far.

    Args:
        own: tolerances of the tool [m, rad]. tolerance: of corners, which get what a line leaves of it [m].
        rates: of the tip by those of the joints. exact_stop: behind each of them.

    Returns:
        The lines, and the tolerances of their corners, shape (n,) [m].
    """
    # of an orientation a degree counts as a millimetre
    turn = MM / DEGREE
    bows = np.hypot(
        np.maximum(0.0, found.off - OWN_SHARE * own[0]),
        turn * np.maximum(0.0, found.off_angle - OWN_SHARE * own[1]),
    )
    fitting = bows <= (0.0 if exact_stop else BEND_SHARE * tolerance)
    count = leading(fitting)
    levers = found.rates[:count] / np.array([MM / axis.type.si_per_unit for axis in axes])
    levers[:, :, 3:] *= turn
    greatest = np.linalg.svd(levers, compute_uv=False).max(axis=(1, 2), initial=0.0)
    fastest = FASTER_BETWEEN * found.fastest[:count]
    columns = TipColumns(rates, fastest, np.maximum(1.0, LEVER_CHANGE * greatest))
    return columns, tolerance - bows[:count]


def tip_line(
    block: BlockState,
    axes: tuple[int, ...],
    found: EvenPaths,
    own: tuple[float, float],
    travel: float,
    rates: ToolRates,
) -> TipLine | None:
    """Return the line of joints ``axes`` that was found, whose corners get what it leaves of the tolerance.

    Args:
        own, rates: as of `tip_columns`. travel: of the tip [m].

    Returns:
        None where none was found, or it would bow too far.
    """
    named = [block.setup.axes[axis] for axis in axes]
    columns, tolerances = tip_columns(
        named, found, own, block.path_tolerance, rates, exact_stop=block.exact_stop
    )
    if not len(columns):
        return None
    block.tolerance = min(block.tolerance, float(tolerances[0]))
    start, end = (tuple(each) for each in found.joints.tolist())
    return columns.line(0, axes, (start, end), travel)
