"""A machine as an MTConnect device: its components and data items (Part 2), and what they observe."""

from __future__ import annotations

import re
import uuid
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from typing import NamedTuple

from mcclient import Fault, Info, MachineStatus
from mcclient.broken_off import is_by_hand, is_typed
from mcclient.types import ProgramStatus

from mcserver.terminal import visible
from mcserver.web.formatting import axis_name, current_program, is_live

UNAVAILABLE = "UNAVAILABLE"
# no characters of XML 1.0 (section 2.2), though a text of UTF-8 may have them
_NO_XML = re.compile("[\ufffe\uffff]")
# of a program that has not ended (Part 2, EXECUTION)
EXECUTION = {
    "queued": "READY",
    "running": "ACTIVE",
    "held": "FEED_HOLD",
    "paused": "PROGRAM_STOPPED",
    "ending": "ACTIVE",
}
ENDED = {"finished": "PROGRAM_COMPLETED"}
# by the unit of an axis: its component, and type and units of its position and of its rate
UNITS = {"mm": ("Linear", "POSITION", "MILLIMETER"), "deg": ("Rotary", "ANGLE", "DEGREE")}
RATES = {"mm": ("AXIS_FEEDRATE", "MILLIMETER/SECOND"), "deg": ("ANGULAR_VELOCITY", "DEGREE/SECOND")}


class Reading(NamedTuple):
    """What a data item observes: a value, or a condition's level with its code and text."""

    value: str
    code: str = ""
    text: str = ""


class DataItem(NamedTuple):
    """A data item and the component that it belongs to."""

    id: str
    category: str
    type: str
    sub_type: str
    component: ElementTree.Element


