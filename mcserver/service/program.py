"""One program as the service keeps it: its numbers, its state, and who waits for it."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence
from enum import IntEnum

from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.modal import ModalState
from mcserver.gcode.switches import AS_WRITTEN
from mcserver.planning.planner_messages import ProgramMessage
from mcserver.planning.start_state import StartState
from mcserver.service.line_queue import LineQueue
from mcserver.service.program_options import ProgramOptions
from mcserver.service.progress import LineProgress
from mcserver.service.reports import (
    ENDED,
    Ack,
    Fault,
    ProgramState,
    ProgramStatus,
    WireDiagnostic,
)
from mcserver.service.target_stream import TargetStream
from mcserver.service.timeline import RunClock
from mcserver.service.tool_use import ToolUse

# messages of lines that are planned and not reached yet; a program that says more is no program
MESSAGES = 1000


class Verdict(IntEnum):
    """What a waiting submit learns."""

    TAKEN = 0
    REJECTED = 1
    NOT_JOURNALED = 2  # the journal cannot be written now


class Program:
    """Bookkeeping of one open or lately ended program; belongs to the loop."""

    def __init__(
        self,
        program: str,
        client: str,
        axes: Sequence[int],
        options: ProgramOptions,
        *,
        opened_at: float,
        queue: LineQueue,
    ) -> None:
        start_line = options.start_line
        self.program = program
        self.client = client
        self.name = options.name
        self.axes = tuple(axes)
        self.on_disconnect = options.on_disconnect
        self.start_line = start_line
        self.step = options.step
        self.switches = options.switches or AS_WRITTEN
        self.resume_of = options.resume_of
        self.opened_at = opened_at
        self.grace_s = options.grace_s
        # of the whole text, if the client said it: what was simulated of it tells its time
        self.sha256 = options.sha256
        self.clock = RunClock(start_line)
        self.queue = queue
        self.state: ProgramState = "queued"
        # for the pipeline, until it begins
        self.modal: ModalState | None = None
        self.slot: int | None = None
        # work offsets and tools as it had them last: what differs from them it has changed itself
        self.frame = Frame()
        # all of a program that needs no planner; and whether it may move axes that are not homed
        self.controls = tuple(options.controls)
        self.unhomed = options.unhomed
        # what its client streams, in servo mode
        self.targets: TargetStream | None = None
        # the machine as it began, or as the one did that it goes on with, and what others changed at its
        # pauses; None: it has not begun
        self.origin: StartState | None = None
        # it may have axes of a program that stands at a pause
        self.at_pause = options.at_pause
        # moved by hand: a jog, homing; in machine coordinates, at its own speed whatever the override
        self.by_hand = options.by_hand
        # lines in machine coordinates that bring the axes to where its first line starts
        self.approach: Sequence[str] = ()
        # executor time of the newest cycle before it began [s]
        self.begun = 0.0
        # counts rejections: what the planner says about lines of an earlier epoch no longer matters, and what
        # clients give for one is not taken
        self.epoch = 0
        self.journaled = start_line - 1
        self.validated = start_line - 1
        self.progress = LineProgress(start_line)
        self.tool_use = ToolUse()
        # where what has been planned ends on the executor's time axis of this program [cycles]
        self.planned_end_u: float | None = None
        # lines through this one have ended, and the journal has it: the one number that is ever said
        self.done = start_line - 1
        self.eta_s: float | None = None
        # what lines say to the operator once the program has come there, and what was said last
        self.messages: deque[ProgramMessage] = deque(maxlen=MESSAGES)
        self.notice = ""
        # the tool that it waits for at a change; None: for none
        self.asks_for: int | None = None
        # the input that it waits for, and the program before whose bodies it stands; empty: for none
        self.waits_for = self.waits_before = ""
        self.closed = bool(options.controls)
        self.held = options.hold
        # names of the inputs that hold it; empty: none does
        self.held_by = ""
        # the place in `Clearance.switches` of what has switched on a zone before it; None: nothing has since
        self.zone_switch: int | None = None
        # it waits at M00, M01 or a tool change, held or not, of this line
        self.paused = False
        self.paused_at = 0
        self.override = 1.0
        # what an approved run has to stay within
        self.envelope = options.envelope
        # the greatest override that whoever armed the program allows
        self.override_limit = options.override_limit
        self.rejected = 0
        self.diagnostics: list[WireDiagnostic] = []
        self.fault: Fault | None = None
        # nothing of it runs any more; its end is said once it is in the journal
        self.over = False
        self.ended_at: float | None = None
        self.ended_as: ProgramState = "finished"
        self.reason = ""
        self.last_reported_credit = queue.limit
        self.last_reported_started = 0
        self.journaled_started = 0
        self._ended_status: ProgramStatus | None = None
        self._waiting: deque[tuple[int, asyncio.Future[Verdict]]] = deque()
        self._waiting_for_journal: deque[tuple[int, asyncio.Future[Verdict]]] = deque()
        # of those that wait for more than lines: its opening, its close
        self._waiting_for_records: deque[asyncio.Future[Verdict]] = deque()

    @property
    def ended(self) -> bool:
        return self.state in ENDED

    @property
    def label(self) -> str:
        """What it is and whose, for people."""
        return f"{self.name or 'a program'} ({self.state}) of {self.client}"

    @property
    def takes_lines(self) -> bool:
        return not self.closed and not self.ended and self.state != "ending"

    def ack(self, expected: int = 0) -> Ack:
        """Return the cumulative acknowledgement; ``expected`` answers a gap."""
        self.last_reported_credit = self.credit
        return Ack(
            program=self.program,
            accepted=self.journaled,
            done=self.done,
            credit=self.last_reported_credit,
            state=self.state,
            rejected=self.rejected,
            diagnostics=self.diagnostics,
            fault=self.fault,
            expected=expected,
            rejections=self.epoch,
            reason=self.reason,
        )

    @property
    def credit(self) -> int:
        """Lines that fit after the last one journaled."""
        if not self.takes_lines:
            return 0
        return self.queue.credit + self.queue.accepted - self.journaled

    def _waits_for(self) -> str:
        if self.over:
            return ""
        # an operator's hold comes before what it waits for
        return self.held_by if self.held else self.waits_for or self.waits_before

    def status(self) -> ProgramStatus:
        shown = self._ended_status
        if shown is not None and shown.accepted == self.journaled:
            return shown
        shown = self._status()
        if self.ended:
            # nothing else of it changes any more
            self._ended_status = shown
        return shown

    def _status(self) -> ProgramStatus:
        return ProgramStatus(
            program=self.program,
            state=self.state,
            client=self.client,
            name=self.name,
            axes=list(self.axes),
            start_line=self.start_line,
            line=max(self.progress.started, self.paused_at if self.paused else 0),
            accepted=self.journaled,
            done=self.done,
            credit=self.credit,
            closed=self.closed,
            override=round(100.0 * self.override, 6),
            progress=self._share(),
            eta_s=None if self.ended else self.eta_s,
            duration_s=self.clock.total_s,
            simulated=self.clock.simulated,
            pauses=0 if self.ended else self.clock.pauses,
            notice=self.notice,
            waits_for=self._waits_for(),
            fault=self.fault,
            rejected=self.rejected,
            diagnostics=self.diagnostics,
            rejections=self.epoch,
            reason=self.reason,
            resume_of=self.resume_of,
            block_delete=self.switches.block_delete,
            optional_stop=self.switches.optional_stop,
            servo=None if self.targets is None else self.targets.status,
            opened_at=self.opened_at,
            ended_at=self.ended_at,
        )

    def _share(self) -> float:
        """Return the share of its time that has passed; of its accepted lines where its time is not known."""
        if self.state == "finished":
            # also where lines behind M2 have not run
            return 1.0
        by_time = self.clock.fraction()
        if by_time is not None:
            return by_time
        total = self.journaled - self.start_line + 1
        return min(1.0, max(0.0, (self.progress.done - self.start_line + 1) / total)) if total else 0.0

    def wait_for(self, through: int, verdict: asyncio.Future[Verdict], *, validated: bool) -> None:
        """Give ``verdict`` once lines through this number are journaled and, if asked for, ``validated``."""
        (self._waiting if validated else self._waiting_for_journal).append((through, verdict))
        self.settle()

    def wait_for_record(self, verdict: asyncio.Future[Verdict]) -> None:
        """Keep ``verdict`` until the journal gives it, or cannot be written."""
        while self._waiting_for_records and self._waiting_for_records[0].done():
            self._waiting_for_records.popleft()
        self._waiting_for_records.append(verdict)

    def settle(self) -> None:
        """Answer those whose lines are journaled and, where the program runs, validated."""
        through = self.journaled
        while self._waiting_for_journal and self._waiting_for_journal[0][0] <= through:
            give(self._waiting_for_journal.popleft()[1], Verdict.TAKEN)
        if self.state not in ("queued", "ending") and not self.step and not self.over:
            through = min(through, self.validated)
        while self._waiting and self._waiting[0][0] <= through:
            give(self._waiting.popleft()[1], Verdict.TAKEN)

    def reject(self, line: int, diagnostics: list[WireDiagnostic]) -> None:
        """Line ``line`` is faulty; it is the next one expected again."""
        self.epoch += 1
        self.rejected = line
        self.diagnostics = diagnostics
        self.queue.reject(line)
        self.journaled = min(self.journaled, line - 1)
        self.validated = max(self.validated, line - 1)
        self.settle()
        self.dismiss(Verdict.REJECTED)

    def dismiss(self, verdict: Verdict) -> None:
        """Answer all that still wait."""
        for waiting in (self._waiting, self._waiting_for_journal):
            while waiting:
                give(waiting.popleft()[1], verdict)

    def dismiss_unjournaled(self) -> None:
        """Answer those whose lines cannot be journaled now; the numbers stay taken."""
        while self._waiting_for_records:
            give(self._waiting_for_records.popleft(), Verdict.NOT_JOURNALED)
        for waiting in (self._waiting, self._waiting_for_journal):
            # numbers grow, but a repeated message waits for older ones
            kept = [each for each in waiting if each[0] <= self.journaled]
            refused = [each for each in waiting if each[0] > self.journaled]
            waiting.clear()
            waiting.extend(kept)
            for _, verdict in refused:
                give(verdict, Verdict.NOT_JOURNALED)


def give(waiting: asyncio.Future[Verdict], verdict: Verdict) -> None:
    """Answer who waits, unless that has been done or it does not wait any more."""
    if not waiting.done():
        waiting.set_result(verdict)
