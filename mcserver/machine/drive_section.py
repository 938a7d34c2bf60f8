"""``[axis.drive]`` and ``[[bus]]`` of the machine file: what they say, and what fits together.

How counts of a drive on a CAN bus become travel is given in one of two ways: ``counts_per_motor_rev`` with
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
from mcserver.can.pdo import ProcessData
from mcserver.errors import ConfigurationError
from mcserver.machine.loop_gains import complete_loop
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.sections import (
    AxisSection,
    BusSection,
    CanDriveSection,
    DriveHomingSection,
    DriveSection,
)
from mcserver.machine.toml_positions import Path

CAN_KINDS = ("cia402", "servosila")
# Without commands for so long a drive acts by itself, unless the machine file says otherwise [ms, cycles].
COMMAND_TIMEOUT_MS = 100
COMMAND_TIMEOUT_CYCLES = 10
# The same of a drive whose torque comes from here: it goes on accelerating with the last one [ms].
TORQUE_TIMEOUT_MS = 20
# Codes of Servosila's commands that its public reference gives; the others come from the machine file.
SERVOSILA_CODES = MappingProxyType(
    {"reset": 0x01, "stop": 0x04, "speed": 0x20, "servo": 0x30, "reset_work_zone": 0xE0}
)
SERVOSILA_OWN_CODES = ("off", "rpm", "torque")
# What the public reference uses these codes for: a command of another meaning must not get one of them.
SERVOSILA_PUBLISHED = MappingProxyType(
    {
        0x01: "Reset",
        0x04: "Stop",
        0x20: "Electronic Speed Control (Hz)",
        0x30: "Servo",
        0x38: "Servo Stepper, an offset from the current position: streamed, it makes the axis run away",
        0x58: "Kickstart",
        0xA4: "PWM output",
        0xB0: "a load test",
        0xE0: "Reset Work Zone",
    }
)
# Two statements of the same travel agree within this share.
SAME = 1e-6
GREATEST_COUNT = 2.0**31
Refusal = Callable[[str, str, str], None]  # key, what, hint


class Drive(msgspec.Struct, frozen=True):
    """One drive with everything filled in that follows from other keys; positions in mm or deg.

    Attributes:
        encoder: increments per motor revolutions (608Fh). gear: motor per shaft revolutions (6091h).
        feed: travel [mm, deg] per shaft revolutions (6092h). invert: the motor turns against the axis.
        velocity_counts_per_motor_rev: what 60FFh and 606Ch show at one motor turn a second; 0: increments.
        rated_torque: 1000 ‰ of 6071h and 6077h, or 0 where torques are not used [N·m].
        position_gain: of the position loop that is closed here with mode = "csv" and "cst" [1/s].
        velocity_gain: of the torque loop, at the motor's shaft [N·m·s/rad]. inertia: at the motor's shaft
            [kg·m²]. max_torque: of the motor, 0: not limited [N·m].
        vendor_id, product_code: 1018h, 0: not checked. heartbeat_ms: of the drive's producer, 0: none.
        command_timeout_ms: without commands for this time the drive acts by itself (1400h:5).
        sdo_writes: [index, subindex, value] or [index, subindex, value, bytes], at boot-up.
        codes: of commands (servosila). pole_pairs: of the motor. telemetry_hz: 0: at every cycle.
        integral_time_s: of the same loop, 0: none. velocity_feed_forward: share of the setpoint's velocity.
        torque_feed_forward: the torque that the motion needs goes to the drive (60B2h, with "cst" 6071h).
        zero_offset: position where the encoder's count is 0 [mm, deg].
        pdo: "fixed" takes the drive's own mapping as it is. monitor: objects shown in telemetry.
        node_axis: which axis of its node, each 800h further. pdo_node: whose COB-IDs its PDOs have, 0: the
            node's own.
        stop_on, warn_on: patterns of error codes in emergency messages. lss: identity of a node that gets
            its number from here. process_data: as agreed with the drive at boot-up; None: the usual.
        eds: absolute path. The others: see `mcserver.machine.sections`.
    """

    kind: Literal["simulated", "ideal", "cia402", "servosila"] = "simulated"
    initial_position: float = 0.0
    bandwidth_hz: float = 40.0
    encoder_resolution: float = 0.0
    heartbeat_timeout_s: float = 0.1
    brake: bool = False
    friction_decel: float = 0.0
    inertia: float = 0.01
    max_torque: float = 0.0
    home_switch: tuple[float, float] | None = None
    index_at: float | None = None
    hard_stops: tuple[float, float] | None = None
    bus: str = ""
    node: int = 0
    eds: str = ""
    mode: Literal["csp", "csv", "cst", "pp", "ip"] = "csp"
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
    integral_time_s: float | None = None
    velocity_gain: float = 0.0
    velocity_feed_forward: float = 1.0
    torque_feed_forward: bool = False
    zero_offset: float = 0.0
    pdo: Literal["auto", "fixed"] = "auto"
    monitor: list[str] = []
    node_axis: int = 0
    pdo_node: int = 0
    stop_on: list[str] = []
    warn_on: list[str] = []
    sdo_timeout_ms: int = 300
    sdo_tries: int = 3
    sdo_store_timeout_s: float = 15.0
    lss: tuple[int, int, int, int] | None = None
    homing: DriveHomingSection | None = None
    process_data: ProcessData | None = None

    @property
    def torque_offset(self) -> bool:
        """Return True if torques go to the drive beside its targets, in 60B2h."""
        return self.torque_feed_forward and self.mode != "cst"


class CanBusConfig(msgspec.Struct, frozen=True):
    """One CAN bus.

    Attributes:
        name: as drives name it. address: see `mcserver.can.address`. bitrate: [bit/s].
        silence_cycles: so many cycles without an answer are a fault of the drive.
        sync: who sends SYNC; "foreign": another one on the bus. listen_ms: for another master, before
            anything is sent [ms]. appear_timeout_s: of a node, from its first reset on.
    """

    name: str
    address: str
    bitrate: int = 1_000_000
    silence_cycles: int = 3
    sync: Literal["own", "foreign"] = "own"
    listen_ms: int = 250
    appear_timeout_s: float = 10.0


def read_buses(
    sections: Iterable[BusSection | None], drives: Iterable[tuple[Path, int, Drive]], mistakes: Mistakes
) -> list[CanBusConfig]:
    """Return the buses of ``[[bus]]``, and those that drives name by their addresses.

    Args:
        sections: None where one has a mistake of its own.
        drives: path of the section, number of the axis, drive.
    """
    buses: dict[str, CanBusConfig] = {}
    names: dict[str, str] = {}  # by address

    def add(bus: CanBusConfig, path: Path, who: str) -> None:
        try:
            address = str(parse_address(bus.address))
        except ConfigurationError as error:
            mistakes.add(path, f"{who}{error.message}", error.hint, error.code)
            return
        if address in names:
            mistakes.add(path, f"{bus.address!r} is the address of bus {names[address]!r}", "use its name")
        names.setdefault(address, bus.name)
        buses[bus.name] = bus

    for position, section in enumerate(sections):
        if section is None:
            continue
        if section.name in buses:
            mistakes.add(("bus", position, "name"), f"{section.name!r} is there twice", "name each bus once")
            continue
        address = section.address or section.name
        bus = CanBusConfig(
            section.name,
            address,
            section.bitrate,
            section.silence_cycles,
            section.sync,
            section.listen_ms,
            section.appear_timeout_s,
        )
        add(bus, ("bus", position, "address"), "")
    owners: dict[tuple[str, int, int], int] = {}
    for path, axis, drive in drives:
        if drive.kind not in CAN_KINDS or not drive.bus:
            continue
        if drive.bus not in buses:
            add(CanBusConfig(drive.bus, drive.bus), (*path, "bus"), f"node {drive.node}: ")
        owner = owners.setdefault((drive.bus, drive.node, drive.node_axis), axis)
        if owner != axis and drive.node:
            mistakes.add(
                (*path, "node"),
                f"axes {owner} and {axis} both have node {drive.node} on bus {drive.bus}",
                "give each drive of a bus a node number of its own, or node_axis where it has several axes",
            )
    nodes = {(bus, node) for bus, node, _ in owners}
    borrowed: dict[tuple[str, int], int] = {}
    for path, axis, drive in drives:
        key = (drive.bus, drive.pdo_node)
        if not drive.pdo_node or drive.pdo_node == drive.node:
            continue
        other = borrowed.setdefault(key, axis)
        if key in nodes or other != axis:
            mistakes.add(
                (*path, "pdo_node"),
                f"the COB-IDs of node {drive.pdo_node} on bus {drive.bus} are in use",
                "give the number of no node and of no other pdo_node",
            )
    return list(buses.values())


def complete_drive(
    section: DriveSection, axis: AxisSection, cycle_s: float, path: Path, mistakes: Mistakes
) -> tuple[Drive, float | None]:
    """Fill in what follows from other keys, and refuse what does not fit together.

    Args:
        path: of the section.

    Returns:
        The drive, and ``units_per_motor_rev`` of the axis [mm, deg] as it follows from the section.
    """
    drive = msgspec.convert(msgspec.to_builtins(section), Drive)
    per_turn = axis.units_per_motor_rev
    if not isinstance(section, CanDriveSection):
        return drive, per_turn

    def bad(key: str, what: str, hint: str) -> None:
        mistakes.add((*path, key), what, hint)

    if not drive.bus:
        bad("bus", f"a {drive.kind} drive needs a bus", 'give bus = "can0", or a [[bus]] name')
    if not drive.node:
        bad("node", "is missing", "give the drive's node number")
    for write in drive.sdo_writes:
        fits = len(write) in (3, 4) and 0 < write[0] <= 0xFFFF and 0 <= write[1] <= 0xFF
        if not fits or (len(write) == 4 and write[3] not in (1, 2, 4, 8)):
            bad(
                "sdo_writes",
                f"{write} is no write",
                "give [index, subindex, value], or [index, subindex, value, bytes] with 1, 2, 4 or 8 bytes",
            )
    if drive.mode == "pp" and drive.torque_feed_forward:
        bad(
            "torque_feed_forward",
            'with mode = "pp" the drive makes the motion, and the torque is not known here',
            "leave it out",
        )
    if drive.torque_feed_forward and drive.rated_torque <= 0.0:
        bad(
            "torque_feed_forward",
            "60B2h counts thousandths of the rated torque, which is not there",
            "give rated_torque = the motor's rated torque in N·m (6076h)",
        )
    if drive.node_axis and not drive.pdo_node:
        bad(
            "pdo_node",
            f"axis {drive.node_axis} of a node needs COB-IDs of its own",
            "give pdo_node = a node number that nobody on the bus has: its PDOs get that node's COB-IDs",
        )
    drive = complete_loop(drive, axis, cycle_s, bad)
    usual_timeout = TORQUE_TIMEOUT_MS if drive.mode == "cst" else COMMAND_TIMEOUT_MS
    timeout = drive.command_timeout_ms or max(
        usual_timeout, math.ceil(COMMAND_TIMEOUT_CYCLES * cycle_s * 1e3 - 1e-9)
    )
    if timeout < 3.0 * cycle_s * 1e3:
        bad("command_timeout_ms", f"{timeout} is below three cycles", "10 cycles are usual")
    codes = drive.codes
    if drive.kind == "servosila":
        _check_codes(drive, bad)
        codes = {**SERVOSILA_CODES, **drive.codes}
    completed = msgspec.structs.replace(drive, command_timeout_ms=timeout, codes=codes)
    travel = _travel(drive, axis, bad)
    if travel is None:
        return completed, per_turn
    encoder, gear, feed, per_turn = travel
    _check_counts(encoder, per_turn, drive, axis, bad)
    return msgspec.structs.replace(completed, encoder=encoder, gear=gear, feed=feed), per_turn


def _check_counts(
    encoder: tuple[int, int], per_turn: float, drive: Drive, axis: AxisSection, bad: Refusal
) -> None:
    """Refuse a limited axis whose travel does not fit 32 bits of a drive's counts."""
    low, high = axis.min_position, axis.max_position
    if drive.kind != "cia402" or low is None or high is None:
        return
    furthest = max(abs(low), abs(high)) * encoder[0] / encoder[1] / per_turn
    if furthest >= GREATEST_COUNT:
        bad(
            "counts_per_motor_rev",
            f"an end of the axis's travel is at {furthest:.3g} counts, beyond 32 bits",
            "check counts_per_motor_rev and units_per_motor_rev",
        )


