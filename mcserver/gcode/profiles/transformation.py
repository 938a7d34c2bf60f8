"""Rotated, scaled, mirrored and polar coordinates of a program, as an immutable value (D-94 to D-96).

As on Fanuc's controllers, programmed coordinates pass through polar coordinates, scaling and rotation in this
order, then the directions of the work system, then zero offsets and cutter compensation.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import msgspec

from mcserver.gcode.profiles.directions import Directions, along, back, cosine_and_sine, coupled

Offsets = Mapping[int, float]
# amounts of factors closer than this are equal
SAME_FACTOR = 1e-9


class Scaling(msgspec.Struct, frozen=True):
    """G51, or G51.1, which mirrors.

    Attributes:
        code: G51 or G51.1. factors, centres: by axis [1, m]; other axes are not scaled.
    """

    code: str
    factors: Offsets
    centres: Offsets

    def scaled(self, axis: int, value: float) -> float:
        """Scale a coordinate [m]."""
        centre = self.centres.get(axis, 0.0)
        return centre + self.factors.get(axis, 1.0) * (value - centre)

    def unscaled(self, axis: int, value: float) -> float:
        """Return the programmed coordinate of a scaled one [m]."""
        centre = self.centres.get(axis, 0.0)
        return centre + (value - centre) / self.factors.get(axis, 1.0)


class Rotation(msgspec.Struct, frozen=True):
    """G68.

    Attributes:
        plane: its two axes. centre: after scaling [m]. degrees: counter-clockwise, seen from the plane's
            normal.
    """

    plane: tuple[int, int]
    centre: tuple[float, float]
    degrees: float

    def turned(self, first: float, second: float, *, back: bool = False) -> tuple[float, float]:
        """Rotate a vector of the plane, ``back``: by the negative angle."""
        cosine, sine = cosine_and_sine(-self.degrees if back else self.degrees)
        return cosine * first - sine * second, sine * first + cosine * second


class Polar(msgspec.Struct, frozen=True):
    """G16: the plane's first letter is a radius, the second an angle; or @ and ^ of one line.

    Attributes:
        plane: its two axes. radius, degrees: of the last words [m, deg]; None: not given yet.
        of_line: @ and ^, whose radius may be incremental or negative, and whose arcs may have I J K.
    """

    plane: tuple[int, int]
    radius: float | None = None
    degrees: float | None = None
    of_line: bool = False


class Transformation(msgspec.Struct, frozen=True):
    """Convert programmed X Y Z to coordinates along the axes, in the zero in force.

    Attributes:
        directions: of the frame in force. tilted: they are of G68.2.
        unsettled: axes whose programmed coordinate differs between controllers, until a word of G90 sets it.
    """

    scaling: Scaling | None = None
    rotation: Rotation | None = None
    polar: Polar | None = None
    directions: Directions | None = None
    tilted: bool = False
    unsettled: frozenset[int] = frozenset()

    @property
    def idle(self) -> bool:
        """Whether it leaves X Y Z unchanged."""
        return self == Transformation()

    @property
    def axes(self) -> frozenset[int]:
        """Axes that do not move to the coordinate in their word."""
        return self.changed | coupled(self.directions, self.changed) | self.turned

    @property
    def changed(self) -> frozenset[int]:
        """Axes whose coordinates codes of the program scale, mirror, rotate or read as polar."""
        found = set(() if self.scaling is None else self.scaling.factors)
        for part in (self.rotation, self.polar):
            found.update(() if part is None else part.plane)
        return frozenset(found)

    @property
    def turned(self) -> frozenset[int]:
        """Axes along which no direction of the frame points."""
        rows = enumerate(self.directions or ())
        return frozenset(
            axis for axis, row in rows if row[axis] < 1.0 or any(row[other] for other in {0, 1, 2} - {axis})
        )

    def in_plane(self, plane: tuple[int, int]) -> bool:
        """Return whether a plane of the program is the plane of the axes with these numbers."""
        return coupled(self.directions, frozenset(plane)) == frozenset(plane)

    def reverses(self, plane: tuple[int, int]) -> bool:
        """Return whether the frame's directions exchange left and right in a plane as of `in_plane`."""
        if self.directions is None:
            return False
        (a, b), (c, d) = (tuple(self.directions[row][column] for column in plane) for row in plane)
        return a * d - b * c < 0.0

    def like(self, other: Transformation | None) -> bool:
        """Return whether both rotate and scale alike."""
        other = other or Transformation()
        polar = (self.polar is None) == (other.polar is None)
        own = (self.scaling, self.rotation, self.directions)
        return polar and own == (other.scaling, other.rotation, other.directions)

    @property
    def needs_plane(self) -> tuple[int, int] | None:
        """Plane that must not be changed, as its two axes; None: any plane may be chosen."""
        part = self.rotation or self.polar
        return None if part is None else part.plane

    @property
    def names(self) -> str:
        """Codes in force, for messages."""
        found = [] if self.scaling is None else [self.scaling.code]
        found += [] if self.rotation is None else ["G68"]
        found += [] if self.polar is None else ["G16"]
        found += ["G68.2"] if self.tilted else []
        return " and ".join(found or ["a turned work system"])

    @property
    def enders(self) -> str:
        """Codes that end those in force, in their order, for messages."""
        found = [] if self.polar is None else ["G15"]
        found += [] if self.rotation is None and not self.tilted else ["G69"]
        found += [] if self.scaling is None else [self.scaling.code.replace("G51", "G50")]
        return " and ".join(found or ["G10 L2 P0 R0, or another system,"])

    def coupled(self, named: frozenset[int]) -> frozenset[int]:
        """Return the axes that words for these axes move."""
        found = set(coupled(self.directions, named))
        for part in (self.rotation, self.polar):
            if part is not None and found.intersection(part.plane):
                found.update(coupled(self.directions, frozenset(part.plane)))
        return frozenset(found)

    def without(self, moved: Iterable[int]) -> Transformation:
        """Return it after a motion of axes to which it does not apply, such as G53."""
        lost = self.coupled(frozenset(moved)) & (frozenset((0, 1, 2)) if self.tilted else self.changed)
        return msgspec.structs.replace(self, unsettled=self.unsettled | lost)

    def applied(self, place: Mapping[int, float]) -> dict[int, float]:
        """Convert programmed coordinates to ones along the axes [m]; both of a rotation's plane, or none."""
        found = dict(place)
        if self.scaling is not None:
            found = {axis: self.scaling.scaled(axis, value) for axis, value in found.items()}
        return along(self.directions, self._turned(found, back=False))

    def undone(self, place: Mapping[int, float]) -> dict[int, float]:
        """Convert coordinates along the axes to programmed ones [m]."""
        found = self._turned(back(self.directions, place), back=True)
        if self.scaling is not None:
            found = {axis: self.scaling.unscaled(axis, value) for axis, value in found.items()}
        return found

    def _turned(self, place: dict[int, float], *, back: bool) -> dict[int, float]:
        rotation = self.rotation
        if rotation is None or not place.keys() >= set(rotation.plane):
            return place
        first, second = rotation.plane
        u, v = rotation.centre
        x, y = rotation.turned(place[first] - u, place[second] - v, back=back)
        return {**place, first: u + x, second: v + y}

    def vector(self, plane: tuple[int, int], first: float, second: float) -> tuple[float, float]:
        """Scale and rotate a programmed vector of a plane."""
        u, v = (factor * each for factor, each in zip(self.factors(plane), (first, second), strict=True))
        rotation = self.rotation
        return (u, v) if rotation is None or rotation.plane != plane else rotation.turned(u, v)

    def factors(self, plane: tuple[int, int]) -> tuple[float, float]:
        """Return the scaling factors of a plane's axes."""
        scaling = self.scaling
        if scaling is None:
            return 1.0, 1.0
        return scaling.factors.get(plane[0], 1.0), scaling.factors.get(plane[1], 1.0)

    def mirrors(self, plane: tuple[int, int]) -> bool:
        """Return whether scaling mirrors a plane."""
        first, second = self.factors(plane)
        return first * second < 0.0

    def keeps_circles(self, plane: tuple[int, int]) -> bool:
        """Return whether scaling maps a plane's arcs to arcs."""
        first, second = self.factors(plane)
        return abs(abs(first) - abs(second)) <= SAME_FACTOR * abs(first)
