"""How a fault shows, and in which cycle it does so first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mcserver.can.cob import Function
from mcserver.can.pdo_layout import RPDO1, RPDO2, TPDO1
from mcserver.drives.cia402.loop_gains import DELAY_CYCLES
from tests.e2e_can.bus_log import Logged
from tests.e2e_can.cycles import Rows, Slice, first_cycle, first_with, slices

Condition = Callable[[Slice], bool]


@dataclass(frozen=True)
class Witness:
    """An axis whose setpoints show which cycle a frame of its bus belongs to."""

    bus: int
    node: int
    column: int
    counts_per_mm: float


@dataclass(frozen=True)
class Evidence:
    """A run.

    Attributes:
        frames: of all buses. injected: number of frames before the fault was asked for.
        witness: on the bus where signs are looked for.
    """

    frames: Sequence[Logged]
    injected: int
    rows: Rows
    witness: Witness

    def slices(self) -> list[Slice]:
        return slices(self.frames, self.witness.bus)

    def begin(self) -> int:
        """Index of the slice in which the fault was asked for."""
        return len(slices(self.frames[: self.injected], self.witness.bus))

    def row(self, index: int) -> int:
        """Row of a slice."""
        witness = self.witness
        first = first_cycle(self.slices(), self.rows, witness.node, witness.column, witness.counts_per_mm)
        return self.rows.of(first + index)


class Sign(Protocol):
    """What shows a fault."""

    def row(self, evidence: Evidence) -> int:
        """Of the first cycle in which it can be seen."""


@dataclass(frozen=True)
class InFrames:
    """Frames of the bus between two SYNCs, asked in their order; a new condition for each run."""

    condition: Callable[[], Condition]

    def row(self, evidence: Evidence) -> int:
        index = first_with(evidence.slices(), evidence.begin(), self.condition())
        assert index is not None, "the fault is not to be seen on the bus"
        return evidence.row(index)


@dataclass(frozen=True)
class NoFrames:
    """The bus is away: the cycle after its last SYNC."""

    def row(self, evidence: Evidence) -> int:
        return evidence.row(len(evidence.slices()))


@dataclass(frozen=True)
class Behind:
    """An encoder further from where its setpoint was, while the reading came, than a limit [mm]."""

    column: int
    limit_mm: float

    def row(self, evidence: Evidence) -> int:
        setpoint, actual = (each[:, self.column] for each in (evidence.rows.setpoint, evidence.rows.actual))
        past = np.stack([np.roll(setpoint, count)[DELAY_CYCLES:] for count in range(DELAY_CYCLES + 1)])
        now = actual[DELAY_CYCLES:]
        outside = np.maximum(now - past.max(axis=0), past.min(axis=0) - now)
        return DELAY_CYCLES + int(np.argmax(outside > self.limit_mm))


def lacks_answer(node: int) -> Condition:
    """No TPDO1 of the node."""
    return lambda part: not part.payloads(Function.TPDO1 + node)


def short_answer(node: int) -> Condition:
    """A TPDO1 with too few bytes."""
    size = TPDO1.packing.size
    return lambda part: any(len(payload) < size for payload in part.payloads(Function.TPDO1 + node))


def has(identifier: int, begin: bytes = b"") -> Condition:
    """A frame of that identifier whose payload begins so."""
    return lambda part: any(payload.startswith(begin) for payload in part.payloads(identifier))


def lacks_heartbeat(node: int, cycles: int) -> Condition:
    """No heartbeat of the node for more cycles than that."""
    since = 0

    def overdue(part: Slice) -> bool:
        nonlocal since
        since = 0 if part.payloads(Function.HEARTBEAT + node) else since + 1
        return since > cycles

    return overdue


def commanded(node: int, bits: int) -> Condition:
    """A controlword with these bits."""
    return lambda part: any(
        RPDO1.packing.unpack(each)[0] & bits == bits for each in part.payloads(Function.RPDO1 + node)
    )


def pulls(node: int, permille: int) -> Condition:
    """A target torque of at least so much, either way."""
    return lambda part: any(
        abs(RPDO2.packing.unpack(each)[2]) >= permille for each in part.payloads(Function.RPDO2 + node)
    )


def commanded_otherwise(node: int) -> Condition:
    """A controlword that was not the one before."""
    last: int | None = None

    def changed(part: Slice) -> bool:
        nonlocal last
        words = [RPDO1.packing.unpack(each)[0] for each in part.payloads(Function.RPDO1 + node)]
        before, last = last, words[-1] if words else last
        return before is not None and last != before

    return changed
