"""Messages between the service and the planner's process: commands and events."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.clearance.mounted import Exchange
from mcserver.errors import Diagnostic
from mcserver.executor.entries import Control, ExecutorEvent
from mcserver.gcode.profiles.frame import Frame
from mcserver.machine.clearance_section import OPERATOR
from mcserver.machine.machine_file import Machine
from mcserver.planning.start_state import PauseEnd, StartState


class PlannerStart(msgspec.Struct, frozen=True):
    """Parameters of a planner's process, on its standard input.

    Attributes:
        memory: descriptor of the executor's memory.
        connection: descriptor of the stream socket to the server.
    """

    machine: Machine
    memory: int
    connection: int


# ---------------------------------------------------------------- commands


class PipelineRequest(msgspec.Struct, frozen=True):
    """Parameters of a program's pipeline.

    Attributes:
        axes: that the program may name. start: the state that it starts from.
        role: whose zones bind it. unhomed: it may move axes that are not homed, slowly.
        machine_coordinates: its lines are in positions of the axes, relative to the reference: a jog.
        approach: lines in machine coordinates that bring the axes to where its first line starts.
        controls: the entries of a program without lines, on a machine with clearance checks.
    """

    program: str
    axes: frozenset[int]
    start: StartState
    unhomed: bool = False
    machine_coordinates: bool = False
    approach: tuple[str, ...] = ()
    controls: tuple[Control, ...] = ()
    role: str = OPERATOR


class Begin(msgspec.Struct, frozen=True, tag=True):
    """Plan a program that has its lease, for an executor's slot that has been opened for it.

    Attributes:
        begun: executor time of the last cycle before it [s]: older events of the slot belong to others.
    """

    request: PipelineRequest
    slot: int
    step: bool
    begun: float

    @property
    def program(self) -> str:
        return self.request.program


class Lines(msgspec.Struct, frozen=True, tag=True):
    """Add journaled lines ``first``, ``first + 1``, …; lines of an earlier ``epoch`` are dropped."""

    program: str
    epoch: int
    first: int
    lines: Sequence[str]


class CloseProgram(msgspec.Struct, frozen=True, tag=True):
    """Finish the program after the lines sent so far."""

    program: str


class StepLine(msgspec.Struct, frozen=True, tag=True):
    """Release the next line of a program in single-line mode."""

    program: str


class EndPause(msgspec.Struct, frozen=True, tag=True):
    """Go on after a pause, from the present positions of the axes."""

    program: str
    end: PauseEnd


class HaltProgram(msgspec.Struct, frozen=True, tag=True):
    """Plan no further: the executor is stopping the program."""

    program: str


class DropProgram(msgspec.Struct, frozen=True, tag=True):
    """Forget the program: it has ended. `Dropped` answers it."""

    program: str


PlannerCommand = Begin | Lines | CloseProgram | StepLine | EndPause | HaltProgram | DropProgram


# ---------------------------------------------------------------- events


class ReportKind(enum.Enum):
    """Kinds of a pipeline's reports."""

    PLANNED = "planned"  # the line is being planned: `requested_s`, `feed_length` are known
    SOLVED = "solved"  # inverse kinematics has solved the line: `planning_s`
    BOUND = "bound"  # a limit has stretched the line: `bound_by`
    REJECTED = "rejected"  # a fault in the line; nothing of it moves, nothing after it is read
    FRAME = "frame"  # the line has set work offsets: `frame`
    CONTACT = "contact"  # the executor stands before what would touch: the program has to be stopped
    WAITING = "waiting"  # what comes next would touch what another program moves, and waits until it has left
    EXCHANGED = "exchanged"  # tools that have bodies are others from here on: `exchange`
    MESSAGE = "message"  # the line says something to the operator: `message`, and asks for `tool`
    FINISHED = "finished"  # all that was submitted has been handed over, the end of the program included


