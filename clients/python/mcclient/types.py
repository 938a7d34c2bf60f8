# Made by `python -m mcserver.contract.sdk clients`: change the server's messages instead.
"""What the server tells, as plain values (docs/keyspace.md).

Positions are in mm (linear axes) or deg (rotary axes), velocities in mm/s or deg/s, torques in N·m, times in
seconds since the executor's start, percentages in %.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from mcclient.words import Word

ENDED: frozenset[str] = frozenset({"finished", "aborted", "rejected", "faulted", "interrupted"})
Value = bool | int | float | str


class AxisKind(Word):
    """One of the words of the wire."""

    LINEAR = "linear"
    ROTARY = "rotary"


class AxisState(Word):
    """One of the words of the wire."""

    OFF = "off"
    STARTING = "starting"
    STANDSTILL = "standstill"
    MOVING = "moving"
    SPEED = "speed"
    TORQUE = "torque"
    STOPPING = "stopping"
    RELEASED = "released"
    FAULT = "fault"


class AxisUnit(Word):
    """One of the words of the wire."""

    MM = "mm"
    DEG = "deg"


class BedMeshState(Word):
    """One of the words of the wire."""

    OFF = "off"
    FILE = "file"
    PROBED = "probed"


class ChannelKind(Word):
    """One of the words of the wire."""

    DIGITAL = "digital"
    ANALOG = "analog"


class DrivePhase(Word):
    """One of the words of the wire."""

    BOOTING = "booting"
    OPERATIONAL = "operational"
    LOST = "lost"
    RESTARTING = "restarting"
    FAILED = "failed"
    CLOSED = "closed"


class EventKind(Word):
    """One of the words of the wire."""

    SERVER_STARTED = "server.started"
    SERVER_STOPPING = "server.stopping"
    PROGRAM_OPENED = "program.opened"
    PROGRAM_STARTED = "program.started"
    PROGRAM_HELD = "program.held"
    PROGRAM_RESUMED = "program.resumed"
    PROGRAM_PAUSED = "program.paused"
    PROGRAM_MESSAGE = "program.message"
    PROGRAM_CLOSED = "program.closed"
    INPUT_READ = "input.read"
    PROGRAM_ENDED = "program.ended"
    LINES_STARTED = "lines.started"
    LINES_ENDED = "lines.ended"
    LINE_REJECTED = "line.rejected"
    FAULT = "fault"
    WARNING = "warning"
    ESTOP = "estop"
    RESET = "reset"
    OVERRIDE = "override"
    COMMAND = "command"
    CLIENT_GONE = "client.gone"
    RECORDING = "recording"
    AXIS_HOMING = "axis.homing"
    AXIS_HOMED = "axis.homed"
    AXIS_UNHOMED = "axis.unhomed"
    PROBE = "probe"
    DRIVE_EMERGENCY = "drive.emergency"
    DRIVE_LOST = "drive.lost"
    DRIVE_BACK = "drive.back"
    DRIVE_REBOOTED = "drive.rebooted"
    DRIVE_STARTED = "drive.started"
    DRIVE_FAILED = "drive.failed"
    BUS_FOREIGN_MASTER = "bus.foreign_master"
    BUS_LOST = "bus.lost"
    BUS_BACK = "bus.back"


class Fieldbus(Word):
    """One of the words of the wire."""

    CAN = "can"
    ETHERCAT = "ethercat"


class ToolFrame(Word):
    """One of the words of the wire."""

    BASE = "base"
    TOOL = "tool"


ToolFrameWord = ToolFrame | Literal["base", "tool"]


class LoopMode(Word):
    """One of the words of the wire."""

    CST = "cst"
    CSV = "csv"


class MachineState(Word):
    """One of the words of the wire."""

    READY = "ready"
    FAULT = "fault"
    ESTOP = "estop"


class OnDisconnect(Word):
    """One of the words of the wire."""

    FINISH = "finish"
    STOP = "stop"


OnDisconnectWord = OnDisconnect | Literal["finish", "stop"]


class Outputs(Word):
    """One of the words of the wire."""

    SET = "set"
    LEAVE = "leave"


OutputsWord = Outputs | Literal["set", "leave"]


class ProgramState(Word):
    """One of the words of the wire."""

    QUEUED = "queued"
    RUNNING = "running"
    HELD = "held"
    PAUSED = "paused"
    ENDING = "ending"
    FINISHED = "finished"
    ABORTED = "aborted"
    REJECTED = "rejected"
    FAULTED = "faulted"
    INTERRUPTED = "interrupted"


class Quantity(Word):
    """One of the words of the wire."""

    END = "end"
    POSITION = "position"
    TRAVEL = "travel"
    SPEED = "speed"
    DURATION = "duration"
    CLEARANCE = "clearance"


class RecordingKind(Word):
    """One of the words of the wire."""

    RECORDING = "recording"
    BLACKBOX = "blackbox"


class RecordingState(Word):
    """One of the words of the wire."""

    WRITING = "writing"
    DONE = "done"
    UNFINISHED = "unfinished"


class RunRole(Word):
    """One of the words of the wire."""

    AGENT = "agent"
    OPERATOR = "operator"


RunRoleWord = RunRole | Literal["agent", "operator"]


class RunState(Word):
    """One of the words of the wire."""

    WAITING = "waiting"
    ARMED = "armed"
    STARTED = "started"
    REJECTED = "rejected"


class SdoType(Word):
    """One of the words of the wire."""

    BOOL = "bool"
    I8 = "i8"
    I16 = "i16"
    I24 = "i24"
    I32 = "i32"
    I64 = "i64"
    U8 = "u8"
    U16 = "u16"
    U24 = "u24"
    U32 = "u32"
    U64 = "u64"
    F32 = "f32"
    F64 = "f64"
    STR = "str"
    UTF16 = "utf16"
    BYTES = "bytes"


SdoTypeWord = (
    SdoType
    | Literal[
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
)


class Severity(Word):
    """One of the words of the wire."""

    ERROR = "error"
    WARNING = "warning"


class ToolDirection(Word):
    """One of the words of the wire."""

    X = "X"
    Y = "Y"
    Z = "Z"
    A = "A"
    B = "B"
    C = "C"


ToolDirectionWord = ToolDirection | Literal["X", "Y", "Z", "A", "B", "C"]


@dataclass(frozen=True, slots=True)
class Edit:
    """A certain remedy: characters of the diagnostic's line and what replaces them.

    Attributes:
        column: code points from 1, end exclusive.
        end_column: code points from 1, end exclusive.
        text: the replacement.
    """

    column: int
    end_column: int
    text: str


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One fault of a program, placed in its text; ``line`` is the client's line number."""

    code: str
    message: str
    line: int = 0
    column: int = 0
    end_column: int = 0
    hint: str = ""
    severity: Severity = Severity.ERROR
    tool: int | None = None
    residual_mm: float | None = None
    axis: int | None = None
    edit: Edit | None = None


