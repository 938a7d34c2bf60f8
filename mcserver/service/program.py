"""State of one program in the service, and who waits for it."""

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

# most messages of planned lines that have not been reached yet
MESSAGES = 1000


class Verdict(IntEnum):
    """Answer to a waiting submit."""

    TAKEN = 0
    REJECTED = 1
    NOT_JOURNALED = 2  # the journal cannot be written now


class Program:
    """State of one open or recently ended program; used only in the loop."""

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
        # of the whole text, if the client gave it: selects the simulated times
        self.sha256 = options.sha256
        self.clock = RunClock(start_line)
        self.queue = queue
        self.state: ProgramState = "queued"
        # for the pipeline, before it begins
        self.modal: ModalState | None = None
        self.slot: int | None = None
        # its last work offsets and tools: differences from them are its own changes
        self.frame = Frame()
        # the whole of a program without planner; and whether it may move axes that are not homed
        self.controls = tuple(options.controls)
        self.unhomed = options.unhomed
        # targets streamed in servo mode
        self.targets: TargetStream | None = None
        # state of the machine when it began, or when the program began that it continues, with others'
        # changes at its pauses; None: not begun
        self.origin: StartState | None = None
        # it may borrow axes of a program at a pause
        self.at_pause = options.at_pause
        # motion by hand: jog or homing; in machine coordinates, at its own speed whatever the override
        self.by_hand = options.by_hand
        # lines in machine coordinates that move the axes to the start of its first line
        self.approach: Sequence[str] = ()
        # executor time of the newest cycle before it began [s]
        self.begun = 0.0
        # count of rejections: planner reports about lines of an earlier count are ignored, and lines numbered
        # at one are refused
        self.epoch = 0
        self.journaled = start_line - 1
        self.validated = start_line - 1
        self.progress = LineProgress(start_line)
        self.tool_use = ToolUse()
        # end of the planned motion on the program's time axis in the executor [cycles]
        self.planned_end_u: float | None = None
        # lines up to this one have ended and are journaled: the only number that is reported
        self.done = start_line - 1
        self.eta_s: float | None = None
        # messages of lines for the operator, due once the program is there, and the last one that was due
        self.messages: deque[ProgramMessage] = deque(maxlen=MESSAGES)
        self.notice = ""
        # tool that a tool change waits for; None: none
        self.asks_for: int | None = None
        # input that it waits for, and program that it waits for to leave; empty: none
        self.waits_for = self.waits_before = ""
        self.closed = bool(options.controls)
        self.held = options.hold
        # names of the inputs that hold it; empty: none
        self.held_by = ""
        # index in `Clearance.switches` of the last input that switched on a zone before it; None: none
        self.zone_switch: int | None = None
        # at a pause by M00, M01 or a tool change, held or not; and its line
        self.paused = False
        self.paused_at = 0
        self.override = 1.0
        # envelope to stay within, of an approved run
        self.envelope = options.envelope
        # greatest override that the arming allows
        self.override_limit = options.override_limit
        self.rejected = 0
        self.diagnostics: list[WireDiagnostic] = []
        self.fault: Fault | None = None
        # nothing of it runs any more; its end is reported once it is journaled
        self.over = False
        self.ended_at: float | None = None
        self.ended_as: ProgramState = "finished"
        self.reason = ""
        self.last_reported_credit = queue.limit
        self.last_reported_started = 0
        self.journaled_started = 0
        self._waiting: deque[tuple[int, asyncio.Future[Verdict]]] = deque()
        self._waiting_for_journal: deque[tuple[int, asyncio.Future[Verdict]]] = deque()
        # of waits for records other than lines: opening, close
        self._waiting_for_records: deque[asyncio.Future[Verdict]] = deque()

    @property
    def ended(self) -> bool:
        return self.state in ENDED

    @property
    def label(self) -> str:
        """Kind and owner of the program, for people."""
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
        """Count of lines that fit after the last one journaled."""
        if not self.takes_lines:
            return 0
        return self.queue.credit + self.queue.accepted - self.journaled

    def _waits_for(self) -> str:
        if self.over:
            return ""
        # an operator's hold has precedence over waits
        return self.held_by if self.held else self.waits_for or self.waits_before

    def status(self) -> ProgramStatus:
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
        """Return the share of its time that has passed, or of its accepted lines if its time is unknown."""
        if self.state == "finished":
            # even if lines after M2 have not run
            return 1.0
        by_time = self.clock.fraction()
        if by_time is not None:
            return by_time
        total = self.journaled - self.start_line + 1
        return min(1.0, max(0.0, (self.progress.done - self.start_line + 1) / total)) if total else 0.0

    def wait_for(self, through: int, verdict: asyncio.Future[Verdict], *, validated: bool) -> None:
        """Resolve ``verdict`` once lines up to this number are journaled and, if requested, ``validated``."""
        (self._waiting if validated else self._waiting_for_journal).append((through, verdict))
        self.settle()

    def wait_for_record(self, verdict: asyncio.Future[Verdict]) -> None:
        """Keep ``verdict`` until the journal resolves it, or fails."""
        while self._waiting_for_records and self._waiting_for_records[0].done():
            self._waiting_for_records.popleft()
        self._waiting_for_records.append(verdict)

    def settle(self) -> None:
        """Resolve submits whose lines are journaled and, if the program runs, validated."""
        through = self.journaled
        while self._waiting_for_journal and self._waiting_for_journal[0][0] <= through:
            give(self._waiting_for_journal.popleft()[1], Verdict.TAKEN)
        if self.state not in ("queued", "ending") and not self.step and not self.over:
            through = min(through, self.validated)
        while self._waiting and self._waiting[0][0] <= through:
            give(self._waiting.popleft()[1], Verdict.TAKEN)

    def reject(self, line: int, diagnostics: list[WireDiagnostic]) -> None:
        """Note that line ``line`` is faulty, and expect it again."""
        self.epoch += 1
        self.rejected = line
        self.diagnostics = diagnostics
        self.queue.reject(line)
        self.journaled = min(self.journaled, line - 1)
        self.validated = max(self.validated, line - 1)
        self.settle()
        self.dismiss(Verdict.REJECTED)

    def dismiss(self, verdict: Verdict) -> None:
        """Resolve everything that still waits."""
        for waiting in (self._waiting, self._waiting_for_journal):
            while waiting:
                give(waiting.popleft()[1], verdict)

    def dismiss_unjournaled(self) -> None:
        """Resolve submits whose lines cannot be journaled now; their numbers stay taken."""
        while self._waiting_for_records:
            give(self._waiting_for_records.popleft(), Verdict.NOT_JOURNALED)
        for waiting in (self._waiting, self._waiting_for_journal):
            # numbers ascend, except that a repeated message waits for older ones
            kept = [each for each in waiting if each[0] <= self.journaled]
            refused = [each for each in waiting if each[0] > self.journaled]
            waiting.clear()
            waiting.extend(kept)
            for _, verdict in refused:
                give(verdict, Verdict.NOT_JOURNALED)


def give(waiting: asyncio.Future[Verdict], verdict: Verdict) -> None:
    """Resolve a future, unless that was done or it was cancelled."""
    if not waiting.done():
        waiting.set_result(verdict)
