"""The bodies of a machine as one Pinocchio model: where they are, which may meet, how far apart they are.

Links of the URDF, bodies of the machine file and zones are objects of one geometry model. Bodies that linear
axes carry hang on sliding joints of their own. Distances come from Coal (signed: negative where two overlap).
"""

from __future__ import annotations

import importlib
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mckinematics.description import AxisDescription
from mckinematics.errors import ModelError
from mckinematics.model import RobotModel, build_chain, import_pinocchio, load_model, read_urdf
from mckinematics.rotation import euler_to_matrix
from numpy.typing import NDArray

from mcserver.clearance.meshes import hull_of, load_hull, refuse_large_meshes
from mcserver.clearance.mounted import SPINDLE, Mounted, place_of
from mcserver.clearance.outlines import turned
from mcserver.errors import ConfigurationError
from mcserver.machine.clearance_section import (
    Body,
    BoxBody,
    CapsuleBody,
    Clearance,
    CutterBody,
    CylinderBody,
    GivenBody,
    MeshBody,
    Place,
    SphereBody,
    Zone,
)
from mcserver.machine.dialect_section import Cutter
from mcserver.machine.machine_file import Machine
from mcserver.machine.section_reader import did_you_mean
from mcserver.machine.work_systems import ANGLE
from mcserver.units import MM

Array = NDArray[np.float64]

# A lever that has no bound (a sliding joint without limits in front of it) counts as this long [m].
LONGEST_LEVER = 1e4


@dataclass(frozen=True)
class Pair:
    """Two bodies that may meet.

    Attributes:
        names: of both; the second may be a zone. zone: whether it is one. keeps_in: bodies stay inside of it.
        tools: that they come with, each as its number and its place; the cutter's is 0, whatever it is.
        max_speed: of a slow zone [m/s]; inf: the zone is no slow one.
        switch: what switches the zone, by its place in `Clearance.switches`; -1: it is always on.
        given: a program has brought one of both. work: the zone is in a work system.
    """

    names: tuple[str, str]
    zone: bool
    tools: tuple[tuple[int, int], ...] = ()
    max_speed: float = math.inf
    switch: int = -1
    given: bool = False
    work: bool = False
    keeps_in: bool = False

    def crosses(self, *, will: bool = False) -> str:
        """Return what the first body does, or would do, to the zone that forbids it."""
        verb, zone = ("leave", "keep-in") if self.keeps_in else ("enter", "keep-out")
        return (
            f"{self.names[0]!r} {f'would {verb}' if will else f'{verb}s'} the {zone} zone {self.names[1]!r}"
        )


