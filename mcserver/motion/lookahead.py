"""Time laws over many segments: no stop where none is needed, no limit broken anywhere (D-33, D-35, D-36).

A *run* is a chain of segments on one coordinate σ. Its nodes are the joints. Key nodes, at which acceleration
is zero, are found by the caps that bind: a stretch between two keys is solved as if nothing bound it; where the
result passes a cap, the lowest such cap becomes a key and both sides are solved again. Segments of G93 stand
between keys of their own, since each has its T.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.limits import (
    Demand,
    Junction,
    Level,
    RunLimits,
    SpeedLimit,
    junction,
    samples_of,
    speed_limit,
)
from mcserver.motion.path import Array
from mcserver.motion.profile import Phases, Profile, ProfileSolver, join, reachable_speed
from mcserver.motion.ramps import exactly, fastest, reachable
from mcserver.motion.segment import AxisLimits, Segment

_SLACK = 1.0 + 1e-9
# Cycles below which a segment's own top speed is that of its joints.
SHORT = 5.0
# Cycles that a group of segments may last, and how alike their speeds have to be.
GROUP = 4.0
SAME = 0.9


@dataclass
class Node:
    """A segment with what is known of it alone.

    Attributes:
        cap: greatest speed at its start, from the joint with the segment before.
        limit: greatest speed by the axes, and which one binds. top: with the feed too.
        demand: samples; the last ones are the vertices at its start and its end, where there are such.
        key: a plan had to bind its start; the next one begins with that.
    """

    segment: Segment
    cap: float
    limit: SpeedLimit
    top: float
    demand: Demand
    key: bool = False
    vertex_before: bool = False
    vertex_after: bool = False


@dataclass(frozen=True)
class Bound:
    """What stretched a segment: column and kind of limit."""

    column: int
    kind: str


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
class _Solution:
    """Key nodes, their speeds, the profiles between them, and what stretched timed segments."""

    keys: list[int]
    speeds: dict[int, float]
    stretches: list[list[Profile]]
    bound_by: list[Bound | None]


class Lookahead:
    """Collects segments into a run and gives its time law."""

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits
        self._solver = ProfileSolver()
        self._run: RunLimits
        self._starts: NDArray[np.intp]
        self.nodes: list[Node] = []
        self.entry = 0.0

    def append(self, segment: Segment, *, from_rest: bool = False) -> None:
        """Joins a segment that travels to the run; the joint's cap says whether it can flow."""
        met = Junction(0.0, None) if from_rest else self._joint(segment)
        demand = samples_of(segment, len(self._limits.velocity))
        limit = speed_limit(demand, self._limits)
        if met.demand is not None:
            demand = Demand.stack([demand, met.demand])
            last = self.nodes[-1]
            self.nodes[-1] = dataclasses.replace(
                last, demand=Demand.stack([last.demand, met.demand]), vertex_after=True
            )
        top = min(limit.velocity, segment.feed * segment.scale)
        self.nodes.append(
            Node(segment, met.speed, limit, top, demand, vertex_before=met.demand is not None)
        )

    def _joint(self, segment: Segment) -> Junction:
        """How the run meets ``segment``; scales its coordinate so that speed is continuous where it can flow."""
        if not self.nodes:
            return Junction(0.0, None)
        before = self.nodes[-1].segment
        end = math.sqrt(float(before.last @ before.last))
        begin = math.sqrt(float(segment.first @ segment.first))
        if end <= 0.0 or begin <= 0.0:
            return Junction(0.0, None)
        natural = segment.scale
        segment.scale = begin * before.scale / end
        met = junction(before, segment, self._limits)
        if met.speed <= 0.0:
            segment.scale = natural
        return met

    def joint_speed(self, segment: Segment) -> float:
        """Greatest speed over the joint with a segment that is not in the run yet [m/s or rad/s along σ]."""
        natural = segment.scale
        speed = self._joint(segment).speed
        segment.scale = natural
        return speed

    def replace_last(self, segment: Segment) -> None:
        """Puts a trimmed segment in the place of the last one."""
        self.nodes[-1] = dataclasses.replace(self.nodes[-1], segment=segment)

    def enter_fast(self) -> None:
        """Sets the entry to the speed that the first segment could have reached from rest in its own length."""
        first = self.nodes[0]
        run = RunLimits([first.demand], np.zeros(1, np.intp), np.array([first.top]), self._limits)
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
        self._run = RunLimits(self._demands(caps), starts, group_tops, self._limits)
        caps[1:-1] = np.minimum(caps[1:-1], np.minimum(self._run.tops[:-1], self._run.tops[1:]))
        groups = len(starts)
        keys = [0]
        for group in range(1, groups):
            node = nodes[starts[group]]
            timed = node.segment.duration is not None or nodes[starts[group - 1]].segment.duration is not None
            if timed or caps[group] <= 0.0 or node.key:
                keys.append(group)
        keys.append(groups)
        solution = self._settle(keys, edges, caps)
        late = [group for group in range(groups) if solution.bound_by[group] is not None]
        if late and self._raise_speeds(late, solution.speeds, caps, hard):
            self._run = RunLimits(self._demands(caps), starts, group_tops, self._limits)
            caps[1:-1] = np.minimum(caps[1:-1], np.minimum(self._run.tops[:-1], self._run.tops[1:]))
            solution = self._settle(keys, edges, caps)
        phases = join([profile for stretch in solution.stretches for profile in stretch])
        times = phases.time_at(bounds)
        # at keys the solver's own durations are exact; where the motion rests, positions tell time poorly
        ends = np.cumsum([sum(part.duration for part in stretch) for stretch in solution.stretches])
        times[np.append(starts, count)[solution.keys]] = np.concatenate([[0.0], ends])
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

    def _demands(self, caps: Array) -> list[Demand]:
        """Demands of the nodes; a vertex at the end of a timed segment asks for no more than its cap does."""
        demands = [node.demand for node in self.nodes]
        for group, index in enumerate(self._starts.tolist()):
            node = self.nodes[index]
            if node.segment.duration is None or not (node.vertex_before or node.vertex_after):
                continue
            ceiling = node.demand.ceiling.copy()
            if node.vertex_after:
                ceiling[-1] = min(ceiling[-1], caps[group + 1])
            if node.vertex_before:
                first = -2 if node.vertex_after else -1
                ceiling[first] = min(ceiling[first], caps[group])
            demands[index] = dataclasses.replace(node.demand, ceiling=ceiling)
        return demands

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

    def _raise_speeds(self, late: list[int], speeds: dict[int, float], caps: Array, hard: Array) -> bool:
        """Raises speeds at the ends of timed segments that take longer than their T (D-33).

        The speed at a joint of two timed segments is at first the lower of their means. A segment that cannot
        keep its T so may with more speed at its ends, if the neighbours keep theirs. True if a cap was changed.
        """
        changed = False
        now = dict(speeds)
        for index in late:
            for end, other in ((index, index - 1), (index + 1, index + 1)):
                if end in (0, len(self._starts)) or hard[end] <= now[end] * (1.0 + 1e-9):
                    continue
                if not self._timed_overrun(index, now):
                    break
                low, high = now[end], float(hard[end])
                best = low
                for share in (0.1, 0.25, 0.5, 0.75, 1.0):
                    trial = {**now, end: low + share * (high - low)}
                    if self._timed_overrun(other, trial) and not self._timed_overrun(other, now):
                        break
                    best = trial[end]
                    if not self._timed_overrun(index, trial):
                        break
                if best > low:
                    now[end] = best
                    caps[end] = best
                    changed = True
        return changed

    def _timed_overrun(self, index: int, speeds: dict[int, float]) -> bool:
        """Whether a timed segment cannot keep its T between these speeds; False for one without T."""
        segment = self.nodes[self._starts[index]].segment
        if segment.duration is None:
            return False
        kept = exactly(
            self._solver,
            segment.extent,
            speeds[index],
            speeds[index + 1],
            self._run.ladder(index, index + 1),
            segment.duration,
        )
        return kept is None

    def _settle(self, keys: list[int], bounds: Array, caps: Array) -> _Solution:
        """Adds keys until no stretch passes a cap; each round binds the lowest cap of each stretch that does."""
        solved: dict[tuple[int, int, float, float], list[Profile]] = {}
        bound_by: list[Bound | None] = [None] * len(self._starts)
        split: set[int] = set()
        for _ in range(4 * len(self._starts) + 8):
            speeds = self._key_speeds(keys, bounds, caps)
            found: list[int] = []
            result: list[list[Profile]] = []
            for left, right in zip(keys[:-1], keys[1:], strict=True):
                question = (left, right, speeds[left], speeds[right])
                answer = solved.get(question)
                if answer is None:
                    if self.nodes[self._starts[left]].segment.duration is not None:
                        answer, bound_by[left] = self._timed(left, speeds[left], speeds[right])
                    else:
                        answer = self._stretch(left, right, speeds[left], speeds[right], bounds)
                        found += self._bind(left, right, answer, bounds, caps, split)
                    solved[question] = answer
                result.append(answer)
            if not found:
                return _Solution(keys, speeds, result, bound_by)
            for index in found:
                self.nodes[self._starts[index]].key = True
            keys = sorted({*keys, *found})
        raise PlanningError(self.nodes[0].segment.line)

    def _bind(
        self, left: int, right: int, profiles: list[Profile], bounds: Array, caps: Array, split: set[int]
    ) -> list[int]:
        """Nodes of a stretch that have to become keys."""
        if right - left == 1:
            return []
        worst = self._worst(left, right, profiles, bounds, caps)
        if worst is not None:
            return [worst]
        if left in split and right in split:
            return []
        better = self._plateau_nodes(left, right, profiles, bounds)
        top = max(part.peak_velocity for part in profiles)
        for node in better:
            caps[node] = min(caps[node], top)
        split.update(better, (left, right))
        return better

    def _key_speeds(self, keys: list[int], bounds: Array, caps: Array) -> dict[int, float]:
        """Speeds at keys so that each can be reached from its neighbours (forward and backward pass)."""
        speeds = {key: float(caps[key]) for key in keys}
        pairs = list(zip(keys[:-1], keys[1:], strict=True))
        for order in (pairs, [(b, a) for a, b in pairs[::-1]]):
            for known, key in order:
                if speeds[key] > speeds[known]:
                    ladder = self._run.ladder(min(known, key), max(known, key))
                    distance = abs(float(bounds[key] - bounds[known])) * (1.0 - 1e-9)
                    speeds[key] = reachable(speeds[known], distance, ladder, speeds[key])
        if speeds[0] < self.entry * (1.0 - 1e-9):
            # the speed that is already there cannot be brought down by the limits assumed here
            raise PlanningError(self.nodes[0].segment.line)
        return speeds

    def _timed(self, index: int, entry: float, exit_: float) -> tuple[list[Profile], Bound | None]:
        """One G93 segment: T to the rounding error where the limits allow it, else as short as they allow."""
        node = self.nodes[self._starts[index]]
        duration = node.segment.duration
        assert duration is not None
        ladder = self._run.ladder(index, index + 1)
        kept = exactly(self._solver, node.segment.extent, entry, exit_, ladder, duration)
        if kept is not None:
            return kept, None
        quickest = fastest(self._solver, node.segment.extent, entry, exit_, ladder)
        if quickest is None:
            raise PlanningError(node.segment.line)
        return quickest, self._bound_of(node, quickest, ladder)

    def _bound_of(self, node: Node, profiles: list[Profile], ladder: list[Level]) -> Bound:
        peak = max(part.peak_velocity for part in profiles)
        if peak >= 0.999 * ladder[-1].velocity:
            return Bound(node.limit.column, node.limit.kind)
        slope = node.demand.slope.max(axis=0)
        with np.errstate(divide="ignore"):
            by_acceleration = self._limits.acceleration / np.maximum(slope, 1e-300)
            by_jerk = self._limits.jerk / np.maximum(slope, 1e-300)
        strongest = max(part.peak_acceleration for part in profiles)
        if strongest >= 0.999 * min(level.acceleration for level in ladder):
            return Bound(int(np.argmin(by_acceleration)), "acceleration")
        return Bound(int(np.argmin(by_jerk)), "jerk")

    def _feed_bounds(self, times: Array, bound_by: list[Bound | None]) -> None:
        for index, node in enumerate(self.nodes):
            segment = node.segment
            if segment.duration is None and node.limit.velocity < segment.feed * segment.scale * (1.0 - 1e-9):
                if times[index + 1] - times[index] > segment.requested * (1.0 + 1e-9):
                    bound_by[index] = Bound(node.limit.column, node.limit.kind)

    # ------------------------------------------------------------------ stretches under G94

    def _stretch(self, left: int, right: int, entry: float, exit_: float, bounds: Array) -> list[Profile]:
        """Profiles between two keys as if no cap bound them between."""
        distance = float(bounds[right] - bounds[left])
        solved = fastest(self._solver, distance, entry, exit_, self._run.ladder(left, right))
        if solved is None:
            # the speeds were chosen for the weakest of the limits: with these they can be joined
            acceleration, jerk = self._run.weakest(left, right)
            top = max(entry, exit_, float(self._run.tops[left:right].min()))
            solved = fastest(self._solver, distance, entry, exit_, [Level(top, acceleration, jerk)])
        if solved is None:
            raise PlanningError(self.nodes[self._starts[left]].segment.line)
        return solved

    def _worst(self, i: int, j: int, profiles: list[Profile], bounds: Array, caps: Array) -> int | None:
        """The node to bind: one at the lowest cap which the profiles pass, or None."""
        tops = self._run.tops
        phases = join(profiles)
        inner = bounds[i + 1 : j] - bounds[i]
        at_nodes = phases.at(phases.time_at(inner))[1]
        speeds = np.concatenate([[profiles[0].velocities[0]], at_nodes, [profiles[-1].velocities[-1]]])
        # speed rises to one peak and falls: elsewhere the greatest is at an end of a segment
        in_segments = np.maximum(speeds[:-1], speeds[1:])
        peak = int(np.argmax(phases.velocity))
        where = int(np.clip(np.searchsorted(inner, phases.position[peak], side="right"), 0, j - i - 1))
        in_segments[where] = max(in_segments[where], phases.velocity[peak])
        worst, lowest = None, math.inf
        over = np.nonzero(at_nodes > caps[i + 1 : j] * _SLACK)[0]
        if len(over):
            best = int(over[np.argmin(caps[i + 1 : j][over])])
            worst, lowest = i + 1 + best, float(caps[i + 1 + best])
        over = np.nonzero(in_segments > tops[i:j] * _SLACK)[0]
        if len(over):
            segment = i + int(over[np.argmin(tops[i:j][over])])
            if tops[segment] < lowest:
                # a segment is bound by keys at both of its ends: the one that is not a key yet
                worst = segment if segment > i else segment + 1
        return worst

    def _plateau_nodes(self, i: int, j: int, solved: list[Profile], bounds: Array) -> list[int]:
        """Nodes passed at constant top speed whose outer sides have better limits than the whole."""
        top = max(part.peak_velocity for part in solved)
        origin = float(bounds[i])
        span: tuple[float, float] | None = None
        for part in solved:
            if part.plateau[1] > part.plateau[0] and part.peak_velocity >= top * (1.0 - 1e-12):
                span = (origin + part.plateau[0], origin + part.plateau[1])
            origin += part.positions[-1]
        if span is None:
            return []
        weak = [self._run.weakest(k, k + 1)[0] for k in (i, j - 1)]
        if max(weak) <= 1.1 * self._run.weakest(i, j)[0]:
            return []
        inside = [k for k in range(i + 1, j) if span[0] <= bounds[k] <= span[1]]
        if not inside:
            return []
        return sorted({inside[0], inside[-1]})


class PlanningError(Exception):
    """No time law was found that keeps the limits: the line is refused rather than moved wrongly."""

    def __init__(self, line: int) -> None:
        super().__init__(f"no time law for line {line}")
        self.line = line
