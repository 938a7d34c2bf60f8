"""What the service path needs of one drive, taken from the machine file."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass

from mcserver.can.pdo_layout import Mode
from mcserver.drives.cia402.scaling import scaling_objects
from mcserver.errors import Diagnostic
from mcserver.machine.drive_section import CAN_KINDS
from mcserver.machine.machine_file import Axis, Machine

_MODES = {"csp": Mode.CYCLIC_POSITION, "csv": Mode.CYCLIC_VELOCITY}


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

    @property
    def name(self) -> str:
        """For messages: ``axis 2, node 3 on can0``."""
        return f"axis {self.axis}, node {self.node} on {self.bus}"


def uses_can(machine: Machine) -> bool:
    """Whether any axis has a drive on a CAN bus."""
    return any(axis.drive.kind in CAN_KINDS for axis in machine.axes)


def settings_of(machine: Machine) -> list[DriveSettings]:
    """All drives on CAN buses, by axis."""
    return [_of_axis(machine, axis) for axis in machine.axes if axis.drive.kind in CAN_KINDS]


def _of_axis(machine: Machine, axis: Axis) -> DriveSettings:
    drive = axis.drive
    bus = machine.bus_of(axis)
    return DriveSettings(
        axis=axis.index,
        kind=drive.kind,
        bus=bus.name,
        address=bus.address,
        node=drive.node,
        eds=drive.eds,
        mode=_MODES.get(drive.mode, Mode.CYCLIC_POSITION),
        scaling=scaling_objects(drive),
        vendor_id=drive.vendor_id,
        product_code=drive.product_code,
        heartbeat_ms=drive.heartbeat_ms,
        command_timeout_ms=drive.command_timeout_ms,
        sdo_writes=tuple(tuple(write) for write in drive.sdo_writes),
    )


def find_drive_faults(machine: Machine) -> list[Diagnostic]:
    """Check CiA 402 drives against their EDS files and the cycle.

    Errors MC008 and MC552: the machine cannot be run. Warnings MC022. Nothing where the packages for drives
    on a CAN bus are missing, which `mcserver.machine.plausibility.find_doubts` says.
    """
    if importlib.util.find_spec("canopen") is None or importlib.util.find_spec("can") is None:
        return []
    if not any(axis.drive.kind in CAN_KINDS for axis in machine.axes):
        return []
    # only such machines need these packages
    from mcserver.canopen.machine_file_check import check_drives

    return check_drives(machine)
