"""Sends a program's lines and follows what the server says of them.

One task a program sends within the credit and, when the server has been silent for too long or was away, asks
how far it has come and sends again what it lacks.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any

from mcclient import endings
from mcclient.calls import Caller
from mcclient.endings import Extent
from mcclient.errors import MotionError, NobodyAnswers, ProgramRejected, RequestRefused
from mcclient.keys import Keys
from mcclient.transport import Arrived, Link
from mcclient.types import (
    ENDED,
    Ack,
    ContinueReply,
    Diagnostic,
    Fault,
    OpenReply,
    ProgramState,
    ProgramStatus,
    SubmitReply,
)
from mcclient.window import LineWindow
from mcclient.wire import decode, encode, from_wire, unpack

log = logging.getLogger(__name__)

# without an acknowledgement for so long, the server is asked; doubled up to the longest while it says nothing
# new
FIRST_DOUBT_S = 0.25
LONGEST_DOUBT_S = 2.0
ACKS_LIMIT = 64
VERDICT_ATTEMPT_S = 5.0
ENDING_S = 2.0


class LineStream:
    """Lines of one program on their way.

    Attributes:
        state: the program's, as last reported.
        done: lines through this number have ended.
        failure: why it does not go on; None while it does.
        rejections: of lines of this program that are known. Each line goes out with this count, and the
            server takes none of before a rejection; what it says with a smaller one is older than that.

    Args:
        patience_s: how long the server may be away before `NobodyAnswers`.
    """

    def __init__(
        self, opened: OpenReply | ContinueReply, *, link: Link, keys: Keys, caller: Caller, patience_s: float
    ) -> None:
        self.program = opened.program
        self.window = LineWindow(opened.expected, opened.credit)
        self.state = opened.state
        self.done = opened.expected - 1
        self.closed = False
        if isinstance(opened, ContinueReply):
            # lines that the server had already are not done
            self.done, self.closed = opened.line - 1, opened.whole
        self.failure: MotionError | None = None
        self.rejections = 0
        self._reported = False
        # the last one of a streamed line: it stays when the line has been corrected
        self._rejection: ProgramRejected | None = None
        # a line under judgement by `submit`: its reply tells of a rejection, not the acknowledgements
        self._judging = False
        self._link = link
        self._keys = keys
        self._caller = caller
        self._patience_s = patience_s
        self._changed = asyncio.Event()
        self._wake = asyncio.Event()
        self._clock = asyncio.get_running_loop().time
        self._heard_at = self._clock()
        self._subscription = link.subscribe(keys.ack(self.program), self._on_ack, limit=ACKS_LIMIT)
        self._task = asyncio.get_running_loop().create_task(self._send_and_ask())

    @property
    def ended(self) -> bool:
        return self.state in ENDED

    @property
    def extent(self) -> Extent:
        return Extent(self.program, self.window.accepted, self.done)

    async def stop(self, failure: MotionError | None = None) -> None:
        """Sends and hears nothing more.

        Args:
            failure: what those who wait get.
        """
        if failure is not None and not self.ended and self.failure is None:
            self._fail(failure)
        self._subscription.close()
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    # ------------------------------------------------------------ lines and waiting

    async def give(self, text: str) -> int:
        """Appends a line, once there is room; returns its number. Raises as `check`."""
        if not self.window.has_room:
            self._wake.set()
            await self.until(lambda: self.window.has_room or self.failure is not None)
        self.check()
        self._wake.set()
        return self.window.give(text)

    def abandon(self) -> None:
        """Give up the lines that have not been sent; those under way may be accepted."""
        self.window.abandon()
        self._changed.set()

    async def accepted_all(self) -> None:
        """Until no given line waits for its acceptance."""
        self._wake.set()
        await self.until(lambda: not self.window.pending)

    async def until(self, condition: Callable[[], bool], *, past_rejection: bool = False) -> None:
        """Until the condition holds; raises the failure where it no longer can.

        Each that waits hears of a rejection, whoever else has heard of it: what it waits for was given up.

        Args:
            past_rejection: what is before a rejected line is waited for all the same.
        """
        before = self._rejection
        while not condition():
            if self._rejection is not None and self._rejection is not before and not past_rejection:
                self._reported = self._reported or self.failure is self._rejection
                raise self._rejection
            if not (past_rejection and isinstance(self.failure, ProgramRejected)):
                self.raise_failure()
            if self.ended and self.window.pending:
                raise endings.closed(self.state, self.extent)
            self._changed.clear()
            self._wake.set()
            await self._changed.wait()

    def raise_failure(self) -> None:
        """Raise it, where there is one; a rejection that was reported does not keep its line from being sent
        anew.
        """
        if self.failure is None:
            return
        if self._reported and isinstance(self.failure, ProgramRejected) and self.state != "rejected":
            return
        self._reported = True
        raise self.failure

    async def submit(self, text: str) -> int:
        """Sends one line and waits for the verdict on it; returns its number.

        Raises:
            ProgramRejected: it, or a line before it, is faulty. MotionError: as `Caller.call`.
        """
        number = self.window.give(text)
        self.window.goes_out(number)
        self._judging = True
        try:
            while self.window.accepted < number:
                await self._submit_once(number, text)
                if self.window.accepted < number:
                    # no credit: what is before has to be consumed first
                    await self._hear_of(FIRST_DOUBT_S)
                    self.raise_failure()
        finally:
            self._judging = False
            self._wake.set()
        return number

    def begin(self) -> None:
        """Before lines are given: raises the failure; a rejection that was reported is over."""
        self.raise_failure()
        if isinstance(self.failure, ProgramRejected):
            self.failure = None

    def check(self) -> None:
        """Raises what has happened since `begin`, whoever else has heard of it: lines that are given in
        ignorance of a rejection would take the numbers of others.
        """
        if self.failure is not None:
            self._reported = True
            raise self.failure

    async def ask_status(self) -> ProgramStatus | None:
        """Return the program as the server knows it; None: it knows no such program."""
        try:
            payload = await self._caller.call(
                "programs", {"program": self.program}, deadline_s=self._patience_s
            )
        except RequestRefused as error:
            if error.code == "MC503":
                return None
            raise
        found = [from_wire(ProgramStatus, each) for each in unpack(payload).get("programs", [])]
        return next((each for each in found if each.program == self.program), None)

    async def translated(self, error: RequestRefused) -> MotionError:
        """Return a refusal as what it means for the program: ended, interrupted, or itself."""
        if error.code in ("MC503", "MC504", "MC510"):
            await self.resynchronise()
            if error.code == "MC510" and self.state == "ending":
                # why it ends is said once it stands still
                await self._hear_of_end(ENDING_S)
            if self.failure is not None:
                return self.failure
            if error.code == "MC510":
                return endings.closed(str(error.details.get("state") or "closed"), self.extent)
        return error

    # ------------------------------------------------------------ what the server says

    def on_server_return(self) -> None:
        """The server is there again, perhaps another start of it: what is known may be old."""
        if isinstance(self.failure, NobodyAnswers):
            self.failure = None
        self._heard_at = float("-inf")
        self._wake.set()

    def progress(
        self,
        state: ProgramState,
        done: int,
        fault: Fault | None = None,
        diagnostics: tuple[Diagnostic, ...] = (),
        reason: str = "",
    ) -> None:
        """Takes the program's state; the first one that is an end stays."""
        self.done = max(self.done, done)
        if not self.ended:
            self.state = state
            if self.ended and (self.failure is None or state != "finished"):
                self._fail(endings.ending(state, self.extent, fault, diagnostics, reason))
        self._changed.set()
        self._wake.set()

    def _on_ack(self, arrived: Arrived) -> None:
        try:
            ack = decode(Ack, arrived.payload)
        except MotionError as error:
            log.warning("an acknowledgement was not understood: %s", error)
            return
        self._hear(ack, ack.expected)

    def _hear(self, report: Ack | ProgramStatus, expected: int = 0) -> None:
        """Takes what the server says of the program, which may be older than what is known."""
        if report.rejections > self.rejections:
            self._hear_rejection(report)
        self._take(report.accepted, report.credit, report.rejections, expected)
        if report.rejections >= self.rejections or report.state in ENDED:
            self.progress(report.state, report.done, report.fault, report.diagnostics, report.reason)

    def _take(self, accepted: int, credit: int, rejections: int, expected: int = 0) -> None:
        """Takes numbers, unless a line before them has been rejected since, or one that is not heard of."""
        self._heard_at = self._clock()
        if rejections == self.rejections:
            self.window.acknowledge(accepted, credit, expected=expected)

    def _hear_rejection(self, report: Ack | ProgramStatus) -> None:
        """A streamed line is faulty: it and what follows is given up."""
        if self._judging and report.state not in ENDED:
            return
        line = report.rejected or report.accepted + 1
        lost = line <= self.window.given
        self.rejections = report.rejections
        self.window.reject(line)
        self._take(report.accepted, report.credit, report.rejections)
        if lost:
            # where the program has ended otherwise than well, that will be the failure
            self._rejection = endings.rejected(line, self.extent, report.diagnostics)
            self._fail(self._rejection)

    def _fail(self, failure: MotionError | None) -> None:
        self.failure = failure
        self._reported = False
        self._changed.set()

    # ------------------------------------------------------------ sending

    async def _submit_once(self, number: int, text: str) -> None:
        request = {
            "program": self.program,
            "first": number,
            "lines": [text],
            "rejections": self.rejections,
        }
        try:
            payload = await self._caller.call(
                "submit", request, deadline_s=self._patience_s, attempt_s=VERDICT_ATTEMPT_S, patient=True
            )
        except NobodyAnswers as error:
            raise endings.gone(error, self.extent) from error
        except RequestRefused as error:
            if error.diagnostics or error.code == "MC505":
                raise await self._rejection_of(number, error) from error
            raise await self.translated(error) from error
        reply = decode(SubmitReply, payload)
        self._take(reply.accepted, reply.credit, reply.rejections)
        self.progress(self.state, reply.done)

    async def _rejection_of(self, number: int, error: RequestRefused) -> MotionError:
        """The line, or one before it that had been accepted, is faulty."""
        details: dict[str, Any] = error.details
        line = int(details.get("expected") or error.line or number)
        diagnostics = error.diagnostics
        if not diagnostics:
            status = await self.ask_status()
            diagnostics = status.diagnostics if status is not None else ()
            if not diagnostics:
                return error
        self.window.reject(min(line, number))
        self.rejections = max(self.rejections, int(details.get("rejections") or 0))
        if isinstance(details.get("accepted"), int) and isinstance(details.get("credit"), int):
            self._take(details["accepted"], details["credit"], self.rejections)
        self.progress(self.state, int(details.get("done") or 0))
        rejection = endings.rejected(line, self.extent, diagnostics)
        if line < number:
            # whoever waits for lines that were streamed hears of it too
            self._rejection = rejection
        return rejection

    async def _send_and_ask(self) -> None:
        """The task: sends what may be sent, and asks the server when it has been silent for too long."""
        doubt_s = FIRST_DOUBT_S
        while True:
            self._wake.clear()
            chunk = None if self._judging or self.failure is not None else self.window.next_chunk()
            if chunk is not None:
                doubt_s = FIRST_DOUBT_S
                await self._link.put(
                    self._keys.lines_in(self.program), encode([chunk.first, chunk.lines, self.rejections])
                )
                continue
            if not self._in_doubt():
                await self._wake.wait()
                continue
            ask_at = max(self._heard_at, self._clock() - doubt_s) + doubt_s
            try:
                async with asyncio.timeout(max(0.001, ask_at - self._clock())):
                    await self._wake.wait()
            except TimeoutError:
                log.debug("program %s: no word for %s s", self.program, doubt_s)
            if self._clock() - self._heard_at < doubt_s:
                continue
            try:
                await self.resynchronise()
            except MotionError as error:
                self._fail(error)
            doubt_s = min(2 * doubt_s, LONGEST_DOUBT_S)

    def _in_doubt(self) -> bool:
        """Return whether something is awaited that a lost acknowledgement could have said."""
        if (
            self.ended
            or self._judging
            or not (self.failure is None or isinstance(self.failure, ProgramRejected))
        ):
            return False
        return self.window.pending or self.closed or self.done < self.window.accepted

    async def resynchronise(self) -> None:
        """Asks what the server has; what it lacks will be sent again."""
        try:
            status = await self.ask_status()
        except NobodyAnswers as error:
            raise endings.gone(error, self.extent) from error
        if status is None:
            self.progress(ProgramState.INTERRUPTED, 0)
            return
        self._hear(status)
        if not self._judging:
            self.window.rewind()

    async def _hear_of_end(self, timeout_s: float) -> None:
        try:
            async with asyncio.timeout(timeout_s):
                while not self.ended:
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return

    async def _hear_of(self, timeout_s: float) -> None:
        self._changed.clear()
        try:
            async with asyncio.timeout(timeout_s):
                await self._changed.wait()
        except TimeoutError:
            await self.resynchronise()
