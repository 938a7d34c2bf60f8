"""Gets the planner ready before its first line: its loops are compiled or read from the cache."""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.canonical import FeedGroup, PlainRun
from mcserver.motion.limits import Level
from mcserver.motion.lookahead import Lookahead
from mcserver.motion.path import LineCurve
from mcserver.motion.profile import join
from mcserver.motion.ramps import fastest
from mcserver.motion.sampling import sample
from mcserver.motion.segment import AxisLimits, StraightRun, place, segment_of

_SLOTS = {0: 0, 1: 1}


def warm_up() -> None:
    """Plans a few lines of no machine. Takes some 20 s once for each installation, then half a second."""
    limits = AxisLimits(
        velocity=np.array([1.0, 1.0]),
        acceleration=np.array([1.0, 1.0]),
        jerk=np.array([10.0, math.inf]),
        cycle=1e-3,
    )
    window = Lookahead(limits)
    position = np.zeros(2)
    points = np.array([[0.0, 0.0], [0.01, 0.0], [0.01, 0.01]])
    run = PlainRun(
        lines=np.array([1, 2]),
        axes=(0, 1),
        points=points,
        lengths=np.array([0.01, 0.01]),
        travels=np.array([0.01, 0.01]),
        requested=np.array([0.1, 0.1]),
        speeds=np.array([0.1, 0.1]),
    )
    straight = StraightRun.of(run, _SLOTS, position)
    assert straight is not None
    window.append_run(straight, active=straight.mask)
    position[:] = points[-1]
    curve = LineCurve((0, 1), (0.01, 0.01), (0.02, 0.02), math.hypot(0.01, 0.01))
    segment = segment_of(FeedGroup((curve,), requested=0.2, duration=0.2), 3, _SLOTS, len(position))
    place(segment, position)
    window.append(segment)
    window.enter_fast()
    window.entry = 0.0
    sample(window.plan(), 0.0, 1, 10, limits.cycle)
    quickest = fastest(0.01, 0.0, 0.0, [Level(0.1, 1.0, 10.0)])
    assert quickest is not None
    join(quickest).time_at(np.array([0.0, 0.01]))
