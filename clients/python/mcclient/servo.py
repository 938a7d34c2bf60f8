"""Servo mode: targets that a client streams, followed by the machine's axes within their limits."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import zenoh
from numpy.typing import ArrayLike

from mcclient import endings
from mcclient.endings import Extent
from mcclient.errors import MotionError, NobodyAnswers, ProgramInterrupted
from mcclient.keys import Keys
from mcclient.machine_calls import MachineCalls
from mcclient.presence import OnReturn
from mcclient.transport import Arrived, Link
from mcclient.types import ENDED, Ack, ProgramStatus, ServoReply
from mcclient.wire import decode, encode

# How long a message counts where nothing else is said [s]: without a newer one by then the axes stop.
COUNTS_S = 0.1
# The server acknowledges targets within 50 ms: one that has not for so long beyond what they count is gone.
UNANSWERED_S = 0.5
ACKS_LIMIT = 16
# between two looks whether it has ended, should the word of it have been lost [s]
ASK_S = 0.25


class Servo:
    """Axes that follow what is sent, until the block ends.

    Attributes:
        id: of the program that follows. axes: its axes; rows of targets have one number for each, in this
            order.
    """

    def __init__(
        self,
        opened: ServoReply,
        *,
        link: Link,
        keys: Keys,
        calls: MachineCalls,
        counts_s: float,
        on_return: Callable[[OnReturn], Callable[[], None]],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.id = opened.program
        self.axes = opened.axes
        self._link = link
        self._key = keys.lines_in(opened.program)
        self._calls = calls
        self._counts_s = counts_s
        self._clock = clock
        self._seq = 0
        # when targets were sent last since the server was heard, and how long it has been silent before [s]
        self._asked: float | None = None
        self._silent_s = 0.0
        self._ended = asyncio.Event()
        self._last: Ack | ProgramStatus | None = None
        # the server has come back, perhaps another start of it, which knows nothing of these targets
        self._returned = False
        self._forget_return = on_return(self._on_server_return)
        self._acks = link.subscribe(keys.ack(opened.program), self._on_ack, limit=ACKS_LIMIT)

    async def send(
        self,
        positions: ArrayLike | None = None,
        velocities: ArrayLike | None = None,
        *,
        times: ArrayLike | None = None,
        counts_s: float | None = None,
        tool: int | None = None,
        frame: Literal["base", "tool"] = "base",
    ) -> None:
        """Sends where the axes, or a tool, are to be; it replaces what was sent before.

        Args:
            positions: shape (n,) [mm, deg]; without ``velocities`` the axes come to rest there, unless the
                next ones lead on.
            velocities: shape (n,) [mm/s, deg/s]: with positions, the axes pass there at them; alone, they go
                on at them.
            times: shape (m,), ascending [s from now]: the others are of shape (m, n), points at these times.
            counts_s: how long it counts, as of `mcclient.Machine.servo`.
            tool: its number. The rows are poses X Y Z A B C and twists then, n = 6, of a tool without
                orientation X Y Z, n = 3 [mm, deg, per s].
            frame: whose axes a tool's velocities are along and about; poses are in the base's.

        Raises:
            ProgramAborted: the program has ended: nothing came in time, or somebody stopped it.
            ProgramFaulted: a fault of the machine ended it.
            ProgramInterrupted: the server was started again.
            ProgramClosed: it was closed, and has finished.
            NobodyAnswers: the server has not answered for as long as targets count, and 0.5 s (MC530).
        """
        if self._returned:
            await self._ask()
        self.check()
        if self.state in ENDED:
            raise endings.closed(self.state, Extent(self.id, 0, 0))
        now, counts_s = self._clock(), self._counts_s if counts_s is None else counts_s
        if self._asked is not None:
            # a sender that stood still for longer has not listened meanwhile
            self._silent_s += min(now - self._asked, UNANSWERED_S)
        self._asked = now
        if self._silent_s > counts_s + UNANSWERED_S:
            raise NobodyAnswers(
                "MC530",
                f"the server has not answered for {self._silent_s:.1f} s",
                "where it is gone the axes have stopped: once it is there, open servo mode anew",
            )
        self._seq += 1
        message = [
            self._seq,
            now,
            counts_s,
            _rows(positions),
            _rows(velocities),
            None if times is None else np.atleast_1d(np.asarray(times, np.float64)).tolist(),
            tool,
            frame,
        ]
        await self._link.put(
            self._key, encode(message), priority=zenoh.Priority.INTERACTIVE_HIGH, express=True, drop=True
        )

    @property
    def state(self) -> str:
        """As last reported."""
        return "running" if self._last is None else self._last.state

    def check(self) -> None:
        """Raises what has ended the program, if anything has."""
        if self._last is not None and self._last.state in ENDED:
            failure = self._failure(self._last)
            if failure is not None:
                raise failure

    async def status(self) -> ProgramStatus:
        """Return the program; ``servo`` of it counts what was late, lost or dropped."""
        (found,) = await self._calls.programs(program=self.id)
        return found

    async def close(self) -> None:
        """Lets the axes go on to the last targets, and returns once they stand there.

        Where they are to go on at a speed they stop once the targets do not count any more. Raises as `send`.
        """
        await self._calls.close_program(self.id)
        await self._until_ended()
        self.check()

    async def abort(self) -> None:
        """Stops the axes within their limits now."""
        await self._calls.abort(self.id)
        await self._until_ended()

    async def __aenter__(self) -> Servo:
        return self

    async def __aexit__(self, raised: type[BaseException] | None, *_: object) -> None:
        if self._ended.is_set():
            self._let_go()
            if raised is None:
                self.check()
        elif raised is None:
            await self.close()
        else:
            await self.abort()

    async def _until_ended(self) -> None:
        """Return once the program has ended; an acknowledgement that is lost is asked for."""
        while not self._ended.is_set():
            try:
                async with asyncio.timeout(ASK_S):
                    await self._ended.wait()
            except TimeoutError:
                self._hear(await self.status())
        self._let_go()

    def _on_server_return(self, _instance: str) -> None:
        self._returned = True

    async def _ask(self) -> None:
        """Ask a server that has come back what has become of the program."""
        with contextlib.suppress(NobodyAnswers):
            self._hear(await self.status())
            self._returned = False

    def _let_go(self) -> None:
        self._acks.close()
        self._forget_return()
        self._forget_return = _nothing

    def _on_ack(self, arrived: Arrived) -> None:
        self._hear(decode(Ack, arrived.payload))

    def _hear(self, report: Ack | ProgramStatus) -> None:
        """Take how the program is; the first end that is heard of stays."""
        self._asked, self._silent_s = None, 0.0
        if not self._ended.is_set():
            self._last = report
            if report.state in ENDED:
                self._ended.set()

    def _failure(self, report: Ack | ProgramStatus) -> MotionError | None:
        if report.state == "interrupted":
            return ProgramInterrupted(
                "MC534",
                "the server that followed the targets went away, and the axes were stopped",
                "once the machine is clear, open servo mode anew",
                program=self.id,
                accepted=0,
                done=0,
            )
        return endings.ending(report.state, Extent(self.id, 0, 0), report.fault, (), report.reason)


def _nothing() -> None:
    """Do nothing."""


def _rows(values: ArrayLike | None) -> Any:
    return None if values is None else np.atleast_2d(np.asarray(values, np.float64)).tolist()
