"""What the service path needs of one drive, taken from the machine file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import msgspec

from mcserver.can.pdo import ProcessData
from mcserver.can.pdo_layout import Mode
from mcserver.canopen.canopen_errors import DriveError
from mcserver.drives.cia402.drive import BASE_MODES, Cia402Drive
from mcserver.drives.cia402.scaling import homing_objects, profile_objects, scaling_objects
from mcserver.drives.streamed import StreamedDrive
from mcserver.machine.axis import Axis
from mcserver.machine.bus_section import BusConfig
from mcserver.machine.drive import CanDrive
from mcserver.machine.io_process_data import HEARTBEAT_MS, nodes_on
from mcserver.machine.machine_file import Machine

# From the objects of a node's axis to those of its next one (CiA 402).
AXIS_OFFSET = 0x800
# Store and restore parameters (CiA 301): a write to flash memory, answered when it is done.
STORING = frozenset({0x1010, 0x1011})
# In place of an axis's number, of nodes that have none.
NO_AXIS = -1


@dataclass(frozen=True)
class SdoTimes:
    """How long a node may take.

    Attributes:
        response_s: for one answer. attempts: of a transfer that gets no answer. transfer_s: for a long one.
        queue_s: behind another transfer with the same node. store_s: for the answer to a store (1010h,
            1011h).
    """

    response_s: float = 0.3
    attempts: int = 3
    transfer_s: float = 5.0
    queue_s: float = 2.0
    store_s: float = 15.0


@dataclass(frozen=True)
class DriveSettings:
    """One drive on a CAN bus.

    Attributes:
        bus: the bus's name; address: where it is. eds: its file, empty for the standard's objects.
        mode: 6060h at boot-up.
        scaling: (index, subindex, value) that make the drive's unit of position an increment.
        vendor_id, product_code: what 1018h has to say; 0: anything.
        heartbeat_ms: what the drive sends, 0: none. command_timeout_ms: silence of the master that stops it.
        sdo_writes: (index, subindex, value) or (index, subindex, value, length in bytes), written last.
        node_axis: which axis of its node. pdo_node: whose COB-IDs its PDOs have, 0: the node's own.
        fixed_pdos: the drive's mapping is taken as it is. torque: whether torques are used,
            torque_offset: as feed-forward too (60B2h).
        monitor: (index, subindex, name) of what telemetry shows. sdo: its times.
        listen_s: for another master on its bus. appear_s: how long its node may take to appear.
        lss: identity of a node that gets its number from here.
        homing, profile: (index, subindex, value) for the drive's own homing, and its own profiles; with mode
            "cst" its greatest torque.
        inputs: 60FDh is read in the cycle. outputs: bits of 60FEh that are written.
        streamed: what reads its telemetry, of a drive without a profile.
        fieldbus: kind of its bus; on EtherCAT ``node`` is its position, counted from 1, and ``address`` the
            network interface, ``redundant_interface`` where its ring ends. distributed_clocks: it acts at
            SYNC0 where it can.
    """

    axis: int
    kind: str
    bus: str
    address: str
    node: int
    eds: str = ""
    mode: int = Mode.CYCLIC_POSITION
    scaling: tuple[tuple[int, int, int], ...] = ()
    vendor_id: int = 0
    product_code: int = 0
    heartbeat_ms: int = 100
    command_timeout_ms: int = 100
    sdo_writes: tuple[tuple[int, ...], ...] = ()
    node_axis: int = 0
    pdo_node: int = 0
    fixed_pdos: bool = False
    torque: bool = False
    torque_offset: bool = False
    monitor: tuple[tuple[int, int, str], ...] = ()
    sdo: SdoTimes = SdoTimes()
    listen_s: float = 0.25
    appear_s: float = 10.0
    foreign_sync: bool = False
    lss: tuple[int, int, int, int] | None = None
    homing: tuple[tuple[int, int, int], ...] = ()
    profile: tuple[tuple[int, int, int], ...] = ()
    inputs: bool = False
    outputs: int = 0
    streamed: StreamedDrive | None = None
    fieldbus: str = "can"
    distributed_clocks: bool = False
    redundant_interface: str = ""

    @property
    def offset(self) -> int:
        """From the objects of a node's first axis to those of this one."""
        return AXIS_OFFSET * self.node_axis

    @property
    def place(self) -> int:
        """Its node, on EtherCAT its position as the machine file counts."""
        return self.node - (self.fieldbus == "ethercat")

    @property
    def has_profile(self) -> bool:
        """Whether it is a node by CiA 402 or 401, which is configured, started and watched."""
        return self.streamed is None

    @property
    def name(self) -> str:
        """For messages: ``axis 2, node 3 on can0``, ``axis 2, position 3 on eth1``."""
        if self.fieldbus == "ethercat":
            return f"axis {self.axis}, position {self.node - 1} on {self.bus}"
        if self.kind == "cia401":
            return f"the I/O node {self.node} on {self.bus}"
        return f"axis {self.axis}, node {self.node} on {self.bus}"

    def fault(self, code: str, what: str, hint: str, **details: object) -> DriveError:
        """Return a fault of this drive: ``what`` goes on behind its name."""
        return DriveError(code, f"{self.name}: {what}", hint, axis=self.axis, **details)


