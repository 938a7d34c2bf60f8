"""Stretches between zero-acceleration knots driven quicker, with acceleration at the knots too.

Knots with speed and no acceleration cost time where limits change all along, as on curves of changing
curvature: speed climbs in steps. Such a stretch, from one knot to a later one, is solved again as a whole by
`mcserver.motion.kernels.path_speed`. Both of its ends stay what they were, so motion can be cut, stopped and
planned on there as before; beside a rest, so does the phase that leads from or to it; what has no quicker profile that keeps every limit stays as it was.
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
# Share of the longest stretch behind which it may end at a bottleneck.
FIRST_PART = 0.2
# Nodes that the phase beside a rest is long, at least.
REST_NODES = 2.0


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
        for _ in range(TRIES if failures < MOST_FAILURES else 0):
            rows = phases[first[index] : first[last]]
            ends = _inner(rows, (speeds[index] <= 0.0, speeds[last] <= 0.0 and last < len(knots) - 1), apart)
            if ends is None or (speeds[last] <= 0.0 and last == len(knots) - 1):
                break
            between = rows[ends]
            begin, end = moments[index] + rows[: ends.start, 0].sum(), moments[last] - rows[ends.stop :, 0].sum()
            nodes = max(math.ceil((end - begin) / apart), FEWEST_NODES) + 1
            at, v = profile.at(np.linspace(begin, end, nodes))
            at[0], v[0] = between[0, 1:3]
            at[-1], v[-1], steep = (
                (*rows[ends.stop, 1:3], rows[ends.stop, 3])
                if ends.stop < len(rows)
                else (groups.edges[knots[last]], speeds[last], 0.0)
            )
            steepness = float(between[0, 3]), float(steep)
            edges = int(knots[index]), int(knots[last])
            solved, worth = quicker_phases(run, groups.edges, single, feed, *edges, at, v, steepness)
            if len(solved):
                found = np.concatenate((rows[: ends.start], solved, rows[ends.stop :]))
            if len(solved) or not worth or last == index + 1:
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


def _inner(rows: Array, rests: tuple[bool, bool], apart: float) -> slice | None:
    """Return which phases between two knots are solved anew.

    All but the first one behind a rest and the last one before a rest, which have all the jerk there is.

    Args:
        rows: the phases. rests: whether the motion rests at the first knot and at the last. apart: time
            between nodes [s].

    Returns:
        None where such a phase is too short for nodes to follow what comes behind it.
    """
    start, stop = int(rests[0]), len(rows) - int(rests[1])
    if start >= stop:
        return None
    if (rests[0] and rows[0, 0] < REST_NODES * apart) or (rests[1] and rows[-1, 0] < REST_NODES * apart):
        return None
    return slice(start, stop)


def _stretch_end(index: int, speeds: Array, moments: Array, longest: float) -> int:
    """Return the last knot of the stretch that begins at a knot.

    All of them up to the next rest, as long as that takes no longer than ``longest`` [s]; then the slowest
    bottleneck behind the first part: there the bend rather than what is about it says how fast it is, so a
    stretch loses nothing by an end without acceleration. Without a bottleneck, the slowest knot of the last
    half. The stop at the very end is left as it is: a plan is cut before it, as long as lines come.
    """
    last, final = index + 1, len(speeds) - 1
    while last < final and speeds[last] > 0.0 and not (last + 1 == final and speeds[final] <= 0.0):
        if moments[last + 1] - moments[index] > longest:
            return _slowest_bottleneck(index, last, speeds, moments, longest)
        last += 1
    return last


def _slowest_bottleneck(index: int, last: int, speeds: Array, moments: Array, longest: float) -> int:
    inner = np.arange(index + 1, last + 1)
    inner = inner[moments[inner] - moments[index] >= FIRST_PART * longest]
    lowest = inner[(speeds[inner] <= speeds[inner - 1]) & (speeds[inner] <= speeds[inner + 1])]
    if len(lowest):
        return int(lowest[np.argmin(speeds[lowest])])
    half = int(np.searchsorted(moments, moments[index] + 0.5 * longest))
    first = min(max(half, index + 1), last)
    return first + int(np.argmin(speeds[first : last + 1]))


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