@dataclass(frozen=True, slots=True)
class Fault:
    """What stopped motion: a stable code, and the axis and line if they apply."""

    code: str
    message: str
    hint: str = ""
    axis: int | None = None
    line: int = 0
    program: str | None = None
    t: float = 0.0


@dataclass(frozen=True, slots=True)
class Ack:
    """Payload of ``ack/{program}``: cumulative, so a lost one does not matter.

    Attributes:
        accepted: lines through this number are accepted and journaled.
        done: this line and every one before it have ended: their setpoints have been passed, and after an
            exact stop the axes are in position. Between exact stops an axis may lag by its following
            error, at most ``max_following_error``: a stricter condition would make each line a stop.
        credit: how many lines after ``accepted`` fit now.
        state: the program's.
        rejected: number of the line that was found faulty; it is the next one expected. 0: none.
        diagnostics: what is wrong with it.
        fault: what stopped the program.
        expected: the line number expected, set if the acknowledged message left a gap.
        rejections: how many lines of the program have been rejected so far. An acknowledgement with a
            smaller count than an earlier one is older: its numbers are of lines that were discarded.
        reason: why it was aborted: by whom, or a code; empty in programs of an earlier start of the
            server.
    """

    program: str
    accepted: int
    done: int
    credit: int
    state: ProgramState
    rejected: int = 0
    diagnostics: tuple[Diagnostic, ...] = ()
    fault: Fault | None = None
    expected: int = 0
    rejections: int = 0
    reason: str = ""


@dataclass(frozen=True, slots=True)
class ArgumentInfo:
    """A number that a button asks for, in the units of its text; ``first`` is shown first."""

    name: str
    low: float
    high: float
    first: float
    unit: str


@dataclass(frozen=True, slots=True)
class Assertion:
    """One bound of a run.

    Attributes:
        what: ``end``: where a coordinate ends; ``position``: where it is at any time; ``travel``: how far
            its greatest place is from its least; ``speed``: of an axis, or of a tool's tip (``T3``);
            ``duration`` [s]; ``clearance``: the least between bodies [mm].
        of: the coordinate: ``X``, ``7``, ``T3.X``; a speed's axis or tool; empty for duration and
            clearance.
        least: bounds, which belong to it [mm or deg, per second]; None: none to this side.
        most: bounds, which belong to it [mm or deg, per second]; None: none to this side.
    """

    what: Quantity
    of: str = ""
    least: float | None = None
    most: float | None = None


@dataclass(frozen=True, slots=True)
class AxesStatus:
    """All axes, column-wise: every list has one entry for each of ``index``.

    Attributes:
        homed: whether the axis knows its position; axes without ``[axis.homing]`` always do.
        skew: how much the second drive of a gantry pair is further than its leader [mm, deg]; 0 for other
            axes. Empty on a machine without pairs.
        silent: whether the axis's drive does not answer: its position, velocity and torque are old. Empty
            while all answer.
    """

    index: tuple[int, ...]
    position: tuple[float, ...]
    setpoint: tuple[float, ...]
    velocity: tuple[float, ...]
    torque: tuple[float, ...]
    state: tuple[AxisState, ...]
    homed: tuple[bool, ...] = ()
    skew: tuple[float, ...] = ()
    silent: tuple[bool, ...] = ()


@dataclass(frozen=True, slots=True)
class AxisDifference:
    """How an axis moves otherwise; the other program's minus this one's [mm or deg].

    Attributes:
        most: greatest difference of two setpoints of the same cycle; the shorter run rests at its end.
        time_s: when, and the lines that run then.
        line: when, and the lines that run then.
        other_line: when, and the lines that run then.
        min: differences of the least, greatest and last setpoint.
        max: differences of the least, greatest and last setpoint.
        end: differences of the least, greatest and last setpoint.
    """

    axis: int
    unit: str
    most: float
    time_s: float
    line: int
    other_line: int
    min: float
    max: float
    end: float


@dataclass(frozen=True, slots=True)
class AxisInfo:
    """One axis; limits in mm or deg and seconds, None where not limited.

    ``homing``: how it finds its reference; None: its encoder's reading is its position. ``letter``: an
    additional letter by which programs of the machine's profile name it, such as ``E``; empty: none.
    ``spindle``: M3, M4, M5 and S turn it.
    """

    index: int
    type: AxisKind
    unit: AxisUnit
    max_velocity: float
    max_acceleration: float
    drive: str
    max_jerk: float | None = None
    min_position: float | None = None
    max_position: float | None = None
    in_position: float = 0.0
    homing: str | None = None
    letter: str = ""
    spindle: bool = False


@dataclass(frozen=True, slots=True)
class AxisStart:
    """An axis of a program that is to start at a line.

    Attributes:
        now: present position [mm, deg].
        there: position in the program before the line [mm, deg]; None: unknown.
        energized: the axis is energized in the program there.
        away: the two positions differ by more than the axis's in-position tolerance, or ``there`` is
            unknown.
    """

    axis: int
    unit: str
    now: float
    there: float | None
    energized: bool
    away: bool


@dataclass(frozen=True, slots=True)
class AxisTravel:
    """Where an axis ends, and its least and greatest setpoint [mm or deg]."""

    position: float
    min: float
    max: float
    unit: str


