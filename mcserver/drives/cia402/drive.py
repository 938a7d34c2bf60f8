"""``[axis.drive]`` with kind = "cia402": its keys, what follows from them, and its share of a bus."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

import msgspec
from msgspec import Meta

from mcserver.can.cob import GREATEST_NODE
from mcserver.can.pdo import ProcessData
from mcserver.can.pdo_layout import RPDO1, RPDO2, SLOW_SYNCS, TPDO1, TPDO2, Mode
from mcserver.drives.bus import DriveMode
from mcserver.drives.cia402.loop_gains import DELAY_CYCLES, ETHERCAT_DELAY_CYCLES, complete_loop
from mcserver.machine.bus_load import Share, frame_bits
from mcserver.machine.constraints import Milliseconds, NotNegative, Positive, Unsigned32
from mcserver.machine.drive import COMMAND_TIMEOUT_MS, CanDrive, Refusal

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.sections import AxisSection

# What drives on EtherCAT are run in.
_ETHERCAT_MODES = ("csp", "csv", "cst", "pp")
# The mode of operation of each name of ``mode``.
BASE_MODES = {
    "csp": Mode.CYCLIC_POSITION,
    "csv": Mode.CYCLIC_VELOCITY,
    "ip": Mode.INTERPOLATED_POSITION,
    "pp": Mode.PROFILE_POSITION,
    "cst": Mode.CYCLIC_TORQUE,
}
# Without commands for so long a drive whose torque comes from here acts by itself: it goes on accelerating
# with the last one [ms].
TORQUE_TIMEOUT_MS = 20
GREATEST_COUNT = 2.0**31
_LSS = "vendor, product code, revision and serial number of 1018h"
_ERROR_CODE = "(0x|0X)?[0-9A-Fa-fxX?*]{4}h?"
ErrorCode = Annotated[
    str, Meta(pattern=f"^{_ERROR_CODE}$", description="four hexadecimal digits, x for any: '8611', '81xx'")
]
MonitoredObject = Annotated[
    str,
    Meta(
        pattern=r"^[0-9A-Fa-f]{4}h?(:[0-9A-Fa-f]{1,2})?( .{1,40})?$",
        description="index, subindex and a name: '6079h:00 DC link voltage'",
    ),
]
MonitoredObjects = Annotated[list[MonitoredObject], Meta(max_length=8, description="8 objects at most")]


class DriveHomingSection(msgspec.Struct, frozen=True):
    """``[axis.drive.homing]``: how the drive homes itself (CiA 402, mode 6).

    Attributes:
        method: 6098h. speed_switch, speed_zero: 6099h:01, :02 [mm/s, deg/s].
        acceleration: 609Ah [mm/s², deg/s²]. position: the axis is here at the home position [mm, deg].
        timeout_s: longer than this it has failed.
    """

    method: Annotated[int, Meta(ge=-128, le=127, description="6098h, as the drive's manual numbers them")]
    speed_switch: Positive = 10.0
    speed_zero: Positive = 2.0
    acceleration: Positive = 100.0
    position: float = 0.0
    timeout_s: Positive = 60.0


class Cia402Drive(CanDrive, frozen=True, tag="cia402"):
    """A CiA 402 drive.

    Attributes:
        eds: absolute path.
        position_gain: of the position loop that is closed here with mode = "csv" and "cst" [1/s].
        integral_time_s: of the same loop, 0: none; in the file None: what is usual with the mode.
        velocity_gain: of the torque loop, at the motor's shaft [N·m·s/rad]; 0 in the file: from `inertia`.
        velocity_feed_forward: share of the setpoint's velocity.
        torque_feed_forward: the torque that the motion needs goes to the drive (60B2h, with "cst" 6071h).
        zero_offset: position where the encoder's count is 0 [mm, deg].
        pdo: "fixed" takes the drive's own mapping as it is. monitor: objects shown in telemetry.
        node_axis: which axis of its node, each 800h further. pdo_node: whose COB-IDs its PDOs have, 0: the
            node's own.
        position: on EtherCAT, in the order of the wiring.
        stop_on, warn_on: patterns of error codes in emergency messages. lss: identity of a node that gets
            its number from here.
        vendor_id, product_code: 1018h, 0: not checked. heartbeat_ms: of the drive's producer, 0: none.
        sdo_writes: [index, subindex, value] or [index, subindex, value, bytes], at boot-up.
        process_data: as agreed with the drive at boot-up; None: the usual.
    """

    agreed: ClassVar[frozenset[str]] = frozenset({"process_data"})
    has_switches: ClassVar[bool] = True
    has_pins: ClassVar[bool] = True
    synchronous: ClassVar[bool] = True
    eds: str = ""
    mode: Literal["csp", "csv", "cst", "pp", "ip"] = "csp"
    position_gain: NotNegative = 0.0
    integral_time_s: NotNegative | None = None
    velocity_gain: NotNegative = 0.0
    velocity_feed_forward: Annotated[float, Meta(ge=0.0, le=1.0, description="1 is usual")] = 1.0
    torque_feed_forward: bool = False
    zero_offset: float = 0.0
    pdo: Literal["auto", "fixed"] = "auto"
    monitor: MonitoredObjects = msgspec.field(default_factory=list)
    node_axis: Annotated[int, Meta(ge=0, le=7, description="0 is the node's first axis")] = 0
    pdo_node: Annotated[int, Meta(ge=0, le=GREATEST_NODE, description="a number that no node has")] = 0
    stop_on: list[ErrorCode] = msgspec.field(default_factory=list)
    warn_on: list[ErrorCode] = msgspec.field(default_factory=list)
    sdo_timeout_ms: Annotated[int, Meta(ge=10, le=60_000, description="300 is usual")] = 300
    sdo_tries: Annotated[int, Meta(ge=1, le=10, description="3 is usual")] = 3
    sdo_store_timeout_s: Positive = 15.0
    position: Annotated[int, Meta(ge=0, lt=GREATEST_NODE, description="0 is next to the master")] | None = (
        None
    )
    lss: Annotated[tuple[Unsigned32, Unsigned32, Unsigned32, Unsigned32], Meta(description=_LSS)] | None = (
        None
    )
    homing: DriveHomingSection | None = None
    vendor_id: Unsigned32 = 0
    product_code: Unsigned32 = 0
    heartbeat_ms: Milliseconds = 100
    sdo_writes: list[list[int]] = msgspec.field(default_factory=list)
    process_data: ProcessData | None = None

    @property
    def profiled(self) -> bool:
        return self.mode == "pp"

    @property
    def homes(self) -> bool:
        return self.homing is not None

    @property
    def takes_torques(self) -> bool:
        return self.torque_feed_forward

    @property
    def torque_offset(self) -> bool:
        """Whether torques go to the drive beside its targets, in 60B2h."""
        return self.torque_feed_forward and self.mode != "cst"

    @property
    def usual_timeout_ms(self) -> int:
        return TORQUE_TIMEOUT_MS if self.mode == "cst" else COMMAND_TIMEOUT_MS

    @property
    def place(self) -> tuple[int, int]:
        return self.node, self.node_axis

    @property
    def borrowed_node(self) -> int:
        return self.pdo_node

    def misplaced(self, bus_kind: str) -> list[tuple[str, str, str]]:
        if bus_kind == "can":
            if self.position is None:
                return []
            return [("position", 'belongs to a bus of kind = "ethercat"', "give node, the node number")]
        found = []
        if self.position is None:
            found.append(("position", "is missing", "give the place on the bus, 0 next to the master"))
        if self.mode not in _ETHERCAT_MODES:
            shown = " or ".join(f'"{each}"' for each in _ETHERCAT_MODES)
            found.append(("mode", f"{self.mode!r} is not there on EtherCAT", f"set mode = {shown}"))
        usual: tuple[tuple[str, object], ...] = (
            ("lss", None),
            ("node_axis", 0),
            ("pdo_node", 0),
            ("pdo", "auto"),
            ("monitor", []),
        )
        for key, unset in usual:
            if getattr(self, key) != unset:
                found.append((key, "belongs to drives on CAN", "leave it out"))
        return found

    def has_mode(self, mode: int) -> bool:
        if mode == DriveMode.HOMING and self.homing is None:
            return False
        if mode == DriveMode.TORQUE and self.rated_torque <= 0.0:
            return False
        if self.profiled and mode in (DriveMode.VELOCITY, DriveMode.TORQUE):
            return False
        return _exchanges(self, DriveMode(mode))

    def complete(self, axis: AxisSection, cycle_s: float, bad: Refusal) -> tuple[Self, float | None]:
        if self.position is not None and self.node:
            bad("node", "position says where the drive is", "leave one of them out")
        for write in self.sdo_writes:
            fits = len(write) in (3, 4) and 0 < write[0] <= 0xFFFF and 0 <= write[1] <= 0xFF
            if not fits or (len(write) == 4 and write[3] not in (1, 2, 4, 8)):
                bad(
                    "sdo_writes",
                    f"{write} is no write",
                    "give [index, subindex, value], or [index, subindex, value, bytes] "
                    "with 1, 2, 4 or 8 bytes",
                )
        if self.mode == "pp" and self.torque_feed_forward:
            bad(
                "torque_feed_forward",
                'with mode = "pp" the drive makes the motion, and the torque is not known here',
                "leave it out",
            )
        if self.torque_feed_forward and self.rated_torque <= 0.0:
            bad(
                "torque_feed_forward",
                "60B2h counts thousandths of the rated torque, which is not there",
                "give rated_torque = the motor's rated torque in N·m (6076h)",
            )
        if self.node_axis and not self.pdo_node:
            bad(
                "pdo_node",
                f"axis {self.node_axis} of a node needs COB-IDs of its own",
                "give pdo_node = a node number that nobody on the bus has: its PDOs get that node's COB-IDs",
            )
        placed, delay = self, DELAY_CYCLES
        if self.position is not None:
            # a slave has no heartbeat: the state of its application layer is watched
            placed = msgspec.structs.replace(self, node=self.position + 1, heartbeat_ms=0)
            delay = ETHERCAT_DELAY_CYCLES
        looped = complete_loop(placed, axis, cycle_s, bad, delay)
        completed, per_turn = CanDrive.complete(looped, axis, cycle_s, bad)
        if completed.encoder is not None and per_turn is not None:
            _check_counts(completed.encoder, per_turn, axis, bad)
        return completed, per_turn

    def beside(self, folder: Path) -> Self:
        return msgspec.structs.replace(self, eds=str(folder / self.eds)) if self.eds else self

    @classmethod
    def shares(cls, axes: Sequence[Axis], cycle_hz: float) -> list[Share]:
        count = float(len(axes))
        drives = [cia402_drive(axis) for axis in axes]
        beats = sum(1000.0 / drive.heartbeat_ms for drive in drives if drive.heartbeat_ms)
        return [
            *_commands(drives, cycle_hz),
            Share("TPDO1", count, frame_bits(TPDO1.packing.size)),
            Share("TPDO2", count / SLOW_SYNCS, frame_bits(TPDO2.packing.size)),
            Share("heartbeats", 0.0, frame_bits(1), beats),
        ]


DRIVE = Cia402Drive


def cia402_drive(axis: Axis) -> Cia402Drive:
    """Return the drive of an axis that is known to have one by CiA 402."""
    assert isinstance(axis.drive, Cia402Drive)
    return axis.drive


def _commands(drives: Sequence[Cia402Drive], cycle_hz: float) -> list[Share]:
    """RPDOs; 60B2h and 6081h have no room beside mode and position, and go in some of their own."""
    profiled = float(sum(drive.profiled for drive in drives))
    streamed = float(len(drives)) - profiled
    offsets = float(sum(drive.torque_offset for drive in drives))
    # one that is silent for longer than the shortest of these would make its drive act by itself
    timeouts = tuple(
        sorted({(float(drive.command_timeout_ms), float(drive.usual_timeout_ms)) for drive in drives})
    )
    every = (
        Share("RPDO2", streamed, frame_bits(RPDO2.packing.size)),
        Share(
            "RPDO1 besides", streamed, frame_bits(RPDO1.packing.size), timeouts_ms=timeouts, cycle_hz=cycle_hz
        ),
        Share("RPDO1", profiled, frame_bits(RPDO1.packing.size)),
        Share("profile velocity", profiled, frame_bits(4)),
        Share("torque offset", offsets, frame_bits(2)),
    )
    return [share for share in every if share.frames]


def _check_counts(encoder: tuple[int, int], per_turn: float, axis: AxisSection, bad: Refusal) -> None:
    """Refuse a limited axis whose travel does not fit 32 bits of a drive's counts."""
    low, high = axis.min_position, axis.max_position
    if low is None or high is None:
        return
    furthest = max(abs(low), abs(high)) * encoder[0] / encoder[1] / per_turn
    if furthest >= GREATEST_COUNT:
        bad(
            "counts_per_motor_rev",
            f"an end of the axis's travel is at {furthest:.3g} counts, beyond 32 bits",
            "check counts_per_motor_rev and units_per_motor_rev",
        )


# What has to be mapped for a mode, besides the mode of operation itself.
_TARGETS = {DriveMode.VELOCITY: 0x60FF, DriveMode.TORQUE: 0x6071}


def _exchanges(drive: Cia402Drive, mode: DriveMode) -> bool:
    """Return whether the process data that were agreed with a drive have what a mode needs."""
    data = drive.process_data
    if data is None or mode is DriveMode.POSITION or mode < DriveMode.POSITION:
        return True
    offset = 0x800 * drive.node_axis
    mapped = {each.index - offset for pdo in data.rpdos for each in pdo.objects}
    if mode is DriveMode.VELOCITY and drive.mode == "csv" and 0x60FF in mapped:
        return True
    if mode is DriveMode.TORQUE and drive.mode == "cst" and 0x6071 in mapped:
        return True
    return 0x6060 in mapped and _TARGETS.get(mode, 0x6060) in mapped
