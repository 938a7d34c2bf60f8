"""Work systems, G92, tool length, cycle and spindle as an immutable value (D-62 to D-66, D-75, D-110)."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from mcserver.gcode.profiles.directions import Directions, Vector, about_z, along, back, product
from mcserver.machine.dialect_section import Cutter, Retraction
from mcserver.machine.machine_file import Machine
from mcserver.machine.work_systems import ANGLE, SYSTEM_NUMBERS

Offsets = Mapping[int, float]
LENGTH_AXIS = 2  # a tool's length lies along Z


class Level(msgspec.Struct, frozen=True):
    """A height of a canned cycle as its word gives it [m]; ``incremental``: under G91."""

    value: float
    incremental: bool


class Pecks(msgspec.Struct, frozen=True):
    """Depths of pecks [m].

    Attributes:
        first: of the first one; each that follows is ``less`` deep less, and not below ``least``.
        total: with G73 the hole is cleared after so much in pecks; 0: never.
    """

    first: float
    less: float
    least: float
    total: float = 0.0


class DrillCycle(msgspec.Struct, frozen=True):
    """A canned cycle in force, with the words that later lines leave out (D-75).

    Attributes:
        code: one of ``DRILLING``. initial: where the drilling axis was before the first hole [m].
        bottom, clear: depth, and height R above the part. pecks: None: in one. dwell: P [s]; None: not given.
    """

    code: str
    initial: float
    bottom: Level
    clear: Level
    pecks: Pecks | None
    dwell: float | None


class Facing(msgspec.Struct, frozen=True):
    """How a machine stands to a tilted plane since G53.1.

    Attributes:
        turns: of the rotary axes that tilt the tool, axis → [rad].
        directions: where X, Y and Z of the work piece point along the axes at these.
        zero: where X, Y and Z are there with the spindle's point at the place on the work piece that it is at
            with all of these axes at the program's zero and X, Y and Z at 0 [m].
    """

    turns: Offsets
    directions: Directions
    zero: Vector


class PlaneLine(msgspec.Struct, frozen=True):
    """One of the lines of G68.2 that give a plane by points (P2) or vectors (P3).

    Attributes:
        form: P. number: Q. point: X Y Z [m]. vector: I J K.
        turn: R, about the plane's Z [deg]; None: it is not given.
    """

    form: int
    number: int
    point: Vector
    vector: Vector
    turn: float | None


class TiltedPlane(msgspec.Struct, frozen=True):
    """A plane on the work piece, as G68.2 gives it (D-111).

    Attributes:
        tool: number of the ``[[tool]]`` that is turned towards it.
        origin: in the work system [m]. directions: where its X, Y and Z point there.
        facing: None until G53.1.
        lines: those of P2 or P3 until the last one, which gives origin and directions.
    """

    tool: int
    origin: Vector
    directions: Directions
    facing: Facing | None = None
    lines: tuple[PlaneLine, ...] = ()


class Surface(msgspec.Struct, frozen=True):
    """Constant surface speed in force (D-120).

    Attributes:
        speed: at the tool [m/s]. greatest: of the spindle [rad/s].
        zero: where X is on the spindle's axis, as of its last order [m]. line: of its last word.
    """

    speed: float
    greatest: float
    zero: float
    line: int


class Frame(msgspec.Struct, frozen=True):
    """The frame that axis words are in, and the spindle.

    Attributes:
        system: 1 … 9, of G54 … G59.3. systems: origins of the work coordinate systems, axis → [m or rad],
            and by `ANGLE` the angle of those that are turned.
        cutters: of the tool table, by number, as G10 L1 set them; they go before the machine file's.
        worn: numbers of the tools whose life is used up, as the program began or went on behind a pause.
        g92: offsets of G92. g92_on: they count (G92.2 takes them out, G92.3 in). local: of G52.
        tool_length: of G43, G43.4 or G43.5 [m]. tool: number of the last T. changed: number of the last M6.
        tip_tool: number of the ``[[tool]]`` whose tip X Y Z lead (G43.4, G43.5); None: they are the axes.
        by_direction: I J K are where that tool points (G43.5).
        plane: of G68.2; None: there is none.
        stored: positions of G28.1 (28) and G30.1 (30).
        cycle: the last canned cycle; it is in force as long as no motion code is.
        to_initial: between holes the tool goes where it was before the cycle (G98), not to R (G99).
        direction: of the spindle, 1, -1 or 0. spindle_rpm: the last S of G97.
        surface: of G96; None: S counts turns.
        retraction: as M207 and M208 set it; None: as the machine file has it.
        retracted: how far G10 has moved the zeros of the extruder and of Z; None: it has not (D-115).
    """

    system: int = 1
    systems: Mapping[int, Offsets] = {}
    cutters: Mapping[int, Cutter] = {}
    worn: frozenset[int] = frozenset()
    g92: Offsets = {}
    g92_on: bool = True
    local: Offsets = {}
    tool_length: float = 0.0
    tool: int = 0
    changed: int | None = None
    tip_tool: int | None = None
    by_direction: bool = False
    plane: TiltedPlane | None = None
    stored: Mapping[int, Offsets] = {}
    cycle: DrillCycle | None = None
    to_initial: bool = True
    direction: int = 0
    spindle_rpm: float = 0.0
    surface: Surface | None = None
    retraction: Retraction | None = None
    retracted: Offsets | None = None

    def shift(self) -> dict[int, float] | None:
        """Return the program's zero by axis [m or rad]; None where it is the machine's zero.

        Under G43.4 and G43.5 the tip is led to where the words say: the tool's length is no part of it.
        """
        plane, facing = self.plane, self._facing
        inner = self.inner
        if plane is not None and facing is not None:
            inner = _sum(inner, dict(enumerate(plane.origin)))
        system = {axis: at for axis, at in self.systems.get(self.system, {}).items() if axis != ANGLE}
        total = _sum(along(self._turned, inner), system)
        if facing is not None:
            total = _sum(along(facing.directions, total), dict(enumerate(facing.zero)))
        total = _sum(total, self.retracted or {})
        if self.tool_length and self.tip_tool is None:
            lengthwise = along(self.directions, {LENGTH_AXIS: self.tool_length})
            total = _sum(total, lengthwise)
        total = {axis: offset for axis, offset in total.items() if offset != 0.0}
        return total or None

    @property
    def unlifted(self) -> Frame:
        """The frame where Z is not lifted by a retraction any more."""
        retracted = self.retracted
        if retracted is not None:
            retracted = {axis: offset for axis, offset in retracted.items() if axis != LENGTH_AXIS}
        return msgspec.structs.replace(self, retracted=retracted)

    @property
    def fitted(self) -> int:
        """Number of the tool in the spindle: of the last M6, before any of the last T."""
        return self.tool if self.changed is None else self.changed

    @property
    def tip_code(self) -> str:
        """The code by which the tip is led."""
        return "G43.5" if self.by_direction else "G43.4"

    @property
    def inner(self) -> dict[int, float]:
        """Offsets within the work system, of G52 and G92: they are turned with it [m or rad]."""
        return _sum(self.local, self.g92 if self.g92_on else {})

    @property
    def directions(self) -> Directions | None:
        """Where the program's X, Y and Z point; None: along the axes."""
        facing = self._facing
        if self.plane is None or facing is None:
            return self._turned
        return product(facing.directions, product(self._turned, self.plane.directions))

    @property
    def _turned(self) -> Directions | None:
        """Directions of the work system on the work piece."""
        angle = self.systems.get(self.system, {}).get(ANGLE, 0.0)
        return about_z(angle) if angle else None

    @property
    def _facing(self) -> Facing | None:
        return None if self.plane is None else self.plane.facing

    def coordinates(self, positions: Offsets) -> dict[int, float]:
        """Return what axes at these positions read in the zero in force [m or rad], unscaled and unturned."""
        zero = self.shift() or {}
        return back(self.directions, {axis: at - zero.get(axis, 0.0) for axis, at in positions.items()})

    def zeros(self) -> dict[str, Offsets]:
        """Return where programs read zero, by system [m or rad], as in ``systems``.

        Neither a tool's length nor a tilted plane counts.

        The system in force has the offsets of G92 and G52 in it; systems without an origin are left out.
        """
        found = {name: dict(self.systems.get(number, {})) for name, number in SYSTEM_NUMBERS.items()}
        own = next(name for name, number in SYSTEM_NUMBERS.items() if number == self.system)
        turn = {axis: angle for axis, angle in found[own].items() if axis == ANGLE}
        found[own] = {**(msgspec.structs.replace(self, tool_length=0.0, plane=None).shift() or {}), **turn}
        return {name: origin for name, origin in found.items() if any(origin.values())}


def _sum(first: Offsets, second: Offsets) -> dict[int, float]:
    """Return the sum of offsets, each of which may lack axes."""
    return {axis: first.get(axis, 0.0) + second.get(axis, 0.0) for axis in (*first, *second)}


def tool_table(machine: Machine, frame: Frame | None) -> dict[int, Cutter]:
    """Return the tool table in force: of the machine file, and over it what G10 L1 set."""
    return {**machine.dialect.cutters, **({} if frame is None else frame.cutters)}
