"""Journal the progress of programs, and report it when it is journaled."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from functools import partial

from mcserver.service.journal import Journal
from mcserver.service.program import Program
from mcserver.service.reports import LineReport

# Interval after which ended lines are journaled [s], or count of lines.
TICK_S = 0.02
LINES = 32


class ProgressReports:
    """Collects the progress of programs over a tick, so that short lines do not cost a message each.

    Progress is reported when the journal has committed it. One record of a program is written at a time, so
    that what is collected while the disk is slow is bounded by the lines that were accepted before.

    Args:
        publish: publishes an event about a program. acknowledge: a program whose ``done`` has changed.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        journal: Journal,
        publish: Callable[..., None],
        acknowledge: Callable[[Program], None],
    ) -> None:
        self._loop = loop
        self._journal = journal
        self._publish = publish
        self._acknowledge = acknowledge
        # in order, so that runs are reproducible
        self._moved: dict[str, Program] = {}
        self._tick_scheduled = False
        # programs with a record that is being written
        self._writing: set[str] = set()

    def moved(self, program: Program) -> None:
        """Report a program at the end of this tick, or now if much has been collected."""
        self._moved[program.program] = program
        if program.progress.done - program.done >= LINES and program.program not in self._writing:
            self._report(program)
        elif not self._tick_scheduled:
            self._tick_scheduled = True
            self._loop.call_later(TICK_S, self._tick)

    def end(self, program: Program) -> None:
        """Journal the rest of a program that is over, after records that are being written."""
        self._moved.pop(program.program, None)
        self._say_begun(program)
        self._write(program)

    def _tick(self) -> None:
        self._tick_scheduled = False
        moved, self._moved = self._moved, {}
        for program in moved.values():
            self._report(program)

    def _report(self, program: Program) -> None:
        if program.over:
            return
        self._say_begun(program)
        if program.program not in self._writing:
            self._write(program)

    def _say_begun(self, program: Program) -> None:
        started = program.progress.started
        if started > program.last_reported_started:
            program.last_reported_started = started
            self._publish("lines.started", program, line=started)

    def _write(self, program: Program) -> None:
        progress = program.progress
        ended, done = progress.take_ended(), progress.done
        # also for a line that has only begun: after a crash it shows that the program has run
        if ended or done > program.done or progress.started > program.journaled_started:
            self._writing.add(program.program)
            committed = partial(self._committed, program, done, ended)
            program.journaled_started = progress.started
            self._journal.progress(program.program, progress.started, done, committed)

    def _committed(self, program: Program, done: int, ended: Sequence[LineReport]) -> None:
        self._writing.discard(program.program)
        moved, program.done = done > program.done, max(program.done, done)
        if ended:
            self._publish("lines.ended", program, lines=list(ended))
        if ended or moved:
            self._acknowledge(program)
        progress = program.progress
        more = progress.done > program.done or progress.started > program.journaled_started
        if not program.over and (more or progress.any_ended):
            self.moved(program)
