"""Every payload of the key space, typed: MessagePack maps unless a docstring says array.

The wire is defined here, in the files `*_messages.py` beside this one, and in the other modules that
`mcserver.net.schemas` lists, such as `mcserver.service.reports`. That module publishes it as JSON Schema, and
docs/keyspace.md and docs/wire explain it. Positions are in mm (linear axes) or deg
(rotary axes), velocities in mm/s or deg/s, torques in N·m, times in seconds since the executor's start.
Fields that are added later have a default, and a reader skips unknown fields, so the two sides may have
different versions.
"""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
from msgspec import Meta

from mcserver.errors import Edit as Edit
from mcserver.machine.clearance_section import RunRole
from mcserver.service.approach import Outputs
from mcserver.service.reports import Event, OnDisconnect, ProgramState, ProgramStatus, WireDiagnostic
from mcserver.service.tool_reach import ToolDirection, ToolFrame
from mcserver.simulation.assertions import MOST_ASSERTIONS, Assertion
from mcserver.simulation.assertions import Quantity as Quantity

PROTOCOL_VERSION = 1
ENCODING = "application/msgpack"

MAX_LINES_A_MESSAGE = 20_000
MAX_PATH_POINTS = 10_000

ProgramId = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,62}$")]
RequestId = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Sha256 = Annotated[str, Meta(pattern="^[0-9a-f]{1,64}$")]
Grace = Annotated[float, Meta(ge=0.0, le=600.0)]
LineNumber = Annotated[int, Meta(ge=1, le=2**53)]
Rejections = Annotated[int, Meta(ge=0, le=2**53)]
ChannelName = Annotated[str, Meta(max_length=40)]
AxisIndex = Annotated[int, Meta(ge=0, le=63)]


class ErrorReply(msgspec.Struct, frozen=True, omit_defaults=True):
    """Payload of every ``reply_err``.

    Attributes:
        details: what the code's entry in docs/wire/errors.md lists, such as ``expected``.
        diagnostics: faults of G-code, if the error concerns lines.
    """

    code: str
    message: str
    hint: str = ""
    details: dict[str, Any] = {}
    diagnostics: list[WireDiagnostic] = []


# ---------------------------------------------------------------- requests


class Request(msgspec.Struct, frozen=True, kw_only=True):
    """Fields of every request. The client is in the key, not here.

    Attributes:
        request: number that the client gives to this request; repeating the number returns the same answer.
            Required by methods that change something.
    """

    request: RequestId | None = None


class OpenRequest(Request, frozen=True, kw_only=True):
    """Opens a program.

    Attributes:
        name: for people: a file's name.
        axes: the axes to lease; None: all of the machine.
        on_disconnect: what happens when the client's liveliness token disappears, or it calls ``leave``.
        grace_s: how long the token may be absent before that; a client that returns in this time continues.
        start_line: number of the first line that will run.
        before: lines 1 … start_line - 1. They do not run; the axes move to where these lines end, energized,
            in the modal state that they leave.
        resume_of: id of an earlier program; its journaled lines before ``start_line`` serve as ``before``.
        step: single-line mode: a line starts only on a ``step`` call.
        block_delete: lines that begin with ``/`` are skipped, until the program ends; None: they are
            executed as if it were not there, but ``resume_of`` keeps its setting (D-98).
        optional_stop: whether M01 pauses; None: it does, but ``resume_of`` keeps its setting.
        hold: begin held; ``resume`` starts it.
        sha256: of the whole text; its times, from ``simulate`` or ``put_text``, are used for the program.
        at_pause: run now, also on axes of a program that is at a pause, such as to set zero with a new
            tool; refused (MC512) if it would have to wait. Without it a program waits for the other's end.
        way, outputs: of a start in the middle, as in `ContinueRequest`.
    """

    name: Annotated[str, Meta(max_length=200)] = ""
    axes: list[AxisIndex] | None = None
    on_disconnect: OnDisconnect = "stop"
    grace_s: Grace = 10.0
    start_line: LineNumber = 1
    before: list[str] = []
    resume_of: ProgramId | None = None
    step: bool = False
    hold: bool = False
    sha256: Sha256 | None = None
    at_pause: bool = False
    way: bool = False
    outputs: Outputs | None = None
    block_delete: bool | None = None
    optional_stop: bool | None = None


class OpenReply(msgspec.Struct, frozen=True):
    """The program's id; ``expected`` is the next line number, ``credit`` how many lines fit now."""

    program: str
    state: ProgramState
    axes: list[int]
    expected: int
    credit: int
    instance: str


class LeaveRequest(Request, frozen=True, kw_only=True):
    """The client leaves: its open programs end now as their ``on_disconnect`` says, without a grace time."""


