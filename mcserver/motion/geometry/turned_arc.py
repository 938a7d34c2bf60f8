"""An arc or helix in a plane that is skew to the axes, as a curve of all of them."""

from __future__ import annotations

import numpy as np

from mcserver.motion.geometry.curves import ArcCurve, Array, Curve, span_of
from mcserver.units import TURN

# places in a turn for its bounds: an extreme is missed by 5e-6 of the radius
_FINE = 1025


class TurnedArc(Curve, frozen=True, eq=False):
    """An arc in coordinates of its own, turned and moved.

    Attributes:
        flat: the arc, with ``axes`` as its coordinates, the plane's first. directions: rows of the rotation,
            shape (K, K). zero: of its coordinates, shape (K,) [m]. start, end: shape (K,), exact [m].
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
        # along a helix each axis goes on evenly: its extremes are in the first turn or in the last one
        share = min(1.0, TURN / abs(self.flat.sweep)) * np.linspace(0.0, 1.0, _FINE)
        return span_of(self.position(np.concatenate((share, 1.0 - share))))

    def ends(self) -> Array:
        return np.array((self.start, self.end))
