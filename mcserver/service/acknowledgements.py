"""Send acknowledgements: at most one per program and turn of the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from mcserver.service.program import Program
from mcserver.service.reports import Ack


class AckSender:
    """Collects acknowledgements until the next turn of the event loop."""

    def __init__(self, send: Callable[[Ack], None]) -> None:
        self._send = send
        self._loop = asyncio.get_running_loop()
        self._due: dict[str, tuple[Program, int]] = {}

    def acknowledge(self, program: Program, expected: int = 0) -> None:
        """Acknowledge a program's state; ``expected`` answers a gap."""
        if not self._due:
            self._loop.call_soon(self._flush)
        before = self._due.get(program.program, (program, 0))[1]
        self._due[program.program] = (program, max(expected, before))

    def _flush(self) -> None:
        due, self._due = self._due, {}
        for program, expected in due.values():
            self._send(program.ack(expected))