class SubmitRequest(Request, frozen=True, kw_only=True):
    """Lines ``first``, ``first + 1``, …; without ``judge`` the reply does not wait for the verdict.

    ``rejections``: how many the client knows of; lines from before a rejection are refused. None: unknown,
    the lines are taken as current.
    """

    program: ProgramId
    first: LineNumber
    lines: Annotated[list[str], Meta(min_length=1, max_length=MAX_LINES_A_MESSAGE)]
    judge: bool = True
    rejections: Rejections | None = None


class SubmitReply(msgspec.Struct, frozen=True):
    """Cumulative: lines through ``accepted`` are accepted, through ``done`` have ended; ``credit`` more fit.

    ``rejections``: how many the program has had.
    """

    program: str
    accepted: int
    done: int
    credit: int
    rejections: int = 0


class StreamLines(msgspec.Struct, frozen=True, array_like=True):
    """Payload of ``in/{client}/{program}``, an array: ``[first line number, [lines], rejections]``.

    ``rejections``: as in `SubmitRequest`; may be omitted.
    """

    first: LineNumber
    lines: Annotated[list[str], Meta(max_length=MAX_LINES_A_MESSAGE)]
    rejections: Rejections | None = None


class CloseRequest(Request, frozen=True, kw_only=True):
    """No more lines will come; the accepted lines run to their end.

    ``last``: the last line that was sent; the program is only closed if it has been accepted.
    """

    program: ProgramId
    last: Annotated[int, Meta(ge=0)] | None = None


class ProgramRequest(Request, frozen=True, kw_only=True):
    """hold, resume, abort: one program, or every one (None)."""

    program: ProgramId | None = None


class StepRequest(Request, frozen=True, kw_only=True):
    """Starts the next line of a program in single-line mode."""

    program: ProgramId


class OverrideRequest(Request, frozen=True, kw_only=True):
    """Feed override of one program or of all, including future ones; 100 is as programmed."""

    percent: Annotated[float, Meta(ge=0.0, le=200.0)]
    program: ProgramId | None = None


class JogRequest(Request, frozen=True, kw_only=True):
    """Moves one axis by hand.

    Attributes:
        distance: from where it is, signed [mm, deg]; None: until stopped or the limit, by the sign of
        ``velocity``. velocity: [mm/s, deg/s]; None: a tenth of the axis's limit.
        hold_s: dead-man timeout: the axis stops unless the same jog is requested again within it; None: no
            timeout. A jog without distance always has one (default 0.5 s).
        program: id of the running jog that this request keeps alive.
        by: the person, if a client serves several: steps of one person follow each other, those of another
            person are refused (MC512) while the axis moves.
    """

    axis: AxisIndex
    distance: float | None = None
    velocity: float | None = None
    hold_s: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None
    program: ProgramId | None = None
    by: Annotated[str, Meta(max_length=100)] = ""


class ToolJogRequest(Request, frozen=True, kw_only=True):
    """Moves a tool's tip in a straight line, by all its joints, until it is stopped or cannot continue.

    Attributes:
        tool: number of the machine file. word: X Y Z to move along that axis of ``frame``, A B C to turn
            about it with the tip at rest. frame: the base, or the tool itself.
        velocity: of the tip [mm/s], of a turn [deg/s], signed. Near a singular position, and where a joint's
            limit is lower, it is slower.
        hold_s: dead-man timeout, as in ``jog`` (default 0.5 s). program: id of the running jog that this
            request keeps alive. by: the person, if a client serves several.
    """

    tool: int
    word: ToolDirection
    velocity: float
    frame: ToolFrame = "base"
    hold_s: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None
    program: ProgramId | None = None
    by: Annotated[str, Meta(max_length=100)] = ""


class HomeRequest(Request, frozen=True, kw_only=True):
    """Finds the references of axes, those with the lowest order first; None: of all that have a method."""

    axes: Annotated[list[AxisIndex], Meta(min_length=1)] | None = None


class ReferenceRequest(Request, frozen=True, kw_only=True):
    """Sets the positions of axes, by number as text [mm, deg]; nothing moves."""

    positions: dict[str, float]


class ResetRequest(Request, frozen=True, kw_only=True):
    """Clears a latched fault or emergency stop; axes stay de-energized until captured (G1010)."""

    axes: list[AxisIndex] | None = None


class EstopRequest(Request, frozen=True, kw_only=True):
    """Emergency stop by rpc, and payload of the key ``estop`` (where it may be empty).

    Attributes:
        request: on the key ``estop``, a random number from 2^32 on that all copies of one stop share: copies
            that come within 10 s do not stop anything again, even after a reset.
        reason: for people.
        client: on the key ``estop``, who stops, by its own account; a call has it in its key.
    """

    reason: Annotated[str, Meta(max_length=200)] = ""
    client: Annotated[str, Meta(max_length=63)] = ""


class SetOutputRequest(Request, frozen=True, kw_only=True):
    """Sets an output by its name; digital: true and false, or 1 and 0."""

    output: ChannelName
    value: bool | float


