"""Describe the executor's faults in words, and latch them until the reset."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from mcserver.executor.entries import ExecutorEvent
from mcserver.executor.fault_codes import remedy_of
from mcserver.service.reports import AxisState, Fault

LATCHED_FAULTS = 64
# feedback may show the latched fault only after the event
FAULT_SHOWN_S = 0.5


def fault_of(
    event: ExecutorEvent, program: str | None, inputs: Sequence[str] = (), outputs: Sequence[str] = ()
) -> Fault:
    """Describe an event of kind FAULT; ``inputs``, ``outputs``: names of the machine's."""
    axis = event.axis if event.axis >= 0 else None
    message, hint = remedy_of(event.code, event.axis, event.values, inputs, outputs)
    return Fault(
        code=f"MC{event.code}",
        message=message,
        hint=hint,
        axis=axis,
        line=event.line,
        program=program,
        t=event.time,
    )


class FaultLatch:
    """The latched faults of one machine, oldest first; at most `LATCHED_FAULTS`.

    Args:
        now: executor time [s].
        on_latched: called with each fault that is latched.
    """

    def __init__(self, now: Callable[[], float], on_latched: Callable[[Fault], None]) -> None:
        self._now = now
        self._on_latched = on_latched
        self._faults: list[Fault] = []

    def __len__(self) -> int:
        return len(self._faults)

    def __iter__(self) -> Iterator[Fault]:
        return iter(self._faults)

    def latch(self, fault: Fault) -> None:
        """Latch a fault, unless its axis has one of the same code."""
        known = any((other.code, other.axis) == (fault.code, fault.axis) for other in self._faults)
        if not known and len(self._faults) < LATCHED_FAULTS:
            self._faults.append(fault)
            self._on_latched(fault)

    def clear(self) -> None:
        """Clear all, for a reset."""
        self._faults.clear()

    def forget_cleared(self, states: Mapping[int, AxisState]) -> bool:
        """Remove faults that no axis has latched any more; return True if that removed the last ones."""
        since = self._now() - FAULT_SHOWN_S
        kept = [
            fault
            for fault in self._faults
            if fault.t > since or (fault.axis is not None and states.get(fault.axis) == "fault")
        ]
        cleared = bool(self._faults) and not kept
        self._faults = kept
        return cleared
