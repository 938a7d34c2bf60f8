"""Offset lines and arcs of a plane, and find where two of them intersect (D-85).

Points are (first, second) axis of the plane, right-handed as seen from its positive normal [m].
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from mcserver.gcode.semantics.arc_geometry import SMALLEST_RADIUS, Point
from mcserver.motion.geometry.curves import ArcCurve, LineCurve
from mcserver.units import TURN

# points closer than this coincide [m]
ONE_PLACE = 1e-9


class Piece(msgspec.Struct, frozen=True):
    """A line or an arc in the plane.

    Attributes:
        start, end: its ends. angle: direction of a line [rad], kept if trimming leaves no length.
        centre, sweep: of an arc, as in `ArcCurve`; None and 0 for a line.
    """

    start: Point
    end: Point
    angle: float = 0.0
    centre: Point | None = None
    sweep: float = 0.0

    def heading(self, *, at_end: bool) -> float:
        """Return the direction at an end [rad]."""
        if self.centre is None:
            return self.angle
        return _angle(self.centre, self.end if at_end else self.start) + math.copysign(TURN / 4.0, self.sweep)

    def offset(self, left: float) -> Piece | None:
        """Return the piece offset to its left [m]; None if nothing is left of an arc's radius."""
        if self.centre is None:
            across = (-left * math.sin(self.angle), left * math.cos(self.angle))
            return msgspec.structs.replace(self, start=_sum(self.start, across), end=_sum(self.end, across))
        outward = -left if self.sweep > 0.0 else left
        ends = [self._outward(self.centre, place, outward) for place in (self.start, self.end)]
        if ends[0] is None or ends[1] is None:
            return None
        return msgspec.structs.replace(self, start=ends[0], end=ends[1])

    @staticmethod
    def _outward(centre: Point, place: Point, far: float) -> Point | None:
        radius = math.dist(centre, place)
        if radius + far < SMALLEST_RADIUS:
            return None
        share = far / radius
        return (
            place[0] + share * (place[0] - centre[0]),
            place[1] + share * (place[1] - centre[1]),
        )

    def trimmed(self, *, start: Point | None = None, end: Point | None = None) -> Piece:
        """Return the piece with other ends on its line or circle."""
        begin, finish = start or self.start, end or self.end
        sweep = self.sweep
        if self.centre is not None:
            sweep += _turn(_angle(self.centre, begin), _angle(self.centre, self.start))
            sweep += _turn(_angle(self.centre, self.end), _angle(self.centre, finish))
        return msgspec.structs.replace(self, start=begin, end=finish, sweep=sweep)

    def goes_back(self, whole: Piece, begin: Point) -> bool:
        """Return whether nothing is left of this trimmed piece, from ``begin`` on; ``whole``: untrimmed."""
        if self.centre is not None:
            return self.sweep * whole.sweep < 0.0
        along = (math.cos(self.angle), math.sin(self.angle))
        return (self.end[0] - begin[0]) * along[0] + (self.end[1] - begin[1]) * along[1] < -ONE_PLACE

    def passes(self, place: Point) -> float:
        """Return a point's distance from the line or circle [m]."""
        if self.centre is not None:
            return abs(math.dist(place, self.centre) - math.dist(self.start, self.centre))
        away = (place[0] - self.start[0], place[1] - self.start[1])
        return abs(away[1] * math.cos(self.angle) - away[0] * math.sin(self.angle))


def piece_of(curve: LineCurve | ArcCurve, start: Point, end: Point) -> Piece:
    """Return a curve's path in the plane between given ends [m]."""
    if isinstance(curve, ArcCurve):
        return Piece(start, end, centre=curve.centre, sweep=curve.sweep)
    return Piece(start, end, _angle(start, end))


def turn_between(before: Piece, after: Piece) -> float:
    """Return the angle between the directions of two consecutive pieces [rad]; left is positive."""
    return _turn(before.heading(at_end=True), after.heading(at_end=False))


def meet(before: Piece, after: Piece, corner: Point) -> Point | None:
    """Return the intersection of the lines or circles of two offset pieces; None without one.

    Of two intersections the one near the corner, which moves away from it as the offset grows.
    """
    found = _crossings(before, after)
    if before.centre is not None and after.centre is not None:
        base, along = before.centre, _difference(after.centre, before.centre)
        side = [_cross(along, _difference(place, base)) for place in (corner, *found)]
    else:
        arc, line = (before, after) if before.centre is not None else (after, before)
        base = arc.centre or corner
        along = (math.cos(line.angle), math.sin(line.angle))
        side = [_dot(along, _difference(place, base)) for place in (corner, *found)]
    beside = [place for place, where in zip(found, side[1:], strict=True) if where * side[0] > 0.0] or found
    return min(beside, key=lambda place: math.dist(place, corner), default=None)


def _crossings(first: Piece, second: Piece) -> Sequence[Point]:
    if first.centre is None and second.centre is None:
        return _line_line(first, second)
    if first.centre is not None and second.centre is not None:
        return _circle_circle(
            first.centre,
            math.dist(first.centre, first.end),
            second.centre,
            math.dist(second.centre, second.start),
        )
    if first.centre is not None:
        return _line_circle(second, first.centre, math.dist(first.centre, first.end))
    assert second.centre is not None
    return _line_circle(first, second.centre, math.dist(second.centre, second.start))


def _line_line(first: Piece, second: Piece) -> Sequence[Point]:
    along, other = ((math.cos(piece.angle), math.sin(piece.angle)) for piece in (first, second))
    turn = _cross(along, other)
    if abs(turn) < 1e-12:
        return ()
    far = _cross(_difference(second.start, first.start), other) / turn
    return ((first.start[0] + far * along[0], first.start[1] + far * along[1]),)


def _line_circle(line: Piece, centre: Point, radius: float) -> Sequence[Point]:
    along = (math.cos(line.angle), math.sin(line.angle))
    foot = _dot(along, _difference(centre, line.start))
    nearest = (line.start[0] + foot * along[0], line.start[1] + foot * along[1])
    half = radius * radius - math.dist(nearest, centre) ** 2
    if half < 0.0:
        return ()
    return tuple(
        (nearest[0] + far * along[0], nearest[1] + far * along[1])
        for far in (-math.sqrt(half), math.sqrt(half))
    )


def _circle_circle(first: Point, radius: float, second: Point, other: float) -> Sequence[Point]:
    apart = math.dist(first, second)
    if apart < ONE_PLACE:
        return ()
    foot = (apart * apart + radius * radius - other * other) / (2.0 * apart)
    half = radius * radius - foot * foot
    if half < 0.0:
        return ()
    along = ((second[0] - first[0]) / apart, (second[1] - first[1]) / apart)
    nearest = (first[0] + foot * along[0], first[1] + foot * along[1])
    return tuple(
        (nearest[0] - far * along[1], nearest[1] + far * along[0])
        for far in (-math.sqrt(half), math.sqrt(half))
    )


def _angle(start: Point, end: Point) -> float:
    return math.atan2(end[1] - start[1], end[0] - start[0])


def _turn(start: float, end: float) -> float:
    """Return the smaller angle from one direction to another [rad]."""
    return math.remainder(end - start, TURN)


def _sum(first: Point, second: Point) -> Point:
    return first[0] + second[0], first[1] + second[1]


def _difference(first: Point, second: Point) -> Point:
    return first[0] - second[0], first[1] - second[1]


def _cross(first: Point, second: Point) -> float:
    return first[0] * second[1] - first[1] * second[0]


def _dot(first: Point, second: Point) -> float:
    return first[0] * second[0] + first[1] * second[1]
