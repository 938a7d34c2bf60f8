"""Track clients that are away, and end their programs after a grace time.

A client's liveliness token disappears alike when it is killed and when its link is cut. A program sets at
`open` how long its client may be away; a client that ends says so itself (`leave`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable

from mcserver.service.program import Program


class Absences:
    """Programs whose clients are away, each with a timer. All methods run in the loop.

    Args:
        end: ends a program according to its ``on_disconnect``.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, end: Callable[[Program], None]) -> None:
        self._loop = loop
        self._end = end
        self._waiting: dict[str, tuple[Program, asyncio.TimerHandle]] = {}

    def began(self, programs: Iterable[Program]) -> None:
        """Start the grace time of programs whose client's token has disappeared."""
        for program in programs:
            if program.grace_s <= 0.0:
                self._end(program)
            elif program.program not in self._waiting:
                timer = self._loop.call_later(program.grace_s, self._over, program.program)
                self._waiting[program.program] = program, timer

    def ended(self, client: str) -> None:
        """Cancel the grace time of a client's programs: it has returned."""
        for name in [name for name, (program, _) in self._waiting.items() if program.client == client]:
            self._waiting.pop(name)[1].cancel()

    def forget(self, program: str) -> None:
        """Remove a program that has ended."""
        waiting = self._waiting.pop(program, None)
        if waiting is not None:
            waiting[1].cancel()

    def _over(self, name: str) -> None:
        program, _ = self._waiting.pop(name)
        self._end(program)
