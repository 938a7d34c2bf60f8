"""Work systems, G92, tool length, cycle and spindle, as an immutable value (D-62 to D-66, D-75, D-110)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from mcserver.gcode.profiles.directions import Directions, Vector, about, along, back, product
from mcserver.machine.dialect_section import Cutter, Retraction
from mcserver.machine.machine_file import Machine
from mcserver.machine.work_systems import ANGLE, SYSTEM_NUMBERS

Offsets = Mapping[int, float]
LENGTH_AXIS = 2  # a tool's length lies along Z


class Level(msgspec.Struct, frozen=True):
    """A height of a canned cycle as written [m]; ``incremental``: under G91."""

    value: float
    incremental: bool


class Pecks(msgspec.Struct, frozen=True):
    """Depths of pecks [m].

    Attributes:
        first: of the first one; each further one is ``less`` smaller, and at least ``least``.
        total: with G73 the hole is cleared after this depth of pecks; 0: never.
    """

    first: float
    less: float
    least: float
    total: float = 0.0


class DrillCycle(msgspec.Struct, frozen=True):
    """A canned cycle in force, with the words that later lines may omit (D-75).

    Attributes:
        code: one of ``DRILLING``. initial: position of the drilling axis before the first hole [m].
        bottom, clear: depth, and height R above the part. pecks: None without. dwell: P [s]; None: not given.
    """

    code: str
    initial: float
    bottom: Level
    clear: Level
    pecks: Pecks | None
    dwell: float | None


class Facing(msgspec.Struct, frozen=True):
    """Orientation of the machine to a tilted plane since G53.1.

    Attributes:
        turns: positions of the rotary axes that tilt the tool, axis → [rad].
        directions: of the work piece's X, Y and Z along the axes, at these positions.
        zero: positions of X, Y and Z at these turns, for the point on the work piece where the spindle's
            point is with the rotary axes at the program's zero and X, Y and Z at 0 [m].
    """

    turns: Offsets
    directions: Directions
    zero: Vector


class PlaneLine(msgspec.Struct, frozen=True):
    """A line of a G68.2 that gives a plane by points (P2) or vectors (P3).

    Attributes:
        form: P. number: Q. point: X Y Z [m]. vector: I J K.
        turn: R, about the plane's Z [deg]; None: not given.
    """

    form: int
    number: int
    point: Vector
    vector: Vector
    turn: float | None


class TiltedPlane(msgspec.Struct, frozen=True):
    """A plane on the work piece, set by G68.2 (D-111).

    Attributes:
        tool: number of the ``[[tool]]`` that is turned towards it.
        origin: in the work system [m]. directions: of its X, Y and Z there.
        facing: None until G53.1.
        lines: of P2 or P3, until the last one completes origin and directions.
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
        zero: position of X at the spindle's axis, as last commanded [m]. line: of its last word.
    """

    speed: float
    greatest: float
    zero: float
    line: int


class Frame(msgspec.Struct, frozen=True):
    """The frame of axis words, and the spindle.

    Attributes:
        system: 1 … 9, of G54 … G59.3. systems: origins of the work coordinate systems, axis → [m or rad],
            and by `ANGLE` the angle of a rotated one.
        cutters: of the tool table, by number, as G10 L1 set them; they override the machine file's.
        worn: numbers of the tools whose life was used up when the program began or last resumed.
        g92: offsets of G92. g92_on: they are in force (G92.2 suspends, G92.3 restores). local: of G52.
        tool_length: of G43, G43.4 or G43.5 [m]. tool: number of the last T. changed: number of the last M6.
        tip_tool: number of the ``[[tool]]`` whose tip X Y Z command (G43.4, G43.5); None: X Y Z are axes.
        by_direction: I J K are that tool's direction (G43.5).
        plane: of G68.2; None: none in force.
        stored: positions of G28.1 (28) and G30.1 (30).
        cycle: the last canned cycle, in force while no motion code is.
        to_initial: between holes the tool retracts to its height before the cycle (G98), not to R (G99).
        direction: of the spindle, 1, -1 or 0. spindle_rpm: the last S of G97.
        surface: of G96; None: S is turns.
        retraction: as M207 and M208 set it; None: the machine file's.
        parameters: numbered ones that stayed of earlier programs, by number (D-81).
        retracted: shift of the zeros of the extruder and of Z by G10; None: not retracted (D-115).
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
    parameters: Mapping[int, float] = {}
    retracted: Offsets | None = None

    def shift(self) -> dict[int, float] | None:
        """Return the program's zero by axis [m or rad]; None if it is the machine's zero.

        The tool's length is not part of it under G43.4 and G43.5, where words give the tip's place.
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
        """The frame without the lift of Z by a retraction."""
        retracted = self.retracted
        if retracted is not None:
            retracted = {axis: offset for axis, offset in retracted.items() if axis != LENGTH_AXIS}
        return msgspec.structs.replace(self, retracted=retracted)

    @property
    def fitted(self) -> int:
        """Number of the tool in the spindle: of the last M6; before the first, of the last T."""
        return self.tool if self.changed is None else self.changed

    @property
    def tip_code(self) -> str:
        """The code that commands the tip."""
        return "G43.5" if self.by_direction else "G43.4"

    @property
    def inner(self) -> dict[int, float]:
        """Offsets within the work system, of G52 and G92, which rotate with it [m or rad]."""
        return _sum(self.local, self.g92 if self.g92_on else {})

    @property
    def directions(self) -> Directions | None:
        """Directions of the program's X, Y and Z; None: along the axes."""
        facing = self._facing
        if self.plane is None or facing is None:
            return self._turned
        return product(facing.directions, product(self._turned, self.plane.directions))

    @property
    def _turned(self) -> Directions | None:
        """Directions of the work system on the work piece."""
        angle = self.systems.get(self.system, {}).get(ANGLE, 0.0)
        return about(2, math.degrees(angle)) if angle else None

    @property
    def _facing(self) -> Facing | None:
        return None if self.plane is None else self.plane.facing

    def coordinates(self, positions: Offsets) -> dict[int, float]:
        """Return the program's coordinates of axis positions [m or rad], not scaled or rotated by codes."""
        zero = self.shift() or {}
        return back(self.directions, {axis: at - zero.get(axis, 0.0) for axis, at in positions.items()})

    def zeros(self) -> dict[str, Offsets]:
        """Return the zeros of programs by work system [m or rad], as ``systems``.

        Tool length and tilted plane are left out. The system in force includes the offsets of G92 and G52;
        systems without an origin are left out.
        """
        found = {name: dict(self.systems.get(number, {})) for name, number in SYSTEM_NUMBERS.items()}
        own = next(name for name, number in SYSTEM_NUMBERS.items() if number == self.system)
        turn = {axis: angle for axis, angle in found[own].items() if axis == ANGLE}
        found[own] = {**(msgspec.structs.replace(self, tool_length=0.0, plane=None).shift() or {}), **turn}
        return {name: origin for name, origin in found.items() if any(origin.values())}


def _sum(first: Offsets, second: Offsets) -> dict[int, float]:
    """Return the sum of offsets; missing axes count as 0."""
    return {axis: first.get(axis, 0.0) + second.get(axis, 0.0) for axis in (*first, *second)}


def tool_table(machine: Machine, frame: Frame | None) -> dict[int, Cutter]:
    """Return the tool table in force: the machine file's, overridden by G10 L1."""
    return {**machine.dialect.cutters, **({} if frame is None else frame.cutters)}