@dataclass(frozen=True, slots=True)
class NodeHealth:
    """Frames of a node that were counted while a bus was listened to.

    Attributes:
        axes: numbers of the machine's axes that the node has.
        state: NMT state in the last heartbeat; empty: none came.
        heartbeats: number of heartbeats.
        longest_gap_s: longest time between two of them, by this computer's clock [s].
        readings: number of TPDOs that the node sends at SYNC.
        late: number of those that came after the next SYNC.
        lost: number of those that never came.
        boot_ups: number of its boot-up messages.
        emergencies: its last emergency messages in words.
    """

    node: int
    axes: tuple[int, ...]
    state: str = ""
    heartbeats: int = 0
    longest_gap_s: float = 0.0
    readings: int = 0
    late: int = 0
    lost: int = 0
    boot_ups: int = 0
    emergencies: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class BusCounts:
    """Frames that were counted while a bus was listened to.

    Attributes:
        duration_s: how long the bus was listened to [s].
        frames: number of all frames.
        load: share of the bit rate that they took [1], each counted with the most stuff bits that it can
            have.
        syncs: number of SYNCs.
        longest_sync_gap_s: longest time between two of them, by this computer's clock [s].
        strangers: number of frames by COB-ID, of COB-IDs that belong to no node of the machine file.
    """

    duration_s: float
    frames: int
    load: float
    syncs: int = 0
    longest_sync_gap_s: float = 0.0
    nodes: tuple[NodeHealth, ...] = ()
    strangers: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BusHealth:
    """Result of listening to a bus beside its master.

    Attributes:
        counts: numbers of frames; on EtherCAT a node is a position on the line.
        master: the sign by which a master was noticed; empty: none was.
        error_frames: number of errors and malformed packets at this computer's interface, on EtherCAT of
            frames with a wrong working counter.
        following_errors: greatest following error by axis, between setpoint and encoder on the bus [mm,
            deg].
    """

    bus: str
    counts: BusCounts
    master: str = ""
    error_frames: int = 0
    following_errors: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ScannedNode:
    """A node that answers on a bus.

    Attributes:
        node: node number; on EtherCAT the position on the line.
        profile: number of the device profile, from 1000h.
        what: the same in words.
        vendor_id: identity 1018h; None: the node did not give it.
        product_code: identity 1018h; None: the node did not give it.
        revision: identity 1018h; None: the node did not give it.
        serial: identity 1018h; None: the node did not give it.
        modes: modes of operation that 6502h lists.
        axis: axis of the running machine that this drive moves; None: no axis has it.
        eds: path of the EDS file in the machine file, or of one with this vendor and product; empty: none
            was found.
        objects: values of further objects, by keys such as ``"6091:1"``: encoder (608Fh), gear (6091h),
            feed (6092h), rated torque (6076h [mN·m]), greatest motor speed (6080h [1/min]), travel limits
            (607Dh).
    """

    node: int
    profile: int
    what: str
    vendor_id: int | None = None
    product_code: int | None = None
    revision: int | None = None
    serial: int | None = None
    modes: tuple[str, ...] = ()
    axis: int | None = None
    eds: str = ""
    objects: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class BusScan:
    """The nodes that answer on a bus.

    Attributes:
        machine_file: text of a machine file with these drives, to start from.
        fieldbus: kind of the bus.
    """

    bus: str
    address: str
    nodes: tuple[ScannedNode, ...]
    machine_file: str
    fieldbus: Fieldbus = Fieldbus.CAN


@dataclass(frozen=True, slots=True)
class ButtonInfo:
    """A program of the machine file, or a probing cycle, that people start from a page.

    Attributes:
        text: lines of G-code; ``{name}`` is the place of an argument.
        role: the lowest role that may press it, ``operator`` or ``engineer``.
        confirm: what must be confirmed before it runs; empty: nothing.
        group: the heading under which pages show it.
    """

    name: str
    text: str
    role: str
    confirm: str
    arguments: tuple[ArgumentInfo, ...]
    group: str


@dataclass(frozen=True, slots=True)
class CheckReply:
    """As ``mcserver check --json``."""

    ok: bool
    diagnostics: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True)
class PairClearance:
    """How near two ``bodies`` came to each other, when, and in which line."""

    bodies: tuple[str, ...]
    least_mm: float
    time_s: float
    line: int


@dataclass(frozen=True, slots=True)
class ClearanceReport:
    """The least distances of a run's bodies.

    Attributes:
        least_mm: None if all stayed apart by more than the margin plus 50 mm.
        pairs: that came nearer, the nearest first, 20 at most.
        assumed_on: zones that an input switches, which count as on.
    """

    margin_mm: float
    least_mm: float | None
    pairs: tuple[PairClearance, ...]
    assumed_on: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class CloseReply:
    """``accepted``: the last line that will run."""

    program: str
    accepted: int
    done: int
    state: ProgramState


@dataclass(frozen=True, slots=True)
class WayStep:
    """One step of an approach: a move of axes, or a wait for an input.

    Attributes:
        text: description for people.
        targets: end of the move, by axis number as text [mm, deg]; empty: no axis moves.
        rapid: each axis moves at its own limits; otherwise at the approach velocity.
    """

    text: str
    targets: dict[str, float] = field(default_factory=dict)
    rapid: bool = False


@dataclass(frozen=True, slots=True)
class Switched:
    """An output, or the speed or torque of an axis, that differs from its value in the program.

    Attributes:
        name: of the output, or such as ``axis 3``.
        there: value in the program before the line.
        now: present value.
        unit: of both values.
    """

    name: str
    there: float
    now: float
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Need:
    """What has to be resolved before a program starts at a line: code, message and remedy.

    Attributes:
        confirm: field of the request that confirms it, ``way`` or ``outputs``; empty: it cannot be
            confirmed.
    """

    code: str
    message: str
    hint: str
    confirm: str = ""


@dataclass(frozen=True, slots=True)
class Continuation:
    """How a program would continue.

    Attributes:
        program: its id, empty for a text.
        name: as it ended; lines through ``done`` are certain.
        state: as it ended; lines through ``done`` are certain.
        done: as it ended; lines through ``done`` are certain.
        accepted: as it ended; lines through ``done`` are certain.
        whole: its text is known to its end, so nothing must be sent.
        sha256: of its whole text.
        line: the first that would run.
        first: of the text around that line.
        lines: of the text around that line.
        modal: codes in force there.
        energize: axes that are energized first.
        axes: where each is, and where the program has it there.
        way: the moves that bring them there, in order.
        switched: what the program had switched differently from now.
        needs: what prevents it; one that has `confirm` is met by that field of the request.
        block_delete: the settings that it continues with.
        optional_stop: the settings that it continues with.
    """

    program: str
    name: str
    state: ProgramState | None
    done: int
    accepted: int
    whole: bool
    sha256: str | None
    line: int
    first: int
    lines: tuple[str, ...]
    modal: tuple[str, ...]
    energize: tuple[int, ...]
    axes: tuple[AxisStart, ...]
    way: tuple[WayStep, ...]
    switched: tuple[Switched, ...]
    needs: tuple[Need, ...]
    block_delete: bool
    optional_stop: bool


@dataclass(frozen=True, slots=True)
class ContinueReply:
    """The program that continues, like `OpenReply`.

    Attributes:
        line: the first that runs.
        resume_of: the program that it continues.
        whole: the server has all of its lines; otherwise the client sends those from ``expected`` on.
    """

    program: str
    state: ProgramState
    axes: tuple[int, ...]
    expected: int
    credit: int
    instance: str
    line: int
    resume_of: str
    whole: bool


