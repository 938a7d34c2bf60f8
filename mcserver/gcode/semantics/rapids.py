"""Rapid moves of directly named axes: each axis independently, or all on a straight line (D-20, D-61)."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.modal import ModalState
from mcserver.motion.canonical import FeedGroup, RapidGroup
from mcserver.motion.geometry.curves import Curve, LineCurve

# a rapid has no requested time, which reports show as null
NO_TIME = math.inf


def rapid_group(
    setup: Setup,
    modal: ModalState,
    starts: Mapping[int, float],
    targets: Mapping[int, float],
    *,
    straight: bool = False,
) -> FeedGroup | RapidGroup:
    """Return G00 from ``starts`` to ``targets`` [m or rad], as the machine file configures rapids.

    A straight rapid is as fast as its slowest axis allows. Single axes, and axes whose drives make their own
    profiles, move independently.

    Args:
        straight: a straight line whatever the machine file says, for a single axis too.
    """
    axes = tuple(targets)
    ends = tuple(targets.values())
    travelling = sum(starts[axis] != end for axis, end in targets.items())
    least = 1 if straight else 2
    aligned = straight or setup.machine.dialect.straight_rapids
    if not aligned or travelling < least or any(setup.axes[axis].profiled for axis in axes):
        return RapidGroup(axes, ends, True, modal.carried)
    begin = tuple(starts[axis] for axis in axes)
    curve = LineCurve(axes, begin, ends, math.dist(begin, ends))
    return FeedGroup((curve,), NO_TIME, speed=straight_speed(setup, curve), carried=modal.carried)


def straight_speed(setup: Setup, curve: Curve) -> float:
    """Return the greatest speed along a line, or an arc, that all its axes allow."""
    most = [setup.axes[axis].max_velocity for axis in curve.axes]
    if not isinstance(curve, LineCurve):
        return min(most)
    ends = zip(curve.start, curve.end, most, strict=True)
    return curve.length / max(abs(end - start) / limit for start, end, limit in ends)
