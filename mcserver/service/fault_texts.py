"""Faults that the executor reports by number, in words."""

from __future__ import annotations

from mcserver.executor.entries import ExecutorEvent
from mcserver.executor.fault_codes import remedy_of
from mcserver.service.reports import Fault


def fault_of(event: ExecutorEvent, program: str | None) -> Fault:
    """The fault of an event of kind FAULT."""
    axis = event.axis if event.axis >= 0 else None
    message, hint = remedy_of(event.code, event.axis, event.values)
    return Fault(
        code=f"MC{event.code}",
        message=message,
        hint=hint,
        axis=axis,
        line=event.line,
        program=program,
        t=event.time,
    )