@dataclass(frozen=True, slots=True)
class TipDifference:
    """How far apart two paths of a tip are, whatever their times.

    Attributes:
        tool: None: the axes 0, 1 and 2 themselves.
        apart_mm: the greatest distance of a point of one path from the other one.
        time_s: where that is.
        line: where that is.
        other: they are of the other program, whose path goes astray there.
    """

    tool: int | None
    apart_mm: float
    time_s: float
    line: int
    other: bool


@dataclass(frozen=True, slots=True)
class Difference:
    """How another program moves.

    Attributes:
        same: every setpoint is the same to the bit.
        duration_s: the other one's minus this one's.
        axes: those whose setpoints differ.
        tips: all.
    """

    same: bool
    duration_s: float
    axes: tuple[AxisDifference, ...]
    tips: tuple[TipDifference, ...]


@dataclass(frozen=True, slots=True)
class DiskStatus:
    """How slow the disk under the journal is.

    Attributes:
        since: Unix time from which on it is slow [s].
        commit_s: how long messages have waited for the journal's commit [s].
        sync_s: how long the current sync has taken [s]; a power cut loses what was committed in that
            time.
        worst_s: the longest of these since then [s].
    """

    since: float
    commit_s: float
    sync_s: float
    worst_s: float


@dataclass(frozen=True, slots=True)
class Done:
    """Reply of methods that return no data: the programs concerned."""

    programs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MonitoredValue:
    """A value of a drive: of an object that ``monitor`` in the machine file names, or of its own telemetry.

    Attributes:
        value: the newest one; None: none has come yet.
        index: the object; index 0: it is telemetry.
        subindex: the object; index 0: it is telemetry.
    """

    name: str
    value: Value | None
    index: int = 0
    subindex: int = 0


