"""A program: lines streamed within the server's credit, repeated after a loss, never lost and never run
twice.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterable, Iterable
from dataclasses import dataclass

from mcclient import endings
from mcclient.calls import DEADLINE_S, Caller
from mcclient.errors import MotionError, ProgramRejected, RequestRefused
from mcclient.feed import Feed
from mcclient.reports import OpenReports, Report
from mcclient.stream import LineStream
from mcclient.types import ENDED, CloseReply, ProgramState, ProgramStatus
from mcclient.wire import decode

log = logging.getLogger(__name__)

ABORT_DEADLINE_S = 2.0
# give the loop to others while a long file is read
LINES_A_TURN = 2000


@dataclass(frozen=True, slots=True)
class ProgramResult:
    """How a program ended: ``state`` is ``finished``; whatever else can happen is raised."""

    program: str
    state: str
    accepted: int
    done: int


class Line:
    """A line that the server has taken."""

    def __init__(self, program: Program, number: int) -> None:
        self._program = program
        self.number = number

    async def done(self) -> None:
        """Waits until the line has ended; raises as `Program.done`."""
        await self._program.wait_done(self.number)


class Program:
    """One client's stream of lines, with modal state and axes of its own; made by `Machine.program`.

    As a context manager it finishes at the end of the block and waits for its motion; when the block raises,
    the program is aborted.
    """

    def __init__(
        self,
        stream: LineStream,
        *,
        axes: tuple[int, ...],
        caller: Caller,
        open_reports: OpenReports,
        max_line_length: int,
        patience_s: float,
    ) -> None:
        self.id = stream.program
        self.axes = axes
        self._stream = stream
        self._caller = caller
        self._open_reports = open_reports
        self._max_line_length = max_line_length
        self._patience_s = patience_s
        self._turn = asyncio.Lock()

    @property
    def state(self) -> ProgramState:
        """As last reported: queued, running, held, paused, ending, or how it ended."""
        return self._stream.state

    @property
    def ended(self) -> bool:
        return self._stream.ended

    @property
    def accepted_through(self) -> int:
        """Lines through this number are taken and journaled by the server."""
        return self._stream.window.accepted

    @property
    def done_through(self) -> int:
        """Lines through this number have ended."""
        return self._stream.done

    @property
    def given_through(self) -> int:
        """Number of the last line given to `send` or `send_lines`."""
        return self._stream.window.given

    @property
    def lines_ahead(self) -> int:
        """Lines given that have not ended yet: how far this client is ahead of the motion."""
        return max(0, self.given_through - self.done_through)

    @property
    def credit(self) -> int:
        """How many lines beyond those accepted the server takes now."""
        return self._stream.window.credit

    @property
    def failure(self) -> MotionError | None:
        """What `done` and `finish` will raise, as soon as it is known."""
        return self._stream.failure

    @property
    def reports(self) -> Feed[Report]:
        """What happens to this program's lines, from now on: ``async for report in program.reports``."""
        return self._open_reports(self.id)

    # ------------------------------------------------------------ lines

    async def send(self, line: str) -> Line:
        """Sends one line and waits for the verdict on it; it may still be waiting to move.

        A call that is cancelled may have sent the line all the same.

        Raises:
            ProgramRejected: the line has faults; nothing of it moves, and the program goes on living.
            ProgramError: the program has ended. NobodyAnswers: the server is gone.
        """
        text = self._checked(line)
        async with self._turn:
            self._stream.begin()
            await self._stream.accepted_all()
            self._check_open()
            return Line(self, await self._stream.submit(text))

    async def send_lines(self, lines: Iterable[str] | AsyncIterable[str]) -> int:
        """Streams lines as fast as the server takes them, with bounded memory; returns the last one's number.

        It returns when all are accepted. A fault of a line that is judged later is raised by `done` and
        `finish`. Where it is cancelled, or the iterable raises, lines that have not been sent are given up;
        those under way may be accepted, and the next line has the number behind them (`given_through`).

        Raises:
            ProgramRejected: a line has faults; the lines before it are taken.
            ProgramError: the program has ended. NobodyAnswers: the server is gone.
        """
        async with self._turn:
            self._stream.begin()
            self._check_open()
            try:
                if isinstance(lines, AsyncIterable):
                    async for line in lines:
                        await self._stream.give(self._checked(line))
                else:
                    for count, line in enumerate(lines, 1):
                        await self._stream.give(self._checked(line))
                        if count % LINES_A_TURN == 0:
                            await asyncio.sleep(0)
                await self._stream.accepted_all()
            except BaseException:
                self._stream.abandon()
                raise
            self._stream.check()
            return self._stream.window.given

    # ------------------------------------------------------------ the end

    async def wait_accepted(self, number: int) -> None:
        """Waits until the line with this number has been taken by the server; raises as `done`."""
        await self._stream.until(lambda: self.accepted_through >= number)

    async def wait_done(self, number: int) -> None:
        """Waits until the line with this number has ended; raises as `done`."""
        # lines after M02 or M30 are accepted and never run
        await self._stream.until(lambda: self._stream.done >= number or self._stream.state == "finished")

    async def done(self) -> None:
        """Waits until every line given so far has ended.

        Raises:
            ProgramRejected, ProgramFaulted, ProgramAborted, ProgramInterrupted: how it ended instead.
            NobodyAnswers: the server has been away for longer than the client's patience.
        """
        await self.wait_done(self._stream.window.given)
        self._stream.raise_failure()

    async def close(self) -> None:
        """No more lines will come; what is accepted runs to its end. Again is no error."""
        async with self._turn:
            if self.ended or self._stream.closed:
                return
            await self._stream.accepted_all()
            request = {"program": self.id}
            try:
                reply = await self._caller.call("close", request, deadline_s=self._patience_s)
            except RequestRefused as error:
                raise await self._stream.translated(error) from error
            self._stream.closed = True
            answer = decode(CloseReply, reply)
            if answer.state in ENDED:
                # the reply does not say why it ended
                await self._stream.resynchronise()
            else:
                self._stream.progress(answer.state, answer.done)

    async def finish(self) -> ProgramResult:
        """`close`, then waits until the program has ended; raises as `done`, once it has ended."""
        rejection: ProgramRejected | None = None
        try:
            await self.close()
        except ProgramRejected as error:
            # reported once what is before the rejected line has run
            rejection = error
            await self.close()
        await self._stream.until(lambda: self.ended, past_rejection=True)
        self._stream.raise_failure()
        if rejection is not None:
            raise rejection
        return ProgramResult(self.id, self.state, self.accepted_through, self.done_through)

    async def leave(self) -> None:
        """Stops following the program without ending it; ``on_disconnect`` decides once the client closes."""
        await self._stream.stop()

    async def __aenter__(self) -> Program:
        return self

    async def __aexit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                await self.finish()
            elif not self.ended:
                await self._abort_quietly()
        finally:
            await self.leave()

    async def _abort_quietly(self) -> None:
        try:
            await self.abort(deadline_s=ABORT_DEADLINE_S)
        except MotionError as error:
            # the block's own exception is the one to tell
            log.debug("abort at the end of the block: %s", error)

    # ------------------------------------------------------------ the operator's part

    async def hold(self) -> None:
        """Feed hold along the path."""
        await self._order("hold")

    async def resume(self) -> None:
        """Ends a hold, M00 or M01."""
        await self._order("resume")

    async def step(self) -> None:
        """Starts the next line of a program opened with ``step=True``."""
        await self._order("step")

    async def abort(self, *, deadline_s: float = DEADLINE_S) -> None:
        """Stops along the path and drops the rest; the program ends as aborted."""
        await self._order("abort", deadline_s=deadline_s)

    async def override(self, percent: float) -> None:
        """Feed override of this program; 100 is as programmed."""
        await self._order("override", percent=percent)

    async def _order(self, method: str, *, deadline_s: float = DEADLINE_S, **request: object) -> None:
        """Give an order; of a program that a restart has interrupted that is raised, not an unknown id."""
        try:
            await self._caller.call(method, {"program": self.id, **request}, deadline_s=deadline_s)
        except RequestRefused as error:
            if error.code == "MC503":
                raise await self._stream.translated(error) from error
            raise

    async def status(self) -> ProgramStatus:
        """Return the program as the server knows it.

        Raises:
            RequestRefused: MC503 it knows no such program.
        """
        status = await self._stream.ask_status()
        if status is None:
            raise RequestRefused(
                "MC503", f"the server knows no program {self.id}", "mcctl programs lists them"
            )
        return status

    def _checked(self, line: str) -> str:
        text = line.rstrip("\r\n")
        if "\n" in text or "\r" in text:
            raise RequestRefused(
                "MC538", "a line must not hold a line end", "use send_lines(text.splitlines())"
            )
        if len(text) > self._max_line_length:
            raise RequestRefused(
                "MC538",
                f"the line has {len(text)} characters, the server takes {self._max_line_length}",
                "break it at a command",
                line=self.given_through + 1,
            )
        return text

    def _check_open(self) -> None:
        self._stream.check()
        if self._stream.closed or self.ended:
            raise endings.closed(self.state if self.ended else "closed", self._stream.extent)