class SetInputRequest(Request, frozen=True, kw_only=True):
    """Sets a simulated input by its name, like `SetOutputRequest`; its script ends."""

    input: ChannelName
    value: bool | float


class CheckRequest(Request, frozen=True, kw_only=True):
    """Every fault of a program's text; nothing runs.

    Attributes:
        text: the whole text; or sha256: of one that was uploaded by ``put_text``.
        positions: start the axes there [mm, deg].
        block_delete, optional_stop: as of `OpenRequest`.
    """

    text: str | None = None
    positions: dict[str, float] | None = None
    sha256: Sha256 | None = None
    block_delete: bool | None = None
    optional_stop: bool | None = None


class SimulateRequest(Request, frozen=True, kw_only=True):
    """Runs a program's text on a virtual clock and simulated drives.

    Attributes:
        positions: start the axes there [mm, deg]; None: where the machine file starts simulated drives.
        path_points: maximum number of points in the reply's `path`; 0: no path.
        lines: whether the reply has the times of every line.
        assertions: are judged on every setpoint; one that does not hold is a fault (MC330).
        against: another program's text, from the same start: the reply has the `difference` to its motion.
        role: whose run it is: `agent`, one that a person approves, or `operator`, any other; zones of
            the other role do not count. None: all zones count.
        block_delete, optional_stop: as of `OpenRequest`.
    """

    text: str
    positions: dict[str, float] | None = None
    path_points: Annotated[int, Meta(ge=0, le=MAX_PATH_POINTS)] = 0
    lines: bool = True
    assertions: Annotated[list[Assertion], Meta(max_length=MOST_ASSERTIONS)] = []
    against: str | None = None
    role: RunRole | None = None
    block_delete: bool | None = None
    optional_stop: bool | None = None


class InfoRequest(Request, frozen=True, kw_only=True):
    """What the machine and its service are: an `Info`."""


class StatusRequest(Request, frozen=True, kw_only=True):
    """The whole machine's state now: a `MachineStatus`."""


class ProgramsRequest(Request, frozen=True, kw_only=True):
    """The programs that the server knows, the newest first.

    Attributes:
        program: only this one. ended: those that have ended too.
    """

    program: ProgramId | None = None
    ended: bool = True
    limit: Annotated[int, Meta(ge=1, le=1000)] = 100


class EventsRequest(Request, frozen=True, kw_only=True):
    """Events that the server still holds, from number ``since`` on, oldest first."""

    since: Annotated[int, Meta(ge=0)] = 0
    limit: Annotated[int, Meta(ge=1, le=1000)] = 500


# ---------------------------------------------------------------- replies and state


class Done(msgspec.Struct, frozen=True):
    """Reply of methods that return no data: the programs concerned."""

    programs: list[str]


class CloseReply(msgspec.Struct, frozen=True):
    """``accepted``: the last line that will run."""

    program: str
    accepted: int
    done: int
    state: ProgramState


class OverrideReply(msgspec.Struct, frozen=True):
    """The override now in force [%]."""

    percent: float
    programs: list[str]


class SetReply(msgspec.Struct, frozen=True):
    """The value that an input or output has from the next cycle on."""

    name: str
    value: float


class JogReply(msgspec.Struct, frozen=True):
    """The jog's program id: for ``abort``, and for keeping it alive."""

    program: str


class ToolJogReply(msgspec.Struct, frozen=True):
    """The jog's program, for ``abort`` and for keeping it alive.

    Attributes:
        obstacle: which joint ends the motion, and why, for people; empty: nothing within the tool's reach, or
            the jog was kept alive.
    """

    program: str
    obstacle: str = ""


class HomeReply(msgspec.Struct, frozen=True):
    """The program that homes, for ``abort``, and its axes in the order of their homing."""

    program: str
    axes: list[int]


class CheckReply(msgspec.Struct, frozen=True):
    """As ``mcserver check --json``."""

    ok: bool
    diagnostics: list[WireDiagnostic]


class ProgramsReply(msgspec.Struct, frozen=True):
    """Newest first."""

    programs: list[ProgramStatus]


class TelemetryBlock(msgspec.Struct, frozen=True, array_like=True):
    """Payload of ``tele/batch`` and ``tele/axis/{i}``, an array: ``[seq, t, bin]``.

    Attributes:
        seq: number of the first row's cycle, counted from the executor's start.
        t: executor time of the first row [s]; rows are a cycle apart.
        rows: float32, little endian, shape (rows, axes, fields) in C order, with the axes and fields that
            ``info`` lists under ``telemetry`` (one axis for ``tele/axis/{i}``).
    """

    seq: int
    t: float
    rows: bytes


# ---------------------------------------------------------------- events


class EventsReply(msgspec.Struct, frozen=True):
    """``oldest`` is the first number that the server still holds; ``newest`` the last one published."""

    instance: str
    oldest: int
    newest: int
    events: list[Event]
