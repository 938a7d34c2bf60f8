"""What is written into a CiA 402 drive on EtherCAT (CoE), and the process data that it exchanges.

All outputs of an axis are in one PDO (1600h) and all inputs in another one (1A00h), assigned by 1C12h and
1C13h (ETG.1000.6, 5.6.7.4): every frame takes every output along, so that a controlword may stand in one
place alone. 603Fh, the error code, comes with the inputs in the place of an emergency message.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import msgspec

from mcserver.can.cob import Function
from mcserver.can.pdo import MappedObject, MappedPdo, ProcessData
from mcserver.can.pdo_layout import Mode
from mcserver.canopen import process_data as pdo
from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.configuration import application_writes
from mcserver.canopen.description import dictionary_of
from mcserver.canopen.process_data import PlannedProcessData
from mcserver.canopen.sdo_write import DriveDictionary, SdoWrite, unsigned32
from mcserver.canopen.settings import DriveSettings, settings_of
from mcserver.drives.cia402.drive import Cia402Drive
from mcserver.machine.machine_file import Machine

ERROR_CODE = MappedObject(0x603F, 0, 16)
OUTPUTS, INPUTS = 0x1600, 0x1A00
OUTPUT_ASSIGNMENT, INPUT_ASSIGNMENT = 0x1C12, 0x1C13
# 1C32h:01: the application acts at SYNC0 (ETG.1020).
SYNC_TYPE, AT_SYNC0 = 0x1C32, 2


def configure_coe(drive: DriveSettings, cycle_s: float) -> tuple[list[SdoWrite], PlannedProcessData]:
    """List everything to write into a drive in PREOP, in order, and what its PDOs then carry.

    Raises:
        ConfigurationError: MC008 its EDS, MC552 the drive has no place for what has to be written.
    """
    known = DriveDictionary(drive, dictionary_of(drive))
    data = ProcessData(
        (MappedPdo(1, Function.RPDO1 + drive.node, tuple(_outputs(known)), 1),),
        (MappedPdo(1, Function.TPDO1 + drive.node, tuple(_inputs(known)), 1),),
    )
    mapping = tuple(_mapping_writes(known, data))
    writes = [*mapping, *application_writes(drive, cycle_s, known)]
    if drive.distributed_clocks and known.objects.coe.sync0:
        payload = struct.pack("<H", AT_SYNC0)
        writes.append(SdoWrite(SYNC_TYPE, 1, payload, "synchronization by SYNC0", optional=True))
    return writes, PlannedProcessData(data, mapping, {})


def agreed_on_ethercat(machine: Machine) -> Machine:
    """Return the machine with the process data of its drives on EtherCAT, for the cycle.

    Raises:
        ConfigurationError: as `configure_coe`.
    """
    data = {
        drive.axis: configure_coe(drive, machine.cycle_s)[1].process_data
        for drive in settings_of(machine)
        if drive.fieldbus == "ethercat"
    }
    axes = [
        msgspec.structs.replace(
            axis, drive=msgspec.structs.replace(axis.drive, process_data=data[axis.index])
        )
        if axis.index in data and isinstance(axis.drive, Cia402Drive)
        else axis
        for axis in machine.axes
    ]
    return msgspec.structs.replace(machine, axes=tuple(axes))


def _outputs(known: DriveDictionary) -> Iterator[MappedObject]:
    drive = known.drive
    target = pdo.TARGETS[Mode(drive.mode)]
    wanted = [(pdo.CONTROLWORD, True), (pdo.MODE, False), (target, True)]
    if drive.mode == Mode.PROFILE_POSITION:
        wanted.append((pdo.PROFILE_VELOCITY, False))
    else:
        wanted += [(pdo.TARGET_POSITION, False), (pdo.TARGET_VELOCITY, False)]
        wanted += [(pdo.TARGET_TORQUE, False)] if drive.torque else []
    wanted += [(pdo.TORQUE_OFFSET, True)] if drive.torque_offset else []
    wanted += [(pdo.DIGITAL_OUTPUTS, True)] if drive.outputs else []
    yield from _mapped(known, wanted)


def _inputs(known: DriveDictionary) -> Iterator[MappedObject]:
    drive = known.drive
    wanted = [(pdo.STATUSWORD, True), (pdo.MODE_DISPLAY, False), (pdo.POSITION, True), (ERROR_CODE, False)]
    wanted += [(pdo.TORQUE, False)] if drive.torque else []
    wanted += [(pdo.DIGITAL_INPUTS, True)] if drive.inputs else []
    yield from _mapped(known, wanted)


def _mapped(known: DriveDictionary, wanted: list[tuple[MappedObject, bool]]) -> Iterator[MappedObject]:
    """Objects that can be mapped; those that are needed are refused where they cannot."""
    taken = set()
    for each, needed in wanted:
        variable = known.variable(each.index, each.subindex)
        if each in taken or (not needed and (variable is None or not variable.pdo_mappable)):
            continue
        if not known.must_have(each.index, each.subindex).pdo_mappable:
            raise known.no_place(
                each.index,
                each.subindex,
                "the EDS says that it cannot be mapped into a PDO",
                "check `eds`; another mode may need another object",
            )
        taken.add(each)
        yield each


def _mapping_writes(known: DriveDictionary, data: ProcessData) -> Iterator[SdoWrite]:
    coe = known.objects.coe
    for mapping, usual, assignment, carried in (
        (coe.outputs, OUTPUTS, OUTPUT_ASSIGNMENT, data.rpdos[0].objects),
        (coe.inputs, INPUTS, INPUT_ASSIGNMENT, data.tpdos[0].objects),
    ):
        for index in (mapping, assignment):
            if index is None or (known.has(index) and not known.writable(index)):
                raise known.no_place(
                    index or usual,
                    0,
                    "the file says that it is fixed: the process data of an axis cannot be mapped",
                    "such a drive cannot be used; if the file is wrong, leave `eds` out: the drive is asked",
                )
        assert mapping is not None
        yield SdoWrite(assignment, 0, b"\x00", "assignment of no PDO")
        yield SdoWrite(mapping, 0, b"\x00", "PDO without entries")
        for at, mapped in enumerate(carried, 1):
            what = f"PDO entry {at}: {object_text(mapped.index, mapped.subindex)}"
            yield SdoWrite(mapping, at, unsigned32(mapped.word), what)
        yield SdoWrite(mapping, 0, bytes((len(carried),)), "number of PDO entries")
        yield SdoWrite(assignment, 1, struct.pack("<H", mapping), f"assignment of {mapping:04X}h")
        yield SdoWrite(assignment, 0, b"\x01", "number of assigned PDOs")
