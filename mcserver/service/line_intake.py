"""Lines from clients into their programs: numbered without a gap, journaled, judged, acknowledged."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from mcserver.errors import Refused, RejectedLines, ServiceError
from mcserver.service.line_queue import Gap, LineBatch
from mcserver.service.program import Program, Verdict, give
from mcserver.service.program_access import owned_program
from mcserver.service.program_table import ProgramTable

VERDICT_LIMIT_S = 0.05


class LineIntake:
    """Take the lines of open programs, in the asyncio loop."""

    def __init__(self, table: ProgramTable, loop: asyncio.AbstractEventLoop) -> None:
        self._table = table
        self._loop = loop

    def submit(
        self,
        client: str,
        program_id: str,
        first: int,
        lines: Sequence[str],
        rejections: int | None = None,
        *,
        judge: bool = True,
    ) -> asyncio.Task[Program]:
        """Take lines, now; the result comes once they are journaled and, within a limit, validated.

        Args:
            rejections: how many the client knew of when it gave them the numbers; None: not said.

        Raises:
            ServiceError: MC503, MC504, MC505 a gap or lines of before a rejection, MC510 closed, MC519. The
                result may be `RejectedLines` (a line is faulty; those before it are taken) or MC519 (they
                cannot be journaled now).
        """
        program = owned_program(self._table.programs, client, program_id)
        self._take(program, first, lines, rejections)
        last = first + len(lines) - 1
        through = min(last, program.queue.accepted)
        self._check_journal(program, through)
        verdict: asyncio.Future[Verdict] = self._loop.create_future()
        program.wait_for(through, verdict, validated=judge)
        return self._begun(self._judged(program, last, through, verdict))

    def _begun(self, answer: Coroutine[Any, Any, Program]) -> asyncio.Task[Program]:
        task = self._loop.create_task(answer)
        # who does not wait for it hears of an error by an acknowledgement
        task.add_done_callback(lambda done: done.cancelled() or done.exception())
        return task

    async def _judged(
        self, program: Program, last: int, through: int, verdict: asyncio.Future[Verdict]
    ) -> Program:
        while not verdict.done():
            await asyncio.wait([verdict], timeout=VERDICT_LIMIT_S)
            # only what is journaled is ever acknowledged
            if program.journaled >= through:
                give(verdict, Verdict.TAKEN)
        if verdict.result() is Verdict.REJECTED and program.rejected <= last:
            raise RejectedLines(program.diagnostics, **numbers_of(program))
        if verdict.result() is Verdict.NOT_JOURNALED:
            raise self.unjournaled(program)
        return program

    def stream(
        self,
        program_id: str,
        first: int,
        lines: Sequence[str],
        rejections: int | None = None,
    ) -> None:
        """Take lines that were put without asking; whatever happens is said by an acknowledgement.

        Args:
            rejections: as of `submit`.
        """
        program = self._table.programs.get(program_id)
        if program is None:
            return
        try:
            self._take(program, first, lines, rejections)
        except ServiceError as error:
            gap = error.code == "MC505" and _of_now(program, rejections)
            self._table.acks.acknowledge(program, program.queue.expected if gap else 0)

    def close(self, client: str, program_id: str, last: int | None = None) -> asyncio.Task[Program]:
        """Take no more lines; the result comes once the journal has those accepted, and that they are all.

        Args:
            last: close only if lines through this number are there.

        Raises:
            ServiceError: MC503, MC504, MC505 line ``last`` is not there yet, MC519 lines cannot be journaled.
        """
        program = owned_program(self._table.programs, client, program_id)
        if not program.over:
            check_last(program, last)
            self._check_journal(program, program.queue.accepted)
        self._table.close(program)
        known = asyncio.sleep(0.0, program) if program.over else self.recorded(program)
        return self._begun(known)

    async def recorded(self, program: Program) -> Program:
        """Return the program once the journal has what has become of it so far.

        Raises:
            ServiceError: MC519 it cannot be journaled.
        """
        if await self._table.recorded(program) is Verdict.NOT_JOURNALED:
            raise self.unjournaled(program)
        return program

    def _take(
        self,
        program: Program,
        first: int,
        lines: Sequence[str],
        rejections: int | None,
    ) -> None:
        taken = take_lines(program, first, lines, rejections, lambda: self._check_journal(program))
        if taken is None:
            self._table.acks.acknowledge(program)
        else:
            self._table.lines(program, taken.first, taken.lines)

    def _check_journal(self, program: Program, through: int | None = None) -> None:
        """Refuse what the journal cannot take now; with ``through`` only if these lines are not in it."""
        if self._table.journal_failure and (through is None or program.journaled < through):
            raise self.unjournaled(program)

    def unjournaled(self, program: Program | None = None) -> Refused:
        """Return the refusal of what the journal cannot take."""
        return Refused(
            "MC519",
            f"the journal cannot be written: {self._table.journal_failure}",
            "make room on the disk, then send again",
            **({} if program is None else numbers_of(program)),
        )


def take_lines(
    program: Program,
    first: int,
    lines: Sequence[str],
    rejections: int | None,
    check: Callable[[], None] = lambda: None,
) -> LineBatch | None:
    """Take lines into a program's queue.

    Args:
        rejections: as of `LineIntake.submit`. check: raises where lines that are new cannot be taken now.

    Returns:
        Those that are new; None: all of it is there, and is acknowledged again.

    Raises:
        ServiceError: MC505 a gap or lines of before a rejection, MC510 it takes no more.
    """
    of_now = _of_now(program, rejections)
    if of_now and first + len(lines) - 1 <= program.queue.accepted:
        # whatever has become of the program since
        return None
    if not program.takes_lines:
        raise Refused(
            "MC510",
            f"{program.program} takes no more lines: {program.state}",
            "open another program",
            state=program.state,
            reason=program.reason,
            **numbers_of(program),
        )
    if not of_now:
        # they were given before a line was rejected: their numbers are those of other lines now
        raise Refused(
            "MC505",
            f"lines from {first} on were given when {rejections} lines had been rejected, now it is"
            f" {program.epoch}",
            f"send what is to run from line {program.queue.expected} on",
            **numbers_of(program),
        )
    check()
    taken = program.queue.take(first, lines)
    if isinstance(taken, Gap):
        raise Refused(
            "MC505",
            f"line {taken.expected} is the next one expected, not {first}",
            f"send lines from {taken.expected} on",
            **numbers_of(program),
        )
    return taken if taken.lines else None


def check_last(program: Program, last: int | None) -> None:
    """Refuse the end of a program before all of its lines are there.

    Args:
        last: of its lines; None: that which is there.

    Raises:
        ServiceError: MC505 it is not there yet.
    """
    if last is not None and program.queue.accepted < last:
        raise Refused(
            "MC505",
            f"line {program.queue.expected} is the next one expected, {last} was to be the last",
            f"send lines from {program.queue.expected} on first",
            **numbers_of(program),
        )


def _of_now(program: Program, rejections: int | None) -> bool:
    """Return whether lines that were given at this count of rejections have the numbers of now."""
    return rejections is None or rejections == program.epoch


def numbers_of(program: Program) -> dict[str, object]:
    """Return what a refusal of lines says of where the program is."""
    return {
        "expected": program.queue.expected,
        "accepted": program.journaled,
        "done": program.done,
        "credit": program.credit,
        "rejections": program.epoch,
    }
