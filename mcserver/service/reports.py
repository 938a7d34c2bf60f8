"""What the service reports: acknowledgements, states, line reports and events.

These are wire types too (`mcserver.net.messages` publishes them): MessagePack maps. Positions are in mm
(linear axes) or deg (rotary axes), velocities in mm/s or deg/s, torques in N·m, times in seconds since the
executor's start. Fields that are added later have a default.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from mcserver import errors
from mcserver.canopen.drive_events import CanopenEventKind

ProgramState = Literal[
    "queued",  # waits for its axes
    "running",
    "held",  # feed hold, along the path
    "paused",  # M00, M01
    "ending",  # closed or aborted: what is there still runs or stops
    "finished",  # everything accepted has been done
    "aborted",  # stopped by an operator, its client or its client's disappearance
    "rejected",  # ended at a line with a fault found while planning
    "faulted",  # ended by a fault of the machine
    "interrupted",  # the server that ran it went away
]
MachineState = Literal["ready", "fault", "estop"]
BedMeshState = Literal["off", "file", "probed"]
AxisState = Literal[
    "off", "starting", "standstill", "moving", "speed", "torque", "stopping", "released", "fault"
]
OnDisconnect = Literal["finish", "stop"]
ENDED: frozenset[ProgramState] = frozenset({"finished", "aborted", "rejected", "faulted", "interrupted"})
EventKind = Literal[
    "server.started",
    "server.stopping",
    "program.opened",
    "program.started",
    "program.held",
    "program.resumed",
    "program.paused",
    "program.message",
    "program.closed",
    "input.read",
    "program.ended",
    "lines.started",
    "lines.ended",
    "line.rejected",
    "fault",
    "warning",
    "estop",
    "reset",
    "override",
    "command",
    "client.gone",
    "recording",
    "axis.homing",
    "axis.homed",
    "axis.unhomed",
    "probe",
    CanopenEventKind,
]


class WireDiagnostic(errors.Diagnostic, frozen=True, omit_defaults=True):
    """One fault of a program, placed in its text; ``line`` is the client's line number."""


def wire_diagnostic(diagnostic: errors.Diagnostic) -> WireDiagnostic:
    """Return the wire's form of a diagnostic."""
    return WireDiagnostic(**msgspec.structs.asdict(diagnostic))


class Fault(msgspec.Struct, frozen=True, omit_defaults=True):
    """What stopped motion: a stable code, and the axis and line if they apply."""

    code: str
    message: str
    hint: str = ""
    axis: int | None = None
    line: int = 0
    program: str | None = None
    t: float = 0.0


class Ack(msgspec.Struct, frozen=True, omit_defaults=True):
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
        rejections: how many lines of the program have been rejected so far. An acknowledgement with a smaller
            count than an earlier one is older: its numbers are of lines that were discarded.
        reason: why it was aborted: by whom, or a code; empty in programs of an earlier start of the server.
    """

    program: str
    accepted: int
    done: int
    credit: int
    state: ProgramState
    rejected: int = 0
    diagnostics: list[WireDiagnostic] = []
    fault: Fault | None = None
    expected: int = 0
    rejections: int = 0
    reason: str = ""


class ServoStatus(msgspec.Struct, frozen=True):
    """The targets of a program in servo mode, counted since it was opened.

    Attributes:
        taken: messages accepted. lost: numbers that never came, or came after later ones.
        late: came after their validity. doubled, reordered: repeated the newest number, or had a lower one.
        jumped: too far from the previous point, and not confirmed by the next one.
        refused: not finite, not of the program's axes, or a pose that the tool cannot reach. clipped: of
            those taken, beyond an axis's travel. slowed: of those taken, faster than a tool's axes can go.
        interval_s: between messages, by the sender's clock. age_s: of the newest one, beyond the quickest.
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


class ProgramStatus(msgspec.Struct, frozen=True, omit_defaults=True):
    """One program.

    Attributes:
        line: the line being run, at a pause the one that asks for it; 0: none yet.
        progress: share of its time that has passed, 0 … 1; if `duration_s` is unknown, of its lines.
        eta_s: until its end at its override [s]; if `duration_s` is unknown, until the end of what is
            planned.
        notice: its last message to the operator; while it is paused, what to do before it is resumed.
        duration_s: of the whole program at 100 %, as its text was simulated [s]; None: not simulated.
        simulated: share of its lines that the simulation has reached; below 1 `duration_s` is an estimate
            from the lines so far.
        pauses: how many of its remaining lines wait for an operator, as far as simulated; `eta_s` excludes
            these waits.
        waits_for: the input that M66, or a code of ``[dialect.waits]``, waits for, the inputs that hold it
            (docs/io.md), or the program that must leave first (docs/clearance.md); empty: none.
        rejections: as in `Ack`; 0 in programs of an earlier start of the server. reason: as in `Ack`.
        servo: of a program in servo mode; None: it is not in servo mode.
        block_delete, optional_stop: as in `OpenRequest`; None: a program of an earlier start of the server
            (`continuation` reports them).
        opened_at, ended_at: Unix time [s].
    """

    program: str
    state: ProgramState
    client: str
    name: str
    axes: list[int]
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
    diagnostics: list[WireDiagnostic] = []
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


