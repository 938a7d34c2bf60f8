"""Rapid moves of directly named axes: every axis by itself, or all on one straight line (D-20, D-61)."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.modal import ModalState
from mcserver.motion.canonical import FeedGroup, RapidGroup
from mcserver.motion.geometry.curves import LineCurve

# no time is asked for: reports have null
_NO_TIME = math.inf


def rapid_group(
    setup: Setup, modal: ModalState, starts: Mapping[int, float], targets: Mapping[int, float]
) -> FeedGroup | RapidGroup:
    """Return G00 from ``starts`` to ``targets`` [m or rad], as the machine file has it.

    A straight rapid is as fast as its slowest axis allows, and none is above its own max_velocity. One axis
    alone, and axes whose drives make profiles of their own, go by themselves.
    """
    axes = tuple(targets)
    ends = tuple(targets.values())
    far = {axis: abs(end - starts[axis]) for axis, end in targets.items()}
    alone = sum(travel > 0.0 for travel in far.values()) < 2
    known = setup.axes
    if not setup.machine.dialect.straight_rapids or alone or any(known[axis].profiled for axis in axes):
        return RapidGroup(axes, ends, True, modal.carried)
    length = math.hypot(*far.values())
    slowest = max(travel / known[axis].max_velocity for axis, travel in far.items())
    curve = LineCurve(axes, tuple(starts[axis] for axis in axes), ends, length)
    return FeedGroup((curve,), _NO_TIME, speed=length / slowest, carried=modal.carried)
