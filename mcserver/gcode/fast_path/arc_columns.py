"""Compute many arcs in their planes at once, as `mcserver.gcode.semantics.arc_geometry` does one (D-22).

Bit for bit: sums, products, quotients, square roots and remainders are the same IEEE operations in the same
order; `math.hypot` and `math.atan2` are those of the standard library, since numpy's may differ in the last
bit.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.gcode.semantics.arc_geometry import RADIUS_TOLERANCE, RADIUS_TOLERANCE_SHARE, SAME_POINT
from mcserver.motion.geometry.curves import Array
from mcserver.units import TURN

Mask = NDArray[np.bool_]


class ArcColumns(msgspec.Struct, frozen=True, eq=False):
    """Arcs in their planes; the numbers of one that is not defined have no meaning.

    Attributes:
        centres: shape (n, 2) [m]. sweeps: signed, shape (n,) [rad].
        radii, growths: mean radius, and end radius less start radius, shape (n,) [m].
        defined: shape (n,), whether `arc_by_radius` or `arc_by_centre` finds no fault.
    """

    centres: Array
    sweeps: Array
    radii: Array
    growths: Array
    defined: Mask

    def lengths(self, climbs: Array) -> Array:
        """Return the lengths of the arcs, or of the helices that climb so far, shape (n,) [m]."""
        return hypot(self.radii * self.sweeps, self.growths, climbs)


def hypot(*columns: Array) -> Array:
    """Return the root of the sum of squares of columns of numbers."""
    return np.array(list(map(math.hypot, *[column.tolist() for column in columns])), np.float64)


def _atan2(y: Array, x: Array) -> Array:
    return np.array(list(map(math.atan2, y.tolist(), x.tolist())), np.float64)


def arcs_of(starts: Array, ends: Array, centres: Array, radii: Array, clockwise: Mask) -> ArcColumns:
    """Compute arcs, some of the R form and some of the I J K form (D-22).

    Args:
        starts, ends: in the plane, shape (n, 2) [m].
        centres: of the I J K form, shape (n, 2) [m]. radii: of the R form, signed, shape (n,) [m]; NaN in the
            I J K form.
    """
    given = np.isnan(radii)
    defined = np.ones(len(radii), np.bool_)
    if not given.all():
        by_radius = np.flatnonzero(~given)
        centres = centres.copy()
        centres[by_radius], defined[by_radius] = _centres(
            starts[by_radius], ends[by_radius], radii[by_radius], clockwise[by_radius]
        )
    x0, y0 = (starts - centres).T
    x1, y1 = (ends - centres).T
    start_radius, end_radius = hypot(x0, y0), hypot(x1, y1)
    allowed = _tolerance(start_radius) * (1.0 + 1e-9) + 1e-12
    zero = (start_radius < SAME_POINT) | (end_radius < SAME_POINT)
    defined &= ~(given & (zero | (np.abs(start_radius - end_radius) > allowed)))
    turned = _atan2(y1, x1) - _atan2(y0, x0)
    sign = np.where(clockwise, -1.0, 1.0)
    forward = np.mod(sign * turned, TURN)
    forward = np.where(forward * start_radius <= SAME_POINT, forward + TURN, forward)
    sweeps = sign * forward
    closed = np.flatnonzero(given & _same(starts, ends))
    if len(closed):
        rest = turned[closed]
        sweeps[closed] = sign[closed] * TURN + (rest - TURN * np.rint(rest / TURN))
    return ArcColumns(centres, sweeps, (start_radius + end_radius) / 2.0, end_radius - start_radius, defined)


def _same(starts: Array, ends: Array) -> Mask:
    """Return which arcs start and end at the same point."""
    across = np.abs(ends - starts)
    same: Mask = (across[:, 0] <= SAME_POINT) & (across[:, 1] <= SAME_POINT)
    near = np.flatnonzero(same)
    if len(near):
        same[near] = hypot(*(ends[near] - starts[near]).T) <= SAME_POINT
    return same


def _tolerance(radii: Array) -> Array:
    """Return how far start and end radius may differ [m] (D-22)."""
    return np.maximum(RADIUS_TOLERANCE, RADIUS_TOLERANCE_SHARE * np.abs(radii))


def _centres(starts: Array, ends: Array, radii: Array, clockwise: Mask) -> tuple[Array, Mask]:
    """Return the centres of arcs of the R form, shape (n, 2) [m], and which of them are defined."""
    across = ends - starts
    chord = hypot(*across.T)
    fits = (np.abs(radii) >= SAME_POINT) & (chord > SAME_POINT)
    fits &= ~(chord > 2.0 * np.abs(radii) + _tolerance(radii))
    half = chord / 2.0
    square = radii * radii - half * half
    height = np.sqrt(np.where(square > 0.0, square, 0.0))
    # a clockwise minor arc has its centre to the right of the chord, a major one to the left
    aside = np.where(clockwise == (radii > 0.0), -1.0, 1.0) * height
    # no chord, no direction: such an arc is not defined
    chord = np.where(chord > 0.0, chord, 1.0)
    left = np.stack((-across[:, 1] / chord, across[:, 0] / chord), axis=1)
    return (starts + ends) / 2.0 + aside[:, None] * left, fits
