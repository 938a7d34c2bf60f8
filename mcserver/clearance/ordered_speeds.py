"""Speed of bodies in slow zones on a machine with shapers, judged on what is ordered before it is shaped.

What drives get is a mean of the rows of the last cycles, whose weights differ by axis, and holds and lower
overrides bring these rows closer together. So in each step a body counts as fast as it is anywhere within a
shaper's length before, and as being wherever it is within that, less far than shapers leave the path.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from mcserver.clearance.scene import Scene
from mcserver.clearance.slow_zones import ROUNDING, SlowZones, TooFast
from mcserver.machine.machine_file import Machine
from mcserver.machine.shaper_section import Shaping

Array = NDArray[np.float64]


class OrderedSpeeds(SlowZones):
    """Looks at ways of rows that are ordered, one each cycle; the last ones are kept.

    Args:
        machine: whose axes are shaped. counted: as `SlowZones`.
    """

    def __init__(self, scene: Scene, machine: Machine, shaping: Shaping, counted: NDArray[np.bool_]) -> None:
        super().__init__(scene, machine.cycle_s, counted)
        self._reach = shaping.length + 1
        self._beside = np.array(shaping.deviations)
        # columns of the same weights, with every tool, move a body together
        kinds = sorted(set(shaping.kinds))
        self._groups = [np.array([each == kind for each in shaping.kinds]) for kind in kinds]
        # joints of a chain turn: what their groups do to a body may come to one direction
        self._slides = machine.urdf is None
        self._behind: Array | None = None

    def forget(self) -> None:
        """Forget the way so far: shaped setpoints have come to its end."""
        self._behind = None

    def moving(self, columns: NDArray[np.bool_]) -> bool:
        """Return whether any of these columns has moved on the way that is kept."""
        return self._behind is not None and bool(np.ptp(self._behind, axis=0)[columns].any())

    def keep(self, way: Array) -> None:
        """Take the part of a way, shape (n + 1, K), that is handed over."""
        self._behind = self._from_behind(way)[-self._reach - 1 :]

    def _from_behind(self, way: Array) -> Array:
        if self._behind is None:
            return way
        # what others have moved since has come to rest there
        stayed = self._behind[-1] == way[0]
        return np.concatenate((np.where(stayed, self._behind[:-1], way[0]), way))

    def first(self, way: Array) -> TooFast | None:
        """Return the first step of a way that makes a body too fast, with what was kept of the way before."""
        whole = self._from_behind(way)
        known = len(whole) - len(way)
        found: TooFast | None = None
        for pair in self.pairs:
            if self._scene.active[pair] and len(way) > 1:
                end = len(whole) if found is None else found.step + 1
                found = self._first_in(pair, whole[:end], known) or found
        return None if found is None else found._replace(step=found.step - known)

    def _first_in(self, pair: int, way: Array, known: int) -> TooFast | None:
        scene, reach = self._scene, self._reach
        limit = float(scene.speeds[pair])
        lever = scene.levers[:, pair]
        steps = np.abs(np.diff(way, axis=0)) * lever
        within = sliding_window_view(np.pad(steps, ((reach - 1, 0), (0, 0))), reach, axis=0).max(axis=-1)
        fast = np.flatnonzero(within.sum(axis=1) > limit * ROUNDING * self._cycle)
        total = np.append(0.0, steps.sum(axis=1).cumsum())
        blur = float(self._beside @ lever)
        # the node that is looked at next, and the last one at which it may be in the zone
        node, inside = 0, -1
        travels: dict[tuple[int, int], float] = {}
        for step in fast[fast >= known].tolist():
            oldest = max(0, step + 1 - reach)
            node = max(node, oldest)
            while node <= step + 1:
                scene.place(way[node])
                apart = scene.distance(pair) - blur
                if apart <= 0.0:
                    inside = node
                node = max(node + 1, int(np.searchsorted(total, total[node] + apart, "right")))
            if inside < oldest:
                continue
            speed = self._speed(pair, way, oldest, step, travels)
            if speed > limit * ROUNDING:
                return TooFast(pair, step, speed, limit)
        return None

    def _speed(
        self, pair: int, way: Array, oldest: int, step: int, travels: dict[tuple[int, int], float]
    ) -> float:
        """Return how fast a body may be by the steps of a way from the oldest to this one [m/s]."""
        most = []
        for number, group in enumerate(self._groups):
            for each in range(oldest, step + 1):
                if (number, each) not in travels:
                    after = np.where(group, way[each + 1], way[each])
                    still = not (after != way[each]).any()
                    travels[number, each] = 0.0 if still else self._scene.travel(pair, way[each], after)
            most.append(max(travels[number, each] for each in range(oldest, step + 1)))
        return (float(np.linalg.norm(most)) if self._slides else math.fsum(most)) / self._cycle


def slow_zones(scene: Scene, machine: Machine, counted: NDArray[np.bool_]) -> SlowZones:
    """Return what looks at the rows that are ordered on a machine."""
    if machine.shaping is None:
        return SlowZones(scene, machine.cycle_s, counted)
    return OrderedSpeeds(scene, machine, machine.shaping, counted)
