"""What the server tells, as plain values (docs/keyspace.md).

Positions are in mm (linear axes) or deg (rotary axes), velocities in mm/s or deg/s, torques in N·m, times in
seconds since the executor's start, percentages in %.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

ProgramState = Literal[
    "queued",
    "running",
    "held",
    "paused",
    "ending",
    "finished",
    "aborted",
    "rejected",
    "faulted",
    "interrupted",
]
OnDisconnect = Literal["finish", "stop"]
ENDED: frozenset[str] = frozenset({"finished", "aborted", "rejected", "faulted", "interrupted"})


@dataclass(frozen=True, slots=True)
class Edit:
    """A certain remedy: characters ``column`` to ``end_column`` of the line become ``text``."""

    column: int
    end_column: int
    text: str


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One fault of a program, placed in its text; columns are code points from 1, the end exclusive."""

    code: str
    message: str
    line: int = 0
    column: int = 0
    end_column: int = 0
    hint: str = ""
    severity: str = "error"
    tool: int | None = None
    residual_mm: float | None = None
    axis: int | None = None
    edit: Edit | None = None


@dataclass(frozen=True, slots=True)
class Fault:
    """What stopped motion; ``axis`` and ``line`` where they apply."""

    code: str
    message: str
    hint: str = ""
    axis: int | None = None
    line: int = 0
    program: str | None = None
    t: float = 0.0


@dataclass(frozen=True, slots=True)
class Ack:
    """Cumulative acknowledgement of a program's lines: the last one counts.

    ``rejections``: how many lines have been rejected so far; one with a smaller count is older.
    """

    program: str
    accepted: int
    done: int
    credit: int
    state: str
    rejected: int = 0
    diagnostics: tuple[Diagnostic, ...] = ()
    fault: Fault | None = None
    expected: int = 0
    rejections: int = 0


@dataclass(frozen=True, slots=True)
class ProgramStatus:
    """One program.

    ``duration_s`` is known once its text was simulated; then ``progress`` is the share of its time and
    ``eta_s`` the time to its end. Without it they are the share of its lines and the time to the end of what
    is planned. ``simulated`` is the share of its lines that the simulation has reached: below 1 the times are
    estimated by the lines so far. ``pauses``: lines to come that wait for an operator, which ``eta_s`` leaves
    out.
    """

    program: str
    state: str
    client: str = ""
    name: str = ""
    axes: tuple[int, ...] = ()
    start_line: int = 1
    line: int = 0
    accepted: int = 0
    done: int = 0
    credit: int = 0
    closed: bool = False
    override: float = 100.0
    progress: float = 0.0
    eta_s: float | None = None
    fault: Fault | None = None
    rejected: int = 0
    diagnostics: tuple[Diagnostic, ...] = ()
    resume_of: str | None = None
    opened_at: float = 0.0
    ended_at: float | None = None
    duration_s: float | None = None
    notice: str = ""
    simulated: float = 1.0
    pauses: int = 0
    rejections: int = 0


@dataclass(frozen=True, slots=True)
class AxesStatus:
    """All axes, column-wise: each tuple has one entry for each of ``index``.

    ``homed``: whether an axis knows where it is; those without ``[axis.homing]`` always do.
    """

    index: tuple[int, ...] = ()
    position: tuple[float, ...] = ()
    setpoint: tuple[float, ...] = ()
    velocity: tuple[float, ...] = ()
    torque: tuple[float, ...] = ()
    state: tuple[str, ...] = ()
    homed: tuple[bool, ...] = ()


@dataclass(frozen=True, slots=True)
class ProbeStatus:
    """How the last probing move ended; positions of axes by number [mm, deg]."""

    program: str
    line: int
    tripped: bool
    positions: dict[str, float]
    t: float


@dataclass(frozen=True, slots=True)
class WorkOffset:
    """The origin of a work coordinate system such as ``G54``, by axis number [mm, deg]."""

    system: str
    origin: dict[str, float]


@dataclass(frozen=True, slots=True)
class ToolPose:
    """Where a tool's frame is: [x, y, z] in mm, [a, b, c] in deg."""

    number: int
    position: tuple[float, ...]
    orientation: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class InputStatus:
    """An input: its value (digital: 0, 1), and whether it holds the programs or stops the machine now."""

    name: str
    value: float
    holds: bool = False
    stops: bool = False


@dataclass(frozen=True, slots=True)
class OutputStatus:
    """An output: its value, and who has set it last: a program's id, ``operator`` or nobody (empty)."""

    name: str
    value: float
    set_by: str = ""


@dataclass(frozen=True, slots=True)
class MachineStatus:
    """The whole machine; ``state`` is ``ready``, ``fault`` or ``estop``, the latter two latched until
    reset.
    """

    t: float
    wall: float
    instance: str
    state: str
    axes: AxesStatus
    programs: tuple[ProgramStatus, ...] = ()
    faults: tuple[Fault, ...] = ()
    override: float = 100.0
    late_cycles: int = 0
    tools: tuple[ToolPose, ...] = ()
    inputs: tuple[InputStatus, ...] = ()
    outputs: tuple[OutputStatus, ...] = ()
    probe: ProbeStatus | None = None
    work_offsets: tuple[WorkOffset, ...] = ()


@dataclass(frozen=True, slots=True)
class LineReport:
    """Time of one line that has ended; ``stretched_by`` is actual / requested, ``bound_by`` the limit at
    fault.
    """

    line: int
    start_s: float
    end_s: float
    requested_s: float | None = None
    stretched_by: float | None = None
    bound_by: str | None = None


