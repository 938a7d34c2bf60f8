"""Hold-to-jog: an axis moves as long as somebody's finger is down, and not a moment longer on what is old.

The browser sends a message when the button goes down, one every 0.1 s while it is down, and one when it is
released or the page loses focus, pointer or visibility. Each keep is passed on to the server, whose dead
man's time stops the axis when they stay out: a link, a browser or this process may die at any moment. What
was delayed on the way must not move anything: a message is judged by the browser's own clock against the
quickest one seen from it, so that a burst after a stall of the link is recognised as old.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Protocol

from mcclient.errors import MotionError

from mcserver.web.delays import late_press

log = logging.getLogger(__name__)

# the server's dead man's time: three keeps may be lost
HOLD_S = 0.35
# how late a message may be against the quickest of its browser [s]
MAX_DELAY_S = 0.3


class Machine(Protocol):
    """The part of `mcclient.Machine` that a jog's end needs."""

    async def abort(self, program: str | None = None) -> object: ...


# starts a move, or keeps the one of that id alive with the dead man's time `HOLD_S`; returns its id
Move = Callable[[str | None], Awaitable[str]]


class HeldJog:
    """The one jog that one browser may hold.

    Args:
        machine: what moves.
        on_error: takes what the operator has to know.
    """

    def __init__(self, machine: Machine, on_error: Callable[[MotionError], None]) -> None:
        self.machine = machine
        self._on_error = on_error
        self._press: int | None = None
        self._released_press: int | None = None
        self._program: str | None = None
        self._move: Move | None = None
        self._busy = asyncio.Lock()

    async def press(self, press: int, move: Move, delay_s: float) -> None:
        """Start a move; ``press`` numbers the touch, whose message was so late [s]."""
        if delay_s > MAX_DELAY_S:
            self._on_error(late_press(delay_s))
            return
        if self._press is not None and press <= self._press:
            return
        self._press, self._move, self._program = press, move, None
        async with self._busy:
            if self._press != press:
                return
            try:
                program = await move(None)
            except MotionError as error:
                self._on_error(error)
                return
            if self._press == press and self._released_press != press:
                self._program = program
            else:
                # released while the server was answering
                await self._stop(program)

    async def keep(self, press: int, delay_s: float) -> None:
        """Keep the axis moving for another `HOLD_S`; never start it again."""
        if delay_s > MAX_DELAY_S or press != self._press or self._program is None:
            return
        if self._busy.locked():
            # the one before it is still under way: this one would only queue behind it
            return
        async with self._busy:
            program, move = self._program, self._move
            if program is None or move is None:
                return
            try:
                await move(program)
            except MotionError as error:
                # it has stopped by itself: at a limit, by a fault, or because the keeps were late
                if self._program == program:
                    self._program = None
                log.info("a jog ended: %s", error.message)

    async def release(self) -> None:
        """Stop whatever this browser holds."""
        program, self._program = self._program, None
        self._released_press = self._press
        if program is not None:
            await self._stop(program)

    async def _stop(self, program: str) -> None:
        try:
            await self.machine.abort(program)
        except MotionError as error:
            log.info("a jog had ended before its release: %s", error.message)
