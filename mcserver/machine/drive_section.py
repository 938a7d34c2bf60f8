"""``[axis.drive]`` and ``[[bus]]`` of the machine file: what they say, and what fits together.

A drive on a CAN bus is told how its counts become travel in one of two ways: ``counts_per_motor_rev`` with
the axis's ``units_per_motor_rev``, or ``encoder``, ``gear`` and ``feed``, the objects 608Fh, 6091h and 6092h
of CiA 402. Either way the section comes out with all three filled in.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable
from types import MappingProxyType
from typing import Literal

import msgspec

from mcserver.can.address import parse_address
from mcserver.can.cob import GREATEST_NODE, LEAST_NODE
from mcserver.errors import ConfigurationError
from mcserver.units import AxisType

CAN_KINDS = ("cia402", "servosila")
# Without commands for so long a drive acts by itself, unless the machine file says otherwise [ms, cycles].
COMMAND_TIMEOUT_MS = 100
COMMAND_TIMEOUT_CYCLES = 10
# Codes of Servosila's commands that its public reference gives; the others come from the machine file.
SERVOSILA_CODES = MappingProxyType(
    {"reset": 0x01, "stop": 0x04, "speed": 0x20, "servo": 0x30, "reset_work_zone": 0xE0}
)
SERVOSILA_OWN_CODES = ("off", "rpm", "torque")
# Two statements of the same travel agree within this share.
SAME = 1e-6
GREATEST_COUNT = 2.0**31
# A loop over a bus, two cycles late, is stable and calm up to this product of gain and cycle time [1].
GREATEST_GAIN = 0.2
USUAL_GAIN = 0.1

Refusal = Callable[[str, str, str], ConfigurationError]


class DriveFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """``[axis.drive]`` as written: positions in mm or deg.

    In a `Machine` the keys of drives on a bus are filled in: ``encoder``, ``gear``, ``feed``,
    ``command_timeout_ms``, ``codes``, ``position_gain``; ``eds`` is an absolute path.

    Attributes:
        encoder: increments per motor revolutions (608Fh). gear: motor per shaft revolutions (6091h).
        feed: travel [mm, deg] per shaft revolutions (6092h). invert: the motor turns against the axis.
        velocity_counts_per_motor_rev: what 60FFh and 606Ch show at one motor turn a second; 0: increments.
        rated_torque: 1000 ‰ of 6071h and 6077h, or 0 where torques are not used [N·m].
        position_gain: of the position loop that is closed here with mode = "csv" [1/s].
        vendor_id, product_code: 1018h, 0: not checked. heartbeat_ms: of the drive's producer, 0: none.
        command_timeout_ms: without commands for this time the drive acts by itself (1400h:5).
        sdo_writes: [index, subindex, value] or [index, subindex, value, bytes], at boot-up.
        codes: of commands (servosila). pole_pairs: of the motor. telemetry_hz: 0: at every cycle.
    """

    kind: Literal["simulated", "ideal", "cia402", "servosila"] = "simulated"
    initial_position: float = 0.0
    # simulated drives
    bandwidth_hz: float = 40.0
    encoder_resolution: float = 0.0
    heartbeat_timeout_s: float = 0.1
    brake: bool = False
    friction_decel: float = 0.0
    inertia: float = 0.01
    max_torque: float = 0.0
    # drives on a CAN bus
    bus: str = ""
    node: int = 0
    eds: str = ""
    mode: Literal["csp", "csv", "cst", "pp"] = "csp"
    counts_per_motor_rev: int = 0
    encoder: tuple[int, int] | None = None
    gear: tuple[int, int] | None = None
    feed: tuple[float, float] | None = None
    invert: bool = False
    velocity_counts_per_motor_rev: float = 0.0
    rated_torque: float = 0.0
    position_gain: float = 0.0
    vendor_id: int = 0
    product_code: int = 0
    heartbeat_ms: int = 100
    command_timeout_ms: int = 0
    sdo_writes: list[list[int]] = []
    codes: dict[str, int] = {}
    pole_pairs: int = 0
    telemetry_hz: float = 0.0


class BusFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """``[[bus]]`` as written; without an address the name is one."""

    name: str
    address: str = ""
    bitrate: int = 1_000_000
    silence_cycles: int = 3


class CanBusConfig(msgspec.Struct, frozen=True):
    """One CAN bus.

    Attributes:
        name: as drives name it. address: see `mcserver.can.address`. bitrate: [bit/s].
        silence_cycles: so many cycles without an answer are a fault of the drive.
    """

    name: str
    address: str
    bitrate: int = 1_000_000
    silence_cycles: int = 3


def read_buses(sections: Iterable[BusFile], drives: Iterable[DriveFile], bad: Refusal) -> list[CanBusConfig]:
    """The buses of ``[[bus]]``, and those that drives name by their addresses."""
    buses: dict[str, CanBusConfig] = {}
    for position, section in enumerate(sections):
        where = f"bus[{position}]"
        if not section.name or section.name in buses:
            raise bad(f"{where}.name", f"{section.name!r} is empty or there twice", "name each bus once")
        if not 10_000 <= section.bitrate <= 1_000_000:
            raise bad(
                f"{where}.bitrate",
                f"{section.bitrate} is outside 10000 … 1000000 bit/s",
                "1000000 is usual; classic CAN has no more",
            )
        if not 1 <= section.silence_cycles <= 1000:
            raise bad(
                f"{where}.silence_cycles", f"{section.silence_cycles} is outside 1 … 1000", "3 is usual"
            )
        address = section.address or section.name
        _check_address(address, f"{where}.address")
        buses[section.name] = CanBusConfig(section.name, address, section.bitrate, section.silence_cycles)
    known = {str(parse_address(bus.address)) for bus in buses.values()}
    if len(known) < len(buses):
        raise bad("bus", "two buses have the same address", "join their sections")
    for drive in drives:
        if drive.kind in CAN_KINDS and drive.bus and drive.bus not in buses:
            _check_address(drive.bus, f"a drive's bus (node {drive.node})")
            address = str(parse_address(drive.bus))
            if address in known:
                raise bad(
                    "axis.drive.bus", f"{drive.bus!r} is the address of another bus here", "use its name"
                )
            known.add(address)
            buses[drive.bus] = CanBusConfig(drive.bus, drive.bus)
    return list(buses.values())


def _check_address(address: str, where: str) -> None:
    try:
        parse_address(address)
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"{where}: {error.message}", error.hint) from error


def complete_drive(
    drive: DriveFile, axis_type: AxisType, per_turn: float | None, cycle_s: float, where: str, bad: Refusal
) -> tuple[DriveFile, float | None]:
    """A drive's section with everything filled in that follows from other keys.

    Args:
        per_turn: ``units_per_motor_rev`` of the axis [mm, deg], None where it is not given.
        where: path of the section.

    Returns:
        The section, and ``units_per_motor_rev`` as it follows from the section.
    """
    if drive.kind not in CAN_KINDS:
        return drive, per_turn
    if not drive.bus:
        raise bad(f"{where}.bus", f"a {drive.kind} drive needs a bus", 'give bus = "can0", or a [[bus]] name')
    if not LEAST_NODE <= drive.node <= GREATEST_NODE:
        raise bad(
            f"{where}.node",
            f"{drive.node} is outside {LEAST_NODE} … {GREATEST_NODE}",
            "give the drive's node number",
        )
    _check_numbers(drive, where, bad)
    encoder, gear, feed, per_turn = _travel(drive, axis_type, per_turn, where, bad)
    gain = drive.position_gain or min(20.0, USUAL_GAIN / cycle_s)
    if drive.kind == "cia402":
        _check_mode(drive, gain, cycle_s, where, bad)
    timeout = drive.command_timeout_ms or max(
        COMMAND_TIMEOUT_MS, math.ceil(COMMAND_TIMEOUT_CYCLES * cycle_s * 1e3 - 1e-9)
    )
    if timeout < 3.0 * cycle_s * 1e3:
        raise bad(f"{where}.command_timeout_ms", f"{timeout} is below three cycles", "10 cycles are usual")
    codes = drive.codes
    if drive.kind == "servosila":
        codes = _codes(drive, where, bad)
    elif codes:
        raise bad(f"{where}.codes", "a cia402 drive has no codes", 'they belong to kind = "servosila"')
    completed = msgspec.structs.replace(
        drive,
        encoder=encoder,
        gear=gear,
        feed=feed,
        position_gain=gain,
        command_timeout_ms=timeout,
        codes=codes,
    )
    return completed, per_turn


def check_travel(
    drive: DriveFile,
    per_turn: float | None,
    travel: tuple[float | None, float | None],
    where: str,
    bad: Refusal,
) -> None:
    """Refuses a limited axis whose travel does not fit 32 bits of a drive's counts.

    Args:
        travel: the two ends [mm, deg], None where not limited.
    """
    low, high = travel
    if drive.kind != "cia402" or drive.encoder is None or per_turn is None or low is None or high is None:
        return
    counts = drive.encoder[0] / drive.encoder[1] / per_turn
    furthest = max(abs(low), abs(high)) * counts
    if furthest >= GREATEST_COUNT:
        raise bad(
            f"{where}.counts_per_motor_rev",
            f"an end of the axis's travel is at {furthest:.3g} counts, beyond 32 bits",
            "check counts_per_motor_rev and units_per_motor_rev",
        )


def _check_numbers(drive: DriveFile, where: str, bad: Refusal) -> None:
    for name in ("rated_torque", "position_gain", "velocity_counts_per_motor_rev", "telemetry_hz"):
        value = getattr(drive, name)
        if not (math.isfinite(value) and value >= 0.0):
            raise bad(f"{where}.{name}", f"{value} is not 0 or more", "leave the key out if it is not known")
    for name in ("heartbeat_ms", "command_timeout_ms"):
        value = getattr(drive, name)
        if not 0 <= value <= 0xFFFF:
            raise bad(f"{where}.{name}", f"{value} is outside 0 … 65535 ms", "100 is usual")
    for name in ("vendor_id", "product_code"):
        if not 0 <= getattr(drive, name) <= 0xFFFFFFFF:
            raise bad(f"{where}.{name}", "is no 32-bit number", "see 1018h of the drive")
    if not 0 <= drive.pole_pairs <= 1000:
        raise bad(f"{where}.pole_pairs", f"{drive.pole_pairs} is outside 0 … 1000", "see the motor's data")
    for write in drive.sdo_writes:
        fits = len(write) in (3, 4) and 0 < write[0] <= 0xFFFF and 0 <= write[1] <= 0xFF
        if not fits or (len(write) == 4 and write[3] not in (1, 2, 4, 8)):
            raise bad(
                f"{where}.sdo_writes",
                f"{write} is no write",
                "give [index, subindex, value], or [index, subindex, value, bytes] with 1, 2, 4 or 8 bytes",
            )


def _check_mode(drive: DriveFile, gain: float, cycle_s: float, where: str, bad: Refusal) -> None:
    if drive.mode in ("cst", "pp"):
        raise bad(
            f"{where}.mode",
            f'mode = "{drive.mode}" cannot follow a path',
            'use "csp" (or "csv"): G1030 and G1040 change to velocity and torque mode by themselves',
        )
    if drive.mode == "csv" and gain * cycle_s > GREATEST_GAIN:
        raise bad(
            f"{where}.position_gain",
            f"{gain:g} /s with a cycle of {cycle_s * 1e3:g} ms is not stable over a bus",
            f"give {GREATEST_GAIN / cycle_s:g} or less, or a greater cycle_hz",
        )


def _travel(
    drive: DriveFile, axis_type: AxisType, per_turn: float | None, where: str, bad: Refusal
) -> tuple[tuple[int, int], tuple[int, int], tuple[float, float], float]:
    """Encoder, gear, feed, and the travel of a motor turn [mm, deg]."""
    if drive.encoder is not None and drive.counts_per_motor_rev:
        raise bad(
            f"{where}.encoder", "contradicts counts_per_motor_rev, which is there too", "give one of them"
        )
    if drive.encoder is None and drive.counts_per_motor_rev <= 0:
        raise bad(
            f"{where}.counts_per_motor_rev",
            "it is not said what a count of the drive is",
            "give counts_per_motor_rev, or encoder = [increments, motor revolutions] (608Fh)",
        )
    encoder = drive.encoder or (drive.counts_per_motor_rev, 1)
    gear = drive.gear or (1, 1)
    for name, pair in (("encoder", encoder), ("gear", gear), ("feed", drive.feed or (1.0, 1.0))):
        if not all(0 < value <= 0xFFFFFFFF for value in pair):
            raise bad(f"{where}.{name}", f"{list(pair)} are not two numbers above 0", 'turn with "invert"')
    feed = drive.feed
    if feed is None:
        if per_turn is not None:
            feed = (per_turn * gear[0] / gear[1], 1.0)
        elif axis_type is AxisType.ROTARY:
            feed = (360.0, 1.0)
        else:
            raise bad(
                f"{where}.feed",
                "it is not said how far a turn of the motor goes",
                "give units_per_motor_rev of the axis, or feed = [mm, shaft revolutions] (6092h)",
            )
    told = feed[0] / feed[1] * gear[1] / gear[0]
    if per_turn is not None and abs(per_turn - told) > SAME * told:
        raise bad(
            f"{where}.feed",
            f"gear and feed say {told:g} for a turn of the motor, units_per_motor_rev says {per_turn:g}",
            "leave one of them out",
        )
    return encoder, gear, feed, told if per_turn is None else per_turn


def _codes(drive: DriveFile, where: str, bad: Refusal) -> dict[str, int]:
    known = (*SERVOSILA_CODES, *SERVOSILA_OWN_CODES)
    for name, code in drive.codes.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"known codes: {', '.join(known)}"
            raise bad(f"{where}.codes", f"there is no command {name!r}", hint)
        if not 0 <= code <= 0xFF:
            raise bad(f"{where}.codes.{name}", f"{code} is outside 0 … 255", "see the drive's reference")
    if "off" not in drive.codes:
        raise bad(
            f"{where}.codes",
            "the code of Off is missing: the drive could not be de-energized",
            "give codes = { off = … } from the drive's reference",
        )
    return {**SERVOSILA_CODES, **drive.codes}