@dataclass(frozen=True, slots=True)
class Event:
    """One event; ``kind`` says which fields are set (docs/wire/events.md)."""

    seq: int
    t: float
    instance: str
    kind: str
    program: str | None = None
    client: str | None = None
    state: str | None = None
    line: int = 0
    lines: tuple[LineReport, ...] = ()
    fault: Fault | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    reason: str = ""
    message: str = ""
    percent: float | None = None
    axis: int | None = None
    probe: ProbeStatus | None = None


@dataclass(frozen=True, slots=True)
class AxisInfo:
    """One axis; limits in mm or deg and seconds, None where not limited."""

    index: int
    type: str
    unit: str
    max_velocity: float = 0.0
    max_acceleration: float = 0.0
    drive: str = ""
    max_jerk: float | None = None
    min_position: float | None = None
    max_position: float | None = None
    in_position: float = 0.0
    homing: str | None = None


@dataclass(frozen=True, slots=True)
class ToolInfo:
    """One tool of G01 … Tn."""

    number: int
    frame: str
    axes: tuple[int, ...] = ()
    orientation: bool = False
    euler: str = "ZYX"


@dataclass(frozen=True, slots=True)
class TelemetryInfo:
    """Columns and fields of the samples."""

    axes: tuple[int, ...] = ()
    fields: tuple[str, ...] = ()
    cycles_a_message: int = 10
    state_hz: float = 20.0


@dataclass(frozen=True, slots=True)
class InputInfo:
    """One input; ``number`` is of its kind, ``source`` empty where it is simulated."""

    name: str
    number: int
    kind: str
    unit: str = ""
    source: str = ""
    hold: bool = False
    stop: bool = False


@dataclass(frozen=True, slots=True)
class OutputInfo:
    """One output; ``number`` is of its kind, ``target`` empty where it is simulated, ``safe`` None: it
    stays."""

    name: str
    number: int
    kind: str
    unit: str = ""
    target: str = ""
    min: float = 0.0
    max: float = 1.0
    safe: float | None = None


@dataclass(frozen=True, slots=True)
class LimitsInfo:
    """Bounds of the service."""

    max_line_length: int = 8192
    max_lines_a_message: int = 20_000
    queue_lines: int = 0
    programs_at_once: int = 0
    open_programs: int = 0
    remembered_answers: int = 0
    remembered_answer_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Info:
    """The machine and the service; ``instance`` is one start of the server, ``epoch`` the Unix time of t =
    0.
    """

    machine: str
    server: str
    protocol: tuple[int, ...]
    instance: str
    epoch: float
    cycle_s: float
    axes: tuple[AxisInfo, ...] = ()
    tools: tuple[ToolInfo, ...] = ()
    telemetry: TelemetryInfo = field(default_factory=TelemetryInfo)
    limits: LimitsInfo = field(default_factory=LimitsInfo)
    methods: tuple[str, ...] = ()
    inputs: tuple[InputInfo, ...] = ()
    outputs: tuple[OutputInfo, ...] = ()


@dataclass(frozen=True, slots=True)
class MonitoredValue:
    """What the machine file shows of a drive (``monitor``); ``value`` None: none has come lately."""

    name: str
    value: int | float | bool | None = None
    index: int = 0
    subindex: int = 0


@dataclass(frozen=True, slots=True)
class ScannedNode:
    """One node that answers on a CAN bus: 1000h in words, 1018h, modes of 6502h, and whose drive it is."""

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


@dataclass(frozen=True, slots=True)
class BusScan:
    """Who is on one CAN bus; ``machine_file``: one to start from."""

    bus: str
    address: str
    nodes: tuple[ScannedNode, ...]
    machine_file: str


@dataclass(frozen=True, slots=True)
class DriveInfo:
    """One drive on a CAN bus.

    ``state`` is ``booting operational lost restarting failed closed``, ``nmt`` what its last heartbeat said,
    ``status`` its statusword in words, ``message`` why its configuration failed; ages are in seconds.
    """

    axis: int
    kind: str
    bus: str
    node: int
    state: str
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


SdoValue = bool | int | float | str


@dataclass(frozen=True, slots=True)
class SdoObject:
    """An object of a drive's dictionary, read or written; ``raw``: its bytes, little endian."""

    axis: int
    bus: str
    node: int
    index: int
    subindex: int
    type: str
    value: Any
    raw: bytes = b""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Every fault of a text; ``ok``: there is no error among them."""

    ok: bool
    diagnostics: tuple[Diagnostic, ...] = ()


@dataclass(frozen=True, slots=True)
class EventPage:
    """Events again, by number; ``oldest`` is the first that the server still has."""

    instance: str
    oldest: int
    newest: int
    events: tuple[Event, ...] = ()


@dataclass(frozen=True, slots=True)
class OpenedProgram:
    """Reply of ``open``."""

    program: str
    state: str
    axes: tuple[int, ...]
    expected: int
    credit: int
    instance: str = ""


@dataclass(frozen=True, slots=True)
class SubmitReply:
    """Reply of ``submit``, cumulative as `Ack`."""

    program: str
    accepted: int
    done: int
    credit: int
    rejections: int = 0


@dataclass(frozen=True, slots=True)
class ErrorReply:
    """Payload of an error reply."""

    code: str
    message: str
    hint: str = ""
    details: dict[str, Any] = field(default_factory=dict)
    diagnostics: tuple[Diagnostic, ...] = ()
