"""Where a program's lines exchange tools with bodies or shapers, bring bodies, move work systems, lead E."""

from __future__ import annotations

from collections.abc import Mapping

from mcserver.clearance.mounted import (
    SPINDLE,
    Exchange,
    Mounted,
    place_of,
    places_with_bodies,
    systems_with_zones,
)
from mcserver.gcode.profiles.frame import Frame, tool_table
from mcserver.gcode.semantics.modal import ModalState
from mcserver.machine.dialect_section import Cutter
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import PauseLine


def mounted_by(machine: Machine, frame: Frame | None) -> Mounted:
    """Return what a program begins with: the tool table, and where the work systems are that zones are in."""
    return Mounted(cutters=tool_table(machine, frame), work=work_systems(machine, frame))


def work_systems(machine: Machine, frame: Frame | None) -> dict[int, Mapping[int, float]]:
    """Return the offsets of the work systems that zones are in; without a frame none has been set."""
    systems = {} if frame is None else frame.systems
    return {each: systems.get(each, {}) for each in systems_with_zones(machine)}


def changes_setpoints(machine: Machine) -> bool:
    """Return whether programs say which shapers count, by the tool in the spindle, or what E is led by."""
    return machine.shaping is not None and bool(machine.shaping.tools or machine.shaping.lead)


class Exchanges:
    """Compares what is said of tools and work systems before and behind each line.

    Args:
        frame: that the program starts in. leads: it says what E is led by: no jog does.
    """

    def __init__(self, machine: Machine, frame: Frame | None, *, leads: bool = True) -> None:
        self._machine = machine
        self._places = places_with_bodies(machine)
        self._shaped = machine.shaping is not None and bool(machine.shaping.tools)
        self._fitted: int | None = None
        lead = None if machine.shaping is None else machine.shaping.lead
        self._led = None if lead is None or not leads else lead.own
        self._advance: float | None = None
        self._tools: dict[int, int] = {}
        # how many bodies it has brought
        self._given = 0
        self._carried: tuple[int, ...] = ()
        self._work = work_systems(machine, frame)
        # what G10 L1 has set
        self._set: Mapping[int, Cutter] = {} if frame is None else frame.cutters

    def by(self, line: int, modal: ModalState) -> list[Exchange]:
        """Return what a line has exchanged, by the modal state behind it; empty: nothing that has a body."""
        found = [*self._brought(line, modal), *self._of_tools(line, modal), *self._moved(line, modal.frame)]
        return found + self._shaping(line, modal.frame) + self._leading(line, modal)

    def _shaping(self, line: int, frame: Frame | None) -> list[Exchange]:
        """Return the tool whose shapers count behind a line, where it is another one; a jog says of none."""
        if not self._shaped or frame is None or frame.changed in (None, self._fitted):
            return []
        self._fitted = frame.changed
        return [Exchange(line, {}, True, {}, fitted=self._fitted)]

    def _leading(self, line: int, modal: ModalState) -> list[Exchange]:
        """Return what E is led by behind a line, where it is another K, and at a program's first line."""
        if self._led is None:
            return []
        advance = self._led.initial if modal.advance is None else modal.advance
        if advance == self._advance:
            return []
        self._advance = advance
        return [Exchange(line, {}, True, {}, advance=advance)]

    def _brought(self, line: int, modal: ModalState) -> list[Exchange]:
        """Return the bodies that a line has brought; those of before stay until the program's end."""
        if len(modal.bodies) <= self._given:
            return []
        self._given = len(modal.bodies)
        return [Exchange(line, {}, True, {}, modal.bodies)]

    def _moved(self, line: int, frame: Frame | None) -> list[Exchange]:
        """Return the work systems with zones that a line has moved; lines of a jog have no frame."""
        work = {} if frame is None else work_systems(self._machine, frame)
        moved = {number: offsets for number, offsets in work.items() if offsets != self._work[number]}
        self._work |= moved
        return [Exchange(line, {}, True, {}, work=moved)] if moved else []

    def _of_tools(self, line: int, modal: ModalState) -> list[Exchange]:
        frame = modal.frame
        tools = {}
        if modal.carried is not self._carried:
            self._carried = modal.carried
            tools = {place_of(self._machine, each): each for each in modal.carried}
        if frame is not None and frame.changed is not None:
            tools[SPINDLE] = frame.changed
        tools = {place: each for place, each in tools.items() if place in self._places}
        measured = {}
        if SPINDLE in self._places and frame is not None and frame.cutters is not self._set:
            measured = {each: size for each, size in frame.cutters.items() if self._set.get(each) != size}
            self._set = frame.cutters
        if self._tools.items() >= tools.items() and not measured:
            return []
        self._tools.update(tools)
        return [Exchange(line, dict(self._tools), True, measured)]

    def asked_for(self, pause: PauseLine) -> list[Exchange]:
        """Return that a tool which somebody is asked to fit may be there from the pause on."""
        if pause.tool is None or SPINDLE not in self._places:
            return []
        # what is fitted when the pause has ended is said again
        self._tools.pop(SPINDLE, None)
        return [Exchange(pause.line, {SPINDLE: pause.tool}, False, {})]
