"""The service: a machine's programs, leases, faults and emergency stop, above planner and executor.

It speaks through two callbacks, acknowledgements and events, and knows nothing of the network.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from mcserver.clearance.mounted import Mounted
from mcserver.errors import Refused
from mcserver.executor.entries import Control
from mcserver.gcode.semantics.modal import ModalState
from mcserver.machine.machine_file import Machine
from mcserver.planning.client import ProcessPlanning
from mcserver.planning.planner_messages import StepLine
from mcserver.service.absences import Absences
from mcserver.service.approach import NO_CONFIRMATION, Approach, Confirmation, refuse_needs
from mcserver.service.axes_of_requests import axes_of
from mcserver.service.channels import Channels
from mcserver.service.executor_port import ExecutorPort
from mcserver.service.forecasts import Forecasts
from mcserver.service.former_start import report_damage, report_interrupted, report_lost_references
from mcserver.service.journal_reader import read_programs, read_unended
from mcserver.service.kept_texts import KeptTexts
from mcserver.service.line_intake import LineIntake
from mcserver.service.line_queue import QUEUE_LINES, LineQueue
from mcserver.service.program import Program
from mcserver.service.program_access import find_program, open_programs, owned_program
from mcserver.service.program_options import BY_DEFAULT, ProgramOptions
from mcserver.service.program_table import ProgramTable
from mcserver.service.progress_reports import TICK_S
from mcserver.service.recovering import Recovering
from mcserver.service.reports import (
    Ack,
    Event,
    Fault,
    OnDisconnect,
    ProgramStatus,
)
from mcserver.service.service_options import ServiceOptions
from mcserver.service.stop_latch import StopLatch

log = logging.getLogger(__name__)

OPEN_PROGRAMS = 64
# Of one client, so that none can keep the others out.
CLIENT_PROGRAMS = 16
SHOWN_ENDED_S = 10.0
STOP_LIMIT_S = 3.0
# for what a reader of the journal is to find there
JOURNAL_LIMIT_S = 2.0


class MachineService:
    """One machine's programs, as clients and operators may use them. All of it runs in the asyncio loop.

    Attributes:
        override: feed override of programs to come, 1 as programmed.
        lines: accepts lines of programs. texts: uploaded by clients. forecasts: of remaining times.
        latch: the emergency stop and the latched faults. acks: sends acknowledgements.
        events: published so far. time: executor time and UTC. disk: of the journal.
        work_tables: work coordinate systems and tools with which programs start, and their changes.
        axis_reports: references, probing and the mesh of the bed. start_state: returns the state from which
        a program would begin now.
        absences: of clients.
    """

    def __init__(
        self,
        machine: Machine,
        port: ExecutorPort,
        planning: ProcessPlanning,
        options: ServiceOptions,
        *,
        on_ack: Callable[[Ack], None],
        on_event: Callable[[Event], None],
    ) -> None:
        self.machine = machine
        self.port = port
        self.options = options
        self.override = 1.0
        self._loop = asyncio.get_running_loop()
        self._table = ProgramTable(
            machine,
            port,
            planning.planner,
            options,
            on_ack=on_ack,
            on_event=on_event,
        )
        self.acks = self._table.acks
        self.events = self._table.events
        self.time = self._table.time
        self.disk = self._table.disk
        self.work_tables = self._table.offsets
        self.axis_reports = self._table.axis_reports
        self.start_state = self._table.start_state
        self.channels = Channels(machine, port, self._table.executor.program_in)
        self.lines = LineIntake(self._table, self._loop)
        self.latch = StopLatch(self._table, port, self._loop, self._journal_stop)
        self._table.on_machine_stop = self.latch.stopped_by_machine
        self._table.on_program_ended = self._program_ended
        # called with each program that has ended, before another one gets its axes
        self.on_program_ended: list[Callable[[Program], None]] = []
        self.forecasts = Forecasts(port, machine.cycle_s, self._table.programs, self._table.time.now)
        self.texts = KeptTexts(options.journal.with_suffix(".texts"))
        self.recovery = Recovering(machine, planning, self._table, self.journal_written)
        self.absences = Absences(self._table, self._loop)
        self.on_program_ended.append(self.absences.forget)
        self._counter = 0
        self._stopping = False

    # ------------------------------------------------------------ life

    def start(self) -> None:
        """Begin: what an earlier start left open counts as interrupted, which is said once it is
        journaled."""
        interrupted = partial(report_interrupted, self._table, read_unended(self.options.journal))
        self._table.journal.server_started(self.options.instance, self.options.clock(), interrupted)
        self._table.planner.start()
        self._table.heartbeat.start()
        self._table.disk.start()
        self.events.publish("server.started", message=f"machine {self.machine.name}")
        report_lost_references(self._table, self.homed)
        report_damage(self._table)

    async def stop(self) -> None:
        """Stop all motion along its paths, end the programs, release the axes and close the journal."""
        if self._stopping:
            return
        self._stopping = True
        if not self.port.alive():
            self._fail_without_executor()
        self.events.publish("server.stopping")
        for program in open_programs(self._table.programs, None):
            self._table.stop(program, "aborted", "the server is stopping")
        deadline = self._loop.time() + STOP_LIMIT_S
        while open_programs(self._table.programs, None) and self._loop.time() < deadline:
            await asyncio.sleep(TICK_S)
        await self._table.planner.stop()
        if self.port.alive():
            positions = self.port.snapshot().position
            self._table.references.stand(dict(zip(axes_of(self.machine, None), positions, strict=True)))
        await asyncio.to_thread(self.port.close)
        self._table.heartbeat.stop()
        self._table.disk.stop()
        self._table.journal.server_stopped(self.options.instance, self.options.clock())
        await asyncio.to_thread(self._table.close_journal)
        await asyncio.to_thread(self.texts.close)

    @property
    def mounted(self) -> Mounted:
        """Mounted tools with bodies, according to the programs of this start."""
        return self._table.mounted

    def record_command(self, client: str, method: str, program: str | None = None, detail: str = "") -> None:
        """Record who did what: in the journal, in the log, and as an event.

        A journal that cannot be written prevents no command.
        """
        log.info("%s: %s %s %s", client, method, program or "the machine", detail)
        self._journal_command(client, method, program, detail)
        self.events.publish("command", client=client, program=program, reason=method, message=detail)

    # ------------------------------------------------------------ a client and its programs

    async def open(self, client: str, options: ProgramOptions = BY_DEFAULT) -> Program:
        """Open a program and queue it for its axes.

        Raises:
            ServiceError: MC503 no program ``resume_of``, MC507 no such axis, MC508 too many programs, MC509 a
                latched fault, MC511, MC514 the journal lacks the lines before, MC515 stopping, MC519; of a
                start in the middle also MC450, MC483, MC512, MC592, MC593, MC594.
        """
        self._ready()
        if self._table.journal_failure:
            raise self.lines.unjournaled()
        wanted = axes_of(self.machine, options.axes)
        if options.at_pause and options.axes is None:
            wanted = self._table.pauses.without_kept(wanted)
        for axis in wanted if options.at_pause and not options.by_hand else ():
            self.refuse_leased(axis, at_pause=True)
        self._check_limits(client)
        confirmed, before = options.confirmed, options.before
        approach: Approach | None = None
        modal: ModalState | None = None
        if options.resume_of is not None or before:
            start = await self.recovery.start_of(
                wanted,
                options.start_line,
                before=before,
                program=options.resume_of,
                switches=options.switches,
            )
            before, options = start.before, replace(options, switches=start.switches)
            if options.start_line > 1 and before:
                approach = self.recovery.plan(start, wanted)
                refuse_needs(approach, way=confirmed.way, outputs=confirmed.outputs)
                modal = self.recovery.modal_from(start)
                for axis in wanted:
                    # the way is from where the axes are now
                    self.refuse_leased(axis)
        self._check_limits(client)
        self._ready()
        self._counter += 1
        program = Program(
            f"{self.options.instance}-{self._counter}",
            client,
            wanted,
            options,
            opened_at=self.options.clock(),
            queue=LineQueue(options.start_line, limit_lines=max(QUEUE_LINES, len(options.known))),
        )
        self.forecasts.begin(program)
        program.modal = modal
        program.override = 1.0 if program.by_hand else min(self.override, program.override_limit)
        if approach is not None:
            program.approach = approach.lines_with_outputs if confirmed.outputs == "set" else approach.lines
            program.notice = f"on the way to line {options.start_line}" if approach.way else ""
            # its lines from 1 on are those of the program that it goes on with
            program.origin = start.origin
        self._table.add(program, before, options.known)
        if approach is not None and program.state == "queued":
            self.abort(program.program, "the axes are in use")
            raise Refused("MC512", "the axes are in use", "wait until they are free")
        return program

    async def continue_program(
        self,
        client: str,
        program_id: str,
        line: int | None = None,
        *,
        confirmed: Confirmation = NO_CONFIRMATION,
        on_disconnect: OnDisconnect = "stop",
        grace_s: float = 0.0,
        hold: bool = False,
    ) -> Program:
        """Go on with a program that has ended, or with the last one that has gone on with it.

        Its lines are those that the journal has; where they were not all, the client gives the rest.

        Args:
            line: the first that runs; None: the one behind the last that is done.

        Raises:
            ServiceError: as `open`; MC514 the journal lacks lines, MC517 it has not ended, or has finished.
        """
        found = await self.recovery.recorded(program_id)
        status = found.status
        start = status.done + 1 if line is None else line
        finished = status.state == "finished" or (found.whole and status.done >= status.accepted)
        if (line is None and finished) or (found.whole and start > status.accepted):
            raise Refused("MC517", f"{status.program} is done", "choose a line", state=status.state)
        # what a person has approved bounds the rest of it too; it is not known after a restart
        former = self._table.programs.get(status.program)
        options = ProgramOptions(
            name=status.name,
            axes=status.axes,
            envelope=None if former is None else former.envelope,
            override_limit=math.inf if former is None else former.override_limit,
            on_disconnect=on_disconnect,
            grace_s=grace_s,
            start_line=start,
            resume_of=status.program,
            hold=hold,
            sha256=found.sha256,
            confirmed=confirmed,
            known=await self.recovery.lines(status.program, start, status.accepted),
        )
        program = await self.open(client, options)
        if found.whole:
            self._table.close(program)
        return program

    async def recorded(self, program: Program) -> Program:
        """Return a program that was opened, once the journal has it: only then a client may rely on its id.

        Raises:
            ServiceError: MC519 it cannot be journaled, and is aborted.
        """
        try:
            return await self.lines.recorded(program)
        except Refused:
            self._table.stop(program, "aborted", "it could not be journaled")
            raise

    async def command(
        self, client: str, name: str, axes: Sequence[int], controls: Sequence[Control]
    ) -> Program:
        """Open a program of control entries, which needs no planner, and queue it for its axes.

        Args:
            controls: all of it; the last one is its end. It may have axes of a program at a pause.

        Returns:
            It, once the journal has it: nothing of it is acknowledged by line.

        Raises:
            ServiceError: as `open`.
        """
        program = await self.open(
            client,
            ProgramOptions(name=name, axes=axes, controls=controls, by_hand=True, at_pause=True),
        )
        return await self.recorded(program)

    def step(self, client: str, program_id: str) -> Program:
        """Let the next line of a program in single line mode start."""
        program = owned_program(self._table.programs, client, program_id)
        if not program.step or program.over:
            raise Refused(
                "MC517",
                f"{program_id} is not in single line mode",
                "open it with `step`",
                state=program.state,
            )
        self._ready()
        self._table.planner.send(StepLine(program_id))
        return program

    # ------------------------------------------------------------ operators

    def hold(self, program_id: str | None) -> list[Program]:
        """Feed hold along the path."""
        chosen = [program for program in open_programs(self._table.programs, program_id) if not program.held]
        for program in chosen:
            program.held = True
            if program.slot is not None:
                self.port.orders.set_hold(True, program.slot)
                self._table.enter(program, "held")
            self._table.publish("program.held", program)
        return chosen

    def resume(self, program_id: str | None) -> list[Program]:
        """End a hold; where there is none, M00, M01 or a tool change.

        A program that is held at a pause waits on there: whoever ends a hold has not changed the tool.

        Raises:
            ServiceError: MC602 the tool that it asks for is used up; MC443 an input holds the programs;
                MC512 axes of a program at a pause are in use, or MC460 outside of its envelope; MC503, MC509,
                MC515, MC517.
        """
        self._ready()
        self.channels.refuse_interlocked(self.channels.holding(), "resume")
        chosen = [
            program
            for program in open_programs(self._table.programs, program_id)
            if program.held or program.paused
        ]
        # where several are resumed, those before a zone that is on stay held
        shut = [each for each in chosen if self.channels.switching(each.zone_switch)]
        if shut and len(shut) == len(chosen):
            names = [name for each in shut for name in self.channels.switching(each.zone_switch)]
            self.channels.refuse_interlocked([*dict.fromkeys(names)], "resume")
        chosen = [each for each in chosen if each not in shut]
        for program in chosen:
            if not program.held:
                self._table.pauses.refuse_lent(program)
                self.work_tables.refuse_worn(program.asks_for)
        for program in chosen:
            held, program.held, program.zone_switch, program.held_by = program.held, False, None, ""
            if program.slot is not None and held:
                self.port.orders.resume(program.slot)
            else:
                self._table.end_pause(program)
            if program.slot is not None:
                self._table.enter(program, "paused" if program.paused else "running")
            self._table.publish("program.resumed", program)
        return chosen

    def abort(self, program_id: str | None, reason: str = "") -> list[Program]:
        """Stop along the path and drop the rest."""
        chosen = open_programs(self._table.programs, program_id)
        for program in chosen:
            self._table.stop(program, "aborted", reason)
        if program_id is None:
            # axes that move by themselves too (G1020, G1030, G1040)
            self.port.orders.stop()
        return chosen

    def set_override(self, ratio: float, program_id: str | None) -> list[Program]:
        """Set the feed override of a program; without an id that of all, those included that come before the
        last one ends. What is moved by hand has its own speed.
        """
        chosen = [each for each in open_programs(self._table.programs, program_id) if not each.by_hand]
        if program_id is None:
            self.override = ratio
        for program in chosen:
            program.override = min(ratio, program.override_limit)
            if program.slot is not None:
                self.port.orders.set_override(program.override, program.slot)
        self.events.publish("override", program=program_id, percent=100.0 * ratio)
        return chosen

    def program(self, program_id: str) -> Program:
        """Return a program of this start.

        Raises:
            ServiceError: MC503 the program does not exist.
        """
        return find_program(self._table.programs, program_id)

    # ------------------------------------------------------------ the machine

    def set_output(self, name: str, value: bool | float) -> float:
        """Set an output by its name.

        Raises:
            ServiceError: MC445, MC446; MC509 the emergency stop is latched; MC515.
        """
        self._ready()
        return self.channels.set_output(name, value)

    def reset(self, axes: Sequence[int] | None) -> None:
        """Clear the latch; axes stay without energy.

        Raises:
            ServiceError: MC443 an input stops the machine; MC509 programs are still coming to rest; MC507.
        """
        self.channels.refuse_interlocked(self.channels.stopping(), "reset")
        self.latch.reset(frozenset(axes_of(self.machine, axes)))
        self._end_override()

    def homed(self, axis: int) -> bool:
        """Return whether an axis knows where it is."""
        homed = self.port.snapshot().homed
        return not homed or homed[self.machine.column_of(axis)]

    def holder(self, axis: int, *, at_pause: bool = False) -> Program | None:
        """Return the program that has ``axis``; ``at_pause``: leave out one that stands at a pause and lends
        it.
        """
        name = self._table.leases.holder(axis, at_pause=at_pause)
        return None if name is None else self._table.programs[name]

    def refuse_leased(self, axis: int, *, at_pause: bool = False) -> None:
        """Refuse what needs an axis that a program has.

        Args:
            at_pause: of one that stands at a pause it may be had.

        Raises:
            ServiceError: MC512.
        """
        holder = self.holder(axis, at_pause=at_pause)
        if holder is not None:
            raise Refused(
                "MC512",
                f"axis {axis} is moved by {holder.label}",
                "wait for its end, or abort it",
                program=holder.program,
                client=holder.client,
                name=holder.name,
            )

    def current(self) -> list[Program]:
        """Programs that have not ended, and those that ended a moment ago."""
        since = self.options.clock() - SHOWN_ENDED_S
        self.forecasts.estimate()
        return [
            program
            for program in self._table.programs.values()
            if not program.ended or (program.ended_at is not None and program.ended_at >= since)
        ]

    async def known(self, *, program_id: str | None, ended: bool, limit: int) -> list[ProgramStatus]:
        """Programs of this start and, from the journal, of earlier ones; newest first."""
        self.forecasts.estimate()
        mine = {key: program for key, program in self._table.programs.items() if program_id in (None, key)}
        found = [program.status() for program in reversed(mine.values()) if ended or not program.ended]
        if ended and len(found) < limit:
            await self.journal_written()
            older = await asyncio.to_thread(
                read_programs, self.options.journal, limit=limit + len(mine), program=program_id
            )
            found += [status for status in older if status.program not in mine]
        if program_id is not None and not found and program_id not in mine:
            find_program(self._table.programs, program_id)
        return found[:limit]

    # ------------------------------------------------------------ inside

    def _program_ended(self, program: Program) -> None:
        """End the override with the last of the programs that it was set for."""
        if not program.by_hand and program.progress.started > 0:
            self._end_override()
        for each in self.on_program_ended:
            each(program)

    def _end_override(self) -> None:
        others = [each for each in open_programs(self._table.programs, None) if not each.by_hand]
        if not others and self.override != 1.0:
            self.override = 1.0
            self.events.publish("override", percent=100.0, message="it ends with the program")

    def _journal_stop(self, client: str, reason: str) -> None:
        # only the one that latches it; repetitions would fill the journal
        self._journal_command(client, "estop", None, reason)

    def _journal_command(self, client: str, method: str, program: str | None, detail: str) -> None:
        # what gathers before a journal that cannot be written stays bounded
        if not self._table.journal_failure:
            self._table.journal.command(self.options.clock(), client, method, program, detail)

    def _fail_without_executor(self) -> None:
        fault = Fault(
            code="MC518",
            message=f"the executor process has died ({self.port.ending()}); the drives stop by their own "
            "heartbeat time-out",
            hint="start the server again; axes have to be captured anew",
            t=self.time.now(),
        )
        self._table.faults.latch(fault)
        self.events.publish("fault", fault=fault, message=fault.message)
        # the newest first, so that none is given the axes of one before it
        for program in reversed(open_programs(self._table.programs, None)):
            self._table.stop(program, "faulted", fault.message, fault)

    async def journal_written(self) -> None:
        """Wait until what was journaled so far can be read; not for ever, should it not be written."""
        written: asyncio.Future[None] = self._loop.create_future()
        self._table.journal.after(lambda: None if written.done() else written.set_result(None))
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(written, 0.0 if self._table.journal_failure else JOURNAL_LIMIT_S)

    def _ready(self) -> None:
        if self._stopping:
            raise Refused("MC515", "the server is stopping", "wait for its next start")
        self.latch.refuse_latched()

    def _check_limits(self, client: str) -> None:
        open_by = [program.client for program in self._table.programs.values() if not program.ended]
        if len(open_by) >= OPEN_PROGRAMS:
            raise Refused("MC508", f"{OPEN_PROGRAMS} programs are open", "close one", limit=OPEN_PROGRAMS)
        if open_by.count(client) >= CLIENT_PROGRAMS:
            raise Refused(
                "MC508",
                f"{client} has {CLIENT_PROGRAMS} programs open",
                "close one",
                limit=CLIENT_PROGRAMS,
            )
