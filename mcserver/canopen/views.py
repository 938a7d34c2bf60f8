"""Messages about drives for operators; free of CANopen's packages, for the network's side."""

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
    """A value of a drive: of an object that ``monitor`` in the machine file names, or of its own telemetry.

    Attributes:
        value: the newest one; None: none has come yet. index, subindex: the object; index 0: it is telemetry.
    """

    name: str
    value: int | float | bool | None
    index: int = 0
    subindex: int = 0


class DriveInfo(msgspec.Struct, frozen=True, omit_defaults=True):
    """A drive on a bus and its state.

    Attributes:
        node: node number; on EtherCAT the position on the line. fieldbus: kind of the bus.
        state: state of the drive in the server's supervision. nmt: NMT state in the last heartbeat, on
            EtherCAT the AL state; empty: no heartbeat has come yet.
        heartbeat_age_s: time since the last sign of life [s]; None: none has come yet.
        statusword: 6041h; of a drive that streams telemetry its fault bits. status: the same in words.
        device_type, vendor_id, product_code: objects 1000h, 1018h:01 and 1018h:02.
        emergency: the last emergency message in words, on EtherCAT the error code 603Fh. emergency_code: its
            error code. emergency_age_s: time since it came [s].
        boot_ups: number of the drive's starts since the server started. message: why the last configuration
            failed.
        monitor: newest values of its telemetry, and of objects that ``monitor`` in the machine file names.
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
    """A node that answers on a bus.

    Attributes:
        node: node number; on EtherCAT the position on the line. profile: number of the device profile, from
            1000h. what: the same in words. modes: modes of operation that 6502h lists.
        vendor_id, product_code, revision, serial: identity 1018h; None: the node did not give it.
        axis: axis of the running machine that this drive moves; None: no axis has it. eds: path of the EDS
            file in the machine file, or of one with this vendor and product; empty: none was found.
        objects: values of further objects, by keys such as ``"6091:1"``: encoder (608Fh), gear (6091h), feed
            (6092h), rated torque (6076h [mN·m]), greatest motor speed (6080h [1/min]), travel limits (607Dh).
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
    """The nodes that answer on a bus.

    Attributes:
        machine_file: text of a machine file with these drives, to start from. fieldbus: kind of the bus.
    """

    bus: str
    address: str
    nodes: list[ScannedNode]
    machine_file: str
    fieldbus: Fieldbus = "can"


@dataclass(frozen=True)
class SdoTarget:
    """An object of a drive. The drive is named by its axis, or by its node.

    Attributes:
        bus: needed with a node number that several buses have.
    """

    index: int
    subindex: int = 0
    axis: int | None = None
    node: int | None = None
    bus: str = ""


