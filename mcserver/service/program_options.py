"""Options for opening a program."""

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
    """Options of a program, from its client or the server itself.

    Attributes:
        axes: to lease; None: all, with ``at_pause`` all except those that a program at a pause keeps.
        grace_s: how long the client may be away before ``on_disconnect`` applies [s].
        before: lines before ``start_line``. resume_of: program that has them in the journal.
        step: single line mode.
        switches: of the operator; None: those of ``resume_of``, which may not be changed.
        hold: begin held. unhomed: it may move axes that are not homed.
        controls: the whole of a program without planner; the last one is its end.
        sha256: of its whole text, to find the simulated times.
        by_hand: a jog or a search: in machine coordinates, without override.
        at_pause: it may borrow axes of a program at a pause.
        override_limit: greatest override, 1 as programmed.
        envelope: to stay within, of an approved run.
        confirmed: what a person has confirmed of the approach to ``start_line``.
        known: lines from ``start_line`` on that are treated as if the client had sent them.
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