@dataclass(frozen=True, slots=True)
class DriveInfo:
    """A drive on a bus and its state.

    Attributes:
        node: node number; on EtherCAT the position on the line.
        state: state of the drive in the server's supervision.
        nmt: NMT state in the last heartbeat, on EtherCAT the AL state; empty: no heartbeat has come yet.
        heartbeat_age_s: time since the last sign of life [s]; None: none has come yet.
        statusword: 6041h; of a drive that streams telemetry its fault bits.
        status: the same in words.
        device_type: objects 1000h, 1018h:01 and 1018h:02.
        vendor_id: objects 1000h, 1018h:01 and 1018h:02.
        product_code: objects 1000h, 1018h:01 and 1018h:02.
        emergency: the last emergency message in words, on EtherCAT the error code 603Fh.
        emergency_code: its error code.
        emergency_age_s: time since it came [s].
        boot_ups: number of the drive's starts since the server started.
        message: why the last configuration failed.
        monitor: newest values of its telemetry, and of objects that ``monitor`` in the machine file
            names.
        fieldbus: kind of the bus.
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
    monitor: tuple[MonitoredValue, ...] = ()
    fieldbus: Fieldbus = Fieldbus.CAN


@dataclass(frozen=True, slots=True)
class ParameterInfo:
    """An object of a drive, as its EDS describes it.

    Attributes:
        name: name in the EDS; a member's follows that of its record: ``Gear ratio.Motor revolutions``.
        type: data type.
        access: ro, wo, rw, rwr, rww or const.
        low: limits in the EDS; None: the limits of the type.
        high: limits in the EDS; None: the limits of the type.
    """

    index: int
    subindex: int
    name: str
    type: SdoType
    access: str
    low: int | None = None
    high: int | None = None


@dataclass(frozen=True, slots=True)
class DriveParameters:
    """The objects of a drive, of one axis of its node.

    Attributes:
        node: node number; on EtherCAT the position on the line.
        node_axis: number of the axis among those of its node, from 0.
        eds_sha256: digest of the drive's EDS; empty: it has none, and the objects are those of the
            standard.
        unreadable: entries of the EDS that cannot be read, each with the reason.
        fieldbus: kind of the bus.
    """

    axis: int
    bus: str
    node: int
    node_axis: int
    eds_sha256: str
    parameters: tuple[ParameterInfo, ...]
    unreadable: tuple[str, ...]
    fieldbus: Fieldbus = Fieldbus.CAN


@dataclass(frozen=True, slots=True)
class ScopeSignal:
    """Values of an object in each cycle.

    Attributes:
        object: index and subindex, such as ``6064h:00``; empty: the values were computed.
        unit: unit of the values; empty: the drive's own.
        values: one for each cycle, float64, little endian; NaN: no value came in it.
    """

    object: str
    name: str
    unit: str
    values: bytes


@dataclass(frozen=True, slots=True)
class DriveTrace:
    """Recording of every mapped object of an axis in each cycle, around a trigger.

    Attributes:
        cycles: number of cycles.
        cycle_s: length of a cycle [s].
        begin_s: time of the first cycle; the trigger is at time 0 [s].
        trigger_unix: Unix time of time 0 [s].
        missing: number of SYNCs that are missing in the recording.
    """

    axis: int
    cycles: int
    cycle_s: float
    begin_s: float
    trigger_unix: float
    missing: int
    signals: tuple[ScopeSignal, ...]


@dataclass(frozen=True, slots=True)
class TunedLoop:
    """Gains of a control loop and its stability margins.

    Attributes:
        gains: by the keys of ``[axis.drive]``.
        least: in mode cst the least and the greatest inertia, as multiples of the measured one, with
            which the loop is stable; in mode csv ``greatest`` alone, the multiple of its gain up to which
            it is stable; 0: it is not stable.
        greatest: in mode cst the least and the greatest inertia, as multiples of the measured one, with
            which the loop is stable; in mode csv ``greatest`` alone, the multiple of its gain up to which
            it is stable; 0: it is not stable.
        phase_deg: phase margin [deg].
        crossover_hz: crossover frequency [Hz] and phase margin [deg] on the measured response; None: not
            known.
        measured_phase_deg: crossover frequency [Hz] and phase margin [deg] on the measured response;
            None: not known.
        measured_gain: multiple of the gains up to which the loop is stable on that response; None: more
            than could be measured.
    """

    name: str
    gains: dict[str, float]
    least: float
    greatest: float
    phase_deg: float
    crossover_hz: float | None = None
    measured_phase_deg: float | None = None
    measured_gain: float | None = None


@dataclass(frozen=True, slots=True)
class DriveTuning:
    """Result of measuring an axis in mode cst or csv while it moves, and proposed gains of its loop.

    Attributes:
        measured: in mode cst inertia [kg·m²], friction [N·m], viscous [N·m·s/rad], load [N·m], explained
            and uncertainty [1]; in mode csv scale [1], lag and uncertainty [s].
        said: the same in words.
        loops: the loop with the gains of the machine file, then with the proposed ones.
        changes: lines to change in the machine file; empty: its gains fit.
        remedy: how to apply the changes.
        frequency_hz: open-loop response with the gains of the machine file, as measured; empty: not
            known.
        gain_db: open-loop response with the gains of the machine file, as measured; empty: not known.
        phase_deg: open-loop response with the gains of the machine file, as measured; empty: not known.
    """

    axis: int
    mode: LoopMode
    measured: dict[str, float]
    said: str
    loops: tuple[TunedLoop, ...]
    changes: tuple[str, ...]
    remedy: str
    frequency_hz: tuple[float, ...]
    gain_db: tuple[float, ...]
    phase_deg: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class DrivesHealthReply:
    """By bus."""

    buses: tuple[BusHealth, ...]


@dataclass(frozen=True, slots=True)
class DrivesReply:
    """By axis; empty if no drive is on a bus."""

    drives: tuple[DriveInfo, ...]


@dataclass(frozen=True, slots=True)
class DrivesScanReply:
    """By bus; each with a machine file to start from."""

    buses: tuple[BusScan, ...]


@dataclass(frozen=True, slots=True)
class ErrorReply:
    """Payload of every ``reply_err``.

    Attributes:
        details: what the code's entry in docs/wire/errors.md lists, such as ``expected``.
        diagnostics: faults of G-code, if the error concerns lines.
    """

    code: str
    message: str
    hint: str = ""
    details: dict[str, Any] = field(default_factory=dict)
    diagnostics: tuple[Diagnostic, ...] = ()


@dataclass(frozen=True, slots=True)
class LineReport:
    """Time of one line that has ended.

    Attributes:
        start_s: executor time [s].
        end_s: executor time [s].
        requested_s: None if the line requests no time.
        stretched_by: actual / requested; None without a requested time.
        bound_by: the limit that stretched it, such as ``axis 2 acceleration``.
    """

    line: int
    start_s: float
    end_s: float
    requested_s: float | None = None
    stretched_by: float | None = None
    bound_by: str | None = None


@dataclass(frozen=True, slots=True)
class ProbeStatus:
    """The last probing move that has ended (G38.2 to G38.5).

    Attributes:
        tripped: the probe changed.
        positions: where the axes were then, else where the move ended, by number [mm, deg]: machine
            positions, independent of the program's offsets.
        t: executor time [s].
    """

    program: str
    line: int
    tripped: bool
    positions: dict[str, float]
    t: float


@dataclass(frozen=True, slots=True)
class Event:
    """Payload of ``event``; ``seq`` has no gap within one ``instance``.

    Times ``t`` of two instances cannot be compared.

    Attributes:
        t: executor time [s].
        kind: determines which of the others are set (docs/wire/events.md).
        line: the last line started for ``lines.started``; the line of a fault.
        lines: for ``lines.ended``.
        reason: why a program ended, an emergency stop's reason, a warning's code, a drive's or bus's
            code.
        axis: of a drive's event, or of homing.
        probe: for ``probe``.
        wall: Unix time of ``t``, by the clock as it went then [s].
    """

    seq: int
    t: float
    instance: str
    kind: EventKind
    program: str | None = None
    client: str | None = None
    state: ProgramState | None = None
    line: int = 0
    lines: tuple[LineReport, ...] = ()
    fault: Fault | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    reason: str = ""
    message: str = ""
    percent: float | None = None
    axis: int | None = None
    probe: ProbeStatus | None = None
    wall: float = 0.0


@dataclass(frozen=True, slots=True)
class EventsReply:
    """``oldest`` is the first number that the server still holds; ``newest`` the last one published."""

    instance: str
    oldest: int
    newest: int
    events: tuple[Event, ...]


@dataclass(frozen=True, slots=True)
class Extent:
    """Least and greatest setpoint of an axis [mm or deg], and its greatest speed [mm/s or deg/s].

    Attributes:
        turns: the axis turns continuously at a speed (G1030): its positions are not bounded.
    """

    axis: int
    low: float
    high: float
    unit: str
    speed: float = 0.0
    turns: bool = False


@dataclass(frozen=True, slots=True)
class HomeReply:
    """The program that homes, for ``abort``, and its axes in the order of their homing."""

    program: str
    axes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ToolInfo:
    """One tool of G01 … Tn.

    Attributes:
        work: the frame of its poses; empty: the base.
    """

    number: int
    frame: str
    axes: tuple[int, ...]
    orientation: bool
    euler: str
    work: str = ""


@dataclass(frozen=True, slots=True)
class TelemetryInfo:
    """How to read ``tele/batch``: its columns, its fields and the maximum of cycles in a message."""

    axes: tuple[int, ...]
    fields: tuple[str, ...]
    cycles_a_message: int
    state_hz: float


@dataclass(frozen=True, slots=True)
class LimitsInfo:
    """Bounds of the service."""

    max_line_length: int
    max_lines_a_message: int
    queue_lines: int
    programs_at_once: int
    open_programs: int
    remembered_answers: int
    remembered_answer_s: float


@dataclass(frozen=True, slots=True)
class InputInfo:
    """One input.

    Attributes:
        number: within its kind, as M66 names it.
        source: of a real input; empty: it is simulated.
        hold: it can hold the programs, or stop the machine.
        stop: it can hold the programs, or stop the machine.
    """

    name: str
    number: int
    kind: ChannelKind
    unit: str = ""
    source: str = ""
    hold: bool = False
    stop: bool = False


@dataclass(frozen=True, slots=True)
class OutputInfo:
    """One output.

    Attributes:
        number: within its kind, as M62 to M68 name it.
        target: of a real output; empty: it is simulated.
        min: least and greatest value.
        max: least and greatest value.
        safe: its value once its setter is lost; None: it stays.
    """

    name: str
    number: int
    kind: ChannelKind
    unit: str = ""
    target: str = ""
    min: float = 0.0
    max: float = 1.0
    safe: float | None = None


@dataclass(frozen=True, slots=True)
class Info:
    """Reply of ``info``.

    Attributes:
        protocol: versions of this key space that the server speaks.
        instance: one start of the server; a different one means that earlier programs were interrupted.
        epoch: Unix time of executor time 0, by the clock as it goes now [s].
        buttons: programs of the machine file that operators start, with places for numbers.
        group: by which people find the machine.
        tags: by which people find the machine.
        camera: address of a still picture or of MJPEG; empty: none.
        orders_from: instruments that may command, such as ``opcua``; others only show the machine.
    """

    machine: str
    server: str
    protocol: tuple[int, ...]
    instance: str
    epoch: float
    cycle_s: float
    axes: tuple[AxisInfo, ...]
    tools: tuple[ToolInfo, ...]
    telemetry: TelemetryInfo
    limits: LimitsInfo
    methods: tuple[str, ...]
    inputs: tuple[InputInfo, ...] = ()
    outputs: tuple[OutputInfo, ...] = ()
    buttons: tuple[ButtonInfo, ...] = ()
    group: str = ""
    tags: tuple[str, ...] = ()
    camera: str = ""
    orders_from: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class InputStatus:
    """An input: its value (digital: 0, 1), and whether it holds the programs or stops the machine now."""

    name: str
    value: float
    holds: bool = False
    stops: bool = False


@dataclass(frozen=True, slots=True)
class JogReply:
    """The jog's program id: for ``abort``, and for keeping it alive."""

    program: str


