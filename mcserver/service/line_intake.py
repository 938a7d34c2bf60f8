"""Accept lines from clients into programs: numbered without gaps, journaled, validated, acknowledged."""

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
    """Accepts lines of open programs, in the event loop."""

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
        """Accept lines at once; the result comes once they are journaled and, within a time limit, validated.

        Args:
            rejections: count that the client knew of when it numbered the lines; None: not given.

        Raises:
            ServiceError: MC503, MC504, MC505 a gap, or lines numbered before a rejection, MC510 closed,
                MC519. The result may be `RejectedLines` (a line is faulty; those before it are accepted) or
                MC519 (they cannot be journaled now).
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
        # if nobody awaits it, an acknowledgement reports the error
        task.add_done_callback(lambda done: done.cancelled() or done.exception())
        return task

    async def _judged(
        self, program: Program, last: int, through: int, verdict: asyncio.Future[Verdict]
    ) -> Program:
        while not verdict.done():
            await asyncio.wait([verdict], timeout=VERDICT_LIMIT_S)
            # acknowledge only what is journaled
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
        """Accept lines that were sent without a request; the answer is an acknowledgement in any case.

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
        """Accept no more lines; the result comes once the journal has all accepted lines, and the close.

        Args:
            last: close only if lines up to this number have been accepted.

        Raises:
            ServiceError: MC503, MC504, MC505 line ``last`` is missing, MC519 lines cannot be journaled.
        """
        program = owned_program(self._table.programs, client, program_id)
        if not program.over:
            check_last(program, last)
            self._check_journal(program, program.queue.accepted)
        self._table.close(program)
        known = asyncio.sleep(0.0, program) if program.over else self.recorded(program)
        return self._begun(known)

    async def recorded(self, program: Program) -> Program:
        """Return the program once the journal has everything about it so far.

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
        """Refuse what the journal cannot store now; with ``through`` only if these lines are not in it."""
        if self._table.journal_failure and (through is None or program.journaled < through):
            raise self.unjournaled(program)

    def unjournaled(self, program: Program | None = None) -> Refused:
        """Return the refusal of what the journal cannot store."""
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
        rejections: as in `LineIntake.submit`. check: raises if new lines cannot be accepted now.

    Returns:
        The new lines; None: all were accepted before, and are acknowledged again.

    Raises:
        ServiceError: MC505 a gap, or lines numbered before a rejection, MC510 it accepts no more.
    """
    of_now = _of_now(program, rejections)
    if of_now and first + len(lines) - 1 <= program.queue.accepted:
        # whatever the state of the program
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
        # numbered before a line was rejected: these numbers now belong to other lines
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
    """Refuse the end of a program before all of its lines are accepted.

    Args:
        last: of its lines; None: the last accepted one.

    Raises:
        ServiceError: MC505 it is missing.
    """
    if last is not None and program.queue.accepted < last:
        raise Refused(
            "MC505",
            f"line {program.queue.expected} is the next one expected, {last} was to be the last",
            f"send lines from {program.queue.expected} on first",
            **numbers_of(program),
        )


def _of_now(program: Program, rejections: int | None) -> bool:
    """Return whether lines sent at this count of rejections have current numbers."""
    return rejections is None or rejections == program.epoch


def numbers_of(program: Program) -> dict[str, object]:
    """Return the program's line numbers for a refusal of lines."""
    return {
        "expected": program.queue.expected,
        "accepted": program.journaled,
        "done": program.done,
        "credit": program.credit,
        "rejections": program.epoch,
    }
