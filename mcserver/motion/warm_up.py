"""Compile the planner's kernels, or read them from the cache, before its first line.

``python -m mcserver.motion.warm_up`` fills the cache for later processes.
"""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import sys
from enum import Enum

import numpy as np

from mcserver.motion.canonical import FeedGroup, PathBatch
from mcserver.motion.compiling import (
    BACKGROUND,
    NICE,
    compiling_alone,
    kernels_kept,
    note_kernels_kept,
    plain_kernels,
    start_warm_up,
)
from mcserver.motion.geometry.batch_segments import segments_of_batch
from mcserver.motion.geometry.blend import straight_blend
from mcserver.motion.geometry.curves import ArcCurve, Array, Curve, LineCurve
from mcserver.motion.geometry.segment import AxisLimits, Segment, anchor, segment_of
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.kernels.cache_folder import cache_folder, remove_unused
from mcserver.motion.kernels.corner_trajectory import path_deviation_of
from mcserver.motion.kernels.min_time_trajectories import PHASES, min_time_trajectories
from mcserver.motion.kernels.path_speed import quicker_phases
from mcserver.motion.kernels.rate_search import warm_up_playback
from mcserver.motion.kernels.sample_limits import run_of
from mcserver.motion.kernels.servo_loop import follow_cycles
from mcserver.motion.kernels.timed_moves import timing_of_group
from mcserver.motion.lookahead.blend_choice import best_blend
from mcserver.motion.lookahead.lookahead import Lookahead
from mcserver.motion.lookahead.setpoint_sampling import sample
from mcserver.motion.smoothing.chord_smoothing import ChordSmoother, SmoothRun

_SLOTS = {0: 0, 1: 1}
# Longest wait for the helper process [s].
_HELPER_S = 300.0


class Part(Enum):
    """A share of the kernels, compiled by one process."""

    LINES = "lines"
    CORNERS = "corners"


def warm_up() -> None:
    """Read all kernels from the cache, which takes half a second, or compile them.

    Calls every kernel that a program may need: one compiled while a program runs would delay its motion.
    """
    if plain_kernels():
        return
    if kernels_kept():
        _call(*Part)
        return
    with compiling_alone():
        if not kernels_kept():
            _compile()
            return
    _call(*Part)


def _compile() -> None:
    """Compile in two processes; a kernel that both need is compiled by whichever gets to it first."""
    helper = start_warm_up(Part.CORNERS.value) if _cores() > 1 and cache_folder() else None
    try:
        _call(Part.LINES)
        if helper is not None:
            # what the helper has not compiled, or could not store, is compiled here
            with contextlib.suppress(subprocess.TimeoutExpired):
                helper.wait(_HELPER_S)
        _call(Part.CORNERS)
    finally:
        if helper is not None:
            helper.kill()
            helper.wait()
    remove_unused()
    note_kernels_kept()


def _cores() -> int:
    return os.cpu_count() or 1


def _call(*parts: Part) -> None:
    limits = AxisLimits(
        velocity=np.array([1.0, 1.0]),
        acceleration=np.array([1.0, 1.0]),
        jerk=np.array([10.0, math.inf]),
        cycle=1e-3,
        weights=np.ones(2),
    )
    if Part.LINES in parts:
        _plan_lines(limits)
        warm_up_playback()
    if Part.CORNERS in parts:
        _find_trajectories()
        _round_corners(limits)
        _smooth_chords(limits)