def _travel(
    drive: Drive, axis: AxisSection, bad: Refusal
) -> tuple[tuple[int, int], tuple[int, int], tuple[float, float], float] | None:
    """Return encoder, gear, feed, and the travel of a motor turn [mm, deg]; None after a mistake."""
    if drive.encoder is not None and drive.counts_per_motor_rev:
        bad("encoder", "contradicts counts_per_motor_rev, which is there too", "give one of them")
        return None
    if drive.encoder is None and not drive.counts_per_motor_rev:
        bad(
            "counts_per_motor_rev",
            "it is not said what a count of the drive is",
            "give counts_per_motor_rev, or encoder = [increments, motor revolutions] (608Fh)",
        )
        return None
    encoder = drive.encoder or (drive.counts_per_motor_rev, 1)
    gear = drive.gear or (1, 1)
    per_turn = axis.units_per_motor_rev
    feed = drive.feed
    if feed is None:
        if per_turn is not None:
            feed = (per_turn * gear[0] / gear[1], 1.0)
        elif axis.type == "rotary":
            feed = (360.0, 1.0)
        else:
            bad(
                "feed",
                "it is not said how far a turn of the motor goes",
                "give units_per_motor_rev of the axis, or feed = [mm, shaft revolutions] (6092h)",
            )
            return None
    by_feed = feed[0] / feed[1] * gear[1] / gear[0]
    if per_turn is not None and abs(per_turn - by_feed) > SAME * by_feed:
        bad(
            "feed",
            f"gear and feed say {by_feed:g} for a turn of the motor, units_per_motor_rev says {per_turn:g}",
            "leave one of them out",
        )
        return None
    return encoder, gear, feed, by_feed if per_turn is None else per_turn


