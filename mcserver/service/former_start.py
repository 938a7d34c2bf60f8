"""Report what an earlier start of the server has left: interrupted programs, invalid references, damage."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from mcserver.service.program_table import ProgramTable
from mcserver.service.reports import ProgramStatus


def report_interrupted(table: ProgramTable, programs: Sequence[ProgramStatus]) -> None:
    """Publish the end of programs that an earlier start had not ended."""
    for program in programs:
        table.events.publish(
            "program.ended",
            program=program.program,
            client=program.client,
            state="interrupted",
            line=program.done,
            reason="the server that ran it went away",
        )


def report_lost_references(table: ProgramTable, is_homed: Callable[[int], bool]) -> None:
    """Warn of stored references that are not valid now, and remove them."""
    references = table.references
    if references.damage:
        table.events.warn("MC459", references.damage, level=logging.ERROR)
    for axis in sorted(references.axes):
        if not is_homed(axis):
            why = "its encoder does not read what it did when the server stopped"
            if axis not in references.holding:
                why = "the server ended without noting where it stands: killed, or while it moved"
            table.events.warn("MC459", f"axis {axis} is not homed: {why}", axis=axis)
            references.forget(axis)


def report_damage(table: ProgramTable) -> None:
    """Warn of damage that was found in the journal at this start."""
    damage = table.journal_damage
    if damage is not None:
        message = f"the journal was damaged: {damage.message}; as it was it is kept in {damage.kept}"
        table.events.warn("MC527", message, level=logging.ERROR)
