"""The programs of one machine and what moves them on: journal, leases, planner, executor events.

Everything here runs in the asyncio loop, but `ProgramTable._call_soon`.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import msgspec

from mcserver.clearance.mounted import Mounted
from mcserver.errors import Diagnostic
from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.executor.fault_codes import WARNINGS, FaultCode
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
    Consumed,
    ContactAhead,
    Dropped,
    DropProgram,
    EndPause,
    ExecutorEvents,
    FrameChanged,
    HaltProgram,
    LineRejected,
    Lines,
    OnPlannerEvents,
    PipelineRequest,
    Planned,
    PlannerEvent,
    PlannerFailed,
    ProgramMessage,
    ToolsExchanged,
    Validated,
    WaitChanged,
)
from mcserver.planning.start_state import StartState
from mcserver.service.acknowledgements import AckSender
from mcserver.service.axis_reports import AxisReports
from mcserver.service.disk_watch import DiskWatch
from mcserver.service.event_log import EventLog
from mcserver.service.executor_port import ExecutorPort
from mcserver.service.fault_latch import FaultLatch, fault_of
from mcserver.service.heartbeat import Heartbeat
from mcserver.service.journal import Journal
from mcserver.service.journal_repair import JournalLock, prepare_journal
from mcserver.service.leases import Grant, LeaseTable
from mcserver.service.line_queue import LineBatch
from mcserver.service.pauses import Pauses
from mcserver.service.program import Program, Verdict, give
from mcserver.service.progress_reports import ProgressReports
from mcserver.service.references import References, references_file
from mcserver.service.reports import Ack, Event, Fault, ProgramState, wire_diagnostic
from mcserver.service.reports import EventKind as Kind
from mcserver.service.service_options import ServiceOptions
from mcserver.service.start_of_programs import start_state
from mcserver.service.timebase import Timebase
from mcserver.service.work_offsets import WorkOffsets, offsets_file

log = logging.getLogger(__name__)

ENDED_PROGRAMS = 100
# Lines that the journal had already, in one message to the planner.
KNOWN_LINES = 10_000
# Between two looks whether the programs of a planner that has ended are at rest.
AT_REST_S = 0.02


class ProgramTable:
    """Keeps the programs, and carries out what the service has allowed.

    Attributes:
        programs: open ones and the last `ENDED_PROGRAMS` that have ended, oldest first.
        faults: latched until a reset. time: of this start.
        offsets: work coordinate systems and tools, which outlive programs and the server.
        references: of axes, which outlive the server. axis_reports: of homing and probing.
        pauses: of programs. mounted: tools that have bodies, as programs have said.
        journal_damage: of the journal as it was found at this start; None: it is sound.
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
        self._inputs = [each.name for each in machine.inputs]
        self._outputs = [each.name for each in machine.outputs]
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
        self._progress = ProgressReports(self._loop, self.journal, self.publish, self.acks.acknowledge)
        self.offsets = WorkOffsets(
            offsets_file(options.journal),
            machine.dialect.cutters,
            # before a line that changes them can be done
            self.journal.beside,
        )
        self.references = References(references_file(options.journal), machine, self.journal.beside)
        self.axis_reports = AxisReports(machine.axes, self.references, self.events)
        self.mounted = Mounted()
        self.pauses = Pauses(machine, self.leases, self.programs, self.journal, self.start_state)
        self.disk = DiskWatch(self._loop, self.journal, self.events, options.clock)
        self.planner = planner(self._planner_events)
        # called for a stop that the executor has latched by itself
        self.on_machine_stop: Callable[[Fault], None] = self.faults.latch
        # called once a program has ended
        self.on_program_ended: Callable[[Program], None] = lambda _program: None
        # digest of the machine file, see `machine_digest`
        self.machine_file = machine_digest(machine)
        # inputs that hold the programs now, by column
        self._holding: set[int] = set()
        self.heartbeat = Heartbeat(port.orders.beat, lambda: self.planner.last_seen)

    def start_state(self, modal: ModalState | None = None, switches: Switches = AS_WRITTEN) -> StartState:
        """Return what a program that begins now starts from."""
        frame, tool = self.offsets.frame(), self.offsets.tool
        return start_state(self._machine, self.port.snapshot(), frame, modal, switches, tool)

    def _origin(self, switches: Switches) -> StartState:
        """Return what a program that begins now is recorded with, should it be gone on with."""
        return msgspec.structs.replace(
            self.start_state(switches=switches),
            machine_file=self.machine_file,
            cutters=self._machine.dialect.cutters,
        )

    def close_journal(self) -> None:
        """Write what is left; blocks. Another server may have the journal then."""
        self.journal.close()
        self._lock.release()

    # ------------------------------------------------------------ life of a program

    def add(self, program: Program, before: Sequence[str], known: Sequence[str] = ()) -> None:
        """Journal a new program and queue it for its axes.

        Args:
            before: its lines before the first one that runs. known: lines from that one on.
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
            # it may never begin here: who goes on with it then has to know them
            self.journal.program_begun(program.program, program.origin or self._origin(program.switches))
        self.publish("program.opened", program, message=program.name)
        for at in range(0, len(known), KNOWN_LINES):
            taken = program.queue.take(program.start_line + at, known[at : at + KNOWN_LINES])
            assert isinstance(taken, LineBatch)
            command = Lines(program.program, program.epoch, taken.first, taken.lines)
            self.journal.after(partial(self._lines_committed, program, command))
        self._start(self.leases.request(program.program, program.axes, at_pause=program.at_pause))

    def lines(self, program: Program, first: int, lines: Sequence[str]) -> None:
        """Give lines that the program's queue has taken to the journal, and from there to the planner."""
        if program.rejected:
            program.rejected = 0
            program.diagnostics = []
        command = Lines(program.program, program.epoch, first, lines)
        committed = partial(self._lines_committed, program, command)
        self.journal.lines(program.program, first, lines, committed)

    def close(self, program: Program, *, whole: bool = True) -> None:
        """No more lines; what is there runs to its end.

        Args:
            whole: its client has given all of its text.
        """
        if program.closed:
            return
        program.closed = True
        if program.rejected:
            # nobody can correct that line any more
            program.ended_as = "rejected"
        if whole:
            self.journal.program_closed(program.program)
        # through the journal, so that it comes to the planner behind the lines accepted
        self.journal.after(partial(self._close_planned, program))
        self.publish("program.closed", program)

    def _close_planned(self, program: Program) -> None:
        if not program.over:
            self.planner.send(CloseProgram(program.program))

    def recorded(self, program: Program) -> asyncio.Future[Verdict]:
        """Return what tells once the journal has all that has become of a program so far."""
        verdict: asyncio.Future[Verdict] = self._loop.create_future()
        if self.journal_failure:
            verdict.set_result(Verdict.NOT_JOURNALED)
        else:
            program.wait_for_record(verdict)
            self.journal.after(partial(give, verdict, Verdict.TAKEN))
        return verdict

    def stop(self, program: Program, as_state: ProgramState, reason: str, fault: Fault | None = None) -> None:
        """Stop along the path; the program ends ``as_state`` once it is at rest."""
        if program.over or program.state == "ending":
            return
        program.ended_as = as_state
        program.reason = reason
        program.fault = fault
        # an executor that has died brings nothing to rest
        if program.slot is None or not self.port.alive():
            self._end(program, as_state)
            return
        program.state = "ending"
        program.dismiss(Verdict.TAKEN)
        self.planner.send(HaltProgram(program.program))
        self.port.orders.abort(program.slot)
        self.acks.acknowledge(program)

    def end_pause(self, program: Program) -> None:
        """Let a program go on behind its pause; `Pauses.refuse_lent` comes before."""
        if program.slot is None:
            return
        end = self.pauses.end(program)
        program.frame = end.frame or program.frame
        self.planner.send(EndPause(program.program, end))
        self.port.orders.end_pause(program.slot)
        # what was to be done is done
        program.paused, program.asks_for, program.notice = False, None, ""

    def enter(self, program: Program, state: ProgramState) -> None:
        """Change the state of a program that has not ended and is not being stopped."""
        if not program.over and program.state != "ending":
            if state == "held":
                program.tool_use.held(self.time.now())
            else:
                program.tool_use.released(self.time.now())
            program.state = state
            program.settle()
            self.acks.acknowledge(program)

    def _start(self, grants: Sequence[Grant]) -> None:
        for grant in grants:
            program = self.programs[grant.program]
            if self.references.may_move(grant.axes):
                # a reading that holds no longer must not be found after a power cut
                self.enter(program, "held" if program.held else "running")
                self.journal.after(partial(self._begin, program, grant))
            else:
                self._begin(program, grant)

    def _begin(self, program: Program, grant: Grant) -> None:
        """Let the executor and the planner have a program; until then its lease alone is there."""
        if program.over:
            return
        program.slot = grant.slot
        program.begun = self.port.snapshot().time
        # as the executor does by itself
        program.held, program.held_by = program.held or bool(self._holding), self._holders()
        # here, so that no hold or abort can reach the executor before it
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
        """Return as what a program is bound by zones: what a person has approved as an agent's, whoever has
        asked for it; of one that is gone on with it may be any.
        """
        if program.envelope is None:
            return OPERATOR
        return AGENT if program.resume_of else agent_role(program.client)

    def _planned(self, program: Program) -> bool:
        """Return whether the planner has the program: where bodies may touch also one without lines."""
        return not program.controls or self._machine.clearance is not None

    def _end(self, program: Program, state: ProgramState) -> None:
        """Give the axes of a program that is over to the next one; its end is said when it is journaled."""
        if program.over:
            return
        program.over = True
        program.state = "ending"
        program.ended_as = state
        program.closed = True
        program.slot = None
        program.dismiss(Verdict.TAKEN)
        self._progress.end(program)
        self.offsets.save_use()
        done, at = program.progress.done, self.options.clock()
        committed = partial(self._end_committed, program, done, at)
        self.journal.program_ended(program.program, state, done, program.fault, at, committed)
        self.planner.send(DropProgram(program.program))
        self.pauses.forget(program)
        self.on_program_ended(program)
        # all of a program without a planner is in its slot already
        self._start(self.leases.release(program.program, planned=self._planned(program)))

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
        """In the journal's thread: runs ``function`` in the loop."""
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
            log.error("the journal cannot be written: %s", failure)
            self.events.publish(
                "warning", reason="MC519", message=f"the journal cannot be written: {failure}"
            )
            for program in self.programs.values():
                program.dismiss_unjournaled()
            return
        log.warning("the journal can be written again")
        self.events.publish("warning", reason="MC519", message="the journal can be written again")

    # ------------------------------------------------------------ from the planner

    def _planner_events(self, events: Sequence[PlannerEvent]) -> None:
        for event in events:
            if isinstance(event, ExecutorEvents):
                for each in event.events:
                    self._executor_event(each)
                continue
            if isinstance(event, PlannerFailed):
                self._planner_failed(event)
                continue
            if isinstance(event, Dropped):
                self._start(self.leases.forgotten(event.program))
                continue
            program = self.programs.get(event.program)
            if program is None or program.over:
                continue
            match event:
                case Consumed():
                    self._consumed(program, event)
                case FrameChanged():
                    before, program.frame = program.frame, event.frame
                    program.tool_use.behind(event.line, event.frame)
                    self.offsets.keep(
                        event.frame,
                        before=before,
                        wall=self.options.clock(),
                        client=program.client,
                        program=program.program,
                        name=program.name,
                    )
                    self.pauses.offsets_changed()
                case ToolsExchanged():
                    self.mounted = self.mounted.behind(event.exchange)
                    if event.exchange.fitted is not None:
                        self.offsets.fit(event.exchange.fitted)
                case ProgramMessage():
                    program.messages.append(event)
                case Planned():
                    program.progress.planned(event.reports)
                    program.tool_use.planned(event.reports)
                case Validated():
                    self._validated(program, event)
                case LineRejected():
                    self._line_rejected(program, event)
                case WaitChanged():
                    program.waits_before = event.waits_for
                    found = event.diagnostic
                    if found is not None:
                        message = f"waits: {found.message}"
                        self.publish("program.message", program, line=found.line, message=message)
                case ContactAhead():
                    self._fail(program, event.diagnostic)

    def _planner_failed(self, event: PlannerFailed) -> None:
        """Stop the program that the planner failed with, or all of them."""
        for program in list(self.programs.values()):
            if program.over or event.program not in ("", program.program):
                continue
            message = f"the planner failed: {event.message}"
            hint = "this is a defect of the server; its log tells more. Open the program again"
            self._fail(program, Diagnostic("MC516", message, program.progress.started, hint=hint))
        if not event.program:
            # it puts nothing any more, and the next one knows none of them
            self._start(self.leases.forgotten(None))
            self._end_at_rest()

    def _fail(self, program: Program, found: Diagnostic) -> None:
        """Stop a program for what the planner has found; it may say so again until it hears of the stop."""
        if program.over or program.state == "ending":
            return
        fault = Fault(
            code=found.code,
            message=found.message,
            hint=found.hint,
            program=program.program,
            line=found.line,
            t=self.time.now(),
        )
        if not program.by_hand:
            # nothing is latched; a person who jogs hears it by the jog's end
            self.events.publish(
                "fault", fault=fault, program=fault.program, line=fault.line, message=fault.message
            )
        self.stop(program, "faulted", fault.message, fault)

    def _end_at_rest(self) -> None:
        """End programs that are at rest after the planner's process has ended: the executor's event that says
        so may have gone with it."""
        ending = [program for program in self.programs.values() if program.state == "ending"]
        for program in ending:
            if program.slot is not None and self.port.ended(program.slot):
                self._end(program, program.ended_as)
        if ending:
            self._loop.call_later(AT_REST_S, self._end_at_rest)

    def _consumed(self, program: Program, event: Consumed) -> None:
        if event.through > program.queue.accepted:
            # of lines before a rejection
            return
        program.queue.consume(event.through)
        limit = program.queue.limit
        if program.last_reported_credit < limit // 4 and program.credit > limit // 2:
            self.acks.acknowledge(program)

    def _validated(self, program: Program, event: Validated) -> None:
        program.validated = max(program.validated, event.through)
        program.planned_end_u = event.end_u
        program.settle()

    def _line_rejected(self, program: Program, event: LineRejected) -> None:
        if event.epoch != program.epoch:
            return
        diagnostics = [wire_diagnostic(diagnostic) for diagnostic in event.diagnostics]
        program.reject(event.line, diagnostics)
        self.journal.rejected(program.program, event.line)
        self.publish("line.rejected", program, line=event.line, diagnostics=diagnostics)
        if event.final or program.closed:
            program.closed = True
            program.ended_as = "rejected"
        self.acks.acknowledge(program)

    # ------------------------------------------------------------ from the executor

    def _executor_event(self, event: ExecutorEvent) -> None:
        program = self._in_slot(event.program)
        if event.kind is EventKind.FAULT:
            self._fault(event, program)
            return
        if self.axis_reports.handle(event, None if program is None else program.program):
            return
        if program is None or event.time < program.begun:
            # of the program that was in the slot before, whose end was seen without this
            return
        if event.line == 0 and event.kind in (EventKind.LINE_START, EventKind.LINE_END, EventKind.AXIS_DONE):
            # on the way to the first line
            return
        begins = event.kind in (EventKind.LINE_START, EventKind.PAUSED)
        if begins and program.approach and not program.progress.started:
            program.notice = ""
        if event.kind is EventKind.LINE_START:
            program.progress.line_started(event.line, event.time)
            self._say(program, event.line)
            self._progress.moved(program)
        elif event.kind is EventKind.LINE_END:
            start = program.progress.line_ended(event.line, event.time)
            self._count(program, *program.tool_use.ended(event.line, start, event.time))
            self._progress.moved(program)
        elif event.kind is EventKind.PASSED:
            program.progress.passed(event.line)
            self._progress.moved(program)
        elif event.kind is EventKind.INPUT_WAIT:
            program.waits_for = self._inputs[event.token]
        elif event.kind is EventKind.INPUT:
            program.waits_for = ""
            name = self._inputs[event.token] if event.token < len(self._inputs) else ""
            value, waited = event.values
            message = f"{name} = {value:g} after {waited:.3f} s"
            self.publish("input.read", program, line=event.line, message=message)
        elif event.kind is EventKind.PAUSED:
            self._say(program, event.line)
            program.paused, program.paused_at = True, event.line
            worn = self.offsets.worn_text(program.asks_for)
            if worn:
                program.notice = f"{program.notice} · {worn}"
            if program.state != "ending":
                self.pauses.began(program, event.line, event.token)
            self.enter(program, "paused")
            self.publish("program.paused", program, line=event.line, message=program.notice)
        elif event.kind is EventKind.FINISHED:
            self._say(program, event.line)
            program.progress.passed(event.line)
            self._end(program, program.ended_as)
        elif event.kind is EventKind.STOPPED:
            if event.token:
                self._say_in_thread(program, event.line)
            self._end(program, "aborted" if program.ended_as == "finished" else program.ended_as)

    def _say_in_thread(self, program: Program, line: int) -> None:
        """Say that a program was stopped where a tool may stand in a thread: axes by themselves break it."""
        said = f"it was stopped within the thread of line {line}: get the tool out before an axis moves"
        program.reason = f"{program.reason}; {said}" if program.reason else said
        if program.fault is not None:
            hint = f"{program.fault.hint}; {said}" if program.fault.hint else said
            program.fault = msgspec.structs.replace(program.fault, hint=hint)

    def _fault(self, event: ExecutorEvent, program: Program | None) -> None:
        fault = fault_of(event, None if program is None else program.program, self._inputs, self._outputs)
        if event.code in WARNINGS:
            message = f"{fault.message}: {fault.hint}"
            where = {"program": fault.program, "line": fault.line, "axis": fault.axis}
            self.events.publish("warning", reason=fault.code, message=message, **where)
            self._interlock(event, fault, program)
            if event.code == FaultCode.TARGETS_LOST and program is not None:
                # the executor ends it
                program.reason = f"{fault.code}: {fault.message}"
            return
        if event.code == FaultCode.INTERLOCK_STOP:
            if program is None:
                self.on_machine_stop(fault)
            return
        if event.code == FaultCode.EMERGENCY_STOP:
            # latched and reported by whoever asked for it; what came while axes still come to rest ends by it
            if program is not None:
                self.stop(program, "faulted", fault.message, fault)
            return
        # the executor ends those whose motion a stall has interrupted, each by a fault of its own
        stalled_machine = event.code == FaultCode.CYCLE_STALLED and program is None
        if not stalled_machine:
            # before anybody hears of it
            self.faults.latch(fault)
        self.events.publish(
            "fault", fault=fault, program=fault.program, line=fault.line, message=fault.message
        )
        if stalled_machine:
            return
        hit = [] if program is None else [program]
        if program is not None:
            program.progress.faulted(event.line, lost=event.axis >= 0)
        if program is None and fault.axis is None:
            # a fault of the whole machine ends every program, one of an idle axis none
            hit = [each for each in self.programs.values() if not each.over]
        for each in hit:
            self.stop(each, "faulted", fault.message, fault)

    def _interlock(self, event: ExecutorEvent, fault: Fault, met: Program | None) -> None:
        """Note that an input holds the programs, or does so no more: they stay held until resumed.

        Args:
            met: the program before whose axes an input has switched on a zone.
        """
        if event.code == FaultCode.ZONE_HOLD:
            if met is not None and not met.over:
                met.zone_switch = int(event.values[1])
                met.held_by = self._inputs[int(event.values[0])]
                self._hold_for(met, fault)
            return
        holds = event.code == FaultCode.INTERLOCK_HOLD
        if not holds and event.code != FaultCode.INTERLOCK_FREE:
            return
        inputs = {int(event.values[0])}
        self._holding = self._holding | inputs if holds else self._holding - inputs
        for program in self.programs.values():
            if program.over or program.slot is None:
                continue
            if program.zone_switch is None:
                program.held_by = self._holders()
            if holds:
                self._hold_for(program, fault)

    def _holders(self) -> str:
        """Return the names of the inputs that hold all programs."""
        return ", ".join(self._inputs[each] for each in sorted(self._holding))

    def _hold_for(self, program: Program, fault: Fault) -> None:
        """Note that the executor holds a program for an input."""
        if not program.held:
            program.held = True
            self.enter(program, "held")
            self.publish("program.held", program, reason=fault.code, message=fault.message)

    def program_in(self, slot: int) -> str | None:
        """Return the id of the program in an executor's slot."""
        program = self._in_slot(slot)
        return None if program is None else program.program

    def _record(self, fault: Fault) -> None:
        self.journal.fault(fault, self.options.clock())

    def _in_slot(self, slot: int) -> Program | None:
        for program in self.programs.values():
            if program.slot == slot and not program.over:
                return program
        return None

    def _count(self, program: Program, tool: int, seconds: float) -> None:
        """Count what a line has cut, and say once that a tool's life is used up."""
        if tool and self.offsets.cut(tool, seconds):
            message = f"{self.offsets.worn_text(tool)}; its next change waits for that"
            self.events.publish("warning", reason="MC603", message=message, program=program.program)

    # ------------------------------------------------------------ out

    def publish(self, kind: Kind, program: Program, **values: Any) -> None:
        """An event about a program."""
        self.events.publish(
            kind, program=program.program, client=program.client, state=program.state, **values
        )

    def _say(self, program: Program, line: int) -> None:
        """Publish what lines through this one say to the operator."""
        said: list[str] = []
        while program.messages and program.messages[0].line <= line:
            found = program.messages.popleft()
            said.append(found.message)
            program.asks_for = found.tool
            self.publish("program.message", program, line=found.line, message=found.message)
        if said:
            # what is said on the way to one pause belongs together
            program.notice = " · ".join(said[-3:])
