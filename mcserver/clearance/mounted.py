"""Which tools may be mounted, which bodies programs have brought and where work systems are, as they said.

Tools that exclude each other share a place: all cutters the spindle, tools of a robot the axis that their
chains end at. Of a place of which nothing is known any of its tools may be there, and each counts.
"""

from __future__ import annotations

from collections.abc import Container, Mapping

import msgspec

from mcserver.machine.clearance_section import GivenBody
from mcserver.machine.dialect_section import Cutter
from mcserver.machine.machine_file import Machine

# The place of cutters; those of robots' tools are numbers of axes.
SPINDLE = -1
# The remedy for a contact of a tool of which it is not known that it is there.
NOT_KNOWN = "which tool is mounted is not known yet, and any may be: say it before with T, of a mill T and M6"


class Exchange(msgspec.Struct, frozen=True):
    """What a line says of tools.

    Attributes:
        line: its number. tools: by place the one that is mounted from here on.
        certain: it is; else it may be, as from when somebody is asked to change it.
        cutters: lines of the tool table that it sets, by number.
        bodies: all that its program has brought up to there; empty: it brings none more.
        work: work systems with zones that it has moved, by number, as of `Mounted`.
        fitted: the tool that is in the spindle from here on, 0: none, of a machine whose shapers go by it.
        advance: pressure advance of E from here on [s].
    """

    line: int
    tools: Mapping[int, int]
    certain: bool
    cutters: Mapping[int, Cutter]
    bodies: tuple[GivenBody, ...] = ()
    work: Mapping[int, Mapping[int, float]] = {}
    fitted: int | None = None
    advance: float | None = None


class Mounted(msgspec.Struct, frozen=True):
    """Tools that may be mounted, and where work systems are.

    Attributes:
        at: by place those of which one is there; any may be at a place that is left out.
        cutters: the tool table, by number.
        given: by program the bodies that it has brought.
        work: by number of work systems with zones the offset of each axis [m], and by `ANGLE` the angle about
            Z [rad].
    """

    at: Mapping[int, frozenset[int]] = {}
    cutters: Mapping[int, Cutter] = {}
    given: Mapping[str, tuple[GivenBody, ...]] = {}
    work: Mapping[int, Mapping[int, float]] = {}

    def behind(self, exchange: Exchange, program: str = "") -> Mounted:
        """Return what may be mounted behind a program's exchange."""
        at = dict(self.at)
        for place, tool in exchange.tools.items():
            if exchange.certain:
                at[place] = frozenset((tool,))
            elif place in at:
                at[place] |= {tool}
        given = {**self.given, program: exchange.bodies} if exchange.bodies else self.given
        return Mounted(at, {**self.cutters, **exchange.cutters}, given, {**self.work, **exchange.work})

    def of_running(self, programs: Container[str]) -> Mounted:
        """Return it with bodies that these programs have brought, and no others."""
        given = {name: bodies for name, bodies in self.given.items() if name in programs}
        return self if len(given) == len(self.given) else msgspec.structs.replace(self, given=given)

    def at_begin(self, begins: Mounted, *, beside_others: bool) -> Mounted:
        """Return what may be mounted where a program begins.

        Args:
            begins: the tool table and the work systems that it begins with.
            beside_others: programs run that may have set a line of it meanwhile: the larger size counts.
        """
        table = begins.cutters
        if beside_others and table != self.cutters:
            kept = {number: self.cutters.get(number, each) for number, each in table.items()}
            table = {
                number: Cutter(
                    max(each.length, kept[number].length), max(each.diameter, kept[number].diameter)
                )
                for number, each in table.items()
            }
        cutters = {**self.cutters, **table}
        return msgspec.structs.replace(self, cutters=cutters, work={**self.work, **begins.work})

    def may_be(self, tool: int, place: int) -> bool:
        """Return whether a tool may be mounted at its place."""
        return place not in self.at or tool in self.at[place]

    def certain(self, place: int) -> bool:
        """Return whether it is known what is mounted at a place."""
        return len(self.at.get(place, ())) == 1

    def cutter(self) -> Cutter | None:
        """Return what is as long and as wide as any cutter that may be in the spindle; None: it is empty."""
        fitted = self.at.get(SPINDLE, frozenset(self.cutters)) - {0}
        if not fitted:
            return None
        found = [self.cutters.get(number, Cutter(0.0)) for number in fitted]
        if not all(_measured(each) for each in found):
            # nobody has measured it: it may be as any
            found = list(self.cutters.values())
        return Cutter(max(each.length for each in found), max(each.diameter for each in found))


def _measured(cutter: Cutter) -> bool:
    return cutter.length > 0.0 and cutter.diameter > 0.0


def place_of(machine: Machine, tool: int) -> int:
    """Return the place at which a tool is mounted."""
    return next((each.axes[-1] for each in machine.tools if each.number == tool), SPINDLE)


def systems_with_zones(machine: Machine) -> frozenset[int]:
    """Return the numbers of the work systems that zones are in."""
    zones = () if machine.clearance is None else machine.clearance.zones
    return frozenset(each.system for each in zones if each.system is not None)


def places_with_bodies(machine: Machine) -> frozenset[int]:
    """Return the places whose tools have bodies."""
    if machine.clearance is None:
        return frozenset()
    bodies = machine.clearance.bodies
    places = {place_of(machine, each.tool) for each in bodies if each.tool is not None}
    return frozenset(places | ({SPINDLE} if machine.clearance.follows_cutter else set()))