class SdoReply(msgspec.Struct, frozen=True):
    """Value of an object that was read or written.

    Attributes:
        node: node number; on EtherCAT the position on the line. value: of the type ``bytes`` as hexadecimal
            text. raw: the transferred bytes, little endian. fieldbus: kind of the bus.
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
    """An object of a drive, as its EDS describes it.

    Attributes:
        name: name in the EDS; a member's follows that of its record: ``Gear ratio.Motor revolutions``.
        type: data type. access: ro, wo, rw, rwr, rww or const.
        low, high: limits in the EDS; None: the limits of the type.
    """

    index: int
    subindex: int
    name: str
    type: SdoType
    access: str
    low: int | None = None
    high: int | None = None


class DriveParameters(msgspec.Struct, frozen=True):
    """The objects of a drive, of one axis of its node.

    Attributes:
        node_axis: number of the axis among those of its node, from 0. eds_sha256: digest of the drive's EDS;
            empty: it has none, and the objects are those of the standard. unreadable: entries of the EDS that
            cannot be read, each with the reason.
        node: node number; on EtherCAT the position on the line. fieldbus: kind of the bus.
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
    """Frames of a node that were counted while a bus was listened to.

    Attributes:
        axes: numbers of the machine's axes that the node has.
        state: NMT state in the last heartbeat; empty: none came.
        heartbeats: number of heartbeats. longest_gap_s: longest time between two of them, by this computer's
            clock [s].
        readings: number of TPDOs that the node sends at SYNC. late: number of those that came after the next
            SYNC. lost: number of those that never came.
        boot_ups: number of its boot-up messages. emergencies: its last emergency messages in words.
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
    """Frames that were counted while a bus was listened to.

    Attributes:
        duration_s: how long the bus was listened to [s]. frames: number of all frames. load: share of the
            bit rate that they took [1], each counted with the most stuff bits that it can have.
        syncs: number of SYNCs. longest_sync_gap_s: longest time between two of them, by this computer's clock
            [s].
        strangers: number of frames by COB-ID, of COB-IDs that belong to no node of the machine file.
    """

    duration_s: float
    frames: int
    load: float
    syncs: int = 0
    longest_sync_gap_s: float = 0.0
    nodes: list[NodeHealth] = []
    strangers: dict[str, int] = {}


class BusHealth(msgspec.Struct):
    """Result of listening to a bus beside its master.

    Attributes:
        counts: numbers of frames; on EtherCAT a node is a position on the line. master: the sign by which a
            master was noticed; empty: none was.
        error_frames: number of errors and malformed packets at this computer's interface, on EtherCAT of
            frames with a wrong working counter.
        following_errors: greatest following error by axis, between setpoint and encoder on the bus [mm, deg].
    """

    bus: str
    counts: BusCounts
    master: str = ""
    error_frames: int = 0
    following_errors: dict[str, float] = {}


class ScopeSignal(msgspec.Struct, frozen=True):
    """Values of an object in each cycle.

    Attributes:
        object: index and subindex, such as ``6064h:00``; empty: the values were computed. unit: unit of the
            values; empty: the drive's own.
        values: one for each cycle, float64, little endian; NaN: no value came in it.
    """

    object: str
    name: str
    unit: str
    values: bytes


class DriveTrace(msgspec.Struct, frozen=True):
    """Recording of every mapped object of an axis in each cycle, around a trigger.

    Attributes:
        cycles: number of cycles. cycle_s: length of a cycle [s]. begin_s: time of the first cycle; the
            trigger is at time 0 [s]. trigger_unix: Unix time of time 0 [s]. missing: number of SYNCs that are
            missing in the recording.
    """

    axis: int
    cycles: int
    cycle_s: float
    begin_s: float
    trigger_unix: float
    missing: int
    signals: list[ScopeSignal]


class TunedLoop(msgspec.Struct, frozen=True, omit_defaults=True):
    """Gains of a control loop and its stability margins.

    Attributes:
        gains: by the keys of ``[axis.drive]``. least, greatest: in mode cst the least and the greatest
            inertia, as multiples of the measured one, with which the loop is stable; in mode csv ``greatest``
            alone, the multiple of its gain up to which it is stable; 0: it is not stable. phase_deg: phase
            margin [deg].
        crossover_hz, measured_phase_deg: crossover frequency [Hz] and phase margin [deg] on the measured
            response; None: not known. measured_gain: multiple of the gains up to which the loop is stable on
            that response; None: more than could be measured.
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
    """Result of measuring an axis in mode cst or csv while it moves, and proposed gains of its loop.

    Attributes:
        measured: in mode cst inertia [kg·m²], friction [N·m], viscous [N·m·s/rad], load [N·m], explained and
            uncertainty [1]; in mode csv scale [1], lag and uncertainty [s]. said: the same in words.
        loops: the loop with the gains of the machine file, then with the proposed ones. changes: lines to
            change in the machine file; empty: its gains fit. remedy: how to apply the changes.
        frequency_hz, gain_db, phase_deg: open-loop response with the gains of the machine file, as measured;
            empty: not known.
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