@dataclass(frozen=True, slots=True)
class Judged:
    """An assertion as the run keeps to it.

    Attributes:
        what: of the assertion.
        of: of the assertion.
        least: of the assertion.
        most: of the assertion.
        holds: whether the run keeps to it.
        value: the extreme that counts; None: bodies stay farther apart than is reported.
        time_s: when and in which line it has this value, or leaves the bounds of a position or speed.
        line: when and in which line it has this value, or leaves the bounds of a position or speed.
    """

    what: Quantity
    of: str
    least: float | None
    most: float | None
    holds: bool
    value: float | None
    time_s: float
    line: int


@dataclass(frozen=True, slots=True)
class MachineFileReply:
    """.

    Attributes:
        name: of the file, without its folder.
        text: as it is on the disk now.
        sha256: of that text.
        in_force: the server runs with this text; otherwise it has changed since the start.
    """

    name: str
    text: str
    sha256: str
    in_force: bool


@dataclass(frozen=True, slots=True)
class ServoStatus:
    """The targets of a program in servo mode, counted since it was opened.

    Attributes:
        taken: messages accepted.
        lost: numbers that never came, or came after later ones.
        late: came after their validity.
        doubled: repeated the newest number, or had a lower one.
        reordered: repeated the newest number, or had a lower one.
        jumped: too far from the previous point, and not confirmed by the next one.
        refused: not finite, not of the program's axes, or a pose that the tool cannot reach.
        clipped: of those taken, beyond an axis's travel.
        slowed: of those taken, faster than a tool's axes can go.
        interval_s: between messages, by the sender's clock.
        age_s: of the newest one, beyond the quickest.
    """

    taken: int
    lost: int
    late: int
    doubled: int
    reordered: int
    jumped: int
    refused: int
    clipped: int
    slowed: int
    interval_s: float
    age_s: float


@dataclass(frozen=True, slots=True)
class ProgramStatus:
    """One program.

    Attributes:
        line: the line being run, at a pause the one that asks for it; 0: none yet.
        progress: share of its time that has passed, 0 … 1; if `duration_s` is unknown, of its lines.
        opened_at: Unix time [s].
        eta_s: until its end at its override [s]; if `duration_s` is unknown, until the end of what is
            planned.
        ended_at: Unix time [s].
        duration_s: of the whole program at 100 %, as its text was simulated [s]; None: not simulated.
        notice: its last message to the operator; while it is paused, what to do before it is resumed.
        simulated: share of its lines that the simulation has reached; below 1 `duration_s` is an estimate
            from the lines so far.
        pauses: how many of its remaining lines wait for an operator, as far as simulated; `eta_s`
            excludes these waits.
        waits_for: the input that M66, or a code of ``[dialect.waits]``, waits for, the inputs that hold
            it (docs/io.md), or the program that must leave first (docs/clearance.md); empty: none.
        rejections: as in `Ack`; 0 in programs of an earlier start of the server.
        servo: of a program in servo mode; None: it is not in servo mode.
        reason: as in `Ack`.
        block_delete: as in `OpenRequest`; None: a program of an earlier start of the server
            (`continuation` reports them).
        optional_stop: as in `OpenRequest`; None: a program of an earlier start of the server
            (`continuation` reports them).
    """

    program: str
    state: ProgramState
    client: str
    name: str
    axes: tuple[int, ...]
    start_line: int
    line: int
    accepted: int
    done: int
    credit: int
    closed: bool
    override: float
    progress: float
    opened_at: float
    eta_s: float | None = None
    fault: Fault | None = None
    rejected: int = 0
    diagnostics: tuple[Diagnostic, ...] = ()
    resume_of: str | None = None
    ended_at: float | None = None
    duration_s: float | None = None
    notice: str = ""
    simulated: float = 1.0
    pauses: int = 0
    waits_for: str = ""
    rejections: int = 0
    servo: ServoStatus | None = None
    reason: str = ""
    block_delete: bool | None = None
    optional_stop: bool | None = None


@dataclass(frozen=True, slots=True)
class ToolPose:
    """Where a tool's frame is: ``[x, y, z]`` in mm, ``[a, b, c]`` in deg."""

    number: int
    position: tuple[float, ...]
    orientation: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class OutputStatus:
    """An output: its value (digital: 0, 1), and who set it last: a program's id, ``operator`` or nobody
    (empty).
    """

    name: str
    value: float
    set_by: str = ""


@dataclass(frozen=True, slots=True)
class WorkOffset:
    """The origin of a work coordinate system.

    Attributes:
        system: such as ``G54``.
        origin: where the axes read zero, by number [mm, deg]; an axis that is omitted reads as the
            machine does.
        rotation: angle by which X and Y are turned about Z, counter-clockwise (G10 L2 R) [deg]: a single
            axis does not determine what they read then.
    """

    system: str
    origin: dict[str, float]
    rotation: float = 0.0


@dataclass(frozen=True, slots=True)
class MountedTool:
    """A tool that has a body and is mounted, according to a program.

    Attributes:
        spindle: it is the cutter in the spindle, with ``length`` and ``diameter`` of the tool table [mm];
            otherwise both are 0.
    """

    number: int
    spindle: bool
    length: float
    diameter: float


@dataclass(frozen=True, slots=True)
class MachineStatus:
    """Payload of ``tele/state`` and reply of ``status``.

    Attributes:
        t: executor time [s].
        wall: Unix time of ``t`` [s].
        override: machine-wide feed override [%].
        late_cycles: cycles that began too late, since the start.
        inputs: those of the machine file, in the order of ``info``.
        outputs: those of the machine file, in the order of ``info``.
        work_offsets: systems that were set, with which the next program starts (G54 is in force then).
        disk: how slow the disk under the journal is; None: it keeps up.
        mounted: tools that have bodies and are known to be mounted.
        bed_mesh: mesh in force where G29 probes one: none, that of the machine file, or the probed one;
            None: G29 does not probe.
    """

    t: float
    wall: float
    instance: str
    state: MachineState
    axes: AxesStatus
    programs: tuple[ProgramStatus, ...]
    faults: tuple[Fault, ...]
    override: float = 100.0
    late_cycles: int = 0
    tools: tuple[ToolPose, ...] = ()
    inputs: tuple[InputStatus, ...] = ()
    outputs: tuple[OutputStatus, ...] = ()
    probe: ProbeStatus | None = None
    work_offsets: tuple[WorkOffset, ...] = ()
    disk: DiskStatus | None = None
    mounted: tuple[MountedTool, ...] = ()
    bed_mesh: BedMeshState | None = None