class Device:
    """One machine.

    Attributes:
        element: ``Device`` of a Devices document.
        items: by id, in the order of the document.
        instance: start of the machine's server whose axes these are.
    """

    def __init__(self, info: Info) -> None:
        self.name = info.machine
        self.uuid = str(uuid.uuid5(uuid.NAMESPACE_URL, f"mcserver:{info.machine}"))
        self.items: dict[str, DataItem] = {}
        # ids are of the whole document, and names of machines no names of XML
        self._id = f"m{self.uuid[:8]}"
        self.instance = info.instance
        self._axes = tuple((axis.index, axis.unit.value) for axis in info.axes)
        self.element = ElementTree.Element("Device", id=self._id, name=self.name, uuid=self.uuid)
        description = ElementTree.SubElement(self.element, "Description", manufacturer="mcserver")
        description.text = visible(info.server)
        self._add(self.element, "avail", "EVENT", "AVAILABILITY")
        self._add(self.element, "achg", "EVENT", "ASSET_CHANGED")
        self._add(self.element, "arem", "EVENT", "ASSET_REMOVED")
        inside = ElementTree.SubElement(self.element, "Components")
        self._add_axes(inside)
        controller = self._component(inside, "Controller", "cnt", "controller")
        self._add(controller, "estop", "EVENT", "EMERGENCY_STOP")
        self._add(controller, "system", "CONDITION", "SYSTEM")
        path = self._component(ElementTree.SubElement(controller, "Components"), "Path", "path", "path")
        self._add(path, "exec", "EVENT", "EXECUTION")
        self._add(path, "mode", "EVENT", "CONTROLLER_MODE")
        self._add(path, "program", "EVENT", "PROGRAM")
        self._add(path, "line", "EVENT", "LINE_NUMBER", "ABSOLUTE")
        self._add(path, "ovr", "EVENT", "PATH_FEEDRATE_OVERRIDE", "PROGRAMMED", units="PERCENT")
        self._add(path, "motion", "CONDITION", "MOTION_PROGRAM")

    def read(self, status: MachineStatus | None) -> dict[str, tuple[Reading, ...]]:
        """Return what every data item observes, by id; several readings: the faults of a condition.

        Args:
            status: None: the machine does not answer.
        """
        nothing: tuple[Reading, ...] = (Reading(UNAVAILABLE),)
        found = dict.fromkeys(self.items, nothing)
        if status is not None:
            found |= {f"{self._id}_{key}": readings for key, readings in self._readings(status)}
        return found

    def _readings(self, status: MachineStatus) -> Iterator[tuple[str, tuple[Reading, ...]]]:
        program = current_program(status)
        yield "avail", (Reading("AVAILABLE"),)
        yield "estop", (Reading("TRIGGERED" if status.state == "estop" else "ARMED"),)
        yield "exec", (Reading(_execution(status, program)),)
        yield "mode", (Reading(_mode(program)),)
        yield "ovr", (Reading(f"{status.override:.1f}"),)
        if program is not None:
            yield "program", (Reading(_text(program.name or program.program)),)
            yield "line", (Reading(str(program.line)),)
        at_axes = {axis: [each for each in status.faults if each.axis == axis] for axis, _ in self._axes}
        of_program = None if program is None else program.fault
        yield "motion", _condition([] if of_program is None else [of_program])
        yield "system", _condition([each for each in status.faults if each.axis not in at_axes])
        axes = status.axes
        for row, index in enumerate(axes.index):
            if index in at_axes:
                yield f"a{index}_act", (Reading(_decimal(axes.position[row], 4)),)
                yield f"a{index}_com", (Reading(_decimal(axes.setpoint[row], 4)),)
                yield f"a{index}_vel", (Reading(_decimal(axes.velocity[row], 2)),)
                yield f"a{index}_fault", _condition(at_axes[index])

    def _add_axes(self, parent: ElementTree.Element) -> None:
        axes = ElementTree.SubElement(self._component(parent, "Axes", "axes", "axes"), "Components")
        for index, unit in self._axes:
            kind, position, units = UNITS[unit]
            rate, rate_units = RATES[unit]
            key = f"a{index}"
            # a name is no place for brackets
            one = self._component(axes, kind, key, axis_name(index).strip("[]"))
            self._add(one, f"{key}_act", "SAMPLE", position, "ACTUAL", units=units)
            self._add(one, f"{key}_com", "SAMPLE", position, "COMMANDED", units=units)
            self._add(one, f"{key}_vel", "SAMPLE", rate, "ACTUAL", units=rate_units)
            self._add(one, f"{key}_fault", "CONDITION", "ACTUATOR")

    def _component(self, parent: ElementTree.Element, kind: str, key: str, name: str) -> ElementTree.Element:
        return ElementTree.SubElement(parent, kind, id=f"{self._id}_{key}", name=name)

    def _add(
        self,
        component: ElementTree.Element,
        key: str,
        category: str,
        kind: str,
        sub_type: str = "",
        *,
        units: str = "",
    ) -> None:
        items = component.find("DataItems")
        if items is None:
            items = ElementTree.SubElement(component, "DataItems")
        optional = {"subType": sub_type, "units": units}
        ElementTree.SubElement(
            items,
            "DataItem",
            {"category": category, "id": f"{self._id}_{key}", "type": kind}
            | {name: value for name, value in optional.items() if value},
        )
        item = DataItem(f"{self._id}_{key}", category, kind, sub_type, component)
        self.items[item.id] = item


def _execution(status: MachineStatus, program: ProgramStatus | None) -> str:
    if status.state != "ready":
        return "STOPPED"
    if program is None:
        return "READY"
    if is_live(program):
        return EXECUTION.get(program.state.value, "ACTIVE")
    return ENDED.get(program.state.value, "STOPPED")


def _mode(program: ProgramStatus | None) -> str:
    if program is None or not is_live(program) or not is_by_hand(program.name):
        return "AUTOMATIC"
    return "MANUAL_DATA_INPUT" if is_typed(program.name) else "MANUAL"


def _condition(faults: list[Fault]) -> tuple[Reading, ...]:
    if not faults:
        return (Reading("Normal"),)
    unique = {each.code: Reading("Fault", each.code, _text(each.message)) for each in faults}
    return tuple(unique.values())


def _decimal(value: float, places: int) -> str:
    # what rounds to nothing has no sign
    return f"{round(value, places) + 0.0:.{places}f}"


def _text(text: str) -> str:
    return _NO_XML.sub("�", visible(text))
