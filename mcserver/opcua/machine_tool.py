"""A machine's nodes: a MachineTool of OPC 40501-1 in the folder Machines, its values and its alerts."""

from __future__ import annotations

import copy
import functools
import uuid
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote

from asyncua import Node, Server, ua
from asyncua.common.events import get_event_obj_from_type_node
from mcclient import MachineStatus
from mcclient.types import ToolRow

from mcserver.opcua.nodesets import ALERT_TYPE, MACHINE_TOOL_TYPE, MACHINES, Model, State
from mcserver.opcua.readings import Alert, Value, alerts_of, gone, readings_of
from mcserver.terminal import visible

# types of OPC 40501-1 and of Machinery for what is optional in a MachineTool
CHANNEL_TYPE, MESSAGES_TYPE, TOOL_LIST_TYPE, TOOL_TYPE = 16, 38, 44, 50
ITEM_STATE_TYPE = 1002
PERCENT = ua.EUInformation("http://www.opcfoundation.org/UA/units/un/cefact", 20529, ua.LocalizedText("%"))
# the machine's override goes from 0 to here [%]
MOST_OVERRIDE = 200.0
SEVERITY = 800
# of the tool table
MOST_TOOLS = 500
KINDS = {int: ua.VariantType.Int32, float: ua.VariantType.Double, str: ua.VariantType.String}