def _check_codes(drive: Drive, bad: Refusal) -> None:
    known = (*SERVOSILA_CODES, *SERVOSILA_OWN_CODES)
    for name, code in drive.codes.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"known codes: {', '.join(known)}"
            bad("codes", f"there is no command {name!r}", hint)
        elif not 0 <= code <= 0xFF:
            bad("codes", f"{name} = {code} is outside 0 … 255", "see the drive's reference")
        elif code in SERVOSILA_PUBLISHED and SERVOSILA_CODES.get(name) != code:
            bad(
                "codes",
                f"{name} = 0x{code:02X}: {code:02X}h is {SERVOSILA_PUBLISHED[code]}",
                f"take the code of {name} from the drive's reference"
                + (", or leave the key out" if name in SERVOSILA_CODES else ""),
            )
    by_code: dict[int, str] = {}
    for name, code in {**SERVOSILA_CODES, **drive.codes}.items():
        if code in by_code:
            bad("codes", f"{code:02X}h is the code of {name} and of {by_code[code]}", "give each its own")
        by_code[code] = name
    if "off" not in drive.codes and not any(name not in known for name in drive.codes):
        bad(
            "codes",
            "the code of Off is missing: the drive could not be de-energized",
            "give codes = { off = … } from the drive's reference",
        )