def _plan_lines(limits: AxisLimits) -> None:
    """Plan and sample a line and an arc in columns and a line after them, and time a group of them."""
    turn = math.pi / 2.0
    lengths = np.array([0.01, 0.01 * turn])
    points = np.array([[0.0, 0.0], [0.01, 0.0], [0.02, 0.01]])
    run = PathBatch(
        lines=np.array([1, 2]),
        axes=(0, 1),
        points=points,
        frames=((0, 1),),
        frame=np.zeros(2, np.intp),
        centres=np.array([[math.nan, math.nan], [0.01, 0.01]]),
        sweeps=np.array([0.0, turn]),
        lengths=lengths,
        travels=lengths,
        requested=lengths / 0.1,
        speeds=np.array([0.1, 0.1]),
        tolerances=np.zeros(2),
    )
    lines = segments_of_batch(run, _SLOTS, np.ones(2, np.bool_), np.zeros(2))
    assert lines is not None
    window = Lookahead(limits)
    window.append_path(lines)
    plan = window.plan()
    sample(plan, 0.0, 1, math.ceil(plan.phases.duration / limits.cycle), limits.cycle)
    line = LineCurve((0, 1), (0.02, 0.01), (0.03, 0.02), math.hypot(0.01, 0.01))
    window.append(_segment(FeedGroup((line,), requested=0.2, duration=0.2), 3, points[-1].copy()))
    window.enter_fast()
    window.entry = 0.0
    sample(window.plan(), 0.0, 1, 10, limits.cycle)
    rows = np.ones((1, 5 * len(limits.velocity) + 2))
    groups = run_of(rows, np.array([0, 1]), np.ones(1), limits.rows, limits.cycle)
    timing_of_group(groups, 0, (0.01, 0.0, 0.0), 0.2)


def _segment(group: FeedGroup, line: int, position: Array) -> Segment:
    segment = segment_of(group, line, _SLOTS, np.ones(len(position), np.bool_))
    anchor(segment, position)
    return segment


def _find_trajectories() -> None:
    """Find trajectories around a corner; shares no kernel with `_plan_lines`."""
    trajectories = np.zeros((2, PHASES, 5))
    pair = np.ones((2, 2))
    min_time_trajectories(np.ones((2, 5)), pair, 1.0, True, trajectories)
    path_deviation_of(trajectories, 1.0, np.ones((3, 2)), 0.0, np.ones(2), np.ones(2), pair, pair, 1e-3)


def _round_corners(limits: AxisLimits) -> None:
    """Round a corner of two lines, and one of a line and an arc."""
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
        # whichever rounding was best, call the kernels of all of them
        if after.straight:
            assert straight_blend(window.table.segments[-1], after, limits)
        window.append(after)
        run = window.plan()
        assert run.timed.any()
        sample(run, 0.0, 1, math.ceil(run.phases.duration / limits.cycle), limits.cycle)


def _smooth_chords(limits: AxisLimits) -> None:
    """Compile the smoothing of chords of a curve."""
    lines = []
    position = np.zeros(2)
    for number in range(1, 6):
        end = (0.001 * number, 1e-5 * number * number)
        line = LineCurve((0, 1), (float(position[0]), float(position[1])), end, 0.001)
        lines.append(_segment(FeedGroup((line,), requested=0.01, speed=0.1), number, position))
        lines[-1].tolerance = 1e-4
    (curve,) = ChordSmoother(limits).smooth(SegmentList(lines), rests=True)
    assert isinstance(curve, SmoothRun)
    window = Lookahead(limits)
    window.append_parts(curve.parts, curve.samples, joined=False)
    sample(window.plan(), 0.0, 1, 10, limits.cycle)
    _drive_quicker(limits)
    _follow()


def _follow() -> None:
    """Compile the cycles of simulated drives."""
    pair = np.ones((2, 2))
    cycles = (0, 256, 1e-15)
    servos = (np.ones((7, 2)), np.ones((2, 4, 2)), np.ones((3, 2)), np.ones(2, np.int8))
    follow_cycles(*servos, pair, pair, cycles, 0.001, pair)


def _drive_quicker(limits: AxisLimits) -> None:
    """Compile the search for phases with acceleration at knots."""
    rows = np.ones((2, 5 * len(limits.velocity) + 2))
    offset, edges = np.array([0, 2]), np.array([0.0, 0.01])
    run = run_of(rows, offset, np.ones(1), limits.rows, limits.cycle)
    nodes, speeds = np.linspace(0.0, 0.01, 9), np.full(9, 0.1)
    quicker_phases(run, edges, np.ones((1, 4)), np.ones(1), 0, 1, nodes, speeds, (0.0, 0.0))


def main(part: str | None = None) -> None:
    """Compile a part, or all; in the background, do nothing while another process compiles."""
    if part == BACKGROUND:
        # do not slow down anything that somebody waits for
        if sys.platform != "win32":
            os.nice(NICE)
        with compiling_alone(wait=False) as alone:
            if not alone:
                return
        warm_up()
    elif part is not None:
        _call(Part(part))
    else:
        warm_up()


if __name__ == "__main__":
    main(*sys.argv[1:])
