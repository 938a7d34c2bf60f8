"""Replace the profile over several zero-acceleration knots by a faster one, with acceleration at inner knots.

Knots cost time where limits change all along, as on curves of changing curvature: speed climbs in steps. A
stretch, from one knot to a later one, is solved again as a whole by `mcserver.motion.kernels.path_speed`. Its
end knots stay, so that the motion can still be cut, stopped and replanned there; so does the first or last
phase at a rest. Where no faster profile keeps every limit, the stretch stays as it was.
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

# Longest stretch: its end is a knot again, at which the motion can be cut [s].
LONGEST_S = 1.0
# Fewest node intervals of a stretch.
FEWEST_NODES = 8
# Ends that are tried for one stretch.
TRIES = 3
# Failures in a row after which the rest of a run is not tried: each costs computing time.
MOST_FAILURES = 9
# A stretch may end at a bottleneck after this share of the longest time.
FIRST_PART = 0.2
# Least duration of the phase next to a rest [node intervals].
REST_NODES = 2.0


@dataclass(frozen=True)
class KnotProfile:
    """A velocity profile between knots.

    Attributes:
        phases: rows of `mcserver.motion.kernels.phases`. knots, first: the knots, and the first phase after
            each, shape (k,). uncut: as in `Phases`, shape (n,); None: no phase.
    """

    phases: Array
    knots: NDArray[np.intp]
    first: NDArray[np.intp]
    uncut: NDArray[np.bool_] | None = None


def node_spacing(acceleration: Array, jerk: Array) -> float:
    """Return the time between nodes for these limits of the axes that move [s]."""
    rise = float((acceleration / jerk).min())
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
    """Return a knot profile with faster stretches.

    Args:
        feed: greatest speeds of the groups by F, or by a T that they cannot keep, shape (n,).
        given: the profile of `KnotSolver`. spans: `sample_spans` of the groups. in_time: groups that keep
            their T, which stay as they are, shape (n,). stops: the stop at the end is final, so it may be
            solved again too.
    """
    moved = run.rows[:, : len(limits.jerk)].any(axis=0)
    if not np.isfinite(limits.jerk[moved]).all():
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
        node_spacing(limits.acceleration[moved], limits.jerk[moved]),
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
    """The knot profile of a run, and what is needed to solve its stretches again.

    Attributes:
        spans, feed, stops: see `quicker_stretches`. at_vertex: groups with a vertex, whose zone lies within
            them. profile, given: of `KnotSolver`.
        moments: times of the knots [s]. speeds: at the knots. apart: time between nodes [s]. kept: whether a
            group between each knot and the next one keeps its T, shape (k-1,).
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
            Its phases, none where no faster profile was found; and whether one was searched for.
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

        That is the next rest, or the next knot before a group that keeps its T, if it is reached within
        ``longest`` [s]. Else the slowest bottleneck after the first part of that time: speed is least there
        in any profile, so an end without acceleration costs nothing. Else the slowest knot of the second
        half. As long as lines come, the ramp to the stop at the very end stays: a plan is cut before it.
        Ramps from and to other rests stay where their phases are too short for the spacing of nodes.
        """
        last, final = index + 1, len(self.speeds) - 1
        first = self.given.first
        if self.kept[index] or self._abrupt(index, first[index]):
            return last
        while last < final and self.speeds[last] > 0.0 and not self.kept[last]:
            if last + 1 == final and self.speeds[final] <= 0.0 and not self.stops:
                break
            if self.moments[last + 1] - self.moments[index] > longest:
                return self._slowest_bottleneck(index, last, longest)
            last += 1
        return last - 1 if last > index + 1 and self._abrupt(last, first[last] - 1) else last

    def _abrupt(self, knot: int, phase: int) -> bool:
        """Return whether the motion rests at a knot, and the phase beside it is too short to stay."""
        return bool(self.speeds[knot] <= 0.0 and self.given.phases[phase, 0] < REST_NODES * self.apart)

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
    """Return which phases between two knots are solved again.

    All but the first one after a rest and the last one before a rest, which use all the jerk already.

    Args:
        rows: the phases. rests: whether the motion rests at the first knot and at the last. apart: time
            between nodes [s].

    Returns:
        None where such a phase is too short for the spacing of nodes.
    """
    start, stop = int(rests[0]), len(rows) - int(rests[1])
    if start >= stop:
        return None
    if (rests[0] and rows[0, 0] < REST_NODES * apart) or (rests[1] and rows[-1, 0] < REST_NODES * apart):
        return None
    return slice(start, stop)


def _at_vertices(run: Run) -> NDArray[np.bool_]:
    """Return which groups have a vertex with a step of velocity, shape (n,)."""
    width = run.limits.shape[1]
    steps = (run.rows[:, 3 * width : 4 * width] > 0.0).any(axis=1)
    found: NDArray[np.bool_] = np.logical_or.reduceat(steps, run.offset[:-1])
    return found
