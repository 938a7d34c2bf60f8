"""``[clearance]``, ``[[body]]`` and ``[[zone]]``: bodies that must not touch, and zones."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import msgspec
from msgspec import Meta

from mcserver.machine.section_reader import Mistakes, did_you_mean
from mcserver.machine.toml_positions import Path as TomlPath
from mcserver.machine.work_systems import SYSTEM_NUMBERS, WorkSystem
from mcserver.units import AxisType

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis

Length = Annotated[float, Meta(gt=0.0, le=1e6, description="give mm above 0, at the most 1e6")]
Number = Annotated[float, Meta(ge=-1e6, le=1e6, description="give a number up to 1e6")]
Place = tuple[Number, Number, Number]
AxisIndex = Annotated[int, Meta(ge=0, le=63, description="an axis of this file")]
# Most bodies, and most zones, in a machine file.
MOST_BODIES = 200
# Most bodies that a program may add.
MOST_GIVEN = 32
# Most inputs, with a level each, that switch zones: each is a bit in the executor's message.
MOST_SWITCHES = 63
# Roles that a zone may bind: runs that a person has approved, and all other motion, which only operators and
# engineers can request.
RunRole = Literal["agent", "operator"]
AGENT, OPERATOR = ROLES = ("agent", "operator")
# One agent, by its user's name as in the site file.
_ONE_AGENT = re.compile(rf"{AGENT}:[A-Za-z0-9][A-Za-z0-9_-]{{0,31}}")

ORIGIN: Place = (0.0, 0.0, 0.0)


class Carried(msgspec.Struct, frozen=True, kw_only=True):
    """Attributes that all shapes of bodies have.

    Attributes:
        name: of the body. at_mm: its middle, in the frame of its carrier. turned_deg: angles A, B, C, as
            Rz(C)·Ry(B)·Rx(A).
        link: link of the URDF that carries it. carried_by: linear axes that carry it instead, each along its
            letter X, Y or Z; neither: it is fixed. opposite: for a table, which moves against its axes.
        tool: number of the tool that it belongs to; None: it is always present.
    """

    name: Annotated[str, Meta(min_length=1, max_length=60, description="give it a name")]
    at_mm: Place = ORIGIN
    turned_deg: Place = ORIGIN
    link: str | None = None
    carried_by: list[AxisIndex] = []
    opposite: bool = False
    tool: Annotated[int, Meta(ge=1, le=99999, description="give the number that T names")] | None = None


class BoxBody(Carried, frozen=True, kw_only=True, tag_field="shape", tag="box"):
    """A box with three edge lengths."""

    size_mm: tuple[Length, Length, Length]


class CylinderBody(Carried, frozen=True, kw_only=True, tag_field="shape", tag="cylinder"):
    """A cylinder along its own Z."""

    radius_mm: Length
    length_mm: Length


class CapsuleBody(Carried, frozen=True, kw_only=True, tag_field="shape", tag="capsule"):
    """A cylinder along its own Z with half spheres on its ends, which add to its length."""

    radius_mm: Length
    length_mm: Length


class SphereBody(Carried, frozen=True, kw_only=True, tag_field="shape", tag="sphere"):
    """A sphere."""

    radius_mm: Length


class MeshBody(Carried, frozen=True, kw_only=True, tag_field="shape", tag="mesh"):
    """The convex hull of a mesh file (STL, OBJ, DAE), in mm, relative to the machine file."""

    file: str


class CutterBody(Carried, frozen=True, kw_only=True, tag_field="shape", tag="cutter"):
    """The cutter in the spindle: a cylinder from ``at_mm`` along its own -Z, with length and diameter of the
    fitted tool in the tool table.
    """


Body = BoxBody | CylinderBody | CapsuleBody | SphereBody | MeshBody | CutterBody


class GivenBody(msgspec.Struct, frozen=True):
    """A body that a program adds; ``touches``: names of bodies that may touch it."""

    body: Body
    touches: tuple[str, ...] = ()


def measures(body: Body) -> tuple[str, tuple[float, ...]]:
    """Return a body's shape and sizes [mm]: edges of a box, radius and length of round ones, none of a mesh
    or the cutter.
    """
    match body:
        case BoxBody():
            return "box", body.size_mm
        case CylinderBody():
            return "cylinder", (body.radius_mm, body.length_mm)
        case CapsuleBody():
            return "capsule", (body.radius_mm, body.length_mm)
        case SphereBody():
            return "sphere", (body.radius_mm,)
        case MeshBody():
            return "mesh", ()
        case CutterBody():
            return "cutter", ()


class Switch(NamedTuple):
    """Number of the digital input that switches a zone, and the level at which it is on."""

    input: int
    high: bool


def agent_role(client: str) -> str:
    """Return the role of an approved run by its requesting client's id, which begins with the user and a dot.

    Without a user it is the role of all agents.
    """
    user, dot, _ = client.partition(".")
    return f"{AGENT}:{user}" if dot else ROLES[0]


class Zone(msgspec.Struct, frozen=True, kw_only=True):
    """A ``[[zone]]``: a box that bodies stay out of, or in, or are slow in.

    Attributes:
        max_speed_mm_s: in a slow zone.
        work: work system of its place and angles; None: the base's frame. on: body or URDF link that carries
            it; None: it is fixed.
        bodies: bodies and links that it applies to; empty: all that move.
        roles: whom it binds (`AGENT`, one agent as by `agent_role`, `OPERATOR`); empty: everybody.
        input, active: number of the digital input that switches it, and the level at which it is on.
    """

    name: Annotated[str, Meta(min_length=1, max_length=60, description="give it a name")]
    size_mm: tuple[Length, Length, Length]
    kind: Literal["keep_out", "keep_in", "slow"] = "keep_out"
    max_speed_mm_s: Annotated[float, Meta(gt=0.0, description="give mm/s above 0")] | None = None
    at_mm: Place = ORIGIN
    turned_deg: Place = ORIGIN
    work: WorkSystem | None = None
    on: str | None = None
    bodies: list[str] = []
    roles: list[str] = []
    input: Annotated[int, Meta(ge=0, le=63, description="give the number of a digital input")] | None = None
    active: Literal["high", "low"] | None = None

    @property
    def switch(self) -> Switch | None:
        """Switch of the zone; None: always on."""
        return None if self.input is None else Switch(self.input, self.active == "high")

    @property
    def system(self) -> int | None:
        """Number of its work system; None without one."""
        return None if self.work is None else SYSTEM_NUMBERS[self.work]

    @property
    def fixed(self) -> bool:
        """Whether its place is fixed by the machine file."""
        return self.work is None and self.on is None

    def binds(self, role: str | None) -> bool:
        """Return whether it applies to a role; None: to any role, `AGENT`: to any agent."""
        if role is None or not self.roles or role in self.roles:
            return True
        kind, _, name = role.partition(":")
        return kind in self.roles or (not name and any(each.startswith(f"{kind}:") for each in self.roles))


class ClearanceSection(msgspec.Struct, frozen=True):
    """``[clearance]`` as written.

    Attributes:
        margin_mm: smaller distances of bodies count as contact.
        allowed: pairs of names that may touch. srdf: file whose ``disable_collisions`` may touch too,
            relative to the machine file.
    """

    margin_mm: Annotated[float, Meta(ge=0.0, le=1000.0, description="1 is usual")] = 1.0
    allowed: list[tuple[str, str]] = []
    srdf: str | None = None


class Clearance(msgspec.Struct, frozen=True):
    """``[clearance]``, ``[[body]]`` and ``[[zone]]`` together; file names are absolute.

    Attributes:
        margin: [m]. letters: direction of each linear axis, by axis index: 0 for X, 1 for Y, 2 for Z.
    """

    margin: float
    allowed: tuple[tuple[str, str], ...]
    srdf: str | None
    bodies: tuple[Body, ...]
    zones: tuple[Zone, ...]
    letters: Mapping[int, int]

    @property
    def follows_cutter(self) -> bool:
        """Whether one of the bodies is the cutter."""
        return any(isinstance(each, CutterBody) for each in self.bodies)

    @property
    def switches(self) -> tuple[Switch, ...]:
        """Switches of all zones, each once; the index is its bit."""
        return tuple(dict.fromkeys(each.switch for each in self.zones if each.switch is not None))


class ToolsOfBodies(NamedTuple):
    """Tools that bodies of a machine file may belong to.

    Attributes:
        numbers: that T may name; None: any. spindle: T and M6 fit a cutter in one. cutters: length and
            diameter of each, by index of its section [mm].
    """

    numbers: frozenset[int] | None
    spindle: bool
    cutters: Mapping[int, tuple[float, float]]


def read_clearance(
    section: ClearanceSection | None,
    bodies: Sequence[Body | None],
    zones: Sequence[Zone | None],
    axes: Mapping[int, Axis],
    letters: Mapping[str, int],
    tools: ToolsOfBodies,
    folder: Path | None,
    mistakes: Mistakes,
    *,
    urdf: bool,
) -> Clearance | None:
    """Return the bodies and zones to check motion against; None without any, or after a mistake.

    Args:
        letters: axis of each letter in programs. tools: that bodies may belong to.
        urdf: the machine has one; its links are only known when the model is built.
    """
    if section is None and not bodies and not zones:
        return None
    directions = {
        letters[letter]: direction
        for direction, letter in enumerate("XYZ")
        if letter in letters and letters[letter] in axes and axes[letters[letter]].type is AxisType.LINEAR
    }
    for key, found in (("body", bodies), ("zone", zones)):
        if len(found) > MOST_BODIES:
            mistakes.add((key,), f"there are more than {MOST_BODIES}", "join some of them")
        _check_names(key, [each.name if each is not None else "" for each in found], mistakes)
    for position, body in enumerate(bodies):
        if body is not None:
            _check_carrier(body, directions, ("body", position), mistakes)
            _check_tool(body, tools, ("body", position), mistakes)
    for position, zone in enumerate(zones):
        if zone is not None and (zone.kind == "slow") is (zone.max_speed_mm_s is None):
            hint = "give it to a slow zone, and to no other"
            what = "is missing" if zone.kind == "slow" else f"is not for {zone.kind}"
            mistakes.add(("zone", position, "max_speed_mm_s"), what, hint)
        if zone is not None:
            _check_roles(zone, ("zone", position), mistakes)
            if not urdf:
                _check_carried(zone, bodies, ("zone", position), mistakes)
    _check_cutters([each for each in bodies if each is not None], tools, mistakes)
    if None in bodies or None in zones:
        return None
    section = section or ClearanceSection()
    base = folder or Path()
    return Clearance(
        margin=section.margin_mm * 1e-3,
        allowed=tuple(section.allowed),
        srdf=None if section.srdf is None else str(base / section.srdf),
        bodies=tuple(
            msgspec.structs.replace(each, file=str(base / each.file)) if isinstance(each, MeshBody) else each
            for each in bodies
            if each is not None
        ),
        zones=tuple(each for each in zones if each is not None),
        letters=directions,
    )


def check_switches(zones: Sequence[Zone | None], digital: Container[int], mistakes: Mistakes) -> None:
    """Refuse zones whose input does not exist; ``digital``: numbers of the digital inputs."""
    for position, zone in enumerate(zones):
        if zone is None:
            continue
        path = ("zone", position)
        if zone.input is not None and zone.input not in digital:
            message = f"the machine has no digital input {zone.input}"
            mistakes.add((*path, "input"), message, f"add [[input]] with number = {zone.input}")
        if (zone.input is None) is not (zone.active is None):
            what = "is missing" if zone.active is None else "is not for a zone without input"
            hint = 'give "low" where a cut wire has to count as on, as of a light curtain, else "high"'
            mistakes.add((*path, "active"), what, hint)
    if len({each.switch for each in zones if each is not None} - {None}) > MOST_SWITCHES:
        mistakes.add(("zone",), f"more than {MOST_SWITCHES} inputs switch zones", "let zones share some")


def check_work_systems(zones: Sequence[Zone | None], missing: str, mistakes: Mistakes) -> None:
    """Refuse zones in a work system; ``missing``: why the machine has no work systems, empty: it has."""
    for position, zone in enumerate(zones):
        if missing and zone is not None and zone.work is not None:
            hint = "leave it out, and give the place in the base's frame, or in that of what carries it (on)"
            mistakes.add(
                ("zone", position, "work"), f"no zone of this machine is in {zone.work}: {missing}", hint
            )


def _check_carried(zone: Zone, bodies: Sequence[Body | None], path: TomlPath, mistakes: Mistakes) -> None:
    known = [each.name for each in bodies if each is not None]
    if zone.on is not None and zone.on not in known:
        hint = did_you_mean(zone.on, known, "name a [[body]]")
        mistakes.add((*path, "on"), f"there is no body {zone.on!r} to carry it", hint)


def _check_roles(zone: Zone, path: TomlPath, mistakes: Mistakes) -> None:
    for role in zone.roles:
        if role in ROLES or _ONE_AGENT.fullmatch(role):
            continue
        hint = 'take "agent" (runs that a person has approved), "agent:NAME" or "operator" (all other motion)'
        if role.startswith(f"{AGENT}:"):
            hint = "give the user's name behind the colon, without the dot and what client ids have behind it"
        if role == "engineer":
            hint = 'take "operator": the server cannot tell engineers from operators'
        mistakes.add((*path, "roles"), f"there is no role {role!r} to bind", did_you_mean(role, ROLES, hint))


def _check_names(key: str, names: Sequence[str], mistakes: Mistakes) -> None:
    for position, name in enumerate(names):
        if name and name in names[:position]:
            mistakes.add((key, position, "name"), f"{name!r} is there twice", "give each a name of its own")


def _check_carrier(body: Body, directions: Container[int], path: TomlPath, mistakes: Mistakes) -> None:
    if body.link is not None and body.carried_by:
        mistakes.add((*path, "carried_by"), "a link carries it already", "leave out link or carried_by")
    for axis in body.carried_by:
        if axis not in directions:
            mistakes.add(
                (*path, "carried_by"),
                f"axis {axis} is not one of the linear axes X, Y, Z",
                "name those axes; bodies of robots are carried by a link",
            )
    if len(set(body.carried_by)) < len(body.carried_by):
        mistakes.add((*path, "carried_by"), "names an axis twice", "name each once")


def _check_tool(body: Body, tools: ToolsOfBodies, path: TomlPath, mistakes: Mistakes) -> None:
    """Refuse a body whose tool cannot be selected."""
    if isinstance(body, CutterBody):
        if not tools.spindle:
            hint = 'set profile = "cnc" in [dialect], or give the body a shape and its tool'
            mistakes.add((*path, "shape"), "no program of this machine fits a cutter", hint)
        if body.tool is not None:
            mistakes.add((*path, "tool"), "the cutter is that of any tool", "leave it out")
    elif body.tool is not None and tools.numbers is not None and body.tool not in tools.numbers:
        known = ", ".join(f"T{each}" for each in sorted(tools.numbers))
        hint = f"there are {known}" if known else "add [[tool]] or [[cutter]] sections"
        mistakes.add((*path, "tool"), f"the machine has no tool {body.tool}", hint)


def _check_cutters(bodies: Sequence[Body], tools: ToolsOfBodies, mistakes: Mistakes) -> None:
    """Refuse a tool table that does not give the cutter's body a size."""
    named = [each for each in bodies if isinstance(each, CutterBody)]
    if not named or not tools.spindle:
        return
    if len(named) > 1:
        mistakes.add(("body",), "more than one is the cutter", "a machine has one spindle that M6 serves")
    if not tools.cutters:
        mistakes.add(("body",), "the cutter has no size", "add a [[cutter]] section for each tool")
    for position, sizes in tools.cutters.items():
        for key, size in zip(("length_mm", "diameter_mm"), sizes, strict=True):
            if not size > 0.0:
                hint = "give the size of its body, or no body the shape cutter"
                mistakes.add(("cutter", position, key), f"{size:g} is not above 0", hint)
