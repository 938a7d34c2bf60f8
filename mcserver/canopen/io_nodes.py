"""What is written at boot-up into nodes with inputs and outputs (CiA 401)."""

from __future__ import annotations

import struct

from mcserver.can.pdo import MappedPdo
from mcserver.canopen.sdo_write import SdoWrite, unsigned32
from mcserver.canopen.settings import DriveSettings
from mcserver.machine.io_process_data import HEARTBEAT_MS, io_process_data
from mcserver.machine.machine_file import Machine

# 1400h:01 and 1800h:01: the PDO is off.
INVALID = 0x8000_0000
# The node gives up on a master that is silent for so long [ms].
MASTER_TIMEOUT_MS = 1000
DIGITAL_OUTPUTS = 0x6200
ERROR_MODE, ERROR_VALUE = 0x6206, 0x6207


def configure_io(settings: DriveSettings, machine: Machine, master: int) -> list[SdoWrite]:
    """List what to write into an I/O node, in order: heartbeats, what it does without a master, its PDOs.

    Args:
        master: node of the heartbeat that it watches.
    """
    agreed = io_process_data(machine, settings.bus, settings.node)
    return [
        SdoWrite(0x1017, 0, struct.pack("<H", HEARTBEAT_MS), "its heartbeat"),
        SdoWrite(
            0x1016, 1, unsigned32(master << 16 | MASTER_TIMEOUT_MS), "the watch of the master", optional=True
        ),
        *_without_master(settings, machine),
        *(write for pdo in agreed.rpdos for write in _pdo(0x1400, 0x1600, "RPDO", pdo)),
        *(write for pdo in agreed.tpdos for write in _pdo(0x1800, 0x1A00, "TPDO", pdo)),
    ]


def _without_master(settings: DriveSettings, machine: Machine) -> list[SdoWrite]:
    """6206h, 6207h: digital outputs take their safe values by themselves; those that are kept stay."""
    modes: dict[int, int] = {}
    values: dict[int, int] = {}
    for each in machine.outputs:
        target = each.target
        if target is None or (target.bus, target.node) != (settings.bus, settings.node):
            continue
        if target.index != DIGITAL_OUTPUTS or target.bit is None:
            continue
        modes.setdefault(target.subindex, 0)
        values.setdefault(target.subindex, 0)
        if each.safe is not None:
            modes[target.subindex] |= 1 << target.bit
            if (each.safe != 0.0) is not each.invert:
                values[target.subindex] |= 1 << target.bit
    return [
        SdoWrite(index, subindex, bytes((by_subindex[subindex],)), what, optional=True)
        for index, by_subindex, what in (
            (ERROR_VALUE, values, "outputs without a master"),
            (ERROR_MODE, modes, "outputs without a master"),
        )
        for subindex in sorted(by_subindex)
    ]


def _pdo(communication: int, mapping: int, kind: str, pdo: MappedPdo) -> list[SdoWrite]:
    at = pdo.number - 1
    what = f"{kind}{pdo.number}"
    return [
        SdoWrite(communication + at, 1, unsigned32(pdo.cob_id | INVALID), f"{what} off"),
        SdoWrite(communication + at, 2, bytes((pdo.transmission,)), f"transmission of {what}"),
        SdoWrite(mapping + at, 0, bytes((0,)), f"mapping of {what}"),
        *(
            SdoWrite(mapping + at, number, unsigned32(mapped.word), f"mapping of {what}")
            for number, mapped in enumerate(pdo.objects, 1)
        ),
        SdoWrite(mapping + at, 0, bytes((len(pdo.objects),)), f"mapping of {what}"),
        SdoWrite(communication + at, 1, unsigned32(pdo.cob_id), f"{what} on"),
    ]