class AxesStatus(msgspec.Struct, frozen=True):
    """All axes, column-wise: every list has one entry for each of ``index``.

    Attributes:
        homed: whether the axis knows its position; axes without ``[axis.homing]`` always do.
        silent: whether the axis's drive does not answer: its position, velocity and torque are old. Empty
            while all answer.
        skew: how much the second drive of a gantry pair is further than its leader [mm, deg]; 0 for
            other axes. Empty on a machine without pairs.
    """

    index: list[int]
    position: list[float]
    setpoint: list[float]
    velocity: list[float]
    torque: list[float]
    state: list[AxisState]
    homed: list[bool] = []
    skew: list[float] = []
    silent: list[bool] = []


class ToolPose(msgspec.Struct, frozen=True):
    """Where a tool's frame is: ``[x, y, z]`` in mm, ``[a, b, c]`` in deg."""

    number: int
    position: list[float]
    orientation: list[float]


class InputStatus(msgspec.Struct, frozen=True):
    """An input: its value (digital: 0, 1), and whether it holds the programs or stops the machine now."""

    name: str
    value: float
    holds: bool = False
    stops: bool = False


class OutputStatus(msgspec.Struct, frozen=True):
    """An output: its value (digital: 0, 1), and who set it last: a program's id, ``operator`` or nobody
    (empty)."""

    name: str
    value: float
    set_by: str = ""


class ProbeStatus(msgspec.Struct, frozen=True):
    """The last probing move that has ended (G38.2 to G38.5).

    Attributes:
        tripped: the probe changed. positions: where the axes were then, else where the move ended, by number
            [mm, deg]: machine positions, independent of the program's offsets.
        t: executor time [s].
    """

    program: str
    line: int
    tripped: bool
    positions: dict[str, float]
    t: float


class WorkOffset(msgspec.Struct, frozen=True):
    """The origin of a work coordinate system.

    Attributes:
        system: such as ``G54``. origin: where the axes read zero, by number [mm, deg]; an axis
            that is omitted reads as the machine does.
        rotation: angle by which X and Y are turned about Z, counter-clockwise (G10 L2 R) [deg]: a single axis
            does not determine what they read then.
    """

    system: str
    origin: dict[str, float]
    rotation: float = 0.0


class DiskStatus(msgspec.Struct, frozen=True):
    """How slow the disk under the journal is.

    Attributes:
        since: Unix time from which on it is slow [s].
        commit_s: how long messages have waited for the journal's commit [s].
        sync_s: how long the current sync has taken [s]; a power cut loses what was committed in that time.
        worst_s: the longest of these since then [s].
    """

    since: float
    commit_s: float
    sync_s: float
    worst_s: float


class MountedTool(msgspec.Struct, frozen=True):
    """A tool that has a body and is mounted, according to a program.

    Attributes:
        spindle: it is the cutter in the spindle, with ``length`` and ``diameter`` of the tool table [mm];
            otherwise both are 0.
    """

    number: int
    spindle: bool
    length: float
    diameter: float


class MachineStatus(msgspec.Struct, frozen=True):
    """Payload of ``tele/state`` and reply of ``status``.

    Attributes:
        t: executor time [s]. wall: Unix time of ``t`` [s].
        override: machine-wide feed override [%].
        late_cycles: cycles that began too late, since the start.
        inputs, outputs: those of the machine file, in the order of ``info``.
        work_offsets: systems that were set, with which the next program starts (G54 is in force then).
        disk: how slow the disk under the journal is; None: it keeps up.
        mounted: tools that have bodies and are known to be mounted.
        bed_mesh: mesh in force where G29 probes one: none, that of the machine file, or the probed one; None:
            G29 does not probe.
    """

    t: float
    wall: float
    instance: str
    state: MachineState
    axes: AxesStatus
    programs: list[ProgramStatus]
    faults: list[Fault]
    override: float = 100.0
    late_cycles: int = 0
    tools: list[ToolPose] = []
    inputs: list[InputStatus] = []
    outputs: list[OutputStatus] = []
    probe: ProbeStatus | None = None
    work_offsets: list[WorkOffset] = []
    disk: DiskStatus | None = None
    mounted: list[MountedTool] = []
    bed_mesh: BedMeshState | None = None


class LineReport(msgspec.Struct, frozen=True, omit_defaults=True):
    """Time of one line that has ended.

    Attributes:
        start_s, end_s: executor time [s].
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


class Event(msgspec.Struct, frozen=True, omit_defaults=True):
    """Payload of ``event``; ``seq`` has no gap within one ``instance``.

    Times ``t`` of two instances cannot be compared.

    Attributes:
        t: executor time [s]. wall: Unix time of ``t``, by the clock as it went then [s].
        kind: determines which of the others are set (docs/wire/events.md).
        lines: for ``lines.ended``. line: the last line started for ``lines.started``; the line of a fault.
        reason: why a program ended, an emergency stop's reason, a warning's code, a drive's or bus's code.
        axis: of a drive's event, or of homing. probe: for ``probe``.
    """

    seq: int
    t: float
    instance: str
    kind: EventKind
    program: str | None = None
    client: str | None = None
    state: ProgramState | None = None
    line: int = 0
    lines: list[LineReport] = []
    fault: Fault | None = None
    diagnostics: list[WireDiagnostic] = []
    reason: str = ""
    message: str = ""
    percent: float | None = None
    axis: int | None = None
    probe: ProbeStatus | None = None
    wall: float = 0.0
