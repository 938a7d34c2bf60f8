"""What the service tells the planner, and what it hears of it; all of it can pass between processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import msgspec

from mcserver.errors import Diagnostic
from mcserver.executor.entries import ExecutorEvent
from mcserver.gcode.semantics.modal import ModalState
from mcserver.machine.machine_file import Machine
from mcserver.planning.pipeline_reports import Report

MAX_LINE_LENGTH = 8192


class PlannerStart(msgspec.Struct, frozen=True):
    """What the planner's process is told at its start.

    Attributes:
        memory: descriptor of the executor's memory. slots: of the executor.
        connection: descriptor of the connection to the server.
    """

    machine: Machine
    memory: int
    slots: int
    connection: int


class PipelineRequest(msgspec.Struct, frozen=True):
    """What a pipeline is made of.

    Attributes:
        axes: that the program may name. modal: state to start with; None: a program's own beginning.
    """

    program: str
    axes: frozenset[int]
    modal: ModalState | None = None


class Begin(msgspec.Struct, frozen=True, tag=True):
    """A program has its lease: it runs in ``slot``, which has been opened for it."""

    request: PipelineRequest
    slot: int
    step: bool


class Lines(msgspec.Struct, frozen=True, tag=True):
    """Journaled lines of a program; ``asked``: by a call, whose reply tells more than an acknowledgement."""

    program: str
    epoch: int
    first: int
    lines: Sequence[str]
    asked: bool


class Order(msgspec.Struct, frozen=True, tag=True):
    """``close``, ``step``, ``halt`` (plans no further, it is being stopped) or ``drop`` (forgets it)."""

    program: str
    what: str


Orders = Begin | Lines | Order


class Consumed(msgspec.Struct, frozen=True, tag=True):
    """Lines through ``through`` are in the pipeline: their place in the queue is free."""

    program: str
    through: int


class Rejected(msgspec.Struct, frozen=True, tag=True):
    """A line is faulty. ``final``: found while planning, the program ends there."""

    program: str
    epoch: int
    line: int
    diagnostics: tuple[Diagnostic, ...]
    final: bool


class Planned(msgspec.Struct, frozen=True, tag=True):
    """Lines that now have a time; ``reports`` in order."""

    program: str
    reports: Sequence[Report]


class Judged(msgspec.Struct, frozen=True, tag=True):
    """Lines through ``through`` are right and planned; what is planned ends at ``end_u`` [cycles]."""

    program: str
    through: int
    end_u: float


class Happened(msgspec.Struct, frozen=True, tag=True):
    """Events of the executor, in order."""

    events: Sequence[ExecutorEvent]


class Broken(msgspec.Struct, frozen=True, tag=True):
    """The planner made a mistake, or is gone; a program has to be stopped, all of them without a name."""

    program: str
    message: str


Outcome = Consumed | Rejected | Planned | Judged | Happened | Broken

Deliver = Callable[[list[Outcome]], None]


class Planner(Protocol):
    """Plans the programs of one machine: `mcserver.planning.planner_thread.PlannerThread` in this process,
    `mcserver.planning.client.PlannerProcess` in one of its own."""

    @property
    def seen(self) -> float:
        """When it was last at work [s of `time.monotonic`]."""

    def start(self) -> None: ...

    def order(self, order: Orders) -> None:
        """From any thread."""

    def stop(self) -> None:
        """Blocks until it has ended."""


class Planning(Protocol):
    """What plans a machine's programs: `mcserver.planning.client.ProcessPlanning`."""

    def modal_before(self, lines: Sequence[str]) -> ModalState:
        """Modal state after lines that are only read; from any thread. Raises ProgramRejected."""

    def planner(self, deliver: Deliver) -> Planner:
        """A planner that hands over what happened, in order, in a thread of its own."""
