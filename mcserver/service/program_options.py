"""What a program is opened with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mcserver.executor.entries import Control
from mcserver.executor.envelope_bounds import Envelope
from mcserver.gcode.switches import Switches
from mcserver.service.approach import NO_CONFIRMATION, Confirmation
from mcserver.service.reports import OnDisconnect


@dataclass(frozen=True, kw_only=True)
class ProgramOptions:
    """Options of a program, as its client or the server itself gives them.

    Attributes:
        axes: to be leased; None: all, with ``at_pause`` all but those that a program at a pause keeps.
        grace_s: how long the client may be away before ``on_disconnect`` applies [s].
        before: its lines ahead of ``start_line``. resume_of: the program that has them in the journal.
        step: single line mode.
        switches: of the operator; None: those of ``resume_of``, which none but the same may replace.
        hold: it begins held. unhomed: it may move axes that are not homed.
        controls: all of a program that needs no planner; the last one is its end.
        sha256: of its whole text, so that a simulation of the text tells how long it takes.
        by_hand: a jog or a search: in machine coordinates, and no override applies.
        at_pause: it may have axes of a program that stands at a pause.
        override_limit: the greatest override, 1 as programmed.
        envelope: what an approved run has to stay within.
        confirmed: what a person has agreed to of the way to ``start_line``.
        known: lines from ``start_line`` on that are taken as if the client had sent them.
    """

    name: str = ""
    axes: Sequence[int] | None = None
    on_disconnect: OnDisconnect = "stop"
    grace_s: float = 0.0
    start_line: int = 1
    before: Sequence[str] = ()
    resume_of: str | None = None
    step: bool = False
    switches: Switches | None = None
    hold: bool = False
    unhomed: bool = False
    controls: Sequence[Control] = ()
    sha256: str | None = None
    by_hand: bool = False
    at_pause: bool = False
    override_limit: float = math.inf
    envelope: Envelope | None = None
    confirmed: Confirmation = NO_CONFIRMATION
    known: Sequence[str] = ()


BY_DEFAULT = ProgramOptions()
