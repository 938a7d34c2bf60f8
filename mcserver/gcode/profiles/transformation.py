"""Turned, scaled, mirrored and polar coordinates of a program as an immutable value (D-94 to D-96).

Programmed coordinates go through polar coordinates, scaling and rotation in this order, as on Fanuc's
controllers, and then along the directions of the work system; offsets of the zero and compensation of the
cutter come behind.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import msgspec

from mcserver.gcode.profiles.directions import Directions, along, back, cosine_and_sine, coupled

Offsets = Mapping[int, float]
# factors whose amounts differ by less are equal
SAME_FACTOR = 1e-9


class Scaling(msgspec.Struct, frozen=True):
    """G51, or G51.1, which mirrors.

    Attributes:
        code: that it comes from. factors, centres: by axis [1, m]; axes without are as programmed.
    """

    code: str
    factors: Offsets
    centres: Offsets

    def scaled(self, axis: int, value: float) -> float:
        """Return where a coordinate lies [m]."""
        centre = self.centres.get(axis, 0.0)
        return centre + self.factors.get(axis, 1.0) * (value - centre)

    def unscaled(self, axis: int, value: float) -> float:
        """Return the coordinate of a place [m]."""
        centre = self.centres.get(axis, 0.0)
        return centre + (value - centre) / self.factors.get(axis, 1.0)


class Rotation(msgspec.Struct, frozen=True):
    """G68.

    Attributes:
        plane: its two axes. centre: as scaled [m]. degrees: counter-clockwise, seen from the plane's normal.
    """

    plane: tuple[int, int]
    centre: tuple[float, float]
    degrees: float

    def turned(self, first: float, second: float, *, back: bool = False) -> tuple[float, float]:
        """Turn a vector of the plane; ``back``: the other way."""
        cosine, sine = cosine_and_sine(-self.degrees if back else self.degrees)
        return cosine * first - sine * second, sine * first + cosine * second


class Polar(msgspec.Struct, frozen=True):
    """G16: the plane's first letter is a radius, its second one an angle; or @ and ^ of one line.

    Attributes:
        plane: its two axes. radius, degrees: of the last words [m, deg]; None: there were none yet.
        of_line: @ and ^, whose radius may be an increment or negative, and whose arcs have I J K too.
    """

    plane: tuple[int, int]
    radius: float | None = None
    degrees: float | None = None
    of_line: bool = False


class Transformation(msgspec.Struct, frozen=True):
    """How programmed X Y Z become coordinates along the axes, in the zero in force.

    Attributes:
        directions: of the zero in force, as its frame has them. tilted: they are those of G68.2.
        unsettled: axes whose programmed coordinate controllers have differently, until a word of G90 says it.
    """

    scaling: Scaling | None = None
    rotation: Rotation | None = None
    polar: Polar | None = None
    directions: Directions | None = None
    tilted: bool = False
    unsettled: frozenset[int] = frozenset()

    @property
    def idle(self) -> bool:
        """Whether X Y Z are as they are without it."""
        return self == Transformation()

    @property
    def axes(self) -> frozenset[int]:
        """Return the axes that do not go where their words say."""
        return self.changed | coupled(self.directions, self.changed) | self.turned

    @property
    def changed(self) -> frozenset[int]:
        """Return the coordinates that codes of the program scale, mirror, rotate or have as polar ones."""
        found = set(() if self.scaling is None else self.scaling.factors)
        for part in (self.rotation, self.polar):
            found.update(() if part is None else part.plane)
        return frozenset(found)

    @property
    def turned(self) -> frozenset[int]:
        """Return the axes that are no direction of the zero in force."""
        rows = enumerate(self.directions or ())
        return frozenset(
            axis for axis, row in rows if row[axis] < 1.0 or any(row[other] for other in {0, 1, 2} - {axis})
        )

    def in_plane(self, plane: tuple[int, int]) -> bool:
        """Return whether a plane of the program is the same plane of the axes."""
        return coupled(self.directions, frozenset(plane)) == frozenset(plane)

    def reverses(self, plane: tuple[int, int]) -> bool:
        """Return whether such a plane is seen from behind along the axes: left and right change sides."""
        if self.directions is None:
            return False
        (a, b), (c, d) = (tuple(self.directions[row][column] for column in plane) for row in plane)
        return a * d - b * c < 0.0

    def like(self, other: Transformation | None) -> bool:
        """Return whether places are turned and scaled alike."""
        other = other or Transformation()
        polar = (self.polar is None) == (other.polar is None)
        own = (self.scaling, self.rotation, self.directions)
        return polar and own == (other.scaling, other.rotation, other.directions)

    @property
    def needs_plane(self) -> tuple[int, int] | None:
        """Return the axes of the plane that may not change; None: any may be chosen."""
        part = self.rotation or self.polar
        return None if part is None else part.plane

    @property
    def names(self) -> str:
        """Name the codes in force."""
        found = [] if self.scaling is None else [self.scaling.code]
        found += [] if self.rotation is None else ["G68"]
        found += [] if self.polar is None else ["G16"]
        found += ["G68.2"] if self.tilted else []
        return " and ".join(found or ["a turned work system"])

    @property
    def enders(self) -> str:
        """Name the codes that end those in force, in their order."""
        found = [] if self.polar is None else ["G15"]
        found += [] if self.rotation is None and not self.tilted else ["G69"]
        found += [] if self.scaling is None else [self.scaling.code.replace("G51", "G50")]
        return " and ".join(found or ["G10 L2 P0 R0, or another system,"])

    def coupled(self, named: frozenset[int]) -> frozenset[int]:
        """Return the axes that words of some axes move."""
        found = set(coupled(self.directions, named))
        for part in (self.rotation, self.polar):
            if part is not None and found.intersection(part.plane):
                found.update(coupled(self.directions, frozenset(part.plane)))
        return frozenset(found)

    def without(self, moved: Iterable[int]) -> Transformation:
        """Return it behind a motion that knows nothing of it, such as G53."""
        lost = self.coupled(frozenset(moved)) & (frozenset((0, 1, 2)) if self.tilted else self.changed)
        return msgspec.structs.replace(self, unsettled=self.unsettled | lost)

    def applied(self, place: Mapping[int, float]) -> dict[int, float]:
        """Return coordinates along the axes [m] of programmed ones, both of a rotation's plane or none."""
        found = dict(place)
        if self.scaling is not None:
            found = {axis: self.scaling.scaled(axis, value) for axis, value in found.items()}
        return along(self.directions, self._turned(found, back=False))

    def undone(self, place: Mapping[int, float]) -> dict[int, float]:
        """Return the programmed coordinates [m] of ones along the axes."""
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
        """Return a programmed vector of a plane, scaled and rotated."""
        u, v = (factor * each for factor, each in zip(self.factors(plane), (first, second), strict=True))
        rotation = self.rotation
        return (u, v) if rotation is None or rotation.plane != plane else rotation.turned(u, v)

    def factors(self, plane: tuple[int, int]) -> tuple[float, float]:
        """Return the factors of a plane's axes."""
        scaling = self.scaling
        if scaling is None:
            return 1.0, 1.0
        return scaling.factors.get(plane[0], 1.0), scaling.factors.get(plane[1], 1.0)

    def mirrors(self, plane: tuple[int, int]) -> bool:
        """Return whether left and right change sides in a plane."""
        first, second = self.factors(plane)
        return first * second < 0.0

    def keeps_circles(self, plane: tuple[int, int]) -> bool:
        """Return whether arcs of a plane stay arcs."""
        first, second = self.factors(plane)
        return abs(abs(first) - abs(second)) <= SAME_FACTOR * abs(first)
