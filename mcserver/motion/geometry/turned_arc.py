"""An arc or helix in a plane that is not parallel to two axes."""

from __future__ import annotations

import numpy as np

from mcserver.motion.geometry.curves import ArcCurve, Array, Curve, span_of
from mcserver.units import TURN

# samples per turn for the bounds: an extreme is missed by 5e-6 of the radius
_FINE = 1025


class TurnedArc(Curve, frozen=True, eq=False):
    """An arc in a rotated and shifted coordinate system.

    Attributes:
        flat: the arc in that system, the plane's coordinates first. directions: rows of the rotation to the
            machine's axes, shape (K, K). zero: origin of the system, shape (K,) [m].
        start, end: shape (K,), exact [m].
    """

    flat: ArcCurve
    directions: tuple[tuple[float, ...], ...]
    zero: tuple[float, ...]
    start: tuple[float, ...]
    end: tuple[float, ...]

    @property
    def roundable(self) -> bool:
        return True

    @property
    def length(self) -> float:
        return self.flat.length

    @property
    def max_path_rate(self) -> float:
        return self.flat.max_path_rate

    def samples(self) -> Array:
        return self.flat.samples()

    def position(self, s: Array) -> Array:
        points: Array = np.array(self.zero) + self.flat.position(s) @ np.array(self.directions).T
        points[np.asarray(s) <= 0.0] = self.start
        points[np.asarray(s) >= 1.0] = self.end
        return points

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        matrix = np.array(self.directions).T
        first, second, third = self.flat.derivatives(s)
        return first @ matrix, second @ matrix, third @ matrix

    def bounds(self) -> tuple[Array, Array]:
        # on a helix each axis advances evenly from turn to turn: its extremes are in the first or last one
        share = min(1.0, TURN / abs(self.flat.sweep)) * np.linspace(0.0, 1.0, _FINE)
        return span_of(self.position(np.concatenate((share, 1.0 - share))))

    def ends(self) -> Array:
        return np.array((self.start, self.end))
