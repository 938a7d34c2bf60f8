"""Track clients that come and go, and end the programs of those that are away.

A client's liveliness token disappears alike when it is killed and when its link is cut. A program sets at
`open` how long its client may be away; a client that ends says so itself (`leave`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from mcserver.service.program import Program
from mcserver.service.program_table import ProgramTable


class Absences:
    """Clients that are away, and timers of their programs. All methods run in the loop.

    Attributes:
        when_gone: called with each client that has gone, or has left.
    """

    def __init__(self, table: ProgramTable, loop: asyncio.AbstractEventLoop) -> None:
        self.when_gone: list[Callable[[str], None]] = []
        self._table = table
        self._loop = loop
        self._timers: dict[str, asyncio.TimerHandle] = {}

    def gone(self, client: str) -> None:
        """Start the grace times of a client's programs: its liveliness token has disappeared."""
        left = self._programs_of(client)
        if left:
            self._table.events.publish("client.gone", client=client)
        for program in left:
            if program.grace_s <= 0.0:
                self._end(program)
            elif program.program not in self._timers:
                self._timers[program.program] = self._loop.call_later(program.grace_s, self._end, program)
        for tell in self.when_gone:
            tell(client)

    def back(self, client: str) -> None:
        """Cancel the grace times of a client's programs: its liveliness token has appeared."""
        for program in self._programs_of(client):
            self.forget(program)

    def leave(self, client: str) -> list[Program]:
        """End the programs of a client that leaves, without a grace time; return them."""
        left = self._programs_of(client)
        for program in left:
            self._end(program)
        for tell in self.when_gone:
            tell(client)
        return left

    def forget(self, program: Program) -> None:
        """Remove the timer of a program, if it has one."""
        timer = self._timers.pop(program.program, None)
        if timer is not None:
            timer.cancel()

    def _programs_of(self, client: str) -> list[Program]:
        return [each for each in self._table.programs.values() if each.client == client and not each.over]

    def _end(self, program: Program) -> None:
        """End a program according to its ``on_disconnect``."""
        self.forget(program)
        if program.on_disconnect == "finish":
            self._table.close(program, whole=False)
        else:
            self._table.stop(program, "aborted", f"client {program.client} is gone")
