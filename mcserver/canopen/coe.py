"""What is written into a CiA 402 drive on EtherCAT (CoE), and the process data that it exchanges.

All outputs of an axis are in one PDO (1600h) and all inputs in another one (1A00h), assigned by 1C12h and
1C13h (ETG.1000.6, 5.6.7.4), or in the fewest fixed ones that a drive has: every frame takes every output
along, so that a controlword may stand in one place alone. 603Fh, the error code, comes with the inputs in the
place of an emergency message.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from mcserver.can import pdo_layout as usual
from mcserver.can.cob import Function
from mcserver.can.pdo import MappedObject, MappedPdo, ProcessData
from mcserver.can.pdo_layout import Mode
from mcserver.canopen import process_data as pdo
from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.configuration import application_writes
from mcserver.canopen.description import dictionary_of
from mcserver.canopen.dictionary import FixedPdo
from mcserver.canopen.process_data import PlannedProcessData
from mcserver.canopen.sdo_write import DriveDictionary, SdoWrite, unsigned32
from mcserver.canopen.settings import DriveSettings, settings_of, with_process_data
from mcserver.errors import ConfigurationError
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
    coe = known.objects.coe
    outputs = _Pdos(coe.outputs, OUTPUTS, OUTPUT_ASSIGNMENT, coe.fixed_outputs, pdo.NEUTRAL)
    inputs = _Pdos(coe.inputs, INPUTS, INPUT_ASSIGNMENT, coe.fixed_inputs)
    sent, mapping = _arranged(known, outputs, _wanted_outputs(drive))
    received, more = _arranged(known, inputs, _wanted_inputs(drive))
    data = ProcessData(
        (MappedPdo(1, Function.RPDO1 + drive.node, sent, 1),),
        (MappedPdo(1, Function.TPDO1 + drive.node, received, 1),),
    )
    mapping += more
    writes = [*mapping, *application_writes(drive, cycle_s, known)]
    if drive.distributed_clocks and known.objects.coe.sync0:
        payload = struct.pack("<H", AT_SYNC0)
        writes.append(SdoWrite(SYNC_TYPE, 1, payload, "synchronization by SYNC0", optional=True))
    return writes, PlannedProcessData(data, tuple(mapping), {})


def agreed_on_ethercat(machine: Machine) -> Machine:
    """Return the machine with the process data of its drives on EtherCAT, for the cycle.

    Raises:
        ConfigurationError: as `configure_coe`.
    """
    drives = [drive for drive in settings_of(machine) if drive.fieldbus == "ethercat"]
    data = {drive.axis: configure_coe(drive, machine.cycle_s)[1].process_data for drive in drives}
    return with_process_data(machine, data)


# An object, and whether the drive is of no use without it.
_Wanted = list[tuple[MappedObject, bool]]


def _wanted_outputs(drive: DriveSettings) -> _Wanted:
    target = pdo.TARGETS[Mode(drive.mode)]
    wanted = [(usual.CONTROLWORD, True), (usual.MODE, False), (target, True)]
    if drive.mode == Mode.PROFILE_POSITION:
        wanted.append((pdo.PROFILE_VELOCITY, False))
    else:
        wanted += [(usual.TARGET_POSITION, False), (usual.TARGET_VELOCITY, False)]
        wanted += [(usual.TARGET_TORQUE, False)] if drive.torque else []
    wanted += [(pdo.TORQUE_OFFSET, True)] if drive.torque_offset else []
    return wanted + ([(pdo.DIGITAL_OUTPUTS, True)] if drive.outputs else [])


def _wanted_inputs(drive: DriveSettings) -> _Wanted:
    wanted = [
        (usual.STATUSWORD, True),
        (usual.MODE_DISPLAY, False),
        (usual.POSITION_ACTUAL, True),
        (ERROR_CODE, False),
    ]
    wanted += [(usual.TORQUE_ACTUAL, False)] if drive.torque else []
    return wanted + ([(pdo.DIGITAL_INPUTS, True)] if drive.inputs else [])


@dataclass(frozen=True)
class _Pdos:
    """Outputs or inputs.

    Attributes:
        mapping: the PDO that is mapped, None: all are fixed; usual: the standard's. assignment: 1C12h, 1C13h.
        fixed: the fixed ones. neutral: objects that may stand in these besides; None: all.
    """

    mapping: int | None
    usual: int
    assignment: int
    fixed: tuple[FixedPdo, ...]
    neutral: Collection[int] | None = None


def _arranged(
    known: DriveDictionary, pdos: _Pdos, wanted: _Wanted
) -> tuple[tuple[MappedObject, ...], list[SdoWrite]]:
    """Objects that are exchanged one way, mapped or of fixed PDOs, and the writes for it."""
    mapping = pdos.mapping
    if known.has(pdos.assignment) and not known.writable(pdos.assignment):
        raise _all_fixed(known, pdos.assignment)
    if mapping is not None and (known.writable(mapping) or not known.has(mapping)):
        carried = tuple(_mapped(known, wanted))
        # a PDO is not mapped while it is assigned
        none, *assigned = _assignment_writes(pdos.assignment, [mapping])
        return carried, [none, *_mapping_writes(mapping, carried), *assigned]
    if not pdos.fixed:
        raise _all_fixed(known, mapping or pdos.usual)
    chosen = _cover(known, pdos, wanted)
    carried = tuple(each for taken in chosen for each in taken.objects)
    return carried, _assignment_writes(pdos.assignment, [taken.index for taken in chosen])


def _cover(known: DriveDictionary, pdos: _Pdos, wanted: _Wanted) -> list[FixedPdo]:
    """Fixed PDOs that carry what is needed, none of it twice; an output without a value is never sent."""
    asked = {each for each, _ in wanted}
    chosen: list[FixedPdo] = []
    carried: set[MappedObject] = set()

    def fits(taken: FixedPdo) -> bool:
        indices = {taken.index for taken in chosen}
        own = {each for each in taken.objects if each.index}
        known_all = pdos.neutral is None or all(each in asked or each.index in pdos.neutral for each in own)
        clash = taken.excludes & indices or any(taken.index in each.excludes for each in chosen)
        return known_all and not clash and not own & carried

    for each, needed in wanted:
        if each in carried:
            continue
        found = [taken for taken in pdos.fixed if each in taken.objects and fits(taken)]
        if found:
            best = max(found, key=lambda taken: len(asked.intersection(taken.objects)))
            chosen.append(best)
            carried.update(best.objects)
        elif needed:
            raise known.no_place(
                each.index,
                each.subindex,
                "the drive's PDOs are fixed, and none carries it beside what this server has values for",
                "another mode may need another object; if the file is wrong, leave `eds` out",
            )
    return chosen


def _all_fixed(known: DriveDictionary, index: int) -> ConfigurationError:
    return known.no_place(
        index,
        0,
        "the file says that it is fixed: the process data of an axis cannot be arranged",
        "such a drive cannot be used; if the file is wrong, leave `eds` out: the drive is asked",
    )


def _mapped(known: DriveDictionary, wanted: _Wanted) -> Iterator[MappedObject]:
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


def _mapping_writes(mapping: int, carried: tuple[MappedObject, ...]) -> list[SdoWrite]:
    entries = [
        SdoWrite(
            mapping, at, unsigned32(each.word), f"PDO entry {at}: {object_text(each.index, each.subindex)}"
        )
        for at, each in enumerate(carried, 1)
    ]
    count = SdoWrite(mapping, 0, bytes((len(carried),)), "number of PDO entries")
    return [SdoWrite(mapping, 0, b"\x00", "PDO without entries"), *entries, count]


def _assignment_writes(assignment: int, assigned: list[int]) -> list[SdoWrite]:
    entries = [
        SdoWrite(assignment, at, struct.pack("<H", index), f"assignment of {index:04X}h")
        for at, index in enumerate(assigned, 1)
    ]
    count = SdoWrite(assignment, 0, bytes((len(assigned),)), "number of assigned PDOs")
    return [SdoWrite(assignment, 0, b"\x00", "assignment of no PDO"), *entries, count]