class Report(msgspec.Struct, frozen=True, gc=False):
    """One report of a pipeline about a line.

    Attributes:
        requested_s: requested time of the line [s], or None.
        bound_by: the limit that stretched it, such as ``axis 2 acceleration``, or None.
        feed_length: linear length of its G01-G03 commands [m].
        dwell_s: dwell, which no override changes [s].
        planning_s: time that inverse kinematics took [s].
        waits_for: the program that is waited for; empty: waiting has ended.
    """

    kind: ReportKind
    line: int
    requested_s: float | None = None
    bound_by: str | None = None
    feed_length: float = 0.0
    dwell_s: float = 0.0
    planning_s: float = 0.0
    diagnostics: tuple[Diagnostic, ...] = ()
    frame: Frame | None = None
    message: str = ""
    tool: int | None = None
    exchange: Exchange | None = None
    waits_for: str = ""


@dataclass(frozen=True, eq=False)
class PlannedLines:
    """`PLANNED` of lines in columns.

    Attributes:
        lines: their numbers, increasing, shape (n,). requested_s, feed_lengths: of each, as in `Report`.
    """

    lines: NDArray[np.int64]
    requested_s: NDArray[np.float64]
    feed_lengths: NDArray[np.float64]

    def reports(self) -> list[Report]:
        """Return the reports one by one."""
        columns = (self.lines.tolist(), self.requested_s.tolist(), self.feed_lengths.tolist())
        return [
            Report(ReportKind.PLANNED, line, requested_s=requested, feed_length=travel)
            for line, requested, travel in zip(*columns, strict=True)
        ]


class ProgramMessage(msgspec.Struct, frozen=True, tag=True):
    """A message of a line to the operator, due when the program reaches it; ``tool``: asks for that tool."""

    program: str
    line: int
    message: str
    tool: int | None = None


class FrameChanged(msgspec.Struct, frozen=True, tag=True):
    """A line has set work offsets, or changed the tool or the spindle."""

    program: str
    line: int
    frame: Frame


class Consumed(msgspec.Struct, frozen=True, tag=True):
    """The interpreter has read lines through ``through``: their place in the line buffer is free."""

    program: str
    through: int


class LineRejected(msgspec.Struct, frozen=True, tag=True):
    """A line is faulty. ``final``: the program ends there; else the same number is expected, corrected."""

    program: str
    epoch: int
    line: int
    diagnostics: tuple[Diagnostic, ...]
    final: bool


class ContactAhead(msgspec.Struct, frozen=True, tag=True):
    """The next motion would touch (``diagnostic``): the program stands before it and has to be stopped."""

    program: str
    diagnostic: Diagnostic


class WaitChanged(msgspec.Struct, frozen=True, tag=True):
    """A program waits for another one to leave, or (empty) no longer; ``diagnostic`` is to be shown."""

    program: str
    waits_for: str
    diagnostic: Diagnostic | None


class ToolsExchanged(msgspec.Struct, frozen=True, tag=True):
    """A program has exchanged tools that have bodies, where it stands."""

    program: str
    exchange: Exchange


class Planned(msgspec.Struct, frozen=True, tag=True):
    """Lines now have a time; ``reports`` in order."""

    program: str
    reports: Sequence[Report]


class Validated(msgspec.Struct, frozen=True, tag=True):
    """Lines through ``through`` are free of faults and planned; the plan ends at ``end_u`` [cycles]."""

    program: str
    through: int
    end_u: float


class ExecutorEvents(msgspec.Struct, frozen=True, tag=True):
    """Events of the executor, in order."""

    events: Sequence[ExecutorEvent]


class PlannerFailed(msgspec.Struct, frozen=True, tag=True):
    """Planning of a program failed, which has to be stopped; without a name, of all programs."""

    program: str
    message: str


class Dropped(msgspec.Struct, frozen=True, tag=True):
    """The program is forgotten: nothing is put into its slot any more."""

    program: str


PlannerEvent = (
    Consumed
    | LineRejected
    | ContactAhead
    | WaitChanged
    | FrameChanged
    | ProgramMessage
    | ToolsExchanged
    | Planned
    | Validated
    | ExecutorEvents
    | PlannerFailed
    | Dropped
)

OnPlannerEvents = Callable[[Sequence[PlannerEvent]], None]
