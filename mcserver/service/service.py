"""The service: a machine's programs, leases, faults and emergency stop, above planner and executor.

It speaks through two callbacks, acknowledgements and events, and knows nothing of the network.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence

import msgspec

from mcserver.errors import Refused, RejectedLines, ServiceError
from mcserver.executor.entries import Control
from mcserver.executor.view import SlotView
from mcserver.machine.machine_file import Machine
from mcserver.planning.planner_messages import Planning, StepLine
from mcserver.service.channels import Channels
from mcserver.service.deferred import Deferred
from mcserver.service.event_log import EventLog
from mcserver.service.journal_reader import check_known, read_lines_before, read_programs
from mcserver.service.line_queue import Gap, LineQueue
from mcserver.service.motion_port import MotionPort
from mcserver.service.program import Program, Verdict
from mcserver.service.program_table import TICK_S, ProgramTable, ServiceOptions
from mcserver.service.reports import (
    Ack,
    AxisState,
    Event,
    Fault,
    MachineState,
    OnDisconnect,
    ProbeStatus,
    ProgramStatus,
)

log = logging.getLogger(__name__)

OPEN_PROGRAMS = 64
# Of one client, so that none can keep the others out.
CLIENT_PROGRAMS = 16
VERDICT_LIMIT_S = 0.05
SHOWN_ENDED_S = 10.0
STOP_LIMIT_S = 3.0
# Time between two confirmations of one emergency stop [s]
CONFIRM_PERIOD_S = 0.1


class MachineService:
    """One machine's programs, as clients and operators may use them. All of it runs in the asyncio loop.

    Args:
        machine: its axes.
        port: the executor.
        planning: plans the programs.
        options: journal and instance.
        on_ack, on_event: called in the loop.

    Attributes:
        override: feed override of programs to come, 1 as programmed.
    """

    def __init__(
        self,
        machine: Machine,
        port: MotionPort,
        planning: Planning,
        options: ServiceOptions,
        *,
        on_ack: Callable[[Ack], None],
        on_event: Callable[[Event], None],
    ) -> None:
        self.machine = machine
        self.port = port
        self.options = options
        self.override = 1.0
        # emergency stops asked for so far
        self.stops = 0
        self._loop = asyncio.get_running_loop()
        self._table = ProgramTable(
            machine,
            port,
            planning.planner,
            options,
            on_ack=on_ack,
            on_event=on_event,
            inputs=[each.name for each in machine.inputs],
            outputs=[each.name for each in machine.outputs],
        )
        self._planning = planning
        self.channels = Channels(machine, port, self._table.program_in)
        self._table.on_machine_stop = self._stopped_by_input
        self._counter = 0
        # the event of the stop that is latched
        self._estop: Event | None = None
        self._confirmed = 0.0
        self._stopping = False
        self._all_axes = tuple(axis.index for axis in machine.axes)

    # ------------------------------------------------------------ life

    def start(self) -> None:
        """Begins: what an earlier start left open counts as interrupted."""
        self._table.journal.server_started(self.options.instance, self.options.clock())
        self._table.planner.start()
        self._table.heartbeat.start()
        self.events.publish("server.started", message=f"machine {self.machine.name}")
        self._say_lost_references()
        damage = self._table.journal_damage
        if damage is not None:
            message = f"the journal was damaged: {damage.message}; as it was it is kept in {damage.kept}"
            log.error("MC527: %s", message)
            self.events.publish("warning", reason="MC527", message=message)

    async def stop(self) -> None:
        """Stops all motion along its paths, ends the programs, releases the axes and closes the journal."""
        if self._stopping:
            return
        self._stopping = True
        if not self.port.alive():
            self._fail_without_executor()
        self.events.publish("server.stopping")
        for program in self._chosen(None):
            self._table.stop(program, "aborted", "the server is stopping")
        deadline = self._loop.time() + STOP_LIMIT_S
        while self._chosen(None) and self._loop.time() < deadline:
            await asyncio.sleep(TICK_S)
        await self._table.planner.stop()
        if self.port.alive():
            positions = self.port.snapshot().position.tolist()
            self._table.references.stand(dict(zip(self._all_axes, positions, strict=True)))
        await asyncio.to_thread(self.port.close)
        self._table.heartbeat.stop()
        self._table.journal.server_stopped(self.options.instance, self.options.clock())
        await asyncio.to_thread(self._table.close_journal)

    @property
    def events(self) -> EventLog:
        return self._table.events

    @property
    def work_systems(self) -> Mapping[int, Mapping[int, float]]:
        """Work coordinate systems that a program starts with, number → axis → [m or rad]."""
        return self._table.offsets.systems

    @property
    def probe(self) -> ProbeStatus | None:
        """How the last probing move ended."""
        return self._table.probe

    def record_command(self, client: str, method: str, program: str | None = None, detail: str = "") -> None:
        """Keep in the journal who did what, and publish it; a journal that fails keeps nobody from acting."""
        self._journal_command(client, method, program, detail)
        self.events.publish("command", client=client, program=program, reason=method, message=detail)

    def now(self) -> float:
        """Executor time [s]."""
        return self._table.now()

    def send_acknowledgements(self) -> None:
        """Send those that are due without waiting for the loop to come round."""
        self._table.acks.flush()

    # ------------------------------------------------------------ a client and its programs

    async def open(
        self,
        client: str,
        *,
        name: str = "",
        axes: Sequence[int] | None = None,
        on_disconnect: OnDisconnect = "stop",
        start_line: int = 1,
        before: Sequence[str] = (),
        resume_of: str | None = None,
        step: bool = False,
        hold: bool = False,
        unhomed: bool = False,
        controls: Sequence[Control] = (),
    ) -> Program:
        """Opens a program and queues it for its axes.

        Args:
            unhomed: it may move axes that are not homed. controls: all of a program that needs no planner.

        Raises:
            ServiceError: MC503 no program ``resume_of``, MC507 no such axis, MC508 too many programs, MC509 a
                latched fault, MC511, MC514 the journal lacks the lines before, MC515 stopping, MC519.
        """
        self._ready()
        if self._table.journal_failure:
            raise self._unjournaled()
        wanted = self._axes(axes)
        self._check_limits(client)
        if resume_of is not None:
            earlier = self._table.programs.get(resume_of)
            if earlier is None:
                await asyncio.to_thread(check_known, self.options.journal, resume_of)
            elif not earlier.ended:
                raise Refused("MC517", f"{resume_of} has not ended", "abort it first", state=earlier.state)
            if start_line > 1 and not before:
                before = await asyncio.to_thread(
                    read_lines_before, self.options.journal, resume_of, start_line
                )
        if before and len(before) != start_line - 1:
            raise Refused(
                "MC511",
                f"{len(before)} lines before line {start_line}: lines 1 … {start_line - 1} are meant",
                "give all of them, or none",
            )
        frame = self._table.offsets.frame()
        modal = await asyncio.to_thread(self._planning.modal_before, before, frame) if before else None
        self._check_limits(client)
        self._ready()
        self._counter += 1
        program = Program(
            f"{self.options.instance}-{self._counter}",
            client=client,
            name=name,
            axes=wanted,
            on_disconnect=on_disconnect,
            start_line=start_line,
            step=step,
            resume_of=resume_of,
            opened_at=self.options.clock(),
            queue=LineQueue(start_line),
        )
        program.modal = modal
        program.held = hold
        program.unhomed = unhomed
        program.controls = tuple(controls)
        program.closed = bool(controls)
        program.override = self.override
        self._table.add(program, before)
        return program

    async def command(
        self, client: str, name: str, axes: Sequence[int], controls: Sequence[Control]
    ) -> Program:
        """Open a program of control entries, which needs no planner, and queue it for its axes.

        Args:
            controls: all of it; the last one is its end.

        Raises:
            ServiceError: as `open`.
        """
        return await self.open(client, name=name, axes=axes, controls=controls)

    def submit(
        self, client: str, program_id: str, first: int, lines: Sequence[str], *, judge: bool = True
    ) -> Deferred[Program]:
        """Take lines; the result comes once they are journaled and, within a limit, validated.

        Raises:
            ServiceError: MC503, MC504, MC505 a gap, MC510 closed, MC519. The result may be `RejectedLines` (a
                line is faulty; those before it are taken) or MC519 (they cannot be journaled now).
        """
        program = self._owned(client, program_id)
        self._take(program, first, lines, urgent=True)
        last = first + len(lines) - 1
        through = min(last, program.queue.accepted)
        self._check_journal(program, through)
        result: Deferred[Program] = Deferred()
        verdict: Deferred[Verdict] = Deferred()

        def answer(value: Verdict | None, _error: Exception | None) -> None:
            limit.cancel()
            if value is Verdict.REJECTED and program.rejected <= last:
                result.fail(RejectedLines(program.diagnostics, **self._numbers(program)))
            elif value is Verdict.NOT_JOURNALED:
                result.fail(self._unjournaled(program))
            else:
                result.resolve(program)

        limit = self._loop.call_later(VERDICT_LIMIT_S, self._stop_waiting, program, through, verdict)
        verdict.listen(answer)
        program.wait_for(through, verdict, validated=judge)
        return result

    def stream(self, program_id: str, first: int, lines: Sequence[str], *, urgent: bool = False) -> None:
        """Take lines that were put without asking; whatever happens is said by an acknowledgement.

        Args:
            urgent: no other message waits to be journaled with them.
        """
        program = self._table.programs.get(program_id)
        if program is None:
            return
        try:
            self._take(program, first, lines, urgent=urgent)
        except ServiceError as error:
            self._table.acks.acknowledge(program, program.queue.expected if error.code == "MC505" else 0)

    def close(self, client: str, program_id: str, last: int | None = None) -> Deferred[Program]:
        """Take no more lines; the result comes once those accepted are journaled.

        Args:
            last: close only if lines through this number are there.

        Raises:
            ServiceError: MC503, MC504, MC505 line ``last`` is not there yet, MC519 lines cannot be journaled.
        """
        program = self._owned(client, program_id)
        if last is not None and not program.ended and program.queue.accepted < last:
            raise Refused(
                "MC505",
                f"line {program.queue.expected} is the next one expected, {last} was to be the last",
                f"send lines from {program.queue.expected} on first",
                **self._numbers(program),
            )
        through = program.queue.accepted
        if not program.ended:
            self._check_journal(program, through)
        self._table.close(program)
        result: Deferred[Program] = Deferred()
        verdict: Deferred[Verdict] = Deferred()

        def answer(value: Verdict | None, _error: Exception | None) -> None:
            if value is Verdict.NOT_JOURNALED:
                result.fail(self._unjournaled(program))
            else:
                result.resolve(program)

        verdict.listen(answer)
        if program.ended or program.journaled >= through:
            verdict.resolve(Verdict.TAKEN)
        else:
            program.wait_for(through, verdict, validated=False)
        return result

    def step(self, client: str, program_id: str) -> Program:
        """Lets the next line of a program in single line mode start."""
        program = self._owned(client, program_id)
        if not program.step or program.ended:
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
        chosen = [program for program in self._chosen(program_id) if not program.held]
        for program in chosen:
            program.held = True
            if program.slot is not None:
                self.port.hold(program.slot)
                self._table.enter(program, "held")
            self._table.publish("program.held", program)
        return chosen

    def resume(self, program_id: str | None) -> list[Program]:
        """Ends a hold, M00 or M01.

        Raises:
            ServiceError: MC443 an input holds the programs; MC503, MC509, MC515, MC517.
        """
        self._ready()
        self.channels.refuse_interlocked(self.channels.holding(), "resume")
        chosen = [
            program for program in self._chosen(program_id) if program.held or program.state == "paused"
        ]
        for program in chosen:
            program.held = False
            if program.slot is not None:
                self.port.resume(program.slot)
                self._table.enter(program, "running")
            self._table.publish("program.resumed", program)
        return chosen

    def abort(self, program_id: str | None, reason: str = "") -> list[Program]:
        """Stops along the path and drops the rest."""
        chosen = self._chosen(program_id)
        for program in chosen:
            self._table.stop(program, "aborted", reason)
        if program_id is None:
            # axes that move by themselves too (G1020, G1030, G1040)
            self.port.stop_all()
        return chosen

    def set_override(self, ratio: float, program_id: str | None) -> list[Program]:
        """Feed override; of all programs, those to come included, without an id."""
        chosen = self._chosen(program_id)
        if program_id is None:
            self.override = ratio
        for program in chosen:
            program.override = min(ratio, program.override_limit)
            if program.slot is not None:
                self.port.override(program.slot, program.override)
        self.events.publish("override", program=program_id, percent=100.0 * ratio)
        return chosen

    def client_gone(self, client: str) -> None:
        """A client's liveliness token went: its programs finish or stop, as they chose."""
        left = [
            program
            for program in self._table.programs.values()
            if program.client == client and not program.ended
        ]
        if left:
            self.events.publish("client.gone", client=client)
        for program in left:
            if program.on_disconnect == "finish":
                self._table.close(program)
            else:
                self._table.stop(program, "aborted", f"client {client} is gone")

    def program(self, program_id: str) -> Program:
        """Raises ServiceError MC503 where there is none."""
        program = self._table.programs.get(program_id)
        if program is None:
            raise Refused(
                "MC503", f"there is no program {program_id}", "list them with `programs`", program=program_id
            )
        return program

    # ------------------------------------------------------------ the machine

    def emergency_stop(self, client: str, reason: str) -> None:
        """Latch the stop, here and in the executor; a stop that is latched already is confirmed again."""
        self.stops += 1
        self.port.emergency_stop()
        if self._estop is not None:
            self._confirm_stop(self._estop)
            return
        # the one that latches it; repetitions would fill the journal
        self._journal_command(client, "estop", None, reason)
        fault = Fault(
            code="MC400",
            message="emergency stop" + (f": {reason}" if reason else ""),
            hint="remove the cause, then reset",
            t=self.now(),
        )
        self._table.faults.latch(fault)
        self._estop = self.events.publish("estop", reason=reason, client=client or None)
        self._confirmed = self._loop.time()
        for program in list(self._table.programs.values()):
            if not program.ended:
                self._table.stop(program, "faulted", "emergency stop", fault)

    def _stopped_by_input(self, fault: Fault) -> None:
        """The executor has latched a stop by itself: it counts like one that was asked for."""
        self._table.faults.latch(fault)
        if self._estop is None:
            self._estop = self.events.publish("estop", reason=fault.message)
            self._confirmed = self._loop.time()
        for program in list(self._table.programs.values()):
            if not program.ended:
                self._table.stop(program, "faulted", fault.message, fault)

    def set_output(self, name: str, value: bool | float) -> float:
        """Set an output by its name.

        Raises:
            ServiceError: MC445, MC446; MC509 the emergency stop is latched; MC515.
        """
        self._ready()
        return self.channels.set_output(name, value)

    def _confirm_stop(self, event: Event) -> None:
        """Publish the event of the latched stop again, under its number; seldom, however many ask for it."""
        if self._loop.time() - self._confirmed >= CONFIRM_PERIOD_S:
            self._confirmed = self._loop.time()
            self.events.repeat(event)

    def reset(self, axes: Sequence[int] | None) -> None:
        """Clears the latch; axes stay without energy.

        Raises:
            ServiceError: MC443 an input stops the machine; MC509 programs are still coming to rest; MC507.
        """
        self.channels.refuse_interlocked(self.channels.stopping(), "reset")
        wanted = self._axes(axes)
        if any(program.state == "ending" for program in self._table.programs.values()):
            raise Refused("MC509", "motion is still coming to rest", "try again in a moment", faults=[])
        self.port.reset(frozenset(wanted))
        self._estop = None
        self._table.faults.clear()
        self.events.publish("reset", message="the latch is cleared")

    @property
    def state(self) -> MachineState:
        if self._estop is not None:
            return "estop"
        return "fault" if self._table.faults else "ready"

    @property
    def faults(self) -> list[Fault]:
        return list(self._table.faults)

    def refresh_faults(self, states: Mapping[int, AxisState]) -> None:
        """Drops the faults of axes that a G1000 has cleared, and of lines that no axis has latched."""
        if self._estop is None and self._table.faults.forget_cleared(states):
            self.events.publish("reset", message="the latch is cleared")

    def homed(self, axis: int) -> bool:
        """Return whether an axis knows where it is."""
        homed = self.port.snapshot().homed
        return not homed or homed[self.machine.column_of(axis)]

    def holder(self, axis: int) -> str | None:
        """The program that may move ``axis`` now."""
        return self._table.leases.holder(axis)

    def positions_si(self, positions: Mapping[str, float]) -> dict[int, float]:
        """Positions by axis number as text [mm, deg], in SI.

        Raises:
            ServiceError: MC507 no such axis.
        """
        found = {}
        for name, value in positions.items():
            axis = self.machine.axis(int(name)) if name.isdecimal() else None
            if axis is None:
                raise Refused(
                    "MC507", f"the machine {self.machine.name} has no axis {name!r}", "see `info`", axis=name
                )
            found[axis.index] = value * axis.type.si_per_unit
        return found

    def current(self) -> list[Program]:
        """Programs that have not ended, and those that ended a moment ago."""
        since = self.options.clock() - SHOWN_ENDED_S
        self._estimate()
        return [
            program
            for program in self._table.programs.values()
            if not program.ended or (program.ended_at is not None and program.ended_at >= since)
        ]

    async def known(self, *, program_id: str | None, ended: bool, limit: int) -> list[ProgramStatus]:
        """Programs of this start and, from the journal, of earlier ones; newest first."""
        self._estimate()
        mine = {key: program for key, program in self._table.programs.items() if program_id in (None, key)}
        found = [program.status() for program in reversed(mine.values()) if ended or not program.ended]
        if ended and len(found) < limit:
            older = await asyncio.to_thread(
                read_programs, self.options.journal, limit=limit + len(mine), program=program_id
            )
            found += [status for status in older if status.program not in mine]
        if program_id is not None and not found and program_id not in mine:
            self.program(program_id)
        return found[:limit]

    # ------------------------------------------------------------ inside

    def _journal_command(self, client: str, method: str, program: str | None, detail: str) -> None:
        # what gathers before a journal that cannot be written stays bounded
        if not self._table.journal_failure:
            self._table.journal.command(self.options.clock(), client, method, program, detail)

    def _say_lost_references(self) -> None:
        """Say which references of an earlier start do not hold now."""
        references = self._table.references
        if references.damage:
            log.error("MC459: %s", references.damage)
            self.events.publish("warning", reason="MC459", message=references.damage)
        for axis in sorted(references.axes):
            if not self.homed(axis):
                message = (
                    f"axis {axis} is not homed: its encoder does not read what it did when the server stopped"
                )
                log.warning("MC459: %s", message)
                self.events.publish("warning", reason="MC459", axis=axis, message=message)
                references.forget(axis)

    def _fail_without_executor(self) -> None:
        fault = Fault(
            code="MC518",
            message=f"the executor process has died ({self.port.ending()}); the drives stop by their own "
            "heartbeat time-out",
            hint="start the server again; axes have to be captured anew",
            t=self.now(),
        )
        self._table.faults.latch(fault)
        self.events.publish("fault", fault=fault, message=fault.message)
        # the newest first, so that none is given the axes of one before it
        for program in reversed(self._chosen(None)):
            self._table.stop(program, "faulted", fault.message, fault)

    def _estimate(self) -> None:
        """Estimate the time left of what is planned, at the override in force; waits and dwells come on
        top."""
        slots: Sequence[SlotView] | None = None
        for program in self._table.programs.values():
            if program.ended or program.slot is None or program.planned_end_u is None:
                continue
            # only read where something runs: it is half of what a call of an idle machine costs
            slots = slots or self.port.slots()
            left = max(0.0, program.planned_end_u - slots[program.slot].u) * self.machine.cycle_s
            pace = min(1.0, program.override) if program.override > 0.0 else 1.0
            program.eta_s = left / pace

    def _chosen(self, program_id: str | None) -> list[Program]:
        if program_id is None:
            return [program for program in self._table.programs.values() if not program.ended]
        program = self.program(program_id)
        if program.ended:
            raise Refused("MC517", f"{program_id} has ended: {program.state}", "", state=program.state)
        return [program]

    def _ready(self) -> None:
        if self._stopping:
            raise Refused("MC515", "the server is stopping", "wait for its next start")
        if self._estop is not None:
            raise Refused(
                "MC509",
                "the emergency stop is latched",
                "remove the cause, then reset",
                faults=[msgspec.to_builtins(fault) for fault in self._table.faults],
            )

    def _axes(self, axes: Sequence[int] | None) -> tuple[int, ...]:
        if axes is None:
            return self._all_axes
        if not axes:
            raise Refused("MC507", "a lease needs an axis", "leave `axes` out for all")
        for axis in axes:
            if axis not in self._all_axes:
                raise Refused(
                    "MC507",
                    f"the machine {self.machine.name} has no axis {axis}",
                    f"it has {', '.join(map(str, self._all_axes))}",
                    axis=axis,
                )
        return tuple(sorted(set(axes)))

    def _owned(self, client: str, program_id: str) -> Program:
        program = self.program(program_id)
        if program.client != client:
            raise Refused(
                "MC504",
                f"{program_id} belongs to {program.client}",
                "open a program of your own",
                program=program_id,
                client=program.client,
            )
        return program

    def _numbers(self, program: Program) -> dict[str, object]:
        return {
            "expected": program.queue.expected,
            "accepted": program.journaled,
            "done": program.done,
            "credit": program.credit,
        }

    def _take(self, program: Program, first: int, lines: Sequence[str], *, urgent: bool) -> None:
        last = first + len(lines) - 1
        if last <= program.queue.accepted:
            # all of it is there: acknowledged again, whatever has become of the program since
            self._table.acks.acknowledge(program)
            return
        if not program.takes_lines:
            raise Refused(
                "MC510",
                f"{program.program} takes no more lines: {program.state}",
                "open another program",
                state=program.state,
                **self._numbers(program),
            )
        self._check_journal(program)
        taken = program.queue.take(first, lines)
        if isinstance(taken, Gap):
            raise Refused(
                "MC505",
                f"line {taken.expected} is the next one expected, not {first}",
                f"send lines from {taken.expected} on",
                **self._numbers(program),
            )
        if not taken.lines:
            self._table.acks.acknowledge(program)
            return
        self._table.lines(program, taken.first, taken.lines, urgent=urgent)

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

    def _check_journal(self, program: Program, through: int | None = None) -> None:
        """Refuse what the journal cannot take now; with ``through`` only if these lines are not in it."""
        if self._table.journal_failure and (through is None or program.journaled < through):
            raise self._unjournaled(program)

    def _unjournaled(self, program: Program | None = None) -> Refused:
        return Refused(
            "MC519",
            f"the journal cannot be written: {self._table.journal_failure}",
            "make room on the disk, then send again",
            **({} if program is None else self._numbers(program)),
        )

    def _stop_waiting(self, program: Program, through: int, verdict: Deferred[Verdict]) -> None:
        if program.journaled >= through:
            verdict.resolve(Verdict.TAKEN)
        elif not verdict.done:
            # only what is journaled is ever acknowledged
            self._loop.call_later(VERDICT_LIMIT_S, self._stop_waiting, program, through, verdict)