class Scene:
    """All bodies of a machine at the positions of its axes.

    Args:
        machine: has a clearance.

    Attributes:
        pairs: that are judged. levers: shape (K, P), by axis column and pair the most that a unit of the
            axis changes their distance [m/rad or m/m].
        speeds: how fast the first body of each pair may be in its second one, a slow zone, shape (P,)
            [m/s]; inf for all others, which must not touch.
        switches: of each pair what switches its zone, as `Pair`, shape (P,).
        exchanged: of each pair whether one of both comes with a tool, or is a zone in a work system, shape
            (P,). mounted: the tools that may be there, any at first, and where work systems are, at first at
            the base. active: pairs that may be there by that, shape (P,).
        given: of each pair whether a program has brought one of both, shape (P,): the last ones.

    Raises:
        ConfigurationError: MC301 the URDF, MC323 a link, mesh or SRDF that is not there, or nothing moves.
    """

    def __init__(self, machine: Machine) -> None:
        assert machine.clearance is not None
        self._clearance: Clearance = machine.clearance
        self._machine = machine
        self._names: dict[int, str] = {}
        self._zones: dict[int, Zone] = {}
        self._links: set[int] = set()
        # by number of the object the tool and the place that it comes with; the cutter, and where it is held
        self._tools: dict[int, tuple[int, int]] = {}
        self._cutter: tuple[int, Any, Any] | None = None
        # what its body is as long and as wide as
        self._fitted: Cutter | None = None
        try:
            self._pin = import_pinocchio()
            self._coal = importlib.import_module("coal")
            robot = None if machine.urdf is None else load_model(machine.urdf)
            self._model = self._pin.Model() if robot is None else robot.pinocchio_model
            self._driven = self._joints_of_axes(robot)
        except ModelError as error:
            raise ConfigurationError(error.code, error.message, error.hint) from error
        self._geometry = self._pin.GeometryModel()
        if machine.urdf is not None:
            self._add_links(machine.urdf)
        for body in self._clearance.bodies:
            self._add_body(body)
        for zone in self._clearance.zones:
            self._add_zone(zone)
        self._check_names()
        self._allowed = {frozenset(pair) for pair in (*self._clearance.allowed, *self._disabled())}
        self.pairs: tuple[Pair, ...] = tuple(self._pairs(0))
        if not self.pairs:
            raise ConfigurationError(
                "MC323",
                "no two bodies of the machine can meet",
                "give a [[body]] that a link or axes carry, and one that stands, or a [[zone]]",
            )
        # all but what programs bring
        self._own = len(self._names)
        self._data = self._model.createData()
        self._q = self._pin.neutral(self._model)
        # where in q each axis's position goes; a joint without limits has its cosine and sine there
        self._plain, self._plain_columns = self._places_in_q(1)
        self._circles, self._circle_columns = self._places_in_q(2)
        self.levers: Array = np.zeros((len(machine.axes), 0))
        self._describe_pairs()
        self.active: NDArray[np.bool_] = np.ones(len(self.pairs), np.bool_)
        self.mounted = Mounted()
        self.mount(Mounted(cutters=machine.dialect.cutters))

    def mount(self, mounted: Mounted) -> None:
        """Take bodies of tools that may be mounted and those that programs have brought, and no others, and
        zones where their work systems are.
        """
        if mounted.given != self.mounted.given:
            self._bring([each for bodies in mounted.given.values() for each in bodies])
        self.mounted = mounted
        cutter = mounted.cutter()
        if self._cutter is not None and cutter is not None:
            self._resize(cutter)
        for number, zone in self._zones.items():
            if zone.system is not None:
                work = self._in_work(mounted.work.get(zone.system, {}))
                self._geometry.geometryObjects[number].placement = work * self._carried(zone)[1]
        for pair in np.flatnonzero(self.exchanged).tolist():
            self.active[pair] = all(
                mounted.may_be(tool, place) if tool else cutter is not None
                for tool, place in self.pairs[pair].tools
            )

    def _resize(self, cutter: Cutter) -> None:
        """Make the cutter's body as long and as wide as this one."""
        assert self._cutter is not None
        if cutter == self._fitted:
            return
        self._fitted = cutter
        number, shape, held = self._cutter
        shape.radius, shape.halfLength = 0.5 * cutter.diameter, 0.5 * cutter.length
        down = self._pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5 * cutter.length]))
        self._geometry.geometryObjects[number].placement = held * down
        # a joint that turns the cutter changes distances by as much as that is long
        for place, pair in enumerate(self._geometry.collisionPairs):
            if number in (pair.first, pair.second):
                self.levers[:, place] = self._lever(pair)

    def _bring(self, given: Sequence[GivenBody]) -> None:
        """Take bodies that programs bring in place of those so far; their pairs are the last ones."""
        for number in range(self._own, len(self._names)):
            # with its pairs
            self._geometry.removeGeometryObject(self._geometry.geometryObjects[self._own].name)
            del self._names[number]
            self._tools.pop(number, None)
        pairs = [pair for pair in self.pairs if not pair.given]
        for each in given:
            self._add_body(each.body)
            pairs += self._pairs(len(self._names) - 1, each)
        self.pairs = tuple(pairs)
        self.levers = self.levers[:, : sum(not pair.given for pair in pairs)]
        self._describe_pairs()
        self.active = np.ones(len(pairs), np.bool_)

    def keep_own(self, values: Array, fill: float) -> Array:
        """Return values by pair, shape (…, P), with ``fill`` for pairs that programs have brought."""
        own = int(np.count_nonzero(~self.given))
        fresh = np.full((*values.shape[:-1], len(self.pairs) - own), fill)
        return np.concatenate((values[..., :own], fresh), axis=-1)

    def _describe_pairs(self) -> None:
        """Note by pair what is the same wherever the axes are; levers of pairs from before stay."""
        self._placed = self._geometry.createData()
        for request in self._placed.distanceRequests:
            request.enable_signed_distance = True
        fresh = list(self._geometry.collisionPairs)[self.levers.shape[1] :]
        levers = [self._lever(pair)[:, None] for pair in fresh]
        self.levers = np.concatenate((self.levers, *levers), axis=1)
        self.speeds: Array = np.array([each.max_speed for each in self.pairs])
        self.switches = np.array([each.switch for each in self.pairs])
        self.exchanged = np.array([bool(each.tools) or each.work for each in self.pairs])
        self.given = np.array([each.given for each in self.pairs])

    def binding(self, role: str | None) -> NDArray[np.bool_]:
        """Return which pairs count for a role, shape (P,); None: for whoever it may be."""
        free = {each.name for each in self._clearance.zones if not each.binds(role)}
        return np.array([not (each.zone and each.names[1] in free) for each in self.pairs])

    def certain(self, pair: int) -> bool:
        """Return whether it is known that the tools of a pair are mounted."""
        return all(self.mounted.certain(place) for _, place in self.pairs[pair].tools)

    def place(self, positions: Array) -> None:
        """Put all bodies where they are at these positions of the axes, shape (K,) [SI]."""
        self._q[self._plain] = positions[self._plain_columns]
        if len(self._circles):
            angles = positions[self._circle_columns]
            self._q[self._circles], self._q[self._circles + 1] = np.cos(angles), np.sin(angles)
        self._pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._placed, self._q)

    def _places_in_q(self, width: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return where joints of so many numbers have them in q, and the columns of their axes."""
        found = [each for each in self._driven if self._model.nqs[each] == width]
        places = [int(self._model.idx_qs[each]) for each in found]
        return np.array(places, np.intp), np.array([self._driven[each] for each in found], np.intp)

    def distance(self, pair: int) -> float:
        """Return how far the bodies of a pair are apart as placed [m]; negative: they overlap."""
        return float(self._pin.computeDistance(self._geometry, self._placed, pair).min_distance)

    def travel(self, pair: int, before: Array, after: Array) -> float:
        """Return the most that a point of the ball around the first body of a pair moves, as seen from the
        second one, between two places of the axes, shape (K,) each [m].
        """
        bodies = self._geometry.collisionPairs[pair]
        number, seen_from = int(bodies.first), int(bodies.second)
        shape = self._geometry.geometryObjects[number].geometry
        shape.computeLocalAABB()
        middle = np.asarray(shape.aabb_center)
        self.place(before)
        one = self._placed.oMg[seen_from].actInv(self._placed.oMg[number])
        self.place(after)
        other = self._placed.oMg[seen_from].actInv(self._placed.oMg[number])
        # of a turn the chord at the radius: the greatest singular value of the difference
        turn = float(np.linalg.norm(other.rotation - one.rotation)) / math.sqrt(2.0)
        return float(np.linalg.norm(other.act(middle) - one.act(middle))) + turn * float(shape.aabb_radius)

    # ------------------------------------------------------------------ the model

    def _joints_of_axes(self, robot: RobotModel | None) -> dict[int, int]:
        """Return by joint of the URDF the column of the axis that moves it.

        Raises:
            ModelError: a tool does not fit the URDF.
        """
        driven: dict[int, int] = {}
        axes: dict[int, AxisDescription] = {axis.index: axis for axis in self._machine.axes}
        for tool in self._machine.tools:
            assert robot is not None
            chain = build_chain(robot, tool, axes)
            for joint, axis in zip(chain.joint_names, chain.axes, strict=True):
                driven[int(self._model.getJointId(joint))] = self._machine.column_of(axis)
        return driven

    def _frame(self, name: str) -> int:
        if not self._model.existFrame(name):
            known = [frame.name for frame in self._model.frames]
            raise ConfigurationError(
                "MC323",
                f"the URDF has no link {name!r}" if self._machine.urdf else f"{name!r}: there is no URDF",
                did_you_mean(name, known, "name a link of the URDF, or axes in carried_by"),
            )
        return int(self._model.getFrameId(name))

    def _add_links(self, urdf: str) -> None:
        """Add each link's collision geometry, and what it looks like where it has none."""
        text = read_urdf(urdf)
        folders = [str(folder) for folder in Path(urdf).resolve().parents] if Path(urdf).exists() else []
        refuse_large_meshes(text, folders)
        described: set[int] = set()
        for kind in (self._pin.GeometryType.COLLISION, self._pin.GeometryType.VISUAL):
            found = self._pin.GeometryModel()
            try:
                self._pin.buildGeomFromUrdfString(self._model, text, kind, found, folders)
            except (ValueError, RuntimeError) as error:
                raise ConfigurationError(
                    "MC323", f"the meshes of the URDF cannot be read: {error}", "put them beside the URDF"
                ) from error
            fresh = {each.parentFrame for each in found.geometryObjects} - described
            for each in found.geometryObjects:
                if each.parentFrame in fresh:
                    name = str(self._model.frames[each.parentFrame].name)
                    each.geometry = hull_of(each.geometry, name)
                    number = self._geometry.addGeometryObject(each)
                    self._names[number] = name
                    self._links.add(number)
            described |= fresh

    def _add_body(self, body: Body) -> None:
        joint, frame = self._joint_of(body)
        placement = frame * self._pose(body.at_mm, body.turned_deg)
        shape = self._shape(body)
        number = self._add(body.name, joint, placement, shape)
        if isinstance(body, CutterBody):
            self._cutter, self._tools[number] = (number, shape, placement), (0, SPINDLE)
        elif body.tool is not None:
            self._tools[number] = (body.tool, place_of(self._machine, body.tool))

    def _joint_of(self, body: Body) -> tuple[int, Any]:
        """Return the joint that carries a body, and the frame behind it in which the body's place is."""
        if body.link is None:
            return self._carriage(body), self._pin.SE3.Identity()
        return self._link(body.link)

    def _link(self, name: str) -> tuple[int, Any]:
        """Return the joint that carries a link of the URDF, and the link's frame behind it."""
        frame = self._model.frames[self._frame(name)]
        return int(frame.parentJoint), frame.placement

    def _add(self, name: str, joint: int, placement: Any, shape: Any) -> int:
        made = self._pin.GeometryObject(f"{name}#{len(self._names)}", joint, placement, shape)
        number = int(self._geometry.addGeometryObject(made))
        self._names[number] = name
        return number

    def _carriage(self, body: Body) -> int:
        """Return the joint at the end of sliding joints for the axes that carry a body; 0: it stands."""
        joint = 0
        sense = -1.0 if body.opposite else 1.0
        for axis in body.carried_by:
            direction = sense * np.eye(3)[self._clearance.letters[axis]]
            name = f"{axis}{'-' if body.opposite else '+'} on {self._model.names[joint]}"
            if self._model.existJointName(name):
                joint = int(self._model.getJointId(name))
                continue
            slide = self._pin.JointModelPrismaticUnaligned(direction)
            joint = int(self._model.addJoint(joint, slide, self._pin.SE3.Identity(), name))
            self._driven[joint] = self._machine.column_of(axis)
        return joint

    def _shape(self, body: Body) -> Any:
        coal = self._coal
        match body:
            case BoxBody():
                return coal.Box(*(edge * MM for edge in body.size_mm))
            case CylinderBody():
                return coal.Cylinder(body.radius_mm * MM, body.length_mm * MM)
            case CapsuleBody():
                return coal.Capsule(body.radius_mm * MM, body.length_mm * MM)
            case SphereBody():
                return coal.Sphere(body.radius_mm * MM)
            case CutterBody():
                # until it is known what is mounted
                return coal.Cylinder(MM, MM)
            case MeshBody():
                return load_hull(body.file, body.name)

    def _add_zone(self, zone: Zone) -> None:
        joint, placement = self._carried(zone)
        edges = [edge * MM for edge in zone.size_mm]
        if zone.kind != "keep_in":
            self._zones[self._add(zone.name, joint, placement, self._coal.Box(*edges))] = zone
            return
        # what stays in a box stays out of the half spaces behind its six sides
        for axis, edge in enumerate(edges):
            for side in (1.0, -1.0):
                behind = self._coal.Halfspace(-side * np.eye(3)[axis], -0.5 * edge)
                self._zones[self._add(zone.name, joint, placement, behind)] = zone

    def _carried(self, zone: Zone) -> tuple[int, Any]:
        """Return the joint that carries a zone, and its place there, in a work system at the base."""
        carrier = next((each for each in self._clearance.bodies if each.name == zone.on), None)
        if carrier is not None:
            joint, frame = self._joint_of(carrier)
        elif zone.on is not None:
            joint, frame = self._link(zone.on)
        else:
            joint, frame = 0, self._pin.SE3.Identity()
        return joint, frame * self._pose(zone.at_mm, zone.turned_deg)

    def _in_work(self, offsets: Mapping[int, float]) -> Any:
        """Return where a work system is in the base's frame."""
        zero = np.zeros(3)
        for axis, direction in self._clearance.letters.items():
            zero[direction] = offsets.get(axis, 0.0)
        return self._pin.SE3(euler_to_matrix((0.0, 0.0, offsets.get(ANGLE, 0.0)), "ZYX"), zero)

    def _pose(self, at_mm: Place, turned_deg: Place) -> Any:
        return self._pin.SE3(turned(turned_deg), np.array(at_mm) * MM)

    # ------------------------------------------------------------------ the pairs

    def _check_names(self) -> None:
        """Refuse names that belong to no body."""
        known = sorted({name for number, name in self._names.items() if number not in self._zones})
        asked = {name for pair in self._clearance.allowed for name in pair}
        for zone in self._clearance.zones:
            asked |= set(zone.bodies)
        for name in sorted(asked.difference(known)):
            hint = did_you_mean(name, known, f"known are: {', '.join(known)}")
            raise ConfigurationError("MC323", f"there is no body {name!r}", hint)

    def _pairs(self, first_new: int, given: GivenBody | None = None) -> list[Pair]:
        """Register pairs that are judged with the geometry model, and describe them.

        Args:
            first_new: pairs of objects of which one has this number or a greater one.
            given: what a program brings with them.
        """
        allowed = self._allowed
        if given is not None:
            allowed = allowed | {frozenset((given.body.name, each)) for each in given.touches}
        found = []
        switches = self._clearance.switches
        numbers = sorted(self._names)
        for place, one in enumerate(numbers):
            for other in numbers[max(place + 1, first_new) :]:
                first, second = (other, one) if one in self._zones else (one, other)
                if first in self._zones or not self._may_meet(first, second):
                    continue
                names = (self._names[first], self._names[second])
                if frozenset(names) in allowed:
                    continue
                self._geometry.addCollisionPair(self._pin.CollisionPair(first, second))
                tools = tuple(self._tools[each] for each in (first, second) if each in self._tools)
                zone = self._zones.get(second)
                limit = None if zone is None else zone.max_speed_mm_s
                speed = math.inf if limit is None else limit * MM
                switch = None if zone is None else zone.switch
                number = -1 if switch is None else switches.index(switch)
                brought = given is not None
                work = zone is not None and zone.work is not None
                keeps_in = zone is not None and zone.kind == "keep_in"
                found.append(Pair(names, zone is not None, tools, speed, number, brought, work, keeps_in))
        return found

    def _disabled(self) -> list[tuple[str, str]]:
        """Return the pairs that the SRDF lets touch."""
        if self._clearance.srdf is None:
            return []
        try:
            robot = ElementTree.parse(self._clearance.srdf)
        except (OSError, ElementTree.ParseError) as error:
            raise ConfigurationError(
                "MC323", f"the SRDF {self._clearance.srdf!r} cannot be read: {error}", "give another file"
            ) from error
        return [(each.get("link1", ""), each.get("link2", "")) for each in robot.iter("disable_collisions")]

    def _may_meet(self, first: int, second: int) -> bool:
        one, other = (self._geometry.geometryObjects[each].parentJoint for each in (first, second))
        if one == other or self._exclude(first, second):
            return False
        zone = self._zones.get(second)
        if zone is not None:
            # one that moves is for what moves too, but for who is named
            return self._names[first] in zone.bodies if zone.bodies else one != 0
        neighbours = self._model.parents[one] == other or self._model.parents[other] == one
        # links that a joint connects overlap there
        return not (neighbours and first in self._links and second in self._links)

    def _exclude(self, first: int, second: int) -> bool:
        """Return whether two bodies come with different tools of one place."""
        one, other = self._tools.get(first), self._tools.get(second)
        return one is not None and other is not None and one != other and one[1] == other[1]

    def _lever(self, pair: Any) -> Array:
        """Return how far a unit of each axis moves bodies of a pair beside each other at most, shape (K,)."""
        one, other = (self._geometry.geometryObjects[each] for each in (pair.first, pair.second))
        above = [set(self._model.supports[each.parentJoint]) for each in (one, other)]
        levers = np.zeros(len(self._machine.axes))
        for joint, column in self._driven.items():
            # a joint that carries both changes nothing between them
            if joint in above[0] and joint not in above[1]:
                levers[column] += self._reach(joint, one)
            elif joint in above[1] and joint not in above[0]:
                levers[column] += self._reach(joint, other)
                zone = self._zones.get(int(pair.second))
                if zone is not None and zone.kind == "slow" and self._turns(joint):
                    # speed counts of all of a body, which may stick out of the zone
                    one.geometry.computeLocalAABB()
                    levers[column] += 2.0 * float(one.geometry.aabb_radius)
        return levers

    def _reach(self, joint: int, body: Any) -> float:
        """Return the greatest distance of a point of the body from a turning joint's axis; 1 for a slide."""
        if not self._turns(joint):
            return 1.0
        body.geometry.computeLocalAABB()
        middle = body.placement.act(np.asarray(body.geometry.aabb_center))
        reach = float(np.linalg.norm(middle)) + float(body.geometry.aabb_radius)
        behind = [each for each in self._model.supports[body.parentJoint] if each > joint]
        for each in behind:
            reach += float(np.linalg.norm(self._model.jointPlacements[each].translation))
            if not self._turns(each):
                reach += self._travel(each)
        return min(reach, LONGEST_LEVER)

    def _turns(self, joint: int) -> bool:
        return "JointModelR" in str(self._model.joints[joint].shortname())

    def _travel(self, joint: int) -> float:
        column = self._driven.get(joint)
        if column is None:
            return 0.0
        axis = self._machine.axes[column]
        return max(abs(axis.min_position), abs(axis.max_position))
