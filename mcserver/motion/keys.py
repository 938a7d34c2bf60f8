"""The time law of a run: speeds at its keys, and the profiles between them.

Acceleration is zero at keys. They are found by the caps that bind: a stretch between two keys is solved as if
nothing bound it; where the result passes a cap, the lowest such cap becomes a key and both sides are solved
again. Segments of G93 stand between keys of their own, since each has its T.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.kernels.keys import SOLVED, find_keys
from mcserver.motion.limits import Level, RunLimits
from mcserver.motion.node import Bound, Node, PlanningError
from mcserver.motion.path import Array
from mcserver.motion.profile import Profile, ProfileSolver, rows_of
from mcserver.motion.ramps import exactly, fastest
from mcserver.motion.segment import AxisLimits


@dataclass(frozen=True)
class Solution:
    """Key nodes, their speeds, the time law, and what stretched timed segments.

    Attributes:
        phases: rows of `mcserver.motion.kernels.phases`. first: the first phase behind each key, and one past
            the last, shape (k,).
    """

    keys: list[int]
    speeds: dict[int, float]
    phases: Array
    first: NDArray[np.intp]
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
        that does.

        Raises:
            PlanningError: no time law keeps all limits.
        """
        run = self.run
        is_key = np.zeros(len(caps), np.bool_)
        is_key[keys] = True
        timed = np.array([node.segment.duration is not None for node in self.nodes])
        status, blamed, found, key_speeds, phases, first = find_keys(
            self.edges,
            caps,
            run.tops,
            timed,
            is_key,
            run.rows,
            run.offset,
            self._limits.rows,
            self._limits.cycle,
            run.rest,
            run.weak,
            run.ceiling,
            run.kinds,
            run.at_rest,
            run.grid,
            run.known,
            self._entry,
        )
        if status != SOLVED:
            raise PlanningError(self.nodes[blamed].segment.line)
        keys = found.tolist()
        for index in set(keys) - {0, len(self.nodes)}:
            self.nodes[index].key = True
        speeds = dict(zip(keys, key_speeds.tolist(), strict=True))
        bound_by: list[Bound | None] = [None] * len(self.nodes)
        if not timed.any():
            return Solution(keys, speeds, phases, np.append(first, len(phases)), bound_by)
        # stretches with a time of their own between those without
        parts: list[Array] = []
        ends = [*first.tolist(), len(phases)]
        for index, (left, right) in enumerate(pairwise(keys)):
            if ends[index] < 0:
                profiles, bound_by[left] = self._timed(left, speeds[left], speeds[right])
                parts.append(rows_of(profiles, float(self.edges[left])))
            else:
                until = next(end for end in ends[index + 1 :] if end >= 0)
                parts.append(phases[ends[index] : until])
        offsets = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
        return Solution(keys, speeds, np.concatenate(parts), offsets, bound_by)

    def _timed(self, index: int, entry: float, exit_: float) -> tuple[list[Profile], Bound | None]:
        """One G93 segment: T to the rounding error where the limits allow it, else as short as they allow."""
        node = self.nodes[index]
        duration = node.segment.duration
        assert duration is not None
        ladder = self.run.ladder(index, index + 1)
        kept = exactly(self._solver, node.segment.extent, entry, exit_, ladder, duration)
        if kept is not None:
            return kept, None
        quickest = fastest(node.segment.extent, entry, exit_, ladder)
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
        slope = np.concatenate(node.rows)[:, : len(self._limits.velocity)].max(axis=0)
        with np.errstate(divide="ignore"):
            by_acceleration = self._limits.acceleration / np.maximum(slope, 1e-300)
            by_jerk = self._limits.jerk / np.maximum(slope, 1e-300)
        strongest = max(part.peak_acceleration for part in profiles)
        if strongest >= 0.999 * min(level.acceleration for level in ladder):
            return Bound(int(np.argmin(by_acceleration)), "acceleration")
        return Bound(int(np.argmin(by_jerk)), "jerk")
