"""The time law of a run: speeds at its keys, and the profiles between them.

Acceleration is zero at keys. They are found by the caps that bind: a stretch between two keys is solved as if
nothing bound it; where the result passes a cap, the lowest such cap becomes a key and both sides are solved
again. Segments of G93 stand between keys of their own, since each has its T.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mcserver.motion.limits import Level, RunLimits
from mcserver.motion.node import Bound, Node, PlanningError
from mcserver.motion.path import Array
from mcserver.motion.profile import Profile, ProfileSolver, join
from mcserver.motion.ramps import exactly, fastest, reachable
from mcserver.motion.segment import AxisLimits

_SLACK = 1.0 + 1e-9


@dataclass(frozen=True)
class Solution:
    """Key nodes, their speeds, the profiles between them, and what stretched timed segments."""

    keys: list[int]
    speeds: dict[int, float]
    stretches: list[list[Profile]]
    bound_by: list[Bound | None]

    @property
    def late(self) -> list[int]:
        """Timed groups that take longer than their T."""
        return [group for group, bound in enumerate(self.bound_by) if bound is not None]


class KeySolver:
    """Solves one run.

    Args:
        nodes: first nodes of its groups, n of them. edges: σ at the groups' starts and at the end, (n+1,).
        entry: speed at the beginning [m/s or rad/s along σ].

    Attributes:
        run: limits of the groups, set before each `solve`.
    """

    def __init__(
        self,
        solver: ProfileSolver,
        limits: AxisLimits,
        nodes: list[Node],
        edges: Array,
        entry: float,
    ) -> None:
        self._solver = solver
        self._limits = limits
        self.nodes = nodes
        self.edges = edges
        self.run: RunLimits
        self._entry = entry

    def solve(self, keys: list[int], caps: Array) -> Solution:
        """Adds keys until no stretch passes a cap; each round binds the lowest cap of each stretch
        that does."""
        solved: dict[tuple[int, int, float, float], list[Profile]] = {}
        bound_by: list[Bound | None] = [None] * len(self.nodes)
        split: set[int] = set()
        for _ in range(4 * len(self.nodes) + 8):
            speeds = self._key_speeds(keys, caps)
            found: list[int] = []
            result: list[list[Profile]] = []
            for left, right in pairwise(keys):
                question = (left, right, speeds[left], speeds[right])
                answer = solved.get(question)
                if answer is None:
                    if self.nodes[left].segment.duration is not None:
                        answer, bound_by[left] = self._timed(left, speeds[left], speeds[right])
                    else:
                        answer = self._stretch(left, right, speeds[left], speeds[right])
                        found += self._bind(left, right, answer, caps, split)
                    solved[question] = answer
                result.append(answer)
            if not found:
                return Solution(keys, speeds, result, bound_by)
            for index in found:
                self.nodes[index].key = True
            keys = sorted({*keys, *found})
        raise PlanningError(self.nodes[0].segment.line)

    def _bind(
        self, left: int, right: int, profiles: list[Profile], caps: Array, split: set[int]
    ) -> list[int]:
        """Nodes of a stretch that have to become keys."""
        if right - left == 1:
            return []
        worst = self._worst(left, right, profiles, caps)
        if worst is not None:
            return [worst]
        if left in split and right in split:
            return []
        better = self._plateau_nodes(left, right, profiles)
        top = max(part.peak_velocity for part in profiles)
        for node in better:
            caps[node] = min(caps[node], top)
        split.update(better, (left, right))
        return better

    def _key_speeds(self, keys: list[int], caps: Array) -> dict[int, float]:
        """Speeds at keys so that each can be reached from its neighbours (forward and backward pass)."""
        speeds = {key: float(caps[key]) for key in keys}
        pairs = list(pairwise(keys))
        for order in (pairs, [(b, a) for a, b in pairs[::-1]]):
            for known, key in order:
                if speeds[key] > speeds[known]:
                    ladder = self.run.ladder(min(known, key), max(known, key))
                    distance = abs(float(self.edges[key] - self.edges[known])) * (1.0 - 1e-9)
                    speeds[key] = reachable(speeds[known], distance, ladder, speeds[key])
        if speeds[0] < self._entry * (1.0 - 1e-9):
            # the speed that is already there cannot be brought down by the limits assumed here
            raise PlanningError(self.nodes[0].segment.line)
        return speeds

    def _timed(self, index: int, entry: float, exit_: float) -> tuple[list[Profile], Bound | None]:
        """One G93 segment: T to the rounding error where the limits allow it, else as short as they allow."""
        node = self.nodes[index]
        duration = node.segment.duration
        assert duration is not None
        ladder = self.run.ladder(index, index + 1)
        kept = exactly(self._solver, node.segment.extent, entry, exit_, ladder, duration)
        if kept is not None:
            return kept, None
        quickest = fastest(self._solver, node.segment.extent, entry, exit_, ladder)
        if quickest is None:
            raise PlanningError(node.segment.line)
        return quickest, self._bound_of(node, quickest, ladder)

    def raise_speeds(self, late: list[int], speeds: dict[int, float], caps: Array, hard: Array) -> bool:
        """Raises speeds at the ends of timed segments that take longer than their T (D-33).

        The speed at a joint of two timed segments is at first the lower of their means. A segment that cannot
        keep its T so may with more speed at its ends, if the neighbours keep theirs. True if a cap was
        changed.
        """
        changed = False
        now = dict(speeds)
        for index in late:
            for end, other in ((index, index - 1), (index + 1, index + 1)):
                if end in (0, len(self.nodes)) or hard[end] <= now[end] * (1.0 + 1e-9):
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
        segment = self.nodes[index].segment
        if segment.duration is None:
            return False
        kept = exactly(
            self._solver,
            segment.extent,
            speeds[index],
            speeds[index + 1],
            self.run.ladder(index, index + 1),
            segment.duration,
        )
        return kept is None

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

    # ------------------------------------------------------------------ stretches under G94

    def _stretch(self, left: int, right: int, entry: float, exit_: float) -> list[Profile]:
        """Profiles between two keys as if no cap bound them between."""
        distance = float(self.edges[right] - self.edges[left])
        solved = fastest(self._solver, distance, entry, exit_, self.run.ladder(left, right))
        if solved is None:
            # the speeds were chosen for the weakest of the limits: with these they can be joined
            acceleration, jerk = self.run.weakest(left, right)
            top = max(entry, exit_, float(self.run.tops[left:right].min()))
            solved = fastest(self._solver, distance, entry, exit_, [Level(top, acceleration, jerk)])
        if solved is None:
            raise PlanningError(self.nodes[left].segment.line)
        return solved

    def _worst(self, i: int, j: int, profiles: list[Profile], caps: Array) -> int | None:
        """The node to bind: one at the lowest cap which the profiles pass, or None."""
        tops = self.run.tops
        phases = join(profiles)
        inner = self.edges[i + 1 : j] - self.edges[i]
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

    def _plateau_nodes(self, i: int, j: int, solved: list[Profile]) -> list[int]:
        """Nodes passed at constant top speed whose outer sides have better limits than the whole."""
        top = max(part.peak_velocity for part in solved)
        origin = float(self.edges[i])
        span: tuple[float, float] | None = None
        for part in solved:
            if part.plateau[1] > part.plateau[0] and part.peak_velocity >= top * (1.0 - 1e-12):
                span = (origin + part.plateau[0], origin + part.plateau[1])
            origin += part.positions[-1]
        if span is None:
            return []
        weak = [self.run.weakest(k, k + 1)[0] for k in (i, j - 1)]
        if max(weak) <= 1.1 * self.run.weakest(i, j)[0]:
            return []
        inside = [k for k in range(i + 1, j) if span[0] <= self.edges[k] <= span[1]]
        if not inside:
            return []
        return sorted({inside[0], inside[-1]})
