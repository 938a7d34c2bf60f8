"""Nodes of one machine, by paths below it such as ``Monitoring.Channel.FeedOverride``."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime

from asyncua import Node, Server, ua

from mcserver.opcua.nodesets import Model, State
from mcserver.opcua.readings import Value

KINDS = {
    bool: ua.VariantType.Boolean,
    int: ua.VariantType.Int32,
    float: ua.VariantType.Double,
    str: ua.VariantType.String,
}
# of variables whose type is another one in the models, by the last name of their paths
WIDTHS = {
    "NumberInList": ua.VariantType.UInt16,
    "RunsCompleted": ua.VariantType.UInt32,
    "RunsPlanned": ua.VariantType.UInt32,
}
NOTHING = ua.StatusCode(ua.StatusCodes.BadNoCommunication)


class MachineNodes:
    """Where a machine's nodes are, and the values that they have."""

    def __init__(self, server: Server, model: Model, machine: str) -> None:
        self.server, self.model, self.machine = server, model, machine
        # a name has no colon: no other machine's nodes begin so
        self._id = f"{machine}:"
        self._values: dict[str, Value | None] = {}

    def id_of(self, path: str) -> ua.NodeId:
        """Return the id of a node; the empty path: of the machine's own."""
        return ua.NodeId(f"{self._id}.{path}" if path else self._id, self.model.own)

    def node(self, path: str) -> Node:
        """Return a node."""
        return self.server.get_node(self.id_of(path))

    async def add(self, parent: Node, path: str, name: ua.QualifiedName, kind: ua.NodeId) -> None:
        """Add an object of a type with all that is mandatory in it."""
        await parent.add_object(self.id_of(path), name, objecttype=kind, instantiate_optional=False)

    async def remove(self, path: str) -> None:
        """Remove a node and what is below it."""
        await self.server.delete_nodes([self.node(path)], recursive=True)
        for known in [each for each in self._values if each.startswith(f"{path}.")]:
            del self._values[known]

    async def show(self, readings: Mapping[str, Value | None], time: datetime) -> None:
        """Write the values that have changed; None: there is none, since the machine does not answer."""
        for path, value in readings.items():
            if path not in self._values or self._values[path] != value:
                self._values[path] = value
                await self._write(path, value, time)

    async def set(
        self, path: str, value: ua.Variant, time: datetime | None = None, status: ua.StatusCode | None = None
    ) -> None:
        """Write one value."""
        found = ua.DataValue(
            value, StatusCode=status or ua.StatusCode(), SourceTimestamp=time or datetime.now(UTC)
        )
        await self.server.write_attribute_value(self.id_of(path), found)

    async def _write(self, path: str, value: Value | None, time: datetime) -> None:
        if value is None:
            await self.set(path, ua.Variant(), time, NOTHING)
            if path.endswith(".CurrentState"):
                await self.set(f"{path}.Id", ua.Variant(), time, NOTHING)
        elif isinstance(value, State):
            await self._write_state(path, value, time)
        else:
            kind = WIDTHS.get(path.rpartition(".")[2], KINDS[type(value)])
            await self.set(path, ua.Variant(value, kind), time)

    async def _write_state(self, path: str, state: State, time: datetime) -> None:
        await self.set(path, ua.Variant(ua.LocalizedText(state.name)), time)
        await self.set(f"{path}.Id", ua.Variant(state.node), time)
        if path.startswith("Production."):
            await self.set(f"{path}.Number", ua.Variant(state.number, ua.VariantType.UInt32), time)