@dataclass(frozen=True, slots=True)
class MeshInfo:
    """A mesh that the URDF names: ``name`` as written there; ``size`` in bytes, 0: it is not available."""

    name: str
    size: int


@dataclass(frozen=True, slots=True)
class ModelBody:
    """A body or zone of ``[clearance]``.

    Attributes:
        shape: ``box`` (of a zone too), ``cylinder``, ``capsule``, ``sphere``, ``mesh`` or ``cutter``.
        size_mm: edges of a box, radius and length of a round shape.
        at_mm: in the frame of its carrier, Rz(C)·Ry(B)·Rx(A).
        turned_deg: in the frame of its carrier, Rz(C)·Ry(B)·Rx(A).
        mesh: its index in `ModelReply.meshes`; the file is in mm.
        link: of the URDF that carries it.
        carried_by: axes that carry it instead
        directions: of these, 0 to 2 for X to Z.
        opposite: in their negative direction. Neither: it is fixed.
        tool: with which it is mounted; None: it is always there.
        zone: ``keep_out``, ``keep_in`` or ``slow``; empty: a body.
        input: name of the input that switches it on; empty: it is always on.
        high: the input's level then.
    """

    name: str
    shape: str
    size_mm: tuple[float, ...]
    at_mm: tuple[float, ...]
    turned_deg: tuple[float, ...]
    mesh: int | None = None
    link: str = ""
    carried_by: tuple[int, ...] = ()
    directions: tuple[int, ...] = ()
    opposite: bool = False
    tool: int | None = None
    zone: str = ""
    input: str = ""
    high: bool = False


@dataclass(frozen=True, slots=True)
class ModelPart:
    """``data`` from ``offset`` on; ``size`` of the whole file."""

    offset: int
    size: int
    data: bytes


@dataclass(frozen=True, slots=True)
class ModelReply:
    """A robot's URDF, and the bodies and zones of a machine.

    Attributes:
        urdf: its text; empty: the machine has none.
        digest: of the text and the meshes.
        joints: the joint that each axis moves, by axis number.
        meshes: of the visuals, followed by those of bodies, in the order of `ModelMeshRequest.mesh`.
    """

    urdf: str
    digest: str
    joints: dict[str, str]
    meshes: tuple[MeshInfo, ...]
    bodies: tuple[ModelBody, ...] = ()


@dataclass(frozen=True, slots=True)
class OpenReply:
    """The program's id; ``expected`` is the next line number, ``credit`` how many lines fit now."""

    program: str
    state: ProgramState
    axes: tuple[int, ...]
    expected: int
    credit: int
    instance: str


@dataclass(frozen=True, slots=True)
class OverrideReply:
    """The override now in force [%]."""

    percent: float
    programs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ProgramsReply:
    """Newest first."""

    programs: tuple[ProgramStatus, ...]


@dataclass(frozen=True, slots=True)
class PutTextReply:
    """How much of the text has arrived: the next part begins at ``received``.

    Attributes:
        received: of the text [bytes].
        lines: in this part of it.
        complete: all of it has arrived.
    """

    received: int
    lines: int
    complete: bool


@dataclass(frozen=True, slots=True)
class RecordReply:
    """The recording's name."""

    name: str


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """The recorder.

    Attributes:
        held_s: of the black box in memory.
        held_bytes: of the black box in memory.
        missed_cycles: since the start; the recorder came too late for them.
        writing: names of the recordings under way.
    """

    held_s: float
    held_bytes: int
    missed_cycles: int
    writing: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """A recording on the server's disk.

    Attributes:
        name: without a suffix.
        kind: ``blackbox`` was written by itself or by ``record_save``.
        state: ``unfinished`` was left by a recorder that was killed, and is repaired at the next start.
        size: bytes.
        modified_at: Unix time [s].
    """

    name: str
    kind: RecordingKind
    state: RecordingState
    size: int
    modified_at: float


@dataclass(frozen=True, slots=True)
class RecordingPart:
    """Bytes of a recording from ``offset`` on; ``size`` is the whole file's."""

    name: str
    offset: int
    size: int
    data: bytes


@dataclass(frozen=True, slots=True)
class RecordingsReply:
    """The newest first; ``recorder`` None: it is not running.

    ``folder``: on the server's disk.
    """

    recordings: tuple[RecordingInfo, ...]
    recorder: RecorderStatus | None
    folder: str


@dataclass(frozen=True, slots=True)
class RunArmedReply:
    """The program that was started."""

    program: str
    override: float


@dataclass(frozen=True, slots=True)
class ToolPath:
    """Path of a tool; ``position``: lists of X, of Y and of Z at the moments of the `RunPath` [mm]."""

    tool: int
    position: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class RunPath:
    """Simulated path of a request, sampled at equal intervals, for a picture.

    Attributes:
        time_s: n moments after the start of the run [s].
        positions: for each axis of the request n setpoints [mm or deg].
        tools: paths of the tools that these axes move.
    """

    time_s: tuple[float, ...]
    positions: tuple[tuple[float, ...], ...]
    tools: tuple[ToolPath, ...]


@dataclass(frozen=True, slots=True)
class ToolExtent:
    """Least and greatest X, Y and Z of a tool's tip in the base frame [mm], and its greatest speed [mm/s]."""

    tool: int
    low: tuple[float, ...]
    high: tuple[float, ...]
    speed: float


@dataclass(frozen=True, slots=True)
class RunRequestStatus:
    """A request: what would move, how far, how long; ``remaining_s`` until it or its arming is over.

    Attributes:
        operator: who armed or rejected it.
        block_delete: those of the run, as in `OpenRequest`.
        optional_stop: those of the run, as in `OpenRequest`.
        number: a new one each time that the run is requested, even with the same text.
        reason: why it was rejected.
        effects: what the run leaves changed for later runs, a sentence each.
        tools: extents of the tools' tips.
        digest: SHA-256 of everything that the simulation read.
        changed: which of this has changed since, a sentence each; if there is any it cannot start.
        approval: hash of the approval for a while that has armed it; the run stays inside its envelope.
        beyond: what of the run is outside the envelope approved for its client, a sentence each.
        servo: it is approved for a while, for streamed targets, too.
    """

    sha256: str
    client: str
    name: str
    state: RunState
    axes: tuple[int, ...]
    duration_s: float
    extents: tuple[Extent, ...]
    remaining_s: float
    override: float
    operator: str
    block_delete: bool
    optional_stop: bool
    number: int = 0
    reason: str = ""
    effects: tuple[str, ...] = ()
    tools: tuple[ToolExtent, ...] = ()
    digest: str = ""
    changed: tuple[str, ...] = ()
    approval: str = ""
    beyond: tuple[str, ...] = ()
    servo: bool = False


