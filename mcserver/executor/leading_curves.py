"""Position of a following axis as a function of its leader's: an electronic gear, or a cam table."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Protocol

from mcserver.machine.follow_section import Follow


class LeadingCurve(Protocol):
    """A twice differentiable function from the leader's position to the follower's."""

    def at(self, place: float) -> tuple[float, float, float]:
        """Return value, slope and curvature at a position of the leader."""


class Gear:
    """A constant ratio, through 0."""

    def __init__(self, ratio: float) -> None:
        self._ratio = ratio

    def at(self, place: float) -> tuple[float, float, float]:
        return self._ratio * place, self._ratio, 0.0


class Cam:
    """A cam table; between points a polynomial of the fifth order with curvature 0 at the points.

    Between points with slope 0 that is the 3-4-5 polynomial of cams (Norton, Cam Design and Manufacturing
    Handbook, 2009, ch. 3).

    Args:
        points: leader's position, value and slope, ascending by position; at least two.
        repeats: the cam is periodic; else it is constant beyond its ends.
    """

    def __init__(self, points: Sequence[tuple[float, float, float]], *, repeats: bool) -> None:
        self._points = tuple(points)
        self._places = [place for place, _, _ in points]
        self._repeats = repeats
        self._length = points[-1][0] - points[0][0]
        self._climb = points[-1][1] - points[0][1]

    def at(self, place: float) -> tuple[float, float, float]:
        first, last = self._points[0], self._points[-1]
        climbed = 0.0
        if self._repeats:
            rounds = (place - first[0]) // self._length
            place, climbed = place - rounds * self._length, rounds * self._climb
        # NaN: hold the value at an end
        if not first[0] <= place <= last[0]:
            return (first[1] if place < first[0] else last[1] if place > last[0] else place), 0.0, 0.0
        cell = min(bisect_right(self._places, place), len(self._points) - 1)
        (start, low, slope), (end, high, slope_after) = self._points[cell - 1 : cell + 1]
        width = end - start
        u = (place - start) / width
        rise, turn = high - low - slope * width, (slope_after - slope) * width
        a, b, c = 10.0 * rise - 4.0 * turn, 7.0 * turn - 15.0 * rise, 6.0 * rise - 3.0 * turn
        return (
            climbed + low + u * (slope * width + u * u * (a + u * (b + u * c))),
            slope + u * u * (3.0 * a + u * (4.0 * b + u * 5.0 * c)) / width,
            u * (6.0 * a + u * (12.0 * b + u * 20.0 * c)) / width**2,
        )


def curve_of(follow: Follow) -> LeadingCurve:
    """Return the gear or the cam of an axis's section."""
    if follow.ratio is not None:
        return Gear(follow.ratio)
    return Cam(follow.cam, repeats=follow.repeats)
