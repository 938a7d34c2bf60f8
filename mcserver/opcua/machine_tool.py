"""A machine's nodes: a MachineTool of OPC 40501-1 in the folder Machines, its values and its alerts."""

from __future__ import annotations

import copy
import functools
import uuid
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote

from asyncua import Server, ua
from asyncua.common.events import get_event_obj_from_type_node
from mcclient import AxisInfo, Info, MachineStatus
from mcclient.types import ToolRow

from mcserver.opcua.axes import AXES, show_axes
from mcserver.opcua.nodes import MachineNodes
from mcserver.opcua.nodesets import ALERT_TYPE, MACHINE_TOOL_TYPE, MACHINES, Model
from mcserver.opcua.orders import INSTRUMENT, Order, add_control
from mcserver.opcua.production_plan import ProductionPlan
from mcserver.opcua.readings import Alert, alerts_of, axis_readings, gone, readings_of
from mcserver.terminal import visible

# types of OPC 40501-1 and of Machinery for what is optional in a MachineTool
CHANNEL_TYPE, JOB_LIST_TYPE, MESSAGES_TYPE, TOOL_LIST_TYPE, TOOL_TYPE = 16, 30, 38, 44, 50
ITEM_STATE_TYPE = 1002
PERCENT = ua.EUInformation("http://www.opcfoundation.org/UA/units/un/cefact", 20529, ua.LocalizedText("%"))
# the machine's override goes from 0 to here [%]
MOST_OVERRIDE = 200.0
SEVERITY = 800
# of the tool table
MOST_TOOLS = 500


