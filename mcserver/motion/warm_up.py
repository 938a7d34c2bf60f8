"""Gets the planner ready before its first line: its loops are compiled or read from the cache."""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.canonical import FeedGroup, PlainRun
from mcserver.motion.geometry.blend import straight_blend
from mcserver.motion.geometry.blend_choice import HANDLE, TOLERANCE_SHARES, best_blend
from mcserver.motion.geometry.curves import ArcCurve, Array, Curve, LineCurve
from mcserver.motion.geometry.segment import AxisLimits, Segment, StraightRun, anchor, segment_of
from mcserver.motion.kernels.compiled import compiles
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.path_limits import AccelerationLimit
from mcserver.motion.profile.setpoint_sampling import sample
from mcserver.motion.profile.speed_ramps import min_time_profiles
from mcserver.motion.profile.velocity_profile import join

_SLOTS = {0: 0, 1: 1}


def warm_up() -> None:
    """Plans a few lines of no machine. Takes some 30 s once for each installation, then half a second.

    All that a program may ask for is called here: what is compiled while one runs makes its motion wait.
    """
    if not compiles():
        return
    limits = AxisLimits(
        velocity=np.array([1.0, 1.0]),
        acceleration=np.array([1.0, 1.0]),
        jerk=np.array([10.0, math.inf]),
        cycle=1e-3,
        weights=np.ones(2),
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
    window.plan()
    position[:] = points[-1]
    line = LineCurve((0, 1), (0.01, 0.01), (0.02, 0.02), math.hypot(0.01, 0.01))
    window.append(_segment(FeedGroup((line,), requested=0.2, duration=0.2), 3, position))
    window.enter_fast()
    window.entry = 0.0
    sample(window.plan(), 0.0, 1, 10, limits.cycle)
    quickest = min_time_profiles(0.01, 0.0, 0.0, [AccelerationLimit(0.1, 1.0, 10.0)])
    assert quickest is not None
    join(quickest).time_at(np.array([0.0, 0.01]))
    _round_corners(limits)


def _segment(group: FeedGroup, line: int, position: Array) -> Segment:
    segment = segment_of(group, line, _SLOTS, np.ones(len(position), np.bool_))
    anchor(segment, position)
    return segment


def _round_corners(limits: AxisLimits) -> None:
    """A corner of two lines, and one of a line and an arc."""
    turn = math.pi / 2.0
    seconds: tuple[Curve, ...] = (
        LineCurve((0, 1), (0.01, 0.0), (0.01, 0.01), 0.01),
        ArcCurve((0, 1), (0.01, 0.0), (0.02, 0.01), (0.02, 0.0), -turn, turn * 0.01),
    )
    for second in seconds:
        window = Lookahead(limits)
        first = LineCurve((0, 1), (0.0, 0.0), (0.01, 0.0), 0.01)
        window.append(_segment(FeedGroup((first,), requested=0.1, speed=0.1), 1, np.zeros(2)))
        after = _segment(FeedGroup((second,), requested=0.1, speed=0.1), 2, np.array([0.01, 0.0]))
        after.tolerance = 2e-3
        best_blend(window, after, limits)
        # whichever way round the corner is the best one, all of them are called
        if after.straight:
            assert straight_blend(window.table.segments[-1], after, HANDLE, TOLERANCE_SHARES, limits, 0.0)
        window.append(after)
        run = window.plan()
        assert run.timed.any()
        sample(run, 0.0, 1, math.ceil(run.phases.duration / limits.cycle), limits.cycle)
