"""Stretches between zero-acceleration knots driven quicker, with acceleration at the knots too.

Knots with speed and no acceleration cost time where limits change all along, as on curves of changing
curvature: speed climbs in steps. Such a stretch, from one knot to a later one, is solved again as a whole by
`mcserver.motion.kernels.path_speed`. Both of its ends stay what they were, so motion can be cut, stopped and
planned on there as before; beside a rest, so does the phase that leads from or to it. What has no quicker
profile that keeps every limit stays as it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits
from mcserver.motion.kernels.groups import Groups, SegmentColumns
from mcserver.motion.kernels.path_speed import NODE_SHARE, NODES_APART, quicker_phases
from mcserver.motion.kernels.sample_limits import Run
from mcserver.motion.profile.velocity_profile import Phases, join_phases

# Time of one stretch at the most [s], after which there is a knot again to cut the motion at, and nodes at
# the least.
LONGEST_S, FEWEST_NODES = 1.0, 8
# Ends that are tried for a stretch, and tries in a row after which the rest of a run stays as it is: what has
# no quicker profile here costs time to find out.
TRIES, MOST_FAILURES = 3, 9
# Share of the longest stretch behind which it may end at a bottleneck.
FIRST_PART = 0.2
# Nodes that the phase beside a rest is long, at least.
REST_NODES = 2.0


@dataclass(frozen=True)
class KnotProfile:
    """A velocity profile between knots.

    Attributes:
        phases: rows of `mcserver.motion.kernels.phases`. knots, first: the knots, and the first phase behind
            each, shape (k,). uncut: phases at whose start, or inside of which, the profile is not to be cut,
            shape (n,); None: there are none.
    """

    phases: Array
    knots: NDArray[np.intp]
    first: NDArray[np.intp]
    uncut: NDArray[np.bool_] | None = None


def node_spacing(limits: AxisLimits) -> float:
    """Return the time between nodes [s]."""
    rise = float((limits.acceleration / limits.jerk).min())
    return min(max(NODE_SHARE * rise, NODES_APART[0]), NODES_APART[1])


def quicker_stretches(
    run: Run,
    groups: Groups,
    feed: Array,
    limits: AxisLimits,
    given: KnotProfile,
    spans: Array,
    *,
    in_time: NDArray[np.bool_],
    stops: bool = False,
) -> KnotProfile:
    """Solve the stretches between knots with speed anew.

    Args:
        feed: greatest speeds of the groups by F, or by a T that they cannot keep, shape (n,).
        given: the profile as `KnotSolver` gives it. spans: `sample_spans` of the groups. in_time: groups
            that take their T, and stay as they are, shape (n,). stops: the motion ends with the stop at the
            end, which is then quickened too.
    """
    if not np.isfinite(limits.jerk).all():
        return given
    phases, knots, first = given.phases, given.knots, given.first
    profile = join_phases(phases, float(groups.edges[-1]))
    known = _Known(
        run,
        groups.edges,
        spans,
        _at_vertices(run),
        feed,
        profile,
        given,
        np.append(profile.start, profile.duration)[first],
        np.append(phases[:, 2], 0.0)[first],
        node_spacing(limits),
        np.logical_or.reduceat(in_time, knots[:-1]),
        stops,
    )
    parts: list[Array] = []
    uncut_parts: list[NDArray[np.bool_]] = []
    left: list[NDArray[np.intp]] = []
    starts: list[NDArray[np.intp]] = []
    count = index = failures = 0
    while index < len(knots) - 1:
        longest = LONGEST_S
        last = known.stretch_end(index, longest)
        found = phases[:0]
        for _ in range(TRIES if failures < MOST_FAILURES else 0):
            found, looked = known.solved_anew(index, last)
            if len(found) or not looked or last == index + 1:
                break
            failures += 1
            longest = 0.4 * float(known.moments[last] - known.moments[index])
            last = known.stretch_end(index, longest)
        if len(found):
            rows, uncut = found, np.ones(len(found), np.bool_)
            uncut[0] = False
            kept, failures = slice(index, index + 1), 0
        else:
            rows = phases[first[index] : first[last]]
            uncut = np.zeros(len(rows), np.bool_)
            kept = slice(index, last)
        left.append(knots[kept])
        starts.append(first[kept] - first[index] + count)
        parts.append(rows)
        uncut_parts.append(uncut)
        count += len(rows)
        index = last
    left.append(knots[-1:])
    starts.append(np.array([count]))
    return KnotProfile(
        np.concatenate(parts), np.concatenate(left), np.concatenate(starts), np.concatenate(uncut_parts)
    )


def sample_spans(groups: Groups, columns: SegmentColumns) -> Array:
    """Return where the samples of groups stand along σ, for `quicker_phases`, shape (n, 4)."""
    first = groups.starts
    ends = np.append(first[1:], len(groups.bounds) - 1)
    single = ends - first == 1
    # zones of one long segment share its samples
    own_start = first[1:] != first[:-1]
    single[1:] &= own_start
    single[:-1] &= own_start
    before = columns.vertex_before[first]
    own = np.diff(groups.offset) - before - columns.vertex_after[first]
    start = groups.bounds[first] - columns.begin[first]
    return np.column_stack((start, columns.whole[first], np.where(single, own, 0), before))


@dataclass(frozen=True)
class _Known:
    """What is known of a run.

    Attributes:
        spans, feed, stops: see `quicker_stretches`. at_vertex: groups with a vertex, which have all that is
            about it. profile, given: as `KnotSolver` gives it.
        moments, speeds: at the knots [s]. apart: time between nodes [s]. kept: which knots have a group that
            takes its T between them and the next one, shape (k-1,).
    """

    run: Run
    edges: Array
    spans: Array
    at_vertex: NDArray[np.bool_]
    feed: Array
    profile: Phases
    given: KnotProfile
    moments: Array
    speeds: Array
    apart: float
    kept: NDArray[np.bool_]
    stops: bool

    def solved_anew(self, index: int, last: int) -> tuple[Array, bool]:
        """Solve the stretch from one knot to a later one.

        Returns:
            Its phases, none where there is nothing quicker; and whether it was looked for.
        """
        given = self.given
        rows = given.phases[given.first[index] : given.first[last]]
        if self.kept[index]:
            return rows[:0], False
        rests = bool(self.speeds[index] <= 0.0), bool(self.speeds[last] <= 0.0)
        inner = _inner(rows, rests, self.apart)
        if inner is None or (rests[1] and last == len(given.knots) - 1 and not self.stops):
            return rows[:0], False
        inner, edges = self._between_vertices(rows, inner, index, last)
        if inner.start >= inner.stop:
            return rows[:0], False
        before, between, after = rows[: inner.start], rows[inner], rows[inner.stop :]
        begin = self.moments[index] + before[:, 0].sum()
        end = self.moments[last] - after[:, 0].sum()
        count = max(math.ceil((end - begin) / self.apart), FEWEST_NODES) + 1
        at, v = self.profile.at(np.linspace(begin, end, count))
        at[0], v[0], push = between[0, 1:4]
        at[-1], v[-1], pull = self.edges[given.knots[last]], self.speeds[last], 0.0
        if len(after):
            at[-1], v[-1], pull = after[0, 1:4]
        found, looked = quicker_phases(
            self.run, self.edges, self.spans, self.feed, *edges, at, v, (float(push), float(pull))
        )
        return np.concatenate((before, found, after)) if len(found) else found, looked

    def _between_vertices(
        self, rows: Array, inner: slice, index: int, last: int
    ) -> tuple[slice, tuple[int, int]]:
        """Return which of the phases between two knots are clear of vertices, and their groups' edges.

        A vertex is passed as it was planned: those of the first half are left before, those of the last
        behind.
        """
        left, right = int(self.given.knots[index]), int(self.given.knots[last])
        vertices = left + np.flatnonzero(self.at_vertex[left:right])
        if not len(vertices):
            return inner, (left, right)
        middle = self.profile.at(np.array([0.5 * (self.moments[index] + self.moments[last])]))[0][0]
        begin, end = inner.start, inner.stop
        split = int(np.searchsorted(self.edges[vertices], middle))
        if split > 0:
            left = int(vertices[split - 1]) + 1
            begin = max(begin, int(np.searchsorted(rows[:, 1], self.edges[left])))
        if split < len(vertices):
            right = int(vertices[split])
            end = min(end, int(np.searchsorted(rows[:, 1], self.edges[right], side="right")) - 1)
        return slice(begin, end), (left, right)

    def stretch_end(self, index: int, longest: float) -> int:
        """Return the last knot of the stretch that begins at a knot.

        All of them up to the next rest, or to a group that takes its T, as long as that takes no longer than
        ``longest`` [s]; then the slowest bottleneck behind the first part: there the bend rather than what is
        about it says how fast it is, so a stretch loses nothing by an end without acceleration. Without a
        bottleneck, the slowest knot of the last half. As long as lines come, the stop at the very end is left
        as it is: a plan is cut before it.
        """
        last, final = index + 1, len(self.speeds) - 1
        if self.kept[index]:
            return last
        while last < final and self.speeds[last] > 0.0 and not self.kept[last]:
            if last + 1 == final and self.speeds[final] <= 0.0 and not self.stops:
                break
            if self.moments[last + 1] - self.moments[index] > longest:
                return self._slowest_bottleneck(index, last, longest)
            last += 1
        return last

    def _slowest_bottleneck(self, index: int, last: int, longest: float) -> int:
        speeds, taken = self.speeds, self.moments - self.moments[index]
        inner = np.arange(index + 1, last + 1)
        inner = inner[taken[inner] >= FIRST_PART * longest]
        lowest = inner[(speeds[inner] <= speeds[inner - 1]) & (speeds[inner] <= speeds[inner + 1])]
        if len(lowest):
            return int(lowest[np.argmin(speeds[lowest])])
        half = int(np.searchsorted(taken, 0.5 * longest))
        first = min(max(half, index + 1), last)
        return first + int(np.argmin(speeds[first : last + 1]))


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


def _at_vertices(run: Run) -> NDArray[np.bool_]:
    """Return in which groups a vertex asks for a step of velocity, shape (n,)."""
    width = run.limits.shape[1]
    steps = (run.rows[:, 3 * width : 4 * width] > 0.0).any(axis=1)
    found: NDArray[np.bool_] = np.logical_or.reduceat(steps, run.offset[:-1])
    return found