@dataclass(frozen=True, slots=True)
class RunPreviewReply:
    """A request with its text and the path of its simulation.

    Attributes:
        certifiable: what ``mcserver certify`` signs of it, as JSON: the initial state of its simulation,
            and a digest of its setpoints.
        warnings: of its check and simulation, the first ones
        unshown_warnings: how many more there were.
    """

    run: RunRequestStatus
    text: str
    path: RunPath
    certifiable: str
    warnings: tuple[Diagnostic, ...] = ()
    unshown_warnings: int = 0


@dataclass(frozen=True, slots=True)
class RunRequestReply:
    """``ok`` false: the text has faults, and nothing waits.

    ``run``: what an operator is shown.
    """

    ok: bool
    diagnostics: tuple[Diagnostic, ...]
    run: RunRequestStatus | None = None


@dataclass(frozen=True, slots=True)
class RunRequestsReply:
    """The oldest first."""

    requests: tuple[RunRequestStatus, ...]


@dataclass(frozen=True, slots=True)
class SdoReply:
    """Value of an object that was read or written.

    Attributes:
        node: node number; on EtherCAT the position on the line.
        value: of the type ``bytes`` as hexadecimal text.
        raw: the transferred bytes, little endian.
        fieldbus: kind of the bus.
    """

    axis: int
    bus: str
    node: int
    index: int
    subindex: int
    type: SdoType
    value: Value
    raw: bytes
    fieldbus: Fieldbus = Fieldbus.CAN


@dataclass(frozen=True, slots=True)
class ServoReply:
    """The program that follows targets, sent as `StreamTargets` on ``in/{client}/{program}``; its axes in
    order.
    """

    program: str
    axes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class SetReply:
    """The value that an input or output has from the next cycle on."""

    name: str
    value: float


@dataclass(frozen=True, slots=True)
class TipPath:
    """Where a tool goes [mm]; ``tool`` None: the axes 0, 1 and 2 themselves."""

    tool: int | None
    points: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class SimulatedPath:
    """Points at equal distances along the axes' travel.

    Attributes:
        lines: the program's line at each point.
        tips: the points of each tool.
    """

    lines: tuple[int, ...]
    tips: tuple[TipPath, ...]


@dataclass(frozen=True, slots=True)
class SimulateReply:
    """What ``mcserver simulate --json`` prints.

    Attributes:
        lines: those that took time, by start.
        axes: by number as text.
        work_offsets: of the systems used or set.
        inputs: their values at the end, by name.
        outputs: their values at the end, by name.
        path: if it was requested.
        clearance: of a machine that names bodies.
        assertions: results of those of the request, in their order.
        difference: to the motion of `against`.
    """

    ok: bool
    duration_s: float
    feed_length_mm: float
    lines: tuple[LineReport, ...]
    axes: dict[str, AxisTravel]
    diagnostics: tuple[Diagnostic, ...]
    work_offsets: tuple[WorkOffset, ...] = ()
    inputs: dict[str, float] = field(default_factory=dict)
    outputs: dict[str, float] = field(default_factory=dict)
    path: SimulatedPath | None = None
    clearance: ClearanceReport | None = None
    assertions: tuple[Judged, ...] = ()
    difference: Difference | None = None


@dataclass(frozen=True, slots=True)
class SubmitReply:
    """Cumulative: lines through ``accepted`` are accepted, through ``done`` have ended; ``credit`` more fit.

    ``rejections``: how many the program has had.
    """

    program: str
    accepted: int
    done: int
    credit: int
    rejections: int = 0


@dataclass(frozen=True, slots=True)
class TableChange:
    """Who changed a row of the tables; what one program does to one row in turn is one change.

    Attributes:
        wall: Unix time [s].
        client: whose program it was.
        program: its id.
        name: of the program.
        row: ``G54`` to ``G59.3``, or ``T3``.
        before: by axis number, ``R`` of a turned system, or ``length`` and ``diameter`` [m, rad; in
            messages mm, deg]; empty: the row was not there. Or a tool's ``life`` and what it has ``used``
            [s; in messages min].
        after: by axis number, ``R`` of a turned system, or ``length`` and ``diameter`` [m, rad; in
            messages mm, deg]; empty: the row was not there. Or a tool's ``life`` and what it has ``used``
            [s; in messages min].
        was_called: its name before and after, where that was changed.
        called: its name before and after, where that was changed.
    """

    wall: float
    client: str
    program: str
    name: str
    row: str
    before: dict[str, float]
    after: dict[str, float]
    was_called: str = ""
    called: str = ""


@dataclass(frozen=True, slots=True)
class ToolRow:
    """A line of the tool table [mm], for G43.

    Attributes:
        changed: by G10 L1, so that it differs from the machine file.
        life_min: how long it may cut; 0: not set.
        used_min: how long it has cut, counted in G01 to G03 while its spindle turns.
    """

    number: int
    length: float
    diameter: float
    changed: bool = False
    name: str = ""
    life_min: float = 0.0
    used_min: float = 0.0


@dataclass(frozen=True, slots=True)
class Tables:
    """The tables that programs start with, and who changed them.

    Attributes:
        offsets: systems that were set; the others read zero at the machine's zero.
        tool_table: whether the machine's programs have one, with G43 and G10 L1.
        tools: in the order of their numbers.
        changes: the newest first.
        names: of systems, by system.
    """

    offsets: tuple[WorkOffset, ...]
    tool_table: bool
    tools: tuple[ToolRow, ...]
    changes: tuple[TableChange, ...]
    names: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ToolJogReply:
    """The jog's program, for ``abort`` and for keeping it alive.

    Attributes:
        obstacle: which joint ends the motion, and why, for people; empty: nothing within the tool's
            reach, or the jog was kept alive.
    """

    program: str
    obstacle: str = ""


@dataclass(frozen=True, slots=True)
class WriteMachineFileReply:
    """.

    Attributes:
        written: the new text is on the disk.
        before: name of the file that keeps the old one; empty: none.
        diagnostics: errors and warnings of the new text.
    """

    written: bool
    before: str
    diagnostics: tuple[Diagnostic, ...]
