"""Faults that the executor reports by number, in words."""

from __future__ import annotations

from mcserver.executor.entries import ExecutorEvent
from mcserver.programs.reports import Fault


def fault_of(event: ExecutorEvent, program: str | None) -> Fault:
    """The fault of an event of kind FAULT."""
    axis = event.axis if event.axis >= 0 else None
    where = "" if axis is None else f" on axis {axis}"
    return Fault(
        code=f"MC{event.code}",
        message=f"fault{where}",
        hint="remove the cause, then reset (G1000) and capture (G1010)",
        axis=axis,
        line=event.line,
        program=program,
        t=event.time,
    )
