"""What clients do with their own programs: open, submit, stream, close, step.

All of it runs in the asyncio loop and never waits for anything but its own threads.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

import msgspec

from mcserver.errors import ServiceError
from mcserver.machine.machine_file import Machine
from mcserver.planning.planner_messages import Order, Planning
from mcserver.service.deferred import Deferred
from mcserver.service.journal_reader import read_lines_before
from mcserver.service.line_queue import Gap, LineQueue
from mcserver.service.motion_port import MotionPort
from mcserver.service.program import Program, Verdict
from mcserver.service.program_table import ProgramTable
from mcserver.service.refusals import Refused, RejectedLines
from mcserver.service.reports import Ack, Event, OnDisconnect
from mcserver.service.service_options import ServiceOptions

OPEN_PROGRAMS = 64
VERDICT_LIMIT_S = 0.05


class ProgramIntake:
    """Takes programs and their lines, or refuses them.

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
        self._loop = asyncio.get_running_loop()
        self._table = ProgramTable(port, planning.planner, options, on_ack=on_ack, on_event=on_event)
        self._planning = planning
        self._counter = 0
        self._estop = False
        self._stopping = False
        self._all_axes = tuple(axis.index for axis in machine.axes)

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
    ) -> Program:
        """Opens a program and queues it for its axes.

        Raises:
            ServiceError: MC507 an axis that the machine lacks, MC508 too many, MC509 a latched fault, MC511,
                MC514 the journal lacks the lines before, MC515 stopping.
        """
        self._ready()
        wanted = self._axes(axes)
        if resume_of is not None and not before:
            earlier = self._table.programs.get(resume_of)
            if earlier is not None and not earlier.ended:
                raise Refused("MC517", f"{resume_of} has not ended", "abort it first", state=earlier.state)
            if start_line > 1:
                before = await asyncio.to_thread(
                    read_lines_before, self.options.journal, resume_of, start_line
                )
        if before and len(before) != start_line - 1:
            raise Refused(
                "MC511",
                f"{len(before)} lines before line {start_line}: lines 1 … {start_line - 1} are meant",
                "give all of them, or none",
            )
        modal = await asyncio.to_thread(self._planning.modal_before, before) if before else None
        if sum(not program.ended for program in self._table.programs.values()) >= OPEN_PROGRAMS:
            raise Refused("MC508", f"{OPEN_PROGRAMS} programs are open", "close one", limit=OPEN_PROGRAMS)
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
        program.override = self.override
        self._table.add(program, before)
        return program

    def submit(
        self, client: str, program_id: str, first: int, lines: Sequence[str], *, judge: bool = True
    ) -> Deferred[Program]:
        """Takes lines; the result comes once they are journaled and, within a limit, judged.

        Raises:
            ServiceError: MC503, MC504, MC505 a gap, MC510 closed. The result may be `RejectedLines`: a
                line is faulty; those before it are taken.
        """
        program = self._owned(client, program_id)
        self._take(program, first, lines, asked=True)
        last = first + len(lines) - 1
        through = min(last, program.queue.accepted)
        result: Deferred[Program] = Deferred()
        verdict: Deferred[Verdict] = Deferred()

        def judged(value: Verdict | None, _error: Exception | None) -> None:
            limit.cancel()
            if value is Verdict.REJECTED and program.rejected <= last:
                result.fail(RejectedLines(program.diagnostics, **self._numbers(program)))
            else:
                result.resolve(program)

        limit = self._loop.call_later(VERDICT_LIMIT_S, self._stop_waiting, program, through, verdict)
        verdict.listen(judged)
        program.wait_for(through, verdict, judged=judge)
        return result

    def stream(self, program_id: str, first: int, lines: Sequence[str]) -> None:
        """Takes lines that were put without asking; whatever happens is told by an acknowledgement."""
        program = self._table.programs.get(program_id)
        if program is None:
            return
        try:
            self._take(program, first, lines, asked=False)
        except ServiceError as error:
            self._table.acks.acknowledge(program, program.queue.expected if error.code == "MC505" else 0)

    def close(self, client: str, program_id: str, last: int | None = None) -> Program:
        """No more lines. With ``last``: only if lines through ``last`` are there.

        Raises:
            ServiceError: MC503, MC504, MC505 line ``last`` is not there yet.
        """
        program = self._owned(client, program_id)
        if last is not None and not program.ended and program.queue.accepted < last:
            raise Refused(
                "MC505",
                f"line {program.queue.expected} is the next one expected, {last} was to be the last",
                f"send lines from {program.queue.expected} on first",
                **self._numbers(program),
            )
        self._table.close(program)
        return program

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
        self._table.planner.order(Order(program_id, "step"))
        return program

    def program(self, program_id: str) -> Program:
        """Raises ServiceError MC503 where there is none."""
        program = self._table.programs.get(program_id)
        if program is None:
            raise Refused(
                "MC503", f"there is no program {program_id}", "list them with `programs`", program=program_id
            )
        return program

    def _ready(self) -> None:
        if self._stopping:
            raise Refused("MC515", "the server is stopping", "wait for its next start")
        if self._estop:
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

    def _take(self, program: Program, first: int, lines: Sequence[str], *, asked: bool) -> None:
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
        if self._table.journal_failure:
            raise Refused(
                "MC519",
                f"the journal cannot be written: {self._table.journal_failure}",
                "make room on the disk",
            )
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
        self._table.lines(program, taken.first, taken.lines, asked=asked)

    def _stop_waiting(self, program: Program, through: int, verdict: Deferred[Verdict]) -> None:
        if program.journaled >= through:
            verdict.resolve(Verdict.TAKEN)
        elif not verdict.done:
            # only what is journaled is ever acknowledged
            self._loop.call_later(VERDICT_LIMIT_S, self._stop_waiting, program, through, verdict)
