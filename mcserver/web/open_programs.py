"""Why something cannot be done at a machine now: a program is open."""

from __future__ import annotations

from collections.abc import Sequence

from mcclient import MotionError, ProgramStatus

from mcserver.web.formatting import is_live
from mcserver.web.translation import t


def refusal_of(programs: Sequence[ProgramStatus], why: str) -> MotionError | None:
    """Return the refusal (MC512) where a program is open; None where none is, or it stands at a pause.

    Args:
        why: what speaks against it, such as ``zero is set where the axes stand``.
    """
    live = [each for each in programs if is_live(each)]
    # what waits for the axes of one at a pause waits on
    standing = ("paused", "queued") if any(each.state == "paused" for each in live) else ()
    program = next((each for each in live if each.state not in standing), None)
    if program is None:
        return None
    return MotionError(
        "MC512",
        t(
            "{program} of {client} is {state}: {why}",
            program=program.name or program.program,
            client=program.client,
            state=t(program.state),
            why=t(why),
        ),
        t("wait for its end, or abort it"),
    )
