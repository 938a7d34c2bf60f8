"""Compute many arcs in their planes at once, as `mcserver.gcode.semantics.arc_geometry` does one (D-22).

Bit for bit: sums, products, quotients, square roots and remainders are the same IEEE operations in the same
order; `math.hypot` and `math.atan2` come from the standard library, since numpy's may differ in the last bit.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.gcode.semantics.arc_geometry import (
    NEARLY_CLOSED,
    SMALLEST_RADIUS,
    SMALLEST_SWEEP,
    RadiusTolerance,
)
from mcserver.motion.geometry.curves import Array
from mcserver.units import TURN

Mask = NDArray[np.bool_]


class ArcColumns(msgspec.Struct, frozen=True, eq=False):
    """Arcs in their planes; numbers of an arc that is not defined are meaningless.

    Attributes:
        centres: shape (n, 2) [m]. sweeps: signed, shape (n,) [rad].
        radii, growths: mean radius, and end radius less start radius, shape (n,) [m].
        defined: shape (n,), whether `arc_by_radius` or `arc_by_centre` finds neither a fault nor a warning
            (`Arc.nearly_closed`).
    """

    centres: Array
    sweeps: Array
    radii: Array
    growths: Array
    defined: Mask

    def lengths(self, climbs: Array) -> Array:
        """Return the lengths of the arcs, or of helices with these climbs, shape (n,) [m]."""
        return hypot(self.radii * self.sweeps, self.growths, climbs)


def hypot(*columns: Array) -> Array:
    """Return the square roots of the sums of squares of columns."""
    return np.array(list(map(math.hypot, *[column.tolist() for column in columns])), np.float64)


def _atan2(y: Array, x: Array) -> Array:
    return np.array(list(map(math.atan2, y.tolist(), x.tolist())), np.float64)


def arcs_of(
    starts: Array, ends: Array, centres: Array, radii: Array, clockwise: Mask, tolerance: RadiusTolerance
) -> ArcColumns:
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
            starts[by_radius], ends[by_radius], radii[by_radius], clockwise[by_radius], tolerance
        )
    x0, y0 = (starts - centres).T
    x1, y1 = (ends - centres).T
    start_radius, end_radius = hypot(x0, y0), hypot(x1, y1)
    allowed = _allowed(tolerance, start_radius) * (1.0 + 1e-9) + 1e-12
    zero = (start_radius < SMALLEST_RADIUS) | (end_radius < SMALLEST_RADIUS)
    defined &= ~(given & (zero | (np.abs(start_radius - end_radius) > allowed)))
    sign = np.where(clockwise, -1.0, 1.0)
    forward = np.mod(sign * (_atan2(y1, x1) - _atan2(y0, x0)), TURN)
    sweeps = sign * np.where(forward < SMALLEST_SWEEP, forward + TURN, forward)
    # nearly closed arcs have a warning and are left to the block interpreter
    radii = (start_radius + end_radius) / 2.0
    around = np.flatnonzero(np.abs(sweeps) > NEARLY_CLOSED)
    apart = hypot(*(ends[around] - starts[around]).T)
    defined[around] &= apart < SMALLEST_SWEEP * radii[around]
    return ArcColumns(centres, sweeps, radii, end_radius - start_radius, defined)


def _allowed(tolerance: RadiusTolerance, radii: Array) -> Array:
    """Return the largest allowed difference of start and end radius [m]."""
    return np.minimum(tolerance.most, np.maximum(tolerance.least, tolerance.share * np.abs(radii)))


def _centres(
    starts: Array, ends: Array, radii: Array, clockwise: Mask, tolerance: RadiusTolerance
) -> tuple[Array, Mask]:
    """Return the centres of arcs of the R form, shape (n, 2) [m], and which of them are defined."""
    across = ends - starts
    chord = hypot(*across.T)
    fits = (np.abs(radii) >= SMALLEST_RADIUS) & (chord >= SMALLEST_SWEEP * np.abs(radii))
    fits &= ~(chord > 2.0 * np.abs(radii) + _allowed(tolerance, radii))
    half = chord / 2.0
    square = radii * radii - half * half
    height = np.sqrt(np.where(square > 0.0, square, 0.0))
    # a clockwise minor arc has its centre to the right of the chord, a major one to the left
    aside = np.where(clockwise == (radii > 0.0), -1.0, 1.0) * height
    # an arc without a chord has no direction, and is not defined
    chord = np.where(chord > 0.0, chord, 1.0)
    left = np.stack((-across[:, 1] / chord, across[:, 0] / chord), axis=1)
    return (starts + ends) / 2.0 + aside[:, None] * left, fits
