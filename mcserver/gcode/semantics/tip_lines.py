"""Straight lines of a tool on which all joints may go evenly: lines for the planner, which smooths chords."""

from __future__ import annotations

import math

import numpy as np
from mckinematics.even_path import EvenPath
from mckinematics.pose import Array

from mcserver.gcode.semantics.block_state import BlockState
from mcserver.motion.geometry.curves import TipLine, ToolRates
from mcserver.units import DEGREE, MM

# Share of the tool's own tolerance by which it may be off its path while all joints move evenly.
OWN_SHARE = 0.8
# Share of the path tolerance by which it may be off in addition; corners get the rest.
BEND_SHARE = 0.2
# Greatest ratio of the rates beside the path to those sampled on it.
LEVER_CHANGE = 1.02
# Greatest ratio of the rates between samples to those at samples.
FASTER_BETWEEN = 1.0005


def tip_line(
    block: BlockState,
    axes: tuple[int, ...],
    start: Array,
    found: EvenPath,
    own: tuple[float, float],
    travel: float,
    rates: ToolRates,
) -> TipLine | None:
    """Return a line of joints ``axes``, whose corners get what it leaves of the path tolerance.

    Args:
        start: joints at its start, shape (K,). own: tolerances of the tool [m, rad]. travel: of the tip [m].
        rates: of the tip by those of the joints.

    Returns:
        None where it would bow too far.
    """
    # of an orientation a degree counts as a millimetre
    turn = MM / DEGREE
    bow = math.hypot(
        max(0.0, found.off - OWN_SHARE * own[0]), turn * max(0.0, found.off_angle - OWN_SHARE * own[1])
    )
    if bow > (0.0 if block.exact_stop else BEND_SHARE * block.path_tolerance):
        return None
    units = np.array([MM / block.setup.axes[axis].type.si_per_unit for axis in axes])
    levers = found.rates / units
    levers[:, 3:] *= turn
    lever = max(1.0, LEVER_CHANGE * float(np.linalg.svd(levers, compute_uv=False).max()))
    block.tolerance = min(block.tolerance, block.path_tolerance - bow)
    first, last = (tuple(each.tolist()) for each in (start, found.end))
    return TipLine(axes, first, last, travel, rates, FASTER_BETWEEN * found.fastest, lever)
