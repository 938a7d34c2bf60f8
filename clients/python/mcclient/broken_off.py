"""The program that was broken off and that somebody may want to go on with."""

from __future__ import annotations

from collections.abc import Sequence

from mcclient.types import ENDED, ProgramStatus

# Ends that leave something to go on with.
BROKEN_OFF = frozenset({"interrupted", "faulted", "aborted"})
# Names of programs that nobody goes on with: those of the operator's page, and how the server's own begin.
ENERGIZE, MANUAL_INPUT, WORK_OFFSET = "energize", "manual input", "work offset"
# of ``mcctl send``
SENT = "mcctl send"
TOOL_STEP = "step tool "
BY_HAND = (ENERGIZE, WORK_OFFSET, MANUAL_INPUT, SENT)
MOVES_BY_HAND = (
    *("jog axis ", "jog tool ", "home axis ", "reference axis "),
    *(f"{WORK_OFFSET} by ", f"{MANUAL_INPUT} by ", TOOL_STEP),
)


def broken_off(programs: Sequence[ProgramStatus], *, lines_left: bool = False) -> ProgramStatus | None:
    """Return the newest program where it was broken off and nothing runs, else None.

    What was broken off before another program ran has been left behind; what only waited for its axes has not
    run.

    Args:
        lines_left: only where the server has lines of it that are not done.
    """
    if any(program.state not in ENDED for program in programs):
        return None
    ran = [each for each in programs if each.line > 0 and not is_by_hand(each.name)]
    newest = max(ran, key=lambda each: each.opened_at, default=None)
    if newest is None or newest.state not in BROKEN_OFF or (lines_left and newest.done >= newest.accepted):
        return None
    return newest


def is_by_hand(name: str) -> bool:
    """Return whether a program of that name is a move by hand, a few lines that somebody typed included."""
    return name in BY_HAND or name.startswith(MOVES_BY_HAND)


def is_typed(name: str) -> bool:
    """Return whether a program of that name is lines that somebody typed."""
    return name in (MANUAL_INPUT, SENT) or name.startswith(f"{MANUAL_INPUT} by ")
