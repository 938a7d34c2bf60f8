"""Speed of bodies in slow zones: on ways whose steps last one cycle each.

A body's speed in a step is the most that a point of the ball around it moves, which is that of the body
itself where it does not turn. Where no body can be in its zone by what the axes have moved, nothing is
computed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.clearance.scene import Scene
from mcserver.units import MM

Array = NDArray[np.float64]

# Speeds are setpoints' differences: a feed of just the limit is not too fast by its rounding.
ROUNDING = 1.001
# The remedy.
SLOWER = "give the line a lower F, and G01 instead of G00 where it goes through the zone"


class TooFast(NamedTuple):
    """A body that is too fast in a slow zone: the pair, the step of the way, speed and limit [m/s]."""

    pair: int
    step: int
    speed: float
    limit: float

    def message(self, names: tuple[str, str]) -> str:
        """Return it in words; ``names``: of the body and the zone."""
        body, zone = names
        speed, limit = (f"{each / MM:.4g}" for each in (self.speed, self.limit))
        return f"{body!r} goes {speed} mm/s in the slow zone {zone!r}, {limit} are allowed"


class SlowZones:
    """Looks at ways through the slow zones of a scene.

    Args:
        cycle_s: time of a step [s]. counted: pairs that count, shape (P,).
    """

    def __init__(self, scene: Scene, cycle_s: float, counted: NDArray[np.bool_]) -> None:
        self._scene = scene
        self._cycle = cycle_s
        self.pairs: list[int] = []
        self.count(counted)

    def count(self, counted: NDArray[np.bool_]) -> None:
        """Look at these pairs from now on, shape (P,)."""
        self.pairs = np.flatnonzero(np.isfinite(self._scene.speeds) & counted).tolist()

    def keep(self, way: Array) -> None:
        """Take the part of a way that is handed over."""

    def forget(self) -> None:
        """Forget the way so far."""

    def moving(self, columns: NDArray[np.bool_]) -> bool:  # noqa: ARG002
        """Return whether drives of these columns may have to come to the end of the way yet."""
        return False

    def first(self, way: Array) -> TooFast | None:
        """Return the first step of a way, shape (n + 1, K), on which a body is too fast; None: none is."""
        found: TooFast | None = None
        if not self.pairs or len(way) < 2:
            return None
        moved = np.abs(np.diff(way, axis=0)) @ self._scene.levers[:, self.pairs]
        for index, pair in enumerate(self.pairs):
            if self._scene.active[pair]:
                end = len(way) - 1 if found is None else found.step
                found = self._first_of(pair, way[: end + 1], moved[:end, index]) or found
        return found

    def _first_of(self, pair: int, way: Array, moved: Array) -> TooFast | None:
        scene = self._scene
        limit = float(scene.speeds[pair])
        # levers bound the speed from above
        fast = moved > limit * ROUNDING * self._cycle
        if not fast.any():
            return None
        total = np.append(0.0, moved.cumsum())
        at = int(fast.argmax())
        while at < len(moved):
            scene.place(way[at])
            apart = max(0.0, scene.distance(pair))
            # the last place that it has not come into the zone by
            clear = int(np.searchsorted(total, total[at] + apart, "right")) - 1
            if clear <= at:
                speed = scene.travel(pair, way[at], way[at + 1]) / self._cycle
                if speed > limit * ROUNDING:
                    return TooFast(pair, at, speed, limit)
                clear = at + 1
            later = fast[clear:]
            if not later.any():
                return None
            at = clear + int(later.argmax())
        return None