def uses_can(machine: Machine) -> bool:
    """Return whether any axis has a drive on a CAN bus, or any input or output is on one."""
    drives = any(
        isinstance(axis.drive, CanDrive) and machine.bus_of(axis).kind == "can" for axis in machine.axes
    )
    return drives or any(nodes_on(machine, bus.name) for bus in machine.buses)


def settings_of(machine: Machine) -> list[DriveSettings]:
    """Return all drives on buses, by axis, and behind them the nodes with inputs and outputs."""
    drives = [_of_axis(machine, axis) for axis in machine.axes if isinstance(axis.drive, CanDrive)]
    return drives + [_of_io(bus, node) for bus in machine.buses for node in nodes_on(machine, bus.name)]


def with_process_data(machine: Machine, data: Mapping[int, ProcessData]) -> Machine:
    """Return the machine with the process data that its CiA 402 drives have agreed to, by axis."""
    replaced = msgspec.structs.replace
    axes = [
        replaced(axis, drive=replaced(axis.drive, process_data=data[axis.index]))
        if isinstance(axis.drive, Cia402Drive) and axis.index in data
        else axis
        for axis in machine.axes
    ]
    return replaced(machine, axes=tuple(axes))


def _of_io(bus: BusConfig, node: int) -> DriveSettings:
    return DriveSettings(
        axis=NO_AXIS,
        kind="cia401",
        bus=bus.name,
        address=bus.address,
        node=node,
        heartbeat_ms=HEARTBEAT_MS,
        listen_s=bus.listen_ms / 1e3,
        appear_s=bus.appear_timeout_s,
        foreign_sync=bus.sync == "foreign",
    )


def _of_axis(machine: Machine, axis: Axis) -> DriveSettings:
    drive = axis.drive
    assert isinstance(drive, CanDrive)
    bus = machine.bus_of(axis)
    settings = DriveSettings(
        axis=axis.index,
        kind=drive.kind,
        bus=bus.name,
        address=bus.address,
        node=drive.node,
        command_timeout_ms=drive.command_timeout_ms,
        listen_s=bus.listen_ms / 1e3,
        appear_s=bus.appear_timeout_s,
        foreign_sync=bus.sync == "foreign",
        fieldbus=bus.kind,
        distributed_clocks=bus.kind == "ethercat" and bus.distributed_clocks,
        redundant_interface=bus.redundant_interface,
    )
    if isinstance(drive, StreamedDrive):
        return replace(settings, streamed=drive)
    assert isinstance(drive, Cia402Drive)
    return replace(
        settings,
        eds=drive.eds,
        mode=BASE_MODES[drive.mode],
        scaling=scaling_objects(drive),
        vendor_id=drive.vendor_id,
        product_code=drive.product_code,
        heartbeat_ms=drive.heartbeat_ms,
        sdo_writes=tuple(tuple(write) for write in drive.sdo_writes),
        node_axis=drive.node_axis,
        pdo_node=drive.pdo_node,
        fixed_pdos=drive.pdo == "fixed",
        torque=drive.rated_torque > 0.0,
        torque_offset=drive.torque_offset,
        monitor=tuple(_monitored(text) for text in drive.monitor),
        sdo=SdoTimes(
            response_s=drive.sdo_timeout_ms / 1e3,
            attempts=drive.sdo_tries,
            transfer_s=max(5.0, 10.0 * drive.sdo_timeout_ms / 1e3),
            store_s=drive.sdo_store_timeout_s,
        ),
        lss=drive.lss,
        homing=homing_objects(axis),
        profile=profile_objects(axis),
        inputs=_has_inputs(machine, axis),
        outputs=_output_bits(machine, axis),
    )


def _has_inputs(machine: Machine, axis: Axis) -> bool:
    homing = axis.homing
    by_switch = homing is not None and homing.method == "switch" and homing.input is None
    named = any(each.source is not None and each.source.axis == axis.index for each in machine.inputs)
    return by_switch or named


def _output_bits(machine: Machine, axis: Axis) -> int:
    bits = 0
    for each in machine.outputs:
        if each.target is not None and each.target.axis == axis.index:
            bits |= 1 << (each.target.bit or 0)
    return bits


def _monitored(text: str) -> tuple[int, int, str]:
    place, _, name = text.partition(" ")
    index, _, subindex = place.partition(":")
    return int(index.rstrip("hH"), 16), int(subindex or "0", 16), name.strip() or place
