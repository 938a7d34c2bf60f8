"""Ctrl-C while a program runs: hold, abort or leave on a terminal, abort elsewhere; a second one aborts at
once.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable

from mcclient.cli.ahead import JobOptions
from mcclient.cli.output import say
from mcclient.cli.progress import Display
from mcclient.cli.signals import on_signals
from mcclient.errors import MotionError
from mcclient.lines import from_thread
from mcclient.program import Program

INTERRUPTED = 130
TYPED_LINES = 100
RESUMABLE = ("held", "paused")
STATE_LIMIT_S = 0.5


class Interrupts:
    """Turns SIGINT and SIGTERM into orders to the program.

    Args:
        all_accepted: whether the whole file has been taken by the server.
    """

    def __init__(
        self, program: Program, display: Display, options: JobOptions, all_accepted: Callable[[], bool]
    ) -> None:
        self._program = program
        self._display = display
        self._options = options
        self._all_accepted = all_accepted
        self._pressed = asyncio.Event()
        self._terminated = False
        self._aborting = False
        self._typed: asyncio.Queue[str] = asyncio.Queue(TYPED_LINES)
        self._reading: asyncio.Task[None] | None = None
        self._unheard = (
            on_signals((signal.SIGINT,), self._on_interrupt),
            on_signals((signal.SIGTERM,), self._on_terminate),
        )

    def close(self) -> None:
        if self._reading is not None:
            self._reading.cancel()
        for unheard in self._unheard:
            unheard()

    async def serve(self) -> None:
        """Returns when the user leaves the program to itself."""
        while True:
            await self._pressed.wait()
            self._pressed.clear()
            # in single line mode the steps read the terminal
            if self._terminated or not self._options.interactive or self._options.step:
                await self._abort("interrupted: aborting; once more leaves at once")
                continue
            self._display.stop()
            if await self._ask():
                return
            self._display.start()

    def _on_interrupt(self) -> None:
        if self._aborting:
            # the server stops the program by itself once this client's token has gone
            self._display.stop()
            os._exit(INTERRUPTED)
        self._pressed.set()

    def _on_terminate(self) -> None:
        self._terminated = True
        self._on_interrupt()

    async def _ask(self) -> bool:
        """Return whether the user leaves."""
        first = "[r]esume" if await self._state() in RESUMABLE else "[h]old"
        # only what it then does: leaving would stop the program, or cut off lines that are on their way
        leave = "[l]eave, " if self._may_leave() else ""
        say(f"{first}, [a]bort, {leave}[c]ontinue?  (Ctrl-C again aborts)", "bold")
        answer = await self._answer()
        try:
            if answer in ("h", "hold"):
                await self._program.hold()
                say("holding; Ctrl-C again to resume or abort")
            elif answer in ("r", "resume"):
                await self._program.resume()
            elif answer in ("a", "abort"):
                await self._abort("aborting")
            elif answer in ("l", "leave"):
                return await self._leave()
        except MotionError as error:
            say(f"error[{error.code}]: {error.message}", "bold red")
        return False

    async def _state(self) -> str:
        """As the server knows it now: its acknowledgements come on their own way, perhaps after the answer to
        a hold. Where it does not answer in time, what was last reported.
        """
        try:
            async with asyncio.timeout(STATE_LIMIT_S):
                return (await self._program.status()).state
        except (MotionError, TimeoutError):
            return self._program.state

    async def _answer(self) -> str:
        """Return the first letter or word typed; a second Ctrl-C counts as abort."""
        if self._reading is None:
            self._reading = asyncio.create_task(self._read())
        # what was typed before the question is no answer to it
        while not self._typed.empty():
            self._typed.get_nowait()
        typed = asyncio.create_task(self._typed.get())
        again = asyncio.create_task(self._pressed.wait())
        await asyncio.wait([typed, again], return_when=asyncio.FIRST_COMPLETED)
        answer = typed.result().strip().lower() if typed.done() else "a"
        if again.done():
            self._pressed.clear()
            answer = "a"
        for task in (typed, again):
            task.cancel()
        await asyncio.gather(typed, again, return_exceptions=True)
        return answer

    async def _read(self) -> None:
        """One reader for all questions: a second one would take the first one's lines."""
        async for line in from_thread(iter(sys.stdin.readline, "")):
            await self._typed.put(line)

    def _may_leave(self) -> bool:
        return self._options.on_disconnect == "finish" and self._all_accepted()

    async def _leave(self) -> bool:
        if self._may_leave():
            await self._program.close()
            return True
        if self._options.on_disconnect == "finish":
            say("not all lines are accepted yet: it goes on", "yellow")
        else:
            say("it was started with --on-disconnect stop, so leaving would stop it: it goes on", "yellow")
        return False

    async def _abort(self, sentence: str) -> None:
        say(sentence, "yellow")
        self._aborting = True
        try:
            await self._program.abort()
        except MotionError as error:
            say(f"error[{error.code}]: {error.message}", "bold red")
            self._aborting = False
