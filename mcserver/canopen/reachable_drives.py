"""The drives of a running machine that operators may reach, and what must not be written to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from mcserver.can.cob import NmtState
from mcserver.can.pdo import ProcessData
from mcserver.can.port import ListeningPort
from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.configuration import PDO_OBJECTS, of_first_axis
from mcserver.canopen.cycle_samples import Signal, signals_of
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.node import Node, Phase
from mcserver.canopen.node_configuration import SdoClient
from mcserver.canopen.service import CanopenService
from mcserver.canopen.settings import DriveSettings
from mcserver.canopen.views import BusHealth, BusScan, DriveInfo, SdoTarget
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine

# What the cycle, the supervision and the scaling of positions rest on (CiA 301, CiA 402).
_CYCLIC = frozenset({0x6040, 0x6060, 0x6071, 0x607A, 0x60C1, 0x60FF})
# Of position, velocity and torque: what is added to the targets.
_OFFSETS = frozenset({0x60B0, 0x60B1, 0x60B2})
_OUTPUTS = 0x60FE
_WATCHING = frozenset({0x1016, 0x1017})
# Of sync managers with the cycle, on EtherCAT (ETG.1020).
_SYNCHRONIZATION = frozenset({0x1C32, 0x1C33})
_SCALING = frozenset({0x607C, 0x607E, 0x608F, 0x6091, 0x6092, 0x60C2})

_BY_PROGRAM = "move the axis by a program, or by jog"
_BY_FILE = "what it holds follows from the machine file; change it there and start the server again"


def moves_by_sdo(index: int) -> bool:
    """Return whether an object, of any axis of a node, commands motion, energy or, by 60FEh, a brake."""
    return of_first_axis(index) in _CYCLIC | _OFFSETS | {_OUTPUTS}


def refusal_of_write(index: int) -> tuple[str, str] | None:
    """Why an object must not be written while the cycle runs, and what to do instead; None: it may be."""
    index = of_first_axis(index)
    if index in _CYCLIC:
        return "the executor sends it in every cycle", _BY_PROGRAM
    if index in _OFFSETS:
        return "the drive adds it to the targets that the executor sends", _BY_PROGRAM
    if index == _OUTPUTS:
        return "it switches outputs, one of which may hold a brake", "switch outputs by programs"
    if index in PDO_OBJECTS:
        return "it is the mapping of the process data in which the executor and the drive agree", _BY_FILE
    if index in _SYNCHRONIZATION:
        return "its synchronization with the cycle rests on it", _BY_FILE
    if index in _WATCHING:
        return "the watching of the drive rests on it", _BY_FILE
    if index in _SCALING:
        return "the scaling of positions rests on it, and the axis may be energized", _BY_FILE
    return None


@dataclass(frozen=True)
class LineDrive:
    """A drive on EtherCAT, whose line is in the cycle.

    Attributes:
        sdo: its mailbox. dictionary: of its file, or the standard's objects.
    """

    settings: DriveSettings
    sdo: SdoClient
    dictionary: DeviceDictionary

    def refusal_of_write(self, index: int) -> tuple[str, str] | None:
        """As the function."""
        return refusal_of_write(index)


class LineAccess(Protocol):
    """Drives on EtherCAT; `mcserver.ethercat.operator_line.OperatorLine`."""

    @property
    def machine(self) -> Machine:
        """As its file describes it."""

    @property
    def drives(self) -> Sequence[LineDrive]:
        """By axis."""

    @property
    def buses(self) -> Sequence[str]:
        """Their names."""

    def process_data(self) -> dict[int, ProcessData]:
        """Return what the cycle exchanges with the drives, by axis."""

    def infos(self) -> list[DriveInfo]:
        """Return the drives as they are; may wait for a second."""

    def scan(self, bus: str) -> BusScan:
        """Return who was found on a line at its start."""

    def listen(self, bus: str) -> ListeningPort:
        """Open a line for listening. Raises: RuntimeFault MC424 it cannot be."""

    def health(
        self,
        bus: str,
        seconds: float,
        data: Mapping[int, ProcessData],
        signals: Sequence[Signal],
        check: Callable[[], None],
    ) -> BusHealth:
        """As `bus_report`. Raises: as `listen`."""


@dataclass(frozen=True)
class NodeDrive:
    """A drive of a node on a CAN bus, as `LineDrive`."""

    node: Node
    settings: DriveSettings
    dictionary: DeviceDictionary | None

    @property
    def sdo(self) -> SdoClient:
        return self.node.sdo

    def refusal_of_write(self, index: int) -> tuple[str, str] | None:
        node = self.node
        if not node.settings.has_profile:
            return "its drive's SDO takes no standard writes", "use its maker's own tool"
        if node.phase is not Phase.OPERATIONAL and node.nmt is not NmtState.OPERATIONAL:
            return None
        return refusal_of_write(index)


@dataclass(frozen=True)
class OnBus:
    """A CiA 402 drive as it is on its bus in a cycle."""

    machine: Machine
    settings: DriveSettings
    process_data: ProcessData
    dictionary: DeviceDictionary

    @property
    def axis(self) -> Axis:
        return self.machine.axes[self.machine.column_of(self.settings.axis)]

    @property
    def signals(self) -> list[Signal]:
        return signals_of(self.axis, self.process_data, self.dictionary, self.settings.node_axis)


class ReachableDrives:
    """Drives of a machine on its buses.

    Args:
        service: of the CAN buses; None: there are none.

    Attributes:
        line: drives on EtherCAT; None: there are none, or their line is not there yet.
    """

    def __init__(self, service: CanopenService | None) -> None:
        self.service = service
        self.line: LineAccess | None = None

    @property
    def nodes(self) -> list[Node]:
        """Those on CAN."""
        return [] if self.service is None else self.service.nodes

    def on_buses(self) -> list[OnBus]:
        """Every CiA 402 drive with what of it is on its bus in a cycle."""
        service, line = self.service, self.line
        found: list[OnBus] = []
        if service is not None:
            data = service.process_data()
            for node in service.nodes:
                for own in node.axes:
                    index = own.settings.axis
                    known = service.dictionary(index)
                    if index in data and known is not None:
                        found.append(OnBus(service.machine, own.settings, data[index], known))
        if line is not None:
            data = line.process_data()
            found += [
                OnBus(line.machine, each.settings, data[each.settings.axis], each.dictionary)
                for each in line.drives
            ]
        return found

    def find(self, target: SdoTarget) -> NodeDrive | LineDrive:
        """Return the drive that is meant; DriveError: MC559 there is none, or several are."""
        every = [
            NodeDrive(
                node,
                axis.settings,
                None if self.service is None else self.service.dictionary(axis.settings.axis),
            )
            for node in self.nodes
            for axis in node.axes
        ]
        found: list[NodeDrive | LineDrive]
        if target.axis is not None:
            reached: list[NodeDrive | LineDrive] = [*every]
            reached += [] if self.line is None else self.line.drives
            found = [each for each in reached if each.settings.axis == target.axis]
            named = f"axis {target.axis} has no drive on a bus"
            namesake = [each.settings for each in every if each.settings.node == target.axis]
            if namesake and not found:
                named += f"; {target.axis} is the node of axis {namesake[0].axis}"
        else:
            found = [
                each
                for each in every
                if each.settings.node == target.node
                and target.bus in ("", each.settings.bus)
                and each.settings is each.node.axes[0].settings
            ]
            named = f"there is no drive with node {target.node}" + (f" on {target.bus}" if target.bus else "")
        if len(found) > 1:
            buses = ", ".join(each.settings.bus for each in found)
            raise DriveError("MC559", f"node {target.node} is on several buses: {buses}", "name the bus too")
        if not found:
            raise DriveError("MC559", named, "`mcctl drives` lists axes with their nodes")
        return found[0]
