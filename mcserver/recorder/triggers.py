"""When a black box is written: at faults and emergency stops, seen in the cycles or reported as events."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.shm.feedback import ESTOP, TIME, AxisCondition, FeedbackRing

# Kinds of events that write a black box.
EVENTS = frozenset({"fault", "estop"})


class FaultEdges:
    """Finds where the emergency stop or the fault of an axis begins in the cycles.

    It needs no server: a black box is written too where that is gone.
    """

    def __init__(self, ring: FeedbackRing) -> None:
        self._ring = ring
        self._before: NDArray[np.bool_] | None = None

    def first(self, rows: NDArray[np.float64]) -> tuple[float, str] | None:
        """Executor time [s] and word of the first edge in some rows; None where nothing triggers.

        What is latched in the very first row has no seconds before, and is no edge.
        """
        if not len(rows):
            return None
        faulty = self._ring.block(rows, "condition") == AxisCondition.FAULT
        latched = np.concatenate([rows[:, ESTOP : ESTOP + 1] != 0.0, faulty], axis=1)
        before = latched[:1] if self._before is None else self._before
        edges = latched & ~np.concatenate([before, latched[:-1]])
        self._before = latched[-1:].copy()
        at = np.flatnonzero(edges.any(axis=1))
        if not len(at):
            return None
        word = "estop" if edges[at[0], 0] else "fault"
        return float(rows[at[0], TIME]), word


class Trigger:
    """One black box that is due: what caused it, and when its seconds behind have passed.

    Further causes within its time belong to it: a fault is often several.

    Args:
        t: executor time of the first cause [s]. after_s: how long is recorded behind it.
    """

    def __init__(self, t: float, reason: str, after_s: float) -> None:
        self.t = t
        self.due_s = t + after_s
        self._reasons = [reason]

    def add(self, reason: str) -> None:
        """A further cause; a code says more than a word."""
        if reason not in self._reasons:
            self._reasons.append(reason)

    @property
    def reason(self) -> str:
        """A code such as ``MC407``, else the first word."""
        codes = [reason for reason in self._reasons if reason.startswith("MC")]
        return codes[0] if codes else self._reasons[0]
