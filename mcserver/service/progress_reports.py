"""Which lines of programs have begun and ended, at most once a tick."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from mcserver.service.program import Program
from mcserver.service.reports import LineReport

TICK_S = 0.02


class ProgressReports:
    """Gather the progress of programs over a tick, so that short lines do not cost a message each.

    Args:
        loop: in which the ticks come.
        publish: an event about a program.
        journal: writes how far a program has come, with the lines that have ended.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        publish: Callable[..., None],
        journal: Callable[[Program, Sequence[LineReport]], None],
    ) -> None:
        self._loop = loop
        self._publish = publish
        self._journal = journal
        # in order, so that a run can be repeated
        self._moved: dict[str, Program] = {}
        self._tick_scheduled = False

    def moved(self, program: Program) -> None:
        """Report a program at the end of this tick."""
        self._moved[program.program] = program
        if not self._tick_scheduled:
            self._tick_scheduled = True
            self._loop.call_later(TICK_S, self._tick)

    def _tick(self) -> None:
        self._tick_scheduled = False
        moved, self._moved = self._moved, {}
        for program in moved.values():
            if not program.ended:
                self.report(program)

    def report(self, program: Program) -> None:
        """Report at once what has come since the last report."""
        progress = program.progress
        ended = progress.take_ended()
        begun = progress.started > program.last_reported_started
        done = program.done != program.last_reported_done
        if not (ended or begun or done):
            return
        if begun:
            self._publish("lines.started", program, line=progress.started)
        if ended:
            self._publish("lines.ended", program, lines=ended)
        program.last_reported_started, program.last_reported_done = progress.started, program.done
        self._journal(program, ended)
