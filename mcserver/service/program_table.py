"""The programs of one machine, and what advances them: journal, leases, planner, executor events.

All methods run in the event loop, except `ProgramTable._call_soon`.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import msgspec

from mcserver.clearance.mounted import Mounted
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.modal import ModalState
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.machine.clearance_section import AGENT, OPERATOR, agent_role
from mcserver.machine.machine_digest import machine_digest
from mcserver.machine.machine_file import Machine
from mcserver.planning.client import PlannerProcess
from mcserver.planning.planner_messages import (
    Begin,
    CloseProgram,
    DropProgram,
    EndPause,
    HaltProgram,
    Lines,
    OnPlannerEvents,
    PipelineRequest,
)
from mcserver.planning.start_state import StartState
from mcserver.service.acknowledgements import AckSender
from mcserver.service.axis_reports import AxisReports
from mcserver.service.disk_watch import DiskWatch
from mcserver.service.event_log import EventLog
from mcserver.service.executor_port import ExecutorPort
from mcserver.service.executor_reports import ExecutorReports
from mcserver.service.fault_latch import FaultLatch
from mcserver.service.heartbeat import Heartbeat
from mcserver.service.journal import Journal
from mcserver.service.journal_repair import JournalLock, prepare_journal
from mcserver.service.leases import Grant, LeaseTable
from mcserver.service.line_queue import LineBatch
from mcserver.service.pauses import Pauses
from mcserver.service.planner_reports import PlannerReports
from mcserver.service.program import Program, Verdict, give
from mcserver.service.progress_reports import ProgressReports
from mcserver.service.references import References, references_file
from mcserver.service.reports import Ack, Event, Fault, ProgramState
from mcserver.service.reports import EventKind as Kind
from mcserver.service.service_options import ServiceOptions
from mcserver.service.start_of_programs import start_state
from mcserver.service.timebase import Timebase
from mcserver.service.work_offsets import WorkOffsets, offsets_file

log = logging.getLogger(__name__)

ENDED_PROGRAMS = 100
# Most lines from the journal in one message to the planner.
KNOWN_LINES = 10_000


class ProgramTable:
    """Holds the programs, and executes what the service has allowed.

    Attributes:
        programs: open ones and the last `ENDED_PROGRAMS` ended ones, oldest first.
        faults: latched until a reset. time: of this start.
        offsets: work coordinate systems and tools, which outlast programs and the server.
        references: of axes, which outlast the server. axis_reports: of homing and probing.
        executor: applies the executor's events. progress_reports: of lines that have run.
        pauses: of programs. mounted: tools with bodies, as programs have set them.
        journal_damage: found in the journal at this start; None: it is intact.
        journal_failure: why the journal cannot be written now; empty: it can.
    """

    def __init__(
        self,
        machine: Machine,
        port: ExecutorPort,
        planner: Callable[[OnPlannerEvents], PlannerProcess],
        options: ServiceOptions,
        *,
        on_ack: Callable[[Ack], None],
        on_event: Callable[[Event], None],
    ) -> None:
        self.port = port
        self._machine = machine
        self.options = options
        self.programs: dict[str, Program] = {}
        self.leases = LeaseTable()
        self.time = Timebase(port.epoch, options.clock, options.monotonic)
        self.faults = FaultLatch(self.time.now, self._record)
        self.journal_failure = ""
        self.events = EventLog(options.instance, self.time, on_event)
        self.acks = AckSender(on_ack)
        self._loop = asyncio.get_running_loop()
        self._lock = JournalLock(options.journal)
        try:
            self.journal_damage = prepare_journal(options.journal)
            self.journal = Journal(
                options.journal,
                call_soon=self._call_soon,
                on_failure=self._journal_state,
                connect=options.connect,
                threaded=options.journal_thread,
            )
        except BaseException:
            self._lock.release()
            raise
        self.progress_reports = ProgressReports(self._loop, self.journal, self.publish, self.acks.acknowledge)
        self.offsets = WorkOffsets(
            offsets_file(options.journal),
            machine.dialect.cutters,
            # before a line that changes them is done
            self.journal.beside,
        )
        self.references = References(references_file(options.journal), machine, self.journal.beside)
        self.axis_reports = AxisReports(machine.axes, self.references, self.events)
        self.mounted = Mounted()
        self.pauses = Pauses(machine, self.leases, self.programs, self.journal, self.start_state)
        self.disk = DiskWatch(self._loop, self.journal, self.events, options.clock)
        self.planner = planner(PlannerReports(self).take)
        # called for a stop that the executor has latched itself
        self.on_machine_stop: Callable[[Fault], None] = self.faults.latch
        # called once a program has ended
        self.on_program_ended: Callable[[Program], None] = lambda _program: None
        # digest of the machine file; see `machine_digest`
        self.machine_file = machine_digest(machine)
        self.executor = ExecutorReports(machine, self)
        self.heartbeat = Heartbeat(port.orders.beat, lambda: self.planner.last_seen)

    def start_state(self, modal: ModalState | None = None, switches: Switches = AS_WRITTEN) -> StartState:
        """Return the state from which a program would begin now."""
        frame, tool = self.offsets.frame(), self.offsets.tool
        found = start_state(self._machine, self.port.snapshot(), frame, modal, switches, tool)
        return msgspec.structs.replace(found, mesh=self.axis_reports.mesh)

    def _origin(self, switches: Switches) -> StartState:
        """Return the state to record for a program that begins now, for its continuation."""
        return msgspec.structs.replace(
            self.start_state(switches=switches),
            machine_file=self.machine_file,
            cutters=self._machine.dialect.cutters,
        )

    def close_journal(self) -> None:
        """Write the rest and close; blocks. Another server may then use the journal."""
        self.journal.close()
        self._lock.release()

    # ------------------------------------------------------------ life of a program

    def add(self, program: Program, before: Sequence[str], known: Sequence[str] = ()) -> None:
        """Journal a new program and queue it for its axes.

        Args:
            before: lines before the first one that runs. known: lines from that one on.
        """
        self.programs[program.program] = program
        self._forget_ended()
        self.journal.program_opened(
            program.program,
            instance=self.options.instance,
            client=program.client,
            name=program.name,
            axes=program.axes,
            start_line=program.start_line,
            on_disconnect=program.on_disconnect,
            resume_of=program.resume_of,
            at=program.opened_at,
            before=[*before, *known],
            sha256=program.sha256,
            by_hand=program.by_hand or bool(program.controls),
        )
        if program.switches != AS_WRITTEN:
            # it may never begin here: whoever continues it needs them
            self.journal.program_begun(program.program, program.origin or self._origin(program.switches))
        self.publish("program.opened", program, message=program.name)
        for at in range(0, len(known), KNOWN_LINES):
            taken = program.queue.take(program.start_line + at, known[at : at + KNOWN_LINES])
            assert isinstance(taken, LineBatch)
            command = Lines(program.program, program.epoch, taken.first, taken.lines)
            self.journal.after(partial(self._lines_committed, program, command))
        self.start(self.leases.request(program.program, program.axes, at_pause=program.at_pause))

    def lines(self, program: Program, first: int, lines: Sequence[str]) -> None:
        """Pass lines that the program's queue has accepted to the journal, and from there to the planner."""
        if program.rejected:
            program.rejected = 0
            program.diagnostics = []
        command = Lines(program.program, program.epoch, first, lines)
        committed = partial(self._lines_committed, program, command)
        self.journal.lines(program.program, first, lines, committed)

    def close(self, program: Program, *, whole: bool = True) -> None:
        """Accept no more lines; what is accepted runs to its end.

        Args:
            whole: its client has sent all of its text.
        """
        if program.closed:
            return
        program.closed = True
        if program.rejected:
            # the faulty line cannot be corrected any more
            program.ended_as = "rejected"
        if whole:
            self.journal.program_closed(program.program)
        # through the journal, so that it reaches the planner after the accepted lines
        self.journal.after(partial(self._close_planned, program))
        self.publish("program.closed", program)

    def _close_planned(self, program: Program) -> None:
        if not program.over:
            self.planner.send(CloseProgram(program.program))

    def recorded(self, program: Program) -> asyncio.Future[Verdict]:
        """Return a future that is resolved once the journal has everything about a program so far."""
        verdict: asyncio.Future[Verdict] = self._loop.create_future()
        if self.journal_failure:
            verdict.set_result(Verdict.NOT_JOURNALED)
        else:
            program.wait_for_record(verdict)
            self.journal.after(partial(give, verdict, Verdict.TAKEN))
        return verdict

    def stop(self, program: Program, as_state: ProgramState, reason: str, fault: Fault | None = None) -> None:
        """Stop along the path; the program ends as ``as_state`` once at rest."""
        if program.over or program.state == "ending":
            return
        program.ended_as = as_state
        program.reason = reason
        program.fault = fault
        # a dead executor brings nothing to rest
        if program.slot is None or not self.port.alive():
            self.end(program, as_state)
            return
        program.state = "ending"
        program.dismiss(Verdict.TAKEN)
        self.planner.send(HaltProgram(program.program))
        self.port.orders.abort(program.slot)
        self.acks.acknowledge(program)

    def end_pause(self, program: Program) -> None:
        """Continue a program after its pause; call `Pauses.refuse_lent` first."""
        if program.slot is None:
            return
        end = self.pauses.end(program)
        if end.frame is not None:
            # parameters that others have set meanwhile are not the program's
            program.frame = msgspec.structs.replace(end.frame, parameters=program.frame.parameters)
        self.planner.send(EndPause(program.program, end))
        self.port.orders.end_pause(program.slot)
        # what the pause asked for is done
        program.paused, program.asks_for, program.notice = False, None, ""

    def enter(self, program: Program, state: ProgramState) -> None:
        """Change the state of a program that has not ended and is not stopping."""
        if not program.over and program.state != "ending":
            if state == "held":
                program.tool_use.held(self.time.now())
            else:
                program.tool_use.released(self.time.now())
            program.state = state
            program.settle()
            self.acks.acknowledge(program)

    def start(self, grants: Sequence[Grant]) -> None:
        """Begin programs that got their axes."""
        for grant in grants:
            program = self.programs[grant.program]
            if self.references.may_move(grant.axes):
                # references that are no longer valid must not be found after a power cut
                self.enter(program, "held" if program.held else "running")
                self.journal.after(partial(self._begin, program, grant))
            else:
                self._begin(program, grant)

    def _begin(self, program: Program, grant: Grant) -> None:
        """Begin a program in executor and planner; before this it has only its lease."""
        if program.over:
            return
        program.slot = grant.slot
        program.begun = self.port.snapshot().time
        # the executor does the same
        program.held, program.held_by = program.held or self.executor.holding, self.executor.holders
        # here, so that no hold or abort reaches the executor earlier
        self.port.begin(
            grant.slot,
            grant.axes,
            ratio=program.override,
            held=program.held,
            unhomed=program.unhomed,
            controls=() if self._planned(program) else program.controls,
            envelope=program.envelope,
        )
        if self._planned(program):
            begins = self.start_state(program.modal, program.switches)
            program.frame = (program.modal and program.modal.frame) or begins.frame or Frame()
            program.tool_use.behind(program.start_line, program.frame)
            request = PipelineRequest(
                program.program,
                grant.axes,
                begins,
                program.unhomed,
                machine_coordinates=program.by_hand,
                approach=tuple(program.approach),
                controls=tuple(program.controls),
                role=self._role_of(program),
            )
            if not program.controls:
                program.origin = program.origin or self._origin(program.switches)
                self.journal.program_begun(program.program, program.origin)
            self.planner.send(Begin(request, grant.slot, program.step, program.begun))
        program.modal = None
        self.enter(program, "held" if program.held else "running")
        self.publish("program.started", program)

    @staticmethod
    def _role_of(program: Program) -> str:
        """Return the role by which zones bind a program: an operator's, or for an approved run its agent's.

        The agent of a continued run is unknown: any agent's.
        """
        if program.envelope is None:
            return OPERATOR
        return AGENT if program.resume_of else agent_role(program.client)

    def _planned(self, program: Program) -> bool:
        """Return whether the planner has the program; with bodies to check, also one without lines."""
        return not program.controls or self._machine.clearance is not None

    def end(self, program: Program, state: ProgramState) -> None:
        """Release the axes of a program that is over; its end is reported when it is journaled."""
        if program.over:
            return
        program.over = True
        program.state = "ending"
        program.ended_as = state
        program.closed = True
        program.slot = None
        program.dismiss(Verdict.TAKEN)
        self.progress_reports.end(program)
        self.offsets.save_use()
        done, at = program.progress.done, self.options.clock()
        committed = partial(self._end_committed, program, done, at)
        self.journal.program_ended(program.program, state, done, program.fault, at, committed)
        self.planner.send(DropProgram(program.program))
        self.pauses.forget(program)
        self.on_program_ended(program)
        # a program without planner is completely in its slot already
        self.start(self.leases.release(program.program, planned=self._planned(program)))

    def _end_committed(self, program: Program, done: int, at: float) -> None:
        program.done = max(program.done, done)
        program.state = program.ended_as
        program.ended_at = at
        self.publish("program.ended", program, line=program.done, fault=program.fault, reason=program.reason)
        self.acks.acknowledge(program)

    def _forget_ended(self) -> None:
        ended = [key for key, program in self.programs.items() if program.ended]
        for key in ended[: max(0, len(ended) - ENDED_PROGRAMS)]:
            del self.programs[key]

    # ------------------------------------------------------------ from the journal

    def _call_soon(self, function: Callable[[], None]) -> None:
        """Run ``function`` in the loop; called in the journal's thread."""
        try:
            self._loop.call_soon_threadsafe(function)
        except RuntimeError:
            log.debug("the loop is closed")

    def _lines_committed(self, program: Program, command: Lines) -> None:
        if command.epoch != program.epoch:
            # a line before them was rejected meanwhile
            return
        if not program.over:
            self.planner.send(command)
        program.journaled = command.first + len(command.lines) - 1
        program.settle()
        self.acks.acknowledge(program)

    def _journal_state(self, failure: str) -> None:
        if self.journal_failure == failure:
            return
        self.journal_failure = failure
        if failure:
            self.events.warn("MC519", f"the journal cannot be written: {failure}", level=logging.ERROR)
            for program in self.programs.values():
                program.dismiss_unjournaled()
            return
        self.events.warn("MC519", "the journal can be written again")

    # ------------------------------------------------------------ out

    def _record(self, fault: Fault) -> None:
        self.journal.fault(fault, self.options.clock())

    def publish(self, kind: Kind, program: Program, **values: Any) -> None:
        """Publish an event about a program."""
        self.events.publish(
            kind, program=program.program, client=program.client, state=program.state, **values
        )
