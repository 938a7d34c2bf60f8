"""What operators see of drives and ask of them; free of CANopen's packages, for the network's side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import msgspec

Value = int | float | str | bool
SdoType = Literal[
    "bool",
    "i8",
    "i16",
    "i24",
    "i32",
    "i64",
    "u8",
    "u16",
    "u24",
    "u32",
    "u64",
    "f32",
    "f64",
    "str",
    "utf16",
    "bytes",
]
Fieldbus = Literal["can", "ethercat"]
LoopMode = Literal["cst", "csv"]
# those of `mcserver.canopen.node.Phase`
DrivePhase = Literal["booting", "operational", "lost", "restarting", "failed", "closed"]


class MonitoredValue(msgspec.Struct, frozen=True, omit_defaults=True):
    """One object that the machine file shows in telemetry (``monitor``); value None: none has come."""

    name: str
    value: int | float | bool | None
    index: int = 0
    subindex: int = 0


class DriveInfo(msgspec.Struct, frozen=True, omit_defaults=True):
    """One drive on a bus.

    Attributes:
        node: on EtherCAT its position. fieldbus: kind of its bus.
        state: what the server takes it for. nmt: what its last heartbeat said, on EtherCAT its AL state;
            empty: none has come.
        heartbeat_age_s: since its last sign of life [s].
        statusword: 6041h, or the fault bits of a drive that streams telemetry. status: the same in words.
        device_type, vendor_id, product_code: 1000h, 1018h:01, 1018h:02.
        emergency: its last emergency message in words, on EtherCAT what 603Fh says; emergency_code,
            emergency_age_s: of that.
        boot_ups: how often it has started since the server did. message: why its configuration failed.
        monitor: what the machine file wants to see of it, newest values.
    """

    axis: int
    kind: str
    bus: str
    node: int
    state: DrivePhase
    nmt: str = ""
    heartbeat_age_s: float | None = None
    statusword: int | None = None
    status: str = ""
    device_type: int | None = None
    vendor_id: int | None = None
    product_code: int | None = None
    emergency: str = ""
    emergency_code: int | None = None
    emergency_age_s: float | None = None
    boot_ups: int = 0
    message: str = ""
    monitor: list[MonitoredValue] = []
    fieldbus: Fieldbus = "can"


class ScannedNode(msgspec.Struct, frozen=True, omit_defaults=True):
    """One node that answers on a bus.

    Attributes:
        node: on EtherCAT the position. profile: of 1000h; what: the same in words. modes: of 6502h.
        vendor_id … serial: 1018h; None: it does not say.
        axis: of the running machine, whose drive it is. eds: a file that is its by vendor and product.
        objects: what else it says of itself, by object, such as ``"6091:1"``: encoder (608Fh), gear (6091h),
            feed (6092h), rated torque (6076h [mN·m]), greatest speed of the motor (6080h [1/min]), travel
            (607Dh).
    """

    node: int
    profile: int
    what: str
    vendor_id: int | None = None
    product_code: int | None = None
    revision: int | None = None
    serial: int | None = None
    modes: list[str] = []
    axis: int | None = None
    eds: str = ""
    objects: dict[str, int] = {}


class BusScan(msgspec.Struct, frozen=True):
    """Who is on one bus; ``machine_file``: one to start from. ``fieldbus``: kind of the bus."""

    bus: str
    address: str
    nodes: list[ScannedNode]
    machine_file: str
    fieldbus: Fieldbus = "can"


@dataclass(frozen=True)
class SdoTarget:
    """An object of one drive, named by its axis, or by node (and bus, where the number is on several)."""

    index: int
    subindex: int = 0
    axis: int | None = None
    node: int | None = None
    bus: str = ""


class SdoReply(msgspec.Struct, frozen=True):
    """An object's value, read or written; ``bytes`` are shown as text.

    Attributes:
        node: on EtherCAT its position. raw: the bytes, little endian. fieldbus: kind of its bus.
    """

    axis: int
    bus: str
    node: int
    index: int
    subindex: int
    type: SdoType
    value: bool | int | float | str
    raw: bytes
    fieldbus: Fieldbus = "can"


class ParameterInfo(msgspec.Struct, frozen=True, omit_defaults=True):
    """One object of a drive's dictionary, as its EDS has it.

    Attributes:
        name: members behind their record: ``Gear ratio.Motor revolutions``. type: by which it is read.
        access: ro, wo, rw, rwr, rww or const. low, high: limits of the EDS; None: only those of the type.
    """

    index: int
    subindex: int
    name: str
    type: SdoType
    access: str
    low: int | None = None
    high: int | None = None


class DriveParameters(msgspec.Struct, frozen=True):
    """What a drive's dictionary has of one axis.

    Attributes:
        node_axis: which axis of its node it is. eds_sha256: of its EDS; empty: there is none, and these are
            the standard's objects. unreadable: entries of the EDS that make no sense, each with why.
        node: on EtherCAT its position. fieldbus: kind of its bus.
    """

    axis: int
    bus: str
    node: int
    node_axis: int
    eds_sha256: str
    parameters: list[ParameterInfo]
    unreadable: list[str]
    fieldbus: Fieldbus = "can"


class NodeHealth(msgspec.Struct):
    """One node while it was listened to.

    Attributes:
        state: NMT state of its last heartbeat; empty: none came.
        heartbeats: that came. longest_gap_s: between two of them, by this computer's clock.
        readings: process data that it sent at SYNC. late: those that came after the next SYNC.
            lost: those that never came.
        boot_ups: times it started. emergencies: the last ones, in words.
    """

    node: int
    axes: list[int]
    state: str = ""
    heartbeats: int = 0
    longest_gap_s: float = 0.0
    readings: int = 0
    late: int = 0
    lost: int = 0
    boot_ups: int = 0
    emergencies: list[str] = []


class BusCounts(msgspec.Struct):
    """One bus while it was listened to.

    Attributes:
        duration_s: of that. frames: that came. load: of the bit rate [1], each frame with the most stuff
            bits.
        syncs: SYNCs. longest_sync_gap_s: between two of them, by this computer's clock.
        strangers: COB-IDs that belong to no node of the machine file, with how many frames came.
    """

    duration_s: float
    frames: int
    load: float
    syncs: int = 0
    longest_sync_gap_s: float = 0.0
    nodes: list[NodeHealth] = []
    strangers: dict[str, int] = {}


class BusHealth(msgspec.Struct):
    """One bus that was listened to, beside whoever is its master.

    Attributes:
        master: by what another master was noticed; empty: none was. counts: of frames; a node of EtherCAT is
            a position on the line.
        error_frames: errors and malformed packets that this computer's interface has seen, on EtherCAT frames
            with a wrong working counter.
        following_errors: by axis, the greatest between setpoint and encoder on the bus [mm, deg].
    """

    bus: str
    counts: BusCounts
    master: str = ""
    error_frames: int = 0
    following_errors: dict[str, float] = {}


class ScopeSignal(msgspec.Struct, frozen=True):
    """What one object had in each cycle.

    Attributes:
        object: such as ``6064h:00``; empty: it is computed. unit: empty: as the drive has it.
        values: one a cycle, float64, little endian; NaN: nothing came.
    """

    object: str
    name: str
    unit: str
    values: bytes


class DriveTrace(msgspec.Struct, frozen=True):
    """Every mapped object of an axis in each cycle, around a trigger.

    Attributes:
        cycles: of them. cycle_s: [s]. begin_s: of the first one, by the trigger, or 0 [s]. trigger_unix: Unix
            time of time 0 [s]. missing: SYNCs that the bus had too few.
    """

    axis: int
    cycles: int
    cycle_s: float
    begin_s: float
    trigger_unix: float
    missing: int
    signals: list[ScopeSignal]


class TunedLoop(msgspec.Struct, frozen=True, omit_defaults=True):
    """Gains of a loop and what they leave.

    Attributes:
        gains: as in ``[axis.drive]``. least, greatest: share of the measured inertia (cst) down and up to
            which it is stable, or multiple of its gain (csv, greatest alone); 0: it is not. phase_deg: left.
        crossover_hz, measured_phase_deg: on the measured response, where it is known. measured_gain: multiple
            of the gains up to which it is stable on that; None: beyond what was measured.
    """

    name: str
    gains: dict[str, float]
    least: float
    greatest: float
    phase_deg: float
    crossover_hz: float | None = None
    measured_phase_deg: float | None = None
    measured_gain: float | None = None


class DriveTuning(msgspec.Struct, frozen=True):
    """What a motion tells of a loop in mode cst or csv.

    Attributes:
        measured: cst: inertia [kg·m²], friction [N·m], viscous [N·m·s/rad], load [N·m], explained,
            uncertainty [1]; csv: scale [1], lag, uncertainty [s]. said: the same in words.
        loops: that of the machine file, then the proposed one. changes: lines of the machine file; none: it
            fits. remedy: what to do with them.
        frequency_hz, gain_db, phase_deg: the machine file's loop, opened, on the measured response; empty: it
            is not known.
    """

    axis: int
    mode: LoopMode
    measured: dict[str, float]
    said: str
    loops: list[TunedLoop]
    changes: list[str]
    remedy: str
    frequency_hz: list[float]
    gain_db: list[float]
    phase_deg: list[float]