class MachineTool:
    """One machine: made by `create`.

    Attributes:
        instance: start of the machine's server whose axes are shown.
        orders: its methods, where its machine file takes orders, or has since this process began.
    """

    def __init__(self, server: Server, model: Model, name: str) -> None:
        self.instance = ""
        self.orders: dict[ua.NodeId, Order] = {}
        self._nodes = MachineNodes(server, model, name)
        self._plan = ProductionPlan(self._nodes)
        self._axes: tuple[AxisInfo, ...] = ()
        self._alerts: list[Alert] = []
        self._tools: tuple[ToolRow, ...] = ()
        self._alert: Any = None

    @classmethod
    async def create(cls, server: Server, model: Model, info: Info) -> MachineTool:
        """Add the nodes of a machine."""
        machine = cls(server, model, info.machine)
        nodes = machine._nodes
        name = ua.QualifiedName(info.machine, model.own)
        tool = model.machine_tool
        folder = server.get_node(ua.NodeId(MACHINES, model.machinery))
        await nodes.add(folder, "", name, model.type(MACHINE_TOOL_TYPE))
        monitoring = nodes.node("Monitoring")
        channel = ua.QualifiedName("Channel", model.own)
        await nodes.add(monitoring, "Monitoring.Channel", channel, model.type(CHANNEL_TYPE))
        optional = (
            ("Monitoring.MachineTool", "MachineryItemState", model.machinery, ITEM_STATE_TYPE),
            ("Production", "ProductionPlan", tool, JOB_LIST_TYPE),
            ("Notification", "Messages", tool, MESSAGES_TYPE),
            ("Equipment", "Tools", tool, TOOL_LIST_TYPE),
        )
        for parent, child, namespace, kind in optional:
            of = ua.NodeId(kind, namespace)
            await nodes.add(nodes.node(parent), f"{parent}.{child}", ua.QualifiedName(child, namespace), of)
        job = "Production.ActiveProgram"
        await nodes.node(job).add_variable(
            nodes.id_of(f"{job}.JobIdentifier"), ua.QualifiedName("JobIdentifier", tool), ""
        )
        await monitoring.add_folder(nodes.id_of(AXES), ua.QualifiedName("Axes", model.own))
        await machine._add_override("Monitoring.MachineTool")
        await machine._describe()
        await machine.renew(info)
        machine._alert = await get_event_obj_from_type_node(server.get_node(model.type(ALERT_TYPE)))
        for node in (nodes.node("Notification.Messages"), server.get_node(ua.ObjectIds.Server)):
            await node.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
        return machine

    async def renew(self, info: Info) -> None:
        """Take what another start of the machine's server may have changed: its version and its axes."""
        self.instance = info.instance
        await self._nodes.set("Identification.SoftwareRevision", ua.Variant(visible(info.server)))
        await show_axes(self._nodes, self._axes, info.axes)
        self._axes = info.axes
        if INSTRUMENT in info.orders_from and not self.orders:
            self.orders = await add_control(self._nodes)

    async def show(self, status: MachineStatus | None, wall: float) -> None:
        """Write what has changed; None: the machine does not answer.

        Args:
            wall: Unix time, the values' [s].
        """
        time = datetime.fromtimestamp(wall, UTC)
        model = self._nodes.model
        readings = readings_of(status, model.program_states, model.item_states)
        await self._nodes.show(readings | axis_readings(self._axes, status), time)
        await self._plan.show(status, time)
        if status is not None:
            now = alerts_of(status)
            for alert in gone(self._alerts, now):
                await self._tell(alert, active=False, time=time)
            for alert in gone(now, self._alerts):
                await self._tell(alert, active=True, time=time)
            self._alerts = now

    async def show_tools(self, tools: Sequence[ToolRow]) -> None:
        """Make the list of tools that of the tool table."""
        new = tuple(tools[:MOST_TOOLS])
        numbers = {each.number for each in self._tools}
        for gone_number in numbers - {each.number for each in new}:
            await self._nodes.remove(f"Equipment.Tools.T{gone_number}")
        for tool in new:
            if tool.number not in numbers:
                await self._add_tool(tool.number)
        self._tools = new

    async def _add_tool(self, number: int) -> None:
        nodes, path = self._nodes, f"Equipment.Tools.T{number}"
        name = ua.QualifiedName(f"T{number}", nodes.model.own)
        await nodes.add(nodes.node("Equipment.Tools"), path, name, nodes.model.type(TOOL_TYPE))
        await nodes.set(f"{path}.ControlIdentifier1", ua.Variant(number, ua.VariantType.UInt32))
        await nodes.set(f"{path}.ControlIdentifierInterpretation", ua.Variant(0, ua.VariantType.Int32))
        await nodes.set(f"{path}.Locked", ua.Variant(False))
        await nodes.set(f"{path}.Locked.ReasonForLocking", ua.Variant(0, ua.VariantType.Int32))

    async def _add_override(self, parent: str) -> None:
        """Add FeedOverride with its properties, as the type has it."""
        nodes, path = self._nodes, f"{parent}.FeedOverride"
        name = ua.QualifiedName("FeedOverride", nodes.model.machine_tool)
        node = await nodes.node(parent).add_variable(nodes.id_of(path), name, 0.0)
        await node.add_property(nodes.id_of(f"{path}.EURange"), ua.QualifiedName("EURange", 0), ua.Range())
        unit = ua.QualifiedName("EngineeringUnits", 0)
        await node.add_property(nodes.id_of(f"{path}.EngineeringUnits"), unit, PERCENT)

    async def _describe(self) -> None:
        """Set what stays as it is."""
        nodes = self._nodes
        said = ua.LocalizedText("mcserver")
        await nodes.set("Identification.Manufacturer", ua.Variant(said))
        instance = f"urn:mcserver:{quote(nodes.machine, safe='')}"
        await nodes.set("Identification.ProductInstanceUri", ua.Variant(instance))
        await nodes.set("Identification.SerialNumber", ua.Variant(nodes.machine))
        revision = ua.QualifiedName("SoftwareRevision", nodes.model.di)
        await nodes.node("Identification").add_property(
            nodes.id_of("Identification.SoftwareRevision"), revision, ""
        )
        await nodes.set("Monitoring.Channel.Name", ua.Variant("Channel"))
        for place in ("MachineTool", "Channel"):
            path = f"Monitoring.{place}.FeedOverride"
            await nodes.set(f"{path}.EURange", ua.Variant(ua.Range(0.0, MOST_OVERRIDE)))
            await nodes.set(f"{path}.EngineeringUnits", ua.Variant(PERCENT))

    async def _tell(self, alert: Alert, *, active: bool, time: datetime) -> None:
        """Send an event of AlertType to who listens at the machine's messages or at the server."""
        messages = self._nodes.id_of("Notification.Messages")
        for emitting in (messages, ua.NodeId(ua.ObjectIds.Server)):
            event = copy.copy(self._alert)
            event.to_event_fields = functools.partial(_fields, event)
            event.emitting_node = emitting
            values: dict[str, object] = {
                "EventId": uuid.uuid4().bytes,
                "Time": time,
                "ReceiveTime": time,
                "SourceNode": messages,
                "SourceName": self._nodes.machine,
                "Message": ua.LocalizedText(alert.message),
                "Severity": SEVERITY,
                "ConditionName": alert.code,
                "Retain": active,
                "EnabledState": ua.LocalizedText("Enabled"),
                "EnabledState/Id": True,
                "ActiveState": ua.LocalizedText("Active" if active else "Inactive"),
                "ActiveState/Id": active,
                "AckedState": ua.LocalizedText("Acknowledged"),
                "AckedState/Id": True,
            }
            for name, value in values.items():
                setattr(event, name, value)
            condition = ua.NodeId(f"{messages.Identifier}.{alert.key}", messages.NamespaceIndex)
            event.add_property("NodeId", condition, ua.VariantType.NodeId)
            event.add_property("ErrorCode", alert.code, ua.VariantType.String)
            await self._nodes.server.iserver.subscription_service.trigger_event(event)


def _fields(event: Any, clauses: Sequence[ua.SimpleAttributeOperand]) -> list[ua.Variant]:
    """Return the fields that a client selects, nothing for those that the event does not have.

    asyncua takes any attribute of the object for a field, and fails where that has no data type.
    """
    names = ["/".join(each.Name or "" for each in clause.BrowsePath) or "NodeId" for clause in clauses]
    return [
        ua.Variant(getattr(event, name), event.data_types[name])
        if name in event.data_types and getattr(event, name) is not None
        else ua.Variant()
        for name in names
    ]
