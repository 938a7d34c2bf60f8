"""Time laws over many segments: no stop where none is needed, no limit broken anywhere (D-33, D-35, D-36).

A *run* is a chain of segments on one coordinate σ, scaled so that speed along it is continuous where
the tangent is. Its nodes are the joints, each with the greatest speed at which it can be passed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.kernels.corners import SHORT
from mcserver.motion.kernels.joints import meet_lines
from mcserver.motion.kernels.ramps import reachable_speed
from mcserver.motion.keys import KeySolver, Solution
from mcserver.motion.limits import RunLimits, SpeedLimit, junction, samples_of
from mcserver.motion.node import Bound, Node, PlanningError
from mcserver.motion.path import Array
from mcserver.motion.profile import Phases, ProfileSolver, time_law
from mcserver.motion.segment import AxisLimits, Segment, StraightRun

# Cycles that a group of segments may last, and how alike their speeds have to be.
GROUP = 4.0
SAME = 0.9
# Late segments of one window that stops are tried for.
MOST_STOPS = 8


@dataclass(frozen=True)
class PlannedRun:
    """A time law over segments.

    Attributes:
        segments: in order. bounds: σ at their starts and at the end, shape (n+1,).
        phases: σ over time. times: at ``bounds``, shape (n+1,) [s].
        bound_by: for each segment what limit stretched it, or None.
    """

    segments: list[Segment]
    bounds: Array
    phases: Phases
    times: Array
    bound_by: list[Bound | None]


@dataclass(frozen=True)
class _Samples:
    """Samples of all nodes.

    Attributes:
        rows: see `mcserver.motion.kernels.limits`. offset: the groups' first rows, and one past the last.
        vertices: rows at the ends of timed segments, with the node that each stands at.
    """

    rows: Array
    offset: NDArray[np.intp]
    vertices: list[tuple[int, int]]

    def under(self, caps: Array) -> Array:
        """The rows where a vertex at the end of a timed segment asks for no more than its cap does."""
        if not self.vertices:
            return self.rows
        rows = self.rows.copy()
        for row, node in self.vertices:
            rows[row, -1] = min(rows[row, -1], caps[node])
        return rows


class Lookahead:
    """Collects segments into a run and gives its time law."""

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits
        self._solver = ProfileSolver()
        self._starts: NDArray[np.intp]
        self.nodes: list[Node] = []
        self.entry = 0.0

    def append(self, segment: Segment, *, from_rest: bool = False) -> None:
        """Joins a segment that travels to the run; the joint's cap says whether it can flow."""
        cap = 0.0
        vertex: Array | None = None
        if not from_rest and self.nodes:
            last = self.nodes[-1]
            met = junction(last.segment, segment, self._limits)
            cap, segment.scale = met.speed, met.scale
            if met.samples is not None:
                vertex = met.samples[1:]
                # a node may be in a plan that is held in reserve: it is not changed
                self.nodes[-1] = dataclasses.replace(last, vertex_after=met.samples[:1])
        samples, limit = samples_of(segment, self._limits)
        top = min(limit.velocity, segment.feed * segment.scale)
        self.nodes.append(Node(segment, cap, limit, top, samples, vertex_before=vertex))

    def append_run(self, run: StraightRun, active: int, *, from_rest: bool = False) -> None:
        """Joins segments on end, as `append` does one by one."""
        count, width = run.travels.shape
        rows = np.zeros((count, 5 * width + 2))
        vertices = np.zeros((count, 2, 5 * width + 2))
        scales = run.scales.copy()
        caps, speeds, columns = np.empty(count), np.empty(count), np.empty(count, np.intp)
        last, bend, scale = run.travels[0], run.travels[0], 0.0
        if self.nodes and not from_rest:
            before = self.nodes[-1].segment
            last, bend, scale = before.last, before.bend_last, before.scale
        meet_lines(
            run.travels,
            scales,
            last,
            bend,
            scale,
            self._limits.rows,
            self._limits.cycle,
            rows,
            vertices,
            caps,
            speeds,
            columns,
        )
        tops = np.minimum(speeds, run.feeds * scales).tolist()
        limits = zip(speeds.tolist(), columns.tolist(), strict=True)
        bounded = (np.isfinite(caps) & (caps > 0.0)).tolist()
        segments = run.segments(scales.tolist(), active)
        for index, (segment, cap, limit) in enumerate(zip(segments, caps.tolist(), limits, strict=True)):
            node = Node(segment, cap, SpeedLimit(*limit, "velocity"), tops[index], rows[index : index + 1])
            if bounded[index]:
                if index == 0:
                    # a node may be in a plan that is held in reserve: it is not changed
                    self.nodes[-1] = dataclasses.replace(self.nodes[-1])
                self.nodes[-1].vertex_after = vertices[index, :1]
                node.vertex_before = vertices[index, 1:]
            self.nodes.append(node)

    def joint_speed(self, segment: Segment) -> float:
        """Greatest speed over the joint with a segment that is not in the run yet [m/s or rad/s along σ]."""
        return junction(self.nodes[-1].segment, segment, self._limits).speed if self.nodes else 0.0

    def replace_last(self, segment: Segment) -> None:
        """Puts a trimmed segment in the place of the last one."""
        self.nodes[-1] = dataclasses.replace(self.nodes[-1], segment=segment)

    def enter_fast(self) -> None:
        """Sets the entry to the speed that the first segment could have reached from rest in its own
        length."""
        first = self.nodes[0]
        rows = np.concatenate(first.rows)
        run = RunLimits(rows, np.array([0, len(rows)]), np.array([first.top]), self._limits)
        acceleration, jerk = run.weakest(0, 1)
        whole = first.segment.scale
        self.entry = 0.5 * reachable_speed(0.0, whole, acceleration, jerk, float(run.tops[0]))

    # ------------------------------------------------------------------ planning

    def plan(self) -> PlannedRun:
        """The time law of the whole run from `entry` speed to rest."""
        nodes = self.nodes
        count = len(nodes)
        bounds = np.concatenate([[0.0], np.cumsum([node.segment.extent for node in nodes])])
        caps = np.empty(count + 1)
        caps[:-1] = [node.cap for node in nodes]
        caps[0], caps[-1] = self.entry, 0.0
        tops = np.array([node.top for node in nodes])
        # a segment of few cycles is hardly faster than its joints are
        joints = np.maximum(caps[:-1], caps[1:])
        short = np.diff(bounds) < SHORT * self._limits.cycle * joints
        tops[short] = np.minimum(tops[short], joints[short])
        inner = np.minimum(caps[1:-1], np.minimum(tops[:-1], tops[1:]))
        caps[1:-1] = inner
        starts = self._groups(bounds, caps, tops)
        # from here on everything is about groups of segments
        self._starts = starts
        edges = bounds[np.append(starts, count)]
        hard = np.append(caps[starts], 0.0)
        caps = self._with_nominal(hard)
        group_tops = self._tops_of(starts, tops, inner)
        first = [nodes[index] for index in starts.tolist()]
        solver = KeySolver(self._solver, self._limits, first, edges, self.entry)
        samples = self._samples(starts)

        def attempt(caps: Array) -> Solution:
            solver.run = RunLimits(samples.under(caps), samples.offset, group_tops, self._limits)
            bound = caps.copy()
            bound[1:-1] = np.minimum(bound[1:-1], np.minimum(solver.run.tops[:-1], solver.run.tops[1:]))
            return solver.solve(_first_keys(first, bound), bound)

        solution = attempt(caps)
        if solution.late and solver.raise_speeds(solution.late, solution.speeds, caps, hard):
            solution = attempt(caps)
        if solution.late:
            solution = self._with_stops(solution, caps, attempt)
        phases = time_law(solution.phases, float(edges[-1]))
        times = phases.time_at(bounds)
        # at keys the time law's own times are exact; where the motion rests, positions tell time poorly
        at_keys = np.append(phases.start, phases.duration)[solution.first]
        times[np.append(starts, count)[solution.keys]] = at_keys
        bound_by: list[Bound | None] = [None] * count
        for group, index in enumerate(starts.tolist()):
            bound_by[index] = solution.bound_by[group]
        self._feed_bounds(times, bound_by)
        return PlannedRun([node.segment for node in nodes], bounds, phases, times, bound_by)

    def _with_nominal(self, hard: Array) -> Array:
        """Caps of groups with the mean speeds of timed segments at both of their ends (D-33)."""
        caps = hard.copy()
        for group, index in enumerate(self._starts.tolist()):
            segment = self.nodes[index].segment
            if segment.duration is not None:
                nominal = segment.extent / segment.duration
                for end in (group, group + 1):
                    if 0 < end < len(caps) - 1:
                        caps[end] = min(caps[end], nominal)
        return caps

    def _samples(self, starts: NDArray[np.intp]) -> _Samples:
        parts: list[Array] = []
        lengths: list[int] = []
        vertices: list[tuple[int, int]] = []
        group, at = -1, 0
        first = set(starts.tolist())
        for index, node in enumerate(self.nodes):
            group += index in first
            parts.append(node.samples)
            length = len(node.samples)
            if node.vertex_before is not None:
                parts.append(node.vertex_before)
                length += 1
            if node.vertex_after is not None:
                parts.append(node.vertex_after)
                length += 1
            at += length
            lengths.append(length)
            if node.segment.duration is not None:
                if node.vertex_after is not None:
                    vertices.append((at - 1, group + 1))
                if node.vertex_before is not None:
                    vertices.append((at - 1 - (node.vertex_after is not None), group))
        ends = np.concatenate([[0], np.cumsum(lengths)])
        return _Samples(np.concatenate(parts), ends[np.append(starts, len(self.nodes))], vertices)

    def _with_stops(self, solution: Solution, caps: Array, attempt: Callable[[Array], Solution]) -> Solution:
        """Stops at vertices beside timed segments that are late, where that lets more of them keep their T.

        A vertex that is passed with speed takes its part of the acceleration of the whole segment.
        """
        for group in solution.late[:MOST_STOPS]:
            for ends in ((group,), (group + 1,), (group, group + 1)):
                inner = [end for end in ends if 0 < end < len(caps) - 1 and caps[end] > 0.0]
                if len(inner) < len(ends):
                    continue
                trial = caps.copy()
                trial[inner] = 0.0
                try:
                    other = attempt(trial)
                except PlanningError:
                    continue
                if len(other.late) < len(solution.late):
                    solution = other
                    caps[inner] = 0.0
                    break
        return solution

    def _groups(self, bounds: Array, caps: Array, tops: Array) -> NDArray[np.intp]:
        """First segments of groups that are planned as one: short ones under nearly the same speed.

        A group is passed at the lowest of its caps; its segments together last few cycles, so hardly anything
        is lost, and a curve made of very short lines is planned in steps of milliseconds.
        """
        starts = [0]
        span = GROUP * self._limits.cycle
        low = high = float(tops[0])
        lengths = np.diff(bounds).tolist()
        length = lengths[0]
        inner, own = caps.tolist(), tops.tolist()
        for index in range(1, len(lengths)):
            node = self.nodes[index]
            least = min(low, inner[index], own[index])
            most = max(high, own[index])
            alone = (
                node.key
                or node.segment.duration is not None
                or self.nodes[starts[-1]].segment.duration is not None
                or least < SAME * most
                or length + lengths[index] > span * least
            )
            if alone:
                starts.append(index)
                low = high = own[index]
                length = lengths[index]
            else:
                low, high = least, most
                length += lengths[index]
        return np.array(starts, dtype=np.intp)

    @staticmethod
    def _tops_of(starts: NDArray[np.intp], tops: Array, inner: Array) -> Array:
        """Top speeds of groups: the lowest of their segments and of the joints between these."""
        joints = np.append(np.inf, inner)
        joints[starts] = np.inf
        result: Array = np.minimum.reduceat(np.minimum(tops, joints), starts)
        return result

    def _feed_bounds(self, times: Array, bound_by: list[Bound | None]) -> None:
        for index, node in enumerate(self.nodes):
            segment = node.segment
            slower = node.limit.velocity < segment.feed * segment.scale * (1.0 - 1e-9)
            longer = times[index + 1] - times[index] > segment.requested * (1.0 + 1e-9)
            if segment.duration is None and slower and longer:
                bound_by[index] = Bound(node.limit.column, node.limit.kind)


def _first_keys(nodes: list[Node], caps: Array) -> list[int]:
    """Nodes at which acceleration is zero from the outset: about timed segments, at stops, as last time."""
    keys = [0]
    for group in range(1, len(nodes)):
        timed = nodes[group].segment.duration is not None or nodes[group - 1].segment.duration is not None
        if timed or caps[group] <= 0.0 or nodes[group].key:
            keys.append(group)
    return [*keys, len(nodes)]
