"""Where a bus's frames stand in the executor's cycles: from the frames themselves, never from a clock.

In cycle k the executor takes what has come, sends RPDOs and then SYNC; a drive answers that SYNC with its
TPDOs, which cycle k + 1 takes. So whatever stands between two SYNCs of a log is visible in the cycle of the
second.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mcclient import Samples
from numpy.typing import NDArray

from mcserver.can.cob import SYNC, Function
from mcserver.can.pdo_layout import RPDO1, RPDO2, TPDO1
from tests.e2e_can.bus_log import Logged

Array = NDArray[np.float64]
# a motion is recognized by so many different setpoints
LEAST_MATCHES = 10
# Controlword bits 0 … 3: enable operation (CiA 402).
ENABLE = 0x000F


@dataclass(frozen=True)
class Rows:
    """Telemetry as one table: shape (N,) and (N, K) [mm, deg]; ``seq`` has no gap."""

    seq: NDArray[np.int64]
    time_s: Array
    setpoint: Array
    actual: Array

    def of(self, cycle: int) -> int:
        """Row of a cycle."""
        return int(np.searchsorted(self.seq, cycle))


def rows_of(blocks: Sequence[Samples]) -> Rows:
    """All messages together."""
    seq = np.concatenate([block.seq + np.arange(len(block.time_s)) for block in blocks])
    keep = np.unique(seq, return_index=True)[1]
    parts = [
        np.concatenate([getattr(block, name) for block in blocks])[keep]
        for name in ("time_s", "setpoint", "actual")
    ]
    found = Rows(seq[keep], *parts)
    assert len(found.seq) == found.seq[-1] - found.seq[0] + 1, "telemetry was lost"
    return found


@dataclass(frozen=True)
class Slice:
    """The frames of one bus between two SYNCs, without them; visible in the cycle of the second one."""

    frames: tuple[Logged, ...]

    def payloads(self, identifier: int) -> list[bytes]:
        return [frame.payload for frame in self.frames if frame.identifier == identifier]


def slices(frames: Sequence[Logged], bus: int) -> list[Slice]:
    """One for each SYNC of the bus, with what came since the one before."""
    found: list[Slice] = []
    since: list[Logged] = []
    for frame in frames:
        if frame.bus != bus:
            continue
        if frame.identifier == SYNC:
            found.append(Slice(tuple(since)))
            since = []
        else:
            since.append(frame)
    return found


def targets(parts: Sequence[Slice], node: int) -> list[int | None]:
    """What a node was commanded to follow in each slice [counts]."""
    commands = [part.payloads(Function.RPDO1 + node) for part in parts]
    return [RPDO1.packing.unpack(each[-1])[2] if each else None for each in commands]


def first_cycle(parts: Sequence[Slice], rows: Rows, node: int, column: int, per_mm: float) -> int:
    """Cycle of the first slice, by a node's targets, which are the setpoints of its axis.

    Args:
        per_mm: counts per mm.
    """
    moving = np.flatnonzero(np.abs(np.diff(rows.setpoint[:, column])) > 0.01)
    at = {round(rows.setpoint[row, column] * per_mm): int(rows.seq[row]) for row in moving}
    known = np.array(sorted(at))
    assert len(known) >= LEAST_MATCHES, "nothing has moved"
    votes: Counter[int] = Counter()
    for index, target in enumerate(targets(parts, node)):
        if target is not None:
            near = known[np.argmin(np.abs(known - target))]
            # telemetry has 24 bits
            if abs(near - target) <= 2 + abs(target) * 2.0**-23:
                votes[at[near] - index] += 1
    (offset, matches), *_ = votes.most_common(1)
    assert matches >= LEAST_MATCHES, "the log does not fit the telemetry"
    return offset


def first_with(parts: Sequence[Slice], begin: int, condition: Callable[[Slice], bool]) -> int | None:
    """Index of the first slice from one on that fits; the condition is asked of all, in their order."""
    fits = [condition(part) for part in parts]
    return next((index for index in range(begin, len(parts)) if fits[index]), None)


def jumps(frames: Sequence[Logged], node: int) -> list[int]:
    """Each time that a node was commanded to enable operation: target less actual position then [counts]."""
    found: list[int] = []
    actual: int | None = None
    enabled = False
    for frame in frames:
        if frame.identifier == Function.TPDO1 + node and len(frame.payload) == TPDO1.packing.size:
            actual = TPDO1.packing.unpack(frame.payload)[2]
        elif frame.identifier == Function.RPDO1 + node and len(frame.payload) == RPDO1.packing.size:
            word, _, target = RPDO1.packing.unpack(frame.payload)
            enabling = word & ENABLE == ENABLE
            if enabling and not enabled and actual is not None:
                found.append(target - actual)
            enabled = enabling
    return found


def first_torques(frames: Sequence[Logged], node: int) -> list[int]:
    """Each time that a node was commanded by RPDO2 to enable operation: its target torque then [‰]."""
    found: list[int] = []
    enabled = False
    for frame in frames:
        if frame.identifier == Function.RPDO2 + node and len(frame.payload) == RPDO2.packing.size:
            word, _, torque = RPDO2.packing.unpack(frame.payload)
            enabling = word & ENABLE == ENABLE
            if enabling and not enabled:
                found.append(torque)
            enabled = enabling
    return found


def begins_to_brake(speed: Array, begin: int) -> int | None:
    """First row from ``begin`` on that is slower than the row ``begin`` by 1 %; speed in mm a cycle."""
    slower = np.flatnonzero(speed[begin:] < 0.99 * speed[begin])
    return begin + int(slower[0]) if len(slower) else None


def comes_to_rest(speed: Array, begin: int) -> int | None:
    """First row from ``begin`` on after which the speed stays zero."""
    still = speed[begin:] > 1e-4
    if not len(still) or still[-1]:
        return None
    last = np.flatnonzero(still)
    return begin + (int(last[-1]) + 1 if len(last) else 0)
