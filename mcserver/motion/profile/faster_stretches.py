"""Stretches between zero-acceleration knots driven quicker, with acceleration at the knots too.

Knots with speed and no acceleration cost time where limits change all along, as on curves of changing
curvature: speed climbs in steps. Such a stretch, from one knot to a later one, is solved again as a whole by
`mcserver.motion.kernels.path_speed`. Both of its ends stay what they were, so motion can be cut, stopped and
planned on there as before; what has no quicker profile that keeps every limit stays as it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits
from mcserver.motion.kernels.groups import Groups
from mcserver.motion.kernels.path_speed import NODE_SHARE, NODES_APART, quicker_phases
from mcserver.motion.kernels.sample_limits import Run
from mcserver.motion.profile.velocity_profile import join_phases

# Nodes of one stretch at the most, after which there is a knot again to cut the motion at, and at the least.
MOST_NODES, FEWEST_NODES = 250, 8
# Ends that are tried for a stretch, and tries in a row after which the rest of a run stays as it is: what has
# no quicker profile here costs time to find out.
TRIES, MOST_FAILURES = 3, 9


@dataclass(frozen=True)
class Stretches:
    """A velocity profile, with its stretches driven quicker.

    Attributes:
        phases: rows of `mcserver.motion.kernels.phases`. sealed: those at whose start, or inside of which,
            the profile is not to be cut, shape (n,). knots, first: the knots that are left, and the first
            phase behind each.
    """

    phases: Array
    sealed: NDArray[np.bool_]
    knots: NDArray[np.intp]
    first: NDArray[np.intp]


def node_spacing(limits: AxisLimits) -> float:
    """Return the time between nodes [s]."""
    rise = float((limits.acceleration / limits.jerk).min())
    return min(max(NODE_SHARE * rise, NODES_APART[0]), NODES_APART[1])


def quicker_stretches(
    run: Run,
    groups: Groups,
    feeds: Array,
    limits: AxisLimits,
    phases: Array,
    knots: NDArray[np.intp],
    first: NDArray[np.intp],
    passed: bool,
) -> Stretches:
    """Solve the stretches between knots with speed anew.

    Args:
        feeds: of the run's segments, speeds by F, shape (s,).
        phases, knots, first: the profile as `KnotSolver` gives it. passed: a part of the first segment has
            been passed already.
    """
    sealed = np.zeros(len(phases), np.bool_)
    if not np.isfinite(limits.jerk).all():
        return Stretches(phases, sealed, knots, first)
    profile = join_phases(phases, float(groups.edges[-1]))
    moments = np.append(profile.start, profile.duration)[first]
    speeds = np.append(phases[:, 2], 0.0)[first]
    single = _single_segments(groups, passed)
    feed = _feeds_of(groups, feeds)
    apart = node_spacing(limits)
    parts: list[Array] = []
    seals: list[NDArray[np.bool_]] = []
    left: list[NDArray[np.intp]] = []
    starts: list[NDArray[np.intp]] = []
    count = index = failures = 0
    while index < len(knots) - 1:
        longest = MOST_NODES * apart
        last = _stretch_end(index, speeds, moments, longest)
        found = phases[:0]
        for _ in range(TRIES if speeds[index] > 0.0 and failures < MOST_FAILURES else 0):
            if speeds[last] <= 0.0:
                break
            nodes = max(math.ceil((moments[last] - moments[index]) / apart), FEWEST_NODES) + 1
            at, v = profile.at(np.linspace(moments[index], moments[last], nodes))
            at[0], at[-1] = groups.edges[knots[index]], groups.edges[knots[last]]
            v[0], v[-1] = speeds[index], speeds[last]
            ends = int(knots[index]), int(knots[last])
            found, worth = quicker_phases(run, groups.edges, single, feed, *ends, at, v)
            if len(found) or not worth or last == index + 1:
                break
            failures += 1
            longest = 0.4 * float(moments[last] - moments[index])
            last = _stretch_end(index, speeds, moments, longest)
        if len(found):
            rows, seal = found, np.ones(len(found), np.bool_)
            seal[0] = False
            kept, failures = slice(index, index + 1), 0
        else:
            rows = phases[first[index] : first[last]]
            seal = np.zeros(len(rows), np.bool_)
            kept = slice(index, last)
        left.append(knots[kept])
        starts.append(first[kept] - first[index] + count)
        parts.append(rows)
        seals.append(seal)
        count += len(rows)
        index = last
    left.append(knots[-1:])
    starts.append(np.array([count]))
    return Stretches(
        np.concatenate(parts), np.concatenate(seals), np.concatenate(left), np.concatenate(starts)
    )


def _stretch_end(index: int, speeds: Array, moments: Array, longest: float) -> int:
    """Return the last knot of the stretch that begins at a knot.

    All of them with speed, as long as that takes no longer than ``longest`` [s]; then the slowest one of the
    last half, where a bend rather than what is about it says how fast it is.
    """
    last = index + 1
    if speeds[index] <= 0.0 or speeds[last] <= 0.0:
        return last
    while last < len(speeds) - 1 and speeds[last + 1] > 0.0:
        if moments[last + 1] - moments[index] > longest:
            half = int(np.searchsorted(moments, moments[index] + 0.5 * longest))
            first = min(max(half, index + 1), last)
            return first + int(np.argmin(speeds[first : last + 1]))
        last += 1
    return last


def _feeds_of(groups: Groups, feeds: Array) -> Array:
    """Return the least speed by F of the segments of each group, shape (n,)."""
    least: Array = np.minimum.reduceat(feeds, groups.starts)
    return least


def _single_segments(groups: Groups, passed: bool) -> NDArray[np.bool_]:
    """Return which groups are one whole segment, shape (n,)."""
    ends = np.append(groups.starts[1:], len(groups.bounds) - 1)
    single: NDArray[np.bool_] = ends - groups.starts == 1
    # parts of one long segment share its samples
    single[1:] &= groups.starts[1:] != groups.starts[:-1]
    if passed:
        single[0] = False
    return single
