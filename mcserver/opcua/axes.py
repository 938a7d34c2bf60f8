"""Axes and the spindle of a machine: OPC 40501-1 has the spindle; axes are objects of this namespace."""

from __future__ import annotations

from collections.abc import Sequence

from asyncua import ua
from mcclient import AxisInfo

from mcserver.opcua.nodes import MachineNodes
from mcserver.opcua.readings import SPINDLE, axis_path
from mcserver.web.formatting import axis_name

SPINDLE_TYPE = 22
AXES = "Monitoring.Axes"
UNECE = "http://www.opcfoundation.org/UA/units/un/cefact"
# UN/ECE's codes of units as OPC UA numbers them (Part 8, 5.6.3)
UNITS = {
    "mm": ua.EUInformation(UNECE, 5066068, ua.LocalizedText("mm")),
    "deg": ua.EUInformation(UNECE, 17476, ua.LocalizedText("°")),
    "mm/s": ua.EUInformation(UNECE, 4403766, ua.LocalizedText("mm/s")),
    "deg/s": ua.EUInformation(UNECE, 4536625, ua.LocalizedText("°/s")),
}


async def show_axes(nodes: MachineNodes, before: Sequence[AxisInfo], now: Sequence[AxisInfo]) -> None:
    """Make the axes that a machine has now of those that it had; nodes of axes that stay are kept."""
    here = {(axis_path(each), each.unit) for each in now}
    there = {(axis_path(each), each.unit) for each in before}
    spindle, had_spindle = (next((each for each in axes if each.spindle), None) for axes in (now, before))
    for path, _ in there - here:
        await nodes.remove(path)
    for axis in now:
        if (axis_path(axis), axis.unit) not in there:
            await _add_axis(nodes, axis)
    if had_spindle is not None and had_spindle != spindle:
        await nodes.remove(SPINDLE)
    if spindle is not None and had_spindle != spindle:
        await _add_spindle(nodes, spindle)


async def _add_axis(nodes: MachineNodes, axis: AxisInfo) -> None:
    path, own = axis_path(axis), nodes.model.own
    name = ua.QualifiedName(axis_name(axis.index), own)
    await nodes.node(AXES).add_object(nodes.id_of(path), name)
    at, rate = UNITS[axis.unit.value], UNITS[f"{axis.unit.value}/s"]
    for variable, unit in (("ActualPosition", at), ("CommandedPosition", at), ("ActualVelocity", rate)):
        of = f"{path}.{variable}"
        node = await nodes.node(path).add_variable(nodes.id_of(of), ua.QualifiedName(variable, own), 0.0)
        units = ua.QualifiedName("EngineeringUnits", 0)
        await node.add_property(nodes.id_of(f"{of}.EngineeringUnits"), units, unit)
    await nodes.node(path).add_variable(nodes.id_of(f"{path}.State"), ua.QualifiedName("State", own), "")


async def _add_spindle(nodes: MachineNodes, axis: AxisInfo) -> None:
    """Add a SpindleMonitoringType for the axis that M3, M4, M5 and S turn."""
    space = nodes.model.machine_tool
    name = ua.QualifiedName("Spindle", nodes.model.own)
    await nodes.add(nodes.node("Monitoring"), SPINDLE, name, nodes.model.type(SPINDLE_TYPE))
    used = ua.QualifiedName("IsUsedAsAxis", space)
    await nodes.node(SPINDLE).add_variable(nodes.id_of(f"{SPINDLE}.IsUsedAsAxis"), used, False)
    await nodes.set(f"{SPINDLE}.Name", ua.Variant(axis_name(axis.index)))