class MachineTool:
    """One machine: made by `create`."""

    def __init__(self, server: Server, model: Model, name: str) -> None:
        self._server, self._model, self._name = server, model, name
        # a name has no colon: no other machine's nodes begin so
        self._id = f"{name}:"
        self._values: dict[str, Value | None] = {}
        self._alerts: list[Alert] = []
        self._tools: tuple[ToolRow, ...] = ()
        self._alert: Any = None

    @classmethod
    async def create(cls, server: Server, model: Model, machine_name: str, version: str) -> MachineTool:
        """Add the nodes of a machine; ``version``: of its server."""
        machine = cls(server, model, machine_name)
        name = ua.QualifiedName(machine_name, model.own)
        tool = model.machine_tool
        folder = server.get_node(ua.NodeId(MACHINES, model.machinery))
        await machine._add(folder, "", name, model.type(MACHINE_TOOL_TYPE))
        monitoring = machine._node("Monitoring")
        channel = ua.QualifiedName("Channel", model.own)
        await machine._add(monitoring, "Monitoring.Channel", channel, model.type(CHANNEL_TYPE))
        optional = (
            ("Monitoring.MachineTool", "MachineryItemState", model.machinery, ITEM_STATE_TYPE),
            ("Notification", "Messages", tool, MESSAGES_TYPE),
            ("Equipment", "Tools", tool, TOOL_LIST_TYPE),
        )
        for parent, child, namespace, kind in optional:
            of = ua.NodeId(kind, namespace)
            await machine._add(
                machine._node(parent), f"{parent}.{child}", ua.QualifiedName(child, namespace), of
            )
        await machine._add_override("Monitoring.MachineTool")
        await machine._describe(version)
        machine._alert = await get_event_obj_from_type_node(server.get_node(model.type(ALERT_TYPE)))
        for node in (machine._node("Notification.Messages"), server.get_node(ua.ObjectIds.Server)):
            await node.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
        return machine

    async def show(self, status: MachineStatus | None, wall: float) -> None:
        """Write what has changed; None: the machine does not answer.

        Args:
            wall: Unix time, the values' [s].
        """
        time = datetime.fromtimestamp(wall, UTC)
        readings = readings_of(status, self._model.program_states, self._model.item_states)
        for path, value in readings.items():
            if path not in self._values or self._values[path] != value:
                self._values[path] = value
                await self._write(path, value, time)
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
            await self._server.delete_nodes([self._node(f"Equipment.Tools.T{gone_number}")], recursive=True)
        for tool in new:
            if tool.number not in numbers:
                await self._add_tool(tool.number)
        self._tools = new

    async def _add_tool(self, number: int) -> None:
        path = f"Equipment.Tools.T{number}"
        name = ua.QualifiedName(f"T{number}", self._model.own)
        await self._add(self._node("Equipment.Tools"), path, name, self._model.type(TOOL_TYPE))
        await self._set(f"{path}.ControlIdentifier1", ua.Variant(number, ua.VariantType.UInt32))
        await self._set(f"{path}.ControlIdentifierInterpretation", ua.Variant(0, ua.VariantType.Int32))
        await self._set(f"{path}.Locked", ua.Variant(False))
        await self._set(f"{path}.Locked.ReasonForLocking", ua.Variant(0, ua.VariantType.Int32))

    async def _add(self, parent: Node, path: str, name: ua.QualifiedName, kind: ua.NodeId) -> None:
        """Add an object of a type with all that is mandatory in it."""
        await parent.add_object(self._nodeid(path), name, objecttype=kind, instantiate_optional=False)

    async def _add_override(self, parent: str) -> None:
        """Add FeedOverride with its properties, as the type has it."""
        space = self._model.machine_tool
        node = await self._node(parent).add_variable(
            self._nodeid(f"{parent}.FeedOverride"), ua.QualifiedName("FeedOverride", space), 0.0
        )
        await node.add_property(
            self._nodeid(f"{parent}.FeedOverride.EURange"), ua.QualifiedName("EURange", 0), ua.Range()
        )
        unit = ua.QualifiedName("EngineeringUnits", 0)
        await node.add_property(self._nodeid(f"{parent}.FeedOverride.EngineeringUnits"), unit, PERCENT)

    async def _describe(self, version: str) -> None:
        """Set what stays as it is."""
        said = ua.LocalizedText("mcserver")
        await self._set("Identification.Manufacturer", ua.Variant(said))
        instance = f"urn:mcserver:{quote(self._name, safe='')}"
        await self._set("Identification.ProductInstanceUri", ua.Variant(instance))
        await self._set("Identification.SerialNumber", ua.Variant(self._name))
        revision = ua.QualifiedName("SoftwareRevision", self._model.di)
        await self._node("Identification").add_property(
            self._nodeid("Identification.SoftwareRevision"), revision, visible(version)
        )
        await self._set("Monitoring.Channel.Name", ua.Variant("Channel"))
        for place in ("MachineTool", "Channel"):
            path = f"Monitoring.{place}.FeedOverride"
            await self._set(f"{path}.EURange", ua.Variant(ua.Range(0.0, MOST_OVERRIDE)))
            await self._set(f"{path}.EngineeringUnits", ua.Variant(PERCENT))

    async def _write(self, path: str, value: Value | None, time: datetime) -> None:
        if value is None:
            nothing = ua.StatusCode(ua.StatusCodes.BadNoCommunication)
            await self._set(path, ua.Variant(), time, nothing)
            if path.endswith(".CurrentState"):
                await self._set(f"{path}.Id", ua.Variant(), time, nothing)
        elif isinstance(value, State):
            await self._write_state(path, value, time)
        elif path.endswith(".NumberInList"):
            await self._set(path, ua.Variant(value, ua.VariantType.UInt16), time)
        else:
            await self._set(path, ua.Variant(value, KINDS[type(value)]), time)

    async def _write_state(self, path: str, state: State, time: datetime) -> None:
        await self._set(path, ua.Variant(ua.LocalizedText(state.name)), time)
        await self._set(f"{path}.Id", ua.Variant(state.node), time)
        if path.startswith("Production."):
            await self._set(f"{path}.Number", ua.Variant(state.number, ua.VariantType.UInt32), time)

    async def _set(
        self, path: str, value: ua.Variant, time: datetime | None = None, status: ua.StatusCode | None = None
    ) -> None:
        found = ua.DataValue(
            value, StatusCode=status or ua.StatusCode(), SourceTimestamp=time or datetime.now(UTC)
        )
        await self._server.write_attribute_value(self._nodeid(path), found)

    async def _tell(self, alert: Alert, *, active: bool, time: datetime) -> None:
        """Send an event of AlertType to who listens at the machine's messages or at the server."""
        messages = self._nodeid("Notification.Messages")
        for emitting in (messages, ua.NodeId(ua.ObjectIds.Server)):
            event = copy.copy(self._alert)
            event.to_event_fields = functools.partial(_fields, event)
            event.emitting_node = emitting
            values: dict[str, object] = {
                "EventId": uuid.uuid4().bytes,
                "Time": time,
                "ReceiveTime": time,
                "SourceNode": messages,
                "SourceName": self._name,
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
            await self._server.iserver.subscription_service.trigger_event(event)

    def _nodeid(self, path: str) -> ua.NodeId:
        return ua.NodeId(f"{self._id}.{path}" if path else self._id, self._model.own)

    def _node(self, path: str) -> Node:
        return self._server.get_node(self._nodeid(path))


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
