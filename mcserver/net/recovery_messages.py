"""Payloads about continuing in the middle of a program, as `mcserver.net.messages`."""

from __future__ import annotations

import msgspec

from mcserver.net.messages import AxisIndex, Grace, LineNumber, ProgramId, Request
from mcserver.service.approach import AxisStart as AxisStart
from mcserver.service.approach import Need as Need
from mcserver.service.approach import Outputs as Outputs
from mcserver.service.approach import Switched as Switched
from mcserver.service.approach import WayStep as WayStep
from mcserver.service.reports import OnDisconnect, ProgramState


class ContinuationRequest(Request, frozen=True, kw_only=True):
    """What a start in the middle of a program would do; nothing moves.

    Attributes:
        program: one that has ended; if others have continued it, the last of these is meant.
        line: the first that would run; None: the one after the last that is done.
        before: lines 1 … line - 1 of a text, instead of ``program``. axes: of it; None: all of the machine.
        block_delete, optional_stop: of the text, as in `OpenRequest`; a program keeps its settings.
    """

    program: ProgramId | None = None
    line: LineNumber | None = None
    before: list[str] = msgspec.field(default_factory=list)
    axes: list[AxisIndex] | None = None
    block_delete: bool | None = None
    optional_stop: bool | None = None


class Continuation(msgspec.Struct, frozen=True):
    """How a program would continue.

    Attributes:
        program: its id, empty for a text. name, state, done, accepted: as it ended; lines through ``done``
            are certain.
        whole: its text is known to its end, so nothing must be sent. sha256: of its whole text.
        line: the first that would run. first, lines: of the text around that line.
        modal: codes in force there.
        energize: axes that are energized first. axes: where each is, and where the program has it there.
        way: the moves that bring them there, in order.
        switched: what the program had switched differently from now.
        needs: what prevents it; one that has `confirm` is met by that field of the request.
        block_delete, optional_stop: the settings that it continues with.
    """

    program: str
    name: str
    state: ProgramState | None
    done: int
    accepted: int
    whole: bool
    sha256: str | None
    line: int
    first: int
    lines: list[str]
    modal: list[str]
    energize: list[int]
    axes: list[AxisStart]
    way: list[WayStep]
    switched: list[Switched]
    needs: list[Need]
    block_delete: bool
    optional_stop: bool


class ContinueRequest(Request, frozen=True, kw_only=True):
    """Continues a program that has ended.

    Attributes:
        program, line: as in `ContinuationRequest`.
        way: axes may move as `continuation` shows, if the machine file names no safe way.
        outputs: set what the program had switched, or leave it as it is; None: not specified.
        on_disconnect, grace_s: as in `OpenRequest`. hold: begin held.
    """

    program: ProgramId
    line: LineNumber | None = None
    way: bool = False
    outputs: Outputs | None = None
    on_disconnect: OnDisconnect = "stop"
    grace_s: Grace = 10.0
    hold: bool = False


class ContinueReply(msgspec.Struct, frozen=True):
    """The program that continues, like `OpenReply`.

    Attributes:
        line: the first that runs. resume_of: the program that it continues.
        whole: the server has all of its lines; otherwise the client sends those from ``expected`` on.
    """

    program: str
    state: ProgramState
    axes: list[int]
    expected: int
    credit: int
    instance: str
    line: int
    resume_of: str
    whole: bool
