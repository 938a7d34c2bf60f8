"""From a machine to the simulated drives of its buses."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from importlib import import_module

from mcserver.can.open import open_port
from mcserver.can.port import CanPort
from mcserver.drive_sim.cia401_node import Cia401Node
from mcserver.drive_sim.described import add_objects, described, identity_of
from mcserver.drive_sim.ethercat.drive import EthercatDrive
from mcserver.drive_sim.ethercat.segment import EthercatLine, EthercatSegment
from mcserver.drive_sim.motor import Hardware
from mcserver.drive_sim.simulation import CanNode, Segment, SimulatedBusSegment
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.drives.servo_model import DEFAULT_FRICTION, OVERSPEED
from mcserver.errors import RuntimeFault
from mcserver.machine.axis import Axis
from mcserver.machine.bus_section import BusConfig
from mcserver.machine.drive import CanDrive
from mcserver.machine.io_process_data import nodes_on, objects_of
from mcserver.machine.machine_file import Machine
from mcserver.units import TURN

# A motor without a torque limit in the machine file accelerates by this multiple of the axis's limit.
SPARE_ACCELERATION = 5.0
RETRY_S = 0.1


@dataclass(frozen=True)
class Choice:
    """Which drives are simulated.

    Attributes:
        buses: names or addresses; none: all. nodes: none: all.
        interfaces: where a master of EtherCAT is connected; two: both ends of a ring.
    """

    buses: Collection[str] = ()
    nodes: Collection[int] = ()
    interfaces: Sequence[str] = ()


def simulated_axes(machine: Machine, choice: Choice) -> list[tuple[BusConfig, Axis]]:
    """Return the axes whose drives are to be simulated, with their buses."""
    found = []
    for axis in machine.axes:
        if not isinstance(axis.drive, CanDrive):
            continue
        bus = machine.bus_of(axis)
        if choice.buses and bus.name not in choice.buses and bus.address not in choice.buses:
            continue
        if not choice.nodes or axis.drive.node in choice.nodes:
            found.append((bus, axis))
    return found


def simulated_io(machine: Machine, bus: BusConfig, choice: Choice) -> list[int]:
    """Return the nodes with inputs and outputs on a bus that are to be simulated."""
    if choice.buses and bus.name not in choice.buses and bus.address not in choice.buses:
        return []
    return [node for node in nodes_on(machine, bus.name) if not choice.nodes or node in choice.nodes]


def build_buses(
    machine: Machine,
    choice: Choice,
    wait_s: float = 0.0,
    opener: Callable[[str], CanPort] = open_port,
) -> list[Segment]:
    """Open the buses and put the drives on them, switched off.

    Args:
        wait_s: how long a bus that cannot be opened yet is tried again.

    Raises:
        RuntimeFault: MC424 a bus cannot be opened.
    """
    segments: dict[str, SimulatedBusSegment] = {}
    lines: dict[str, EthercatSegment] = {}
    deadline = time.monotonic() + wait_s

    def segment_of(bus: BusConfig) -> SimulatedBusSegment:
        if bus.name not in segments:
            segments[bus.name] = SimulatedBusSegment(bus.name, _open(bus.address, deadline, opener))
        return segments[bus.name]

    try:
        for bus, axis in simulated_axes(machine, choice):
            if bus.kind == "ethercat":
                if bus.name not in lines:
                    lines[bus.name] = EthercatSegment(bus.name, EthercatLine(choice.interfaces))
                lines[bus.name].nodes.append(_ethercat_drive(machine, axis))
                continue
            segment = segment_of(bus)
            segment.nodes.append(build_node(machine, axis, segment.transmit, start_turns(axis)))
        for bus in machine.buses:
            for number in simulated_io(machine, bus, choice):
                segment = segment_of(bus)
                inputs, outputs = objects_of(machine, bus.name, number)
                segment.nodes.append(Cia401Node(number, segment.transmit, inputs, outputs))
    except RuntimeFault:
        for opened in _all(segments, lines):
            opened.port.close()
        raise
    for line in lines.values():
        line.nodes.sort(key=lambda drive: drive.node)
    return _all(segments, lines)


def _all(segments: dict[str, SimulatedBusSegment], lines: dict[str, EthercatSegment]) -> list[Segment]:
    return [*segments.values(), *lines.values()]


def _ethercat_drive(machine: Machine, axis: Axis) -> EthercatDrive:
    dictionary = described(machine, axis)
    identity = identity_of(axis, dictionary)
    node = cia402_drive(axis).node
    drive = EthercatDrive(node, hardware_of(axis), start_turns(axis), identity, time.monotonic)
    add_objects(drive.store, dictionary)
    return drive


def build_node(
    machine: Machine, axis: Axis, transmit: Callable[[int, bytes], None], position: float
) -> CanNode:
    """Return the drive of one axis, its motor at ``position`` [turn]: of the module with its kind's name."""
    made: CanNode = import_module(f"mcserver.drive_sim.{axis.drive.kind}_node").simulated_node(
        machine, axis, transmit, hardware_of(axis), position
    )
    return made


def hardware_of(axis: Axis) -> Hardware:
    """Motor and encoder as the machine file describes them."""
    drive = axis.drive
    assert isinstance(drive, CanDrive)
    turn = axis.travel_per_motor_turn
    increments, revolutions = drive.encoder or (65536, 1)
    inertia = max(drive.inertia, 1e-9)
    spare = SPARE_ACCELERATION * axis.max_acceleration / turn
    by_torque = drive.max_torque / (inertia * TURN)
    friction = drive.friction_decel * axis.type.si_per_unit or DEFAULT_FRICTION * axis.max_acceleration
    return Hardware(
        increments_per_turn=increments / revolutions,
        velocity_per_turn=drive.velocity_counts_per_motor_rev,
        bandwidth_hz=drive.bandwidth_hz,
        inertia=inertia,
        rated_torque=drive.rated_torque or 1.0,
        max_acceleration=by_torque if by_torque > 0.0 else spare,
        max_speed=OVERSPEED * axis.max_velocity / turn,
        friction=friction / turn,
        brake=drive.brake,
        home_switch=_turns_between(axis),
    )


def start_turns(axis: Axis) -> float:
    """Return where the motor stands when power comes, by the machine file [turn]."""
    return axis.initial_position * _turns_per_travel(axis)


def _turns_per_travel(axis: Axis) -> float:
    inverted = isinstance(axis.drive, CanDrive) and axis.drive.invert
    return (-1.0 if inverted else 1.0) / axis.travel_per_motor_turn


def _turns_between(axis: Axis) -> tuple[float, float] | None:
    """Return where the home switch is active, by the motor [turn]; None: it has none."""
    if axis.drive.home_switch is None:
        return None
    scale = axis.type.si_per_unit * _turns_per_travel(axis)
    low, high = sorted(end * scale for end in axis.drive.home_switch)
    return low, high


def _open(address: str, deadline: float, opener: Callable[[str], CanPort]) -> CanPort:
    while True:
        try:
            return opener(address)
        except RuntimeFault:
            if time.monotonic() + RETRY_S > deadline:
                raise
            time.sleep(RETRY_S)
