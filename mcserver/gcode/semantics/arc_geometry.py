"""Compute arcs of G02 and G03 in their plane (D-22): centre, sweep, length, extrema.

Points are (first, second) axis of the plane, right-handed as seen from its positive normal [m].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec

from mcserver.motion.geometry.curves import ArcCurve
from mcserver.units import DEGREE, INCH, MM, TURN

Point = tuple[float, float]

# A smaller sweep is a full circle; 1e-6 in LinuxCNC, 5e-7 in Grbl [rad].
SMALLEST_SWEEP = 1e-6
# A larger sweep looks like a full circle: D-22 warns if its end is not its start [rad].
NEARLY_CLOSED = 359.99 * DEGREE
SMALLEST_RADIUS = 0.001 * MM


class RadiusTolerance(NamedTuple):
    """Allowed difference of start and end radius: ``share`` of the radius, in ``least`` … ``most`` [m]."""

    least: float
    share: float
    most: float

    def at(self, radius: float) -> float:
        """Return the tolerance at a radius [m]."""
        return min(self.most, max(self.least, self.share * abs(radius)))


D22_TOLERANCE = RadiusTolerance(0.005 * MM, 0.001, math.inf)


def radius_tolerance(profile: str, *, inch: bool) -> RadiusTolerance:
    """Return D-22's tolerance; for ``cnc`` LinuxCNC's, for ends and centres rounded to 0.01 mm or 0.001 in.

    Source: LinuxCNC's defaults of CENTER_ARC_RADIUS_TOLERANCE_MM and _INCH, and its arc_data_ijk.
    """
    if profile != "cnc":
        return D22_TOLERANCE
    least = 2.0 * math.sqrt(2.0) * (0.001 * INCH if inch else 0.01 * MM)
    # LinuxCNC's 0.1 % is of the larger radius
    return RadiusTolerance(least, 0.001 / 0.999, 100.0 * least)


class ChordTooLong(Exception):
    """The chord is longer than 2|R| by more than the radius tolerance."""

    def __init__(self, chord: float) -> None:
        super().__init__(f"chord of {chord} m")
        self.chord = chord


class SamePoint(Exception):
    """Start and end are within `SMALLEST_SWEEP` as seen from the centre, so that R fixes no centre."""


class RadiusMismatch(Exception):
    """The radii at start and end differ by more than the radius tolerance."""

    def __init__(self, start_radius: float, end_radius: float) -> None:
        super().__init__(f"radii of {start_radius} and {end_radius} m")
        self.start_radius = start_radius
        self.end_radius = end_radius


class ZeroRadius(Exception):
    """The centre lies on the start or the end point."""


class Arc(msgspec.Struct, frozen=True):
    """An arc in its plane: centre [m], signed sweep [rad], mean radius and radius growth [m]."""

    centre: Point
    sweep: float
    radius: float
    growth: float

    def nearly_closed(self, start: Point, end: Point) -> bool:
        """Return whether it is almost a full turn but ends at another point: most likely a mistake."""
        apart = math.hypot(end[0] - start[0], end[1] - start[1])
        return abs(self.sweep) > NEARLY_CLOSED and apart >= SMALLEST_SWEEP * self.radius

    def curve(
        self, axes: tuple[int, ...], start: tuple[float, ...], end: tuple[float, ...], *, xyz: bool = False
    ) -> ArcCurve:
        """Return the arc as a path of axes; displacements of the further axes add to its length (D-30).

        Args:
            start, end: shape (len(axes),) [m], the plane's two axes first.
            xyz: only those of X Y Z add to it (D-66).
        """
        further: list[float] = []
        if len(axes) > 2:
            steps = zip(axes[2:], start[2:], end[2:], strict=True)
            further = [last - first for axis, first, last in steps if axis <= 2 or not xyz]
        length = math.hypot(self.radius * self.sweep, self.growth, *further)
        return ArcCurve(axes, start, end, self.centre, self.sweep, length)


def arc_by_radius(
    start: Point,
    end: Point,
    radius: float,
    clockwise: bool,
    turns: int,
    tolerance: RadiusTolerance = D22_TOLERANCE,
) -> Arc:
    """Compute the arc of the R form: minor for R > 0, major for R < 0 (D-22).

    Args:
        start, end: in the plane [m].
        radius: signed [m].
        turns: the word P; each above 1 adds a full turn.

    Raises:
        ZeroRadius, SamePoint, ChordTooLong.
    """
    if abs(radius) < SMALLEST_RADIUS:
        raise ZeroRadius
    across = (end[0] - start[0], end[1] - start[1])
    chord = math.hypot(*across)
    if chord < SMALLEST_SWEEP * abs(radius):
        raise SamePoint
    half = chord / 2.0
    if chord > 2.0 * abs(radius) + tolerance.at(radius):
        raise ChordTooLong(chord)
    height = math.sqrt(max(0.0, radius * radius - half * half))
    # a clockwise minor arc has its centre to the right of the chord, a major one to the left
    side = -1.0 if clockwise == (radius > 0.0) else 1.0
    left = (-across[1] / chord, across[0] / chord)
    centre = (
        (start[0] + end[0]) / 2.0 + side * height * left[0],
        (start[1] + end[1]) / 2.0 + side * height * left[1],
    )
    return _arc(start, end, centre, clockwise, turns)


def arc_by_centre(
    start: Point,
    end: Point,
    centre: Point,
    clockwise: bool,
    turns: int,
    tolerance: RadiusTolerance = D22_TOLERANCE,
) -> Arc:
    """Compute the arc of the I J K form; a sweep below `SMALLEST_SWEEP` is a full circle (D-22).

    Raises:
        ZeroRadius, RadiusMismatch.
    """
    start_radius = math.hypot(start[0] - centre[0], start[1] - centre[1])
    end_radius = math.hypot(end[0] - centre[0], end[1] - centre[1])
    if start_radius < SMALLEST_RADIUS:
        raise ZeroRadius
    # slightly above the rule's value, so that a difference of exactly the tolerance passes in floating point
    if abs(start_radius - end_radius) > tolerance.at(start_radius) * (1.0 + 1e-9) + 1e-12:
        raise RadiusMismatch(start_radius, end_radius)
    if end_radius < SMALLEST_RADIUS:
        raise ZeroRadius
    return _arc(start, end, centre, clockwise, turns)


def _arc(start: Point, end: Point, centre: Point, clockwise: bool, turns: int) -> Arc:
    start_radius = math.hypot(start[0] - centre[0], start[1] - centre[1])
    end_radius = math.hypot(end[0] - centre[0], end[1] - centre[1])
    start_angle = math.atan2(start[1] - centre[1], start[0] - centre[0])
    end_angle = math.atan2(end[1] - centre[1], end[0] - centre[0])
    sign = -1.0 if clockwise else 1.0
    forward = (sign * (end_angle - start_angle)) % TURN
    if forward < SMALLEST_SWEEP:
        forward += TURN
    sweep = sign * (forward + TURN * (turns - 1))
    return Arc(centre, sweep, (start_radius + end_radius) / 2.0, end_radius - start_radius)


def plane_extrema(arc: ArcCurve) -> tuple[Point, Point]:
    """Return the smallest and the largest position of the plane's two axes along the arc [m]."""
    start, end = arc.start, arc.end
    radius = max(arc.start_radius, arc.end_radius)
    low = [min(start[0], end[0]), min(start[1], end[1])]
    high = [max(start[0], end[0]), max(start[1], end[1])]
    first = arc.start_angle
    last = first + arc.sweep
    if last < first:
        first, last = last, first
    quarter = TURN / 4.0
    step = math.ceil(first / quarter - 1e-12)
    for _ in range(4):
        if step * quarter > last + 1e-12:
            break
        column = step % 2
        if step % 4 < 2:
            high[column] = max(high[column], arc.centre[column] + radius)
        else:
            low[column] = min(low[column], arc.centre[column] - radius)
        step += 1
    return (low[0], low[1]), (high[0], high[1])
