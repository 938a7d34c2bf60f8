"""A machine file's drives on CAN buses, looked at before anything is switched on: EDS files, places for the
configuration, watching.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from mcserver.can.pdo_layout import Mode
from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.coe import configure_coe
from mcserver.canopen.configuration import configuration_writes
from mcserver.canopen.description import describe
from mcserver.canopen.dictionary import Description, DeviceDictionary
from mcserver.canopen.listening import MASTER
from mcserver.canopen.profiles import CIA_402, device_text
from mcserver.canopen.sdo_write import DriveDictionary, SdoWrite
from mcserver.canopen.settings import DriveSettings, settings_of
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.errors import ConfigurationError, Diagnostic
from mcserver.machine.machine_file import Machine

# What a torque loop that is closed over a bus is as stiff as at 100 Hz [1/s²].
LEAST_STIFFNESS = 20.0
# Load by which softness is judged, such as friction [mm/s² or deg/s²].
LOAD = 100.0


def check_drives(machine: Machine) -> list[Diagnostic]:
    """List what does not fit CiA 402 drives (errors MC008, MC036, MC552) and what may not (MC022)."""
    found: list[Diagnostic] = []
    for drive in settings_of(machine):
        if drive.kind != "cia402":
            continue
        try:
            described = describe(drive)
            if drive.fieldbus == "ethercat":
                writes = configure_coe(drive, machine.cycle_s)[0]
            else:
                writes = configuration_writes(drive, machine.cycle_s, described.dictionary, MASTER)
        except ConfigurationError as error:
            found.append(Diagnostic(code=error.code, message=error.message, hint=error.hint, axis=drive.axis))
            continue
        found += _doubts(drive, described)
        found += _soft_loops(drive, machine)
        found += _doubtful_values(drive, described, writes)
    return found


def refuse_soft_loops(machine: Machine) -> None:
    """Refuse, before anything is switched on, a torque loop that cannot hold its axis within tolerance.

    Raises:
        ConfigurationError: MC552.
    """
    for drive in settings_of(machine):
        for found in _soft_loops(drive, machine) if drive.kind == "cia402" else ():
            if found.severity == "error":
                raise ConfigurationError(found.code, found.message, found.hint)


def _evidence(drive: DriveSettings, described: Description) -> list[Diagnostic]:
    """Say what the EDS leaves open, or says against the device being such a drive."""
    found = []
    known = DriveDictionary(drive, described.dictionary)
    device_type = known.device_type
    if device_type is None:
        what = "the EDS does not say what the device is (1000h gives no number)"
        found.append(_warning(drive, what, "is it the file of this drive? At boot-up the drive is asked"))
    elif device_type & 0xFFFF != CIA_402:
        what = f"the EDS is of {device_text(device_type)}, not of a drive (1000h = 0x{device_type:08X})"
        found.append(_warning(drive, what, "check `eds` and the node number: at boot-up it is refused"))
    if known.default(0x6502 + drive.offset) is None:
        what = f"the EDS does not say which modes the drive has ({object_text(0x6502 + drive.offset, 0)})"
        remedy = "`mcserver scan` asks the drive; at boot-up a mode that it does not have is refused (MC551)"
        found.append(_warning(drive, what, remedy))
    unread = [error.message for error in described.dictionary.unreadable.values()] + list(described.ignored)
    if unread:
        more = f", and {len(unread) - 1} more" if len(unread) > 1 else ""
        what = f"{drive.eds} has entries that cannot be read and are not used: {unread[0]}{more}"
        found.append(_warning(drive, what, "correct them, or ask the maker for a file that is sound"))
    return found


def _doubts(drive: DriveSettings, described: Description) -> list[Diagnostic]:
    doubts = [] if described.dictionary.generic else _evidence(drive, described)
    has_values = any(each.value is not None for each in described.dictionary.variables)
    if described.commissioned_node not in (None, drive.node) and has_values:
        doubts.append(
            _warning(
                drive,
                f"{drive.eds} was made for node {described.commissioned_node}",
                "take the DCF of this node, if its values are not those of every drive",
            )
        )
    if drive.fieldbus == "ethercat":
        return doubts + _coe_doubts(drive, described.dictionary)
    if described.dictionary.get_variable(0x1400, 5) is None:
        watched = described.dictionary.get_variable(0x1016, 1) is not None
        doubts.append(
            _warning(
                drive,
                "the EDS has no time-out of RPDO1 (1400h:05): the drive does not notice missing setpoints"
                + ("" if watched else ", nor (1016h) that the server is gone"),
                "see the drive's manual for another watch, and set it by sdo_writes",
            )
        )
    if drive.heartbeat_ms == 0 and described.dictionary.get_variable(0x1017, 0) is not None:
        doubts.append(
            _warning(
                drive,
                "heartbeat_ms = 0: a drive that is lost is noticed by its missing process data only",
                "leave heartbeat_ms out",
            )
        )
    return doubts


def _coe_doubts(drive: DriveSettings, dictionary: DeviceDictionary) -> list[Diagnostic]:
    doubts = []
    if drive.eds and dictionary.generic:
        what = f"{drive.eds} lists no objects of it: those of the standard are taken"
        doubts.append(_warning(drive, what, "limits and types are not known, and names are the standard's"))
    if drive.distributed_clocks and not dictionary.coe.sync0:
        what = f"{drive.eds} has no mode with SYNC0 alone: the drive acts when its frame comes"
        doubts.append(_warning(drive, what, "set distributed_clocks = false if no other drive has a clock"))
    return doubts


def _soft_loops(drive: DriveSettings, machine: Machine) -> list[Diagnostic]:
    """Say where a torque loop over the bus is too soft to hold a position.

    It is as stiff as its cycle is short: a load that takes the acceleration a holds the axis off by
    a / (velocity_gain / inertia · position_gain), which the integral takes away with its time constant.
    """
    axis = machine.axis(drive.axis)
    if drive.mode != Mode.CYCLIC_TORQUE or axis is None:
        return []
    gains = cia402_drive(axis)
    stiffness = gains.velocity_gain / gains.inertia * gains.position_gain
    error = LOAD / stiffness
    tolerance = axis.in_position / axis.type.si_per_unit
    # half a per cent: gains are written with few digits
    soft = stiffness < 0.995 * LEAST_STIFFNESS
    patience = machine.exact_stop_timeout
    integral = gains.integral_time_s or 0.0
    settling = integral * math.log(error / tolerance) if error > tolerance else 0.0
    never = error > tolerance and integral == 0.0
    what = (
        f"its torque loop is soft at {machine.cycle_hz:g} Hz: a load that takes {LOAD:g} {axis.type.unit}/s² "
        f"holds the axis {error:.3g} {axis.type.unit} off until the integral has it"
    )
    remedy = "a greater cycle_hz, 500 or more, or a mode whose loop is the drive's own"
    if error > tolerance and (soft or never or settling > patience):
        how_long = "for ever" if never else f"for {settling:.3g} s"
        what += f": out of its in_position of {tolerance:g} {axis.type.unit} {how_long}"
        return [Diagnostic(code="MC552", message=f"{drive.name}: {what}", hint=remedy, axis=drive.axis)]
    return [_warning(drive, what, remedy)] if soft else []


def _doubtful_values(
    drive: DriveSettings, described: Description, writes: Sequence[SdoWrite]
) -> list[Diagnostic]:
    """Say where the EDS has another value than the machine file, which the drive lets nobody change."""
    known = DriveDictionary(drive, described.dictionary)
    found = []
    for write in writes:
        said = known.default(write.index, write.subindex) if write.doubt else None
        if said is not None and said != int.from_bytes(write.payload, "little"):
            place = object_text(write.index, write.subindex)
            found.append(_warning(drive, f"{place} is {said} in the EDS", write.doubt))
    return found


def _warning(drive: DriveSettings, message: str, hint: str) -> Diagnostic:
    return Diagnostic(
        code="MC022", severity="warning", message=f"{drive.name}: {message}", hint=hint, axis=drive.axis
    )
