"""The port over an executor's rings and mailbox, in a process of its own or on a virtual clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mcserver.config import Machine
from mcserver.executor.entries import ExecutorEvent, MotionSink
from mcserver.executor.events import EventRing
from mcserver.executor.feedback import AxisCondition, FeedbackRing
from mcserver.executor.mailbox import CommandMailbox
from mcserver.executor.rings import ProgramRing
from mcserver.programs.port import Cycles, SlotView, Snapshot
from mcserver.programs.refusals import Refused
from mcserver.programs.reports import AxisState

FIRST_CYCLE_LIMIT_S = 10.0
# the executor's counter has to grow within this time
ALIVE_S = 1.0

_STATES: tuple[AxisState, ...] = (
    "off",
    "starting",
    "standstill",
    "moving",
    "speed",
    "torque",
    "stopping",
    "released",
    "fault",
)
ENERGIZED = frozenset(
    {
        AxisCondition.HOLDING,
        AxisCondition.MOVING,
        AxisCondition.SPEED,
        AxisCondition.TORQUE,
        AxisCondition.STOPPING,
    }
)


class ExecutorFaces(Protocol):
    """What an executor shares with the server."""

    @property
    def rings(self) -> Sequence[ProgramRing]: ...
    @property
    def mailbox(self) -> CommandMailbox: ...
    @property
    def events(self) -> EventRing: ...
    @property
    def feedback(self) -> FeedbackRing: ...
    def close(self) -> None: ...


class ExecutorPort:
    """One machine's executor.

    Args:
        machine: its axes, in the order of the executor's columns.
        executor: running, with at least one cycle of feedback.
    """

    def __init__(self, machine: Machine, executor: ExecutorFaces) -> None:
        self._executor = executor
        self._columns = {axis.index: column for column, axis in enumerate(machine.axes)}
        self._closed = threading.Lock()
        self._beat = executor.mailbox.executor_beat
        self._beat_seen = time.monotonic()
        latest = executor.feedback.latest()
        if latest is None:
            raise Refused("MC518", "the executor has not run a cycle", "see its log")
        self._epoch = time.time() - latest.time

    @property
    def epoch(self) -> float:
        return self._epoch

    def begin(self, slot: int, axes: frozenset[int], *, ratio: float, held: bool) -> MotionSink:
        ring = self._executor.rings[slot]
        self._executor.mailbox.open_slot(slot, self._mask(axes), ring.restart(), override=ratio, hold=held)
        return ring

    def poll_events(self) -> list[ExecutorEvent]:
        return self._executor.events.take()

    def beat(self) -> None:
        self._executor.mailbox.beat()

    def slots(self) -> list[SlotView]:
        latest = self._executor.feedback.latest()
        assert latest is not None, "there was feedback when the port was made"
        return [SlotView(slot.u, slot.rate) for slot in latest.slots]

    def hold(self, slot: int) -> None:
        self._executor.mailbox.set_hold(True, slot)

    def resume(self, slot: int) -> None:
        self._executor.mailbox.resume(slot)

    def override(self, slot: int, ratio: float) -> None:
        self._executor.mailbox.set_override(ratio, slot)

    def abort(self, slot: int) -> None:
        self._executor.mailbox.abort(slot)

    def stop_all(self) -> None:
        self._executor.mailbox.stop()

    def emergency_stop(self) -> None:
        self._executor.mailbox.emergency_stop()

    def reset(self, axes: frozenset[int]) -> None:
        self._executor.mailbox.reset(self._mask(axes))

    def snapshot(self) -> Snapshot:
        latest = self._executor.feedback.latest()
        assert latest is not None, "there was feedback when the port was made"
        return Snapshot(
            time=latest.time,
            setpoint=latest.setpoint,
            position=latest.actual,
            velocity=latest.actual_velocity,
            torque=latest.torque,
            states=[_STATES[condition] for condition in latest.condition.tolist()],
            slots=[SlotView(slot.u, slot.rate) for slot in latest.slots],
            late_cycles=latest.late_cycles,
        )

    def cycles_since(self, cycle: int, limit: int) -> Cycles | None:
        feedback = self._executor.feedback
        if cycle < 0:
            cycle = max(0, feedback.written - limit)
        if feedback.written - cycle < limit:
            # a whole message or none
            return None
        first, rows = feedback.since(cycle, limit)
        if len(rows) == 0:
            return None
        block = feedback.block
        return Cycles(
            first=first,
            start=float(feedback.time_of(rows)[0]),
            setpoint=block(rows, "setpoint"),
            position=block(rows, "actual"),
            velocity=block(rows, "actual_velocity"),
            torque=block(rows, "torque"),
        )

    def alive(self) -> bool:
        beat = self._executor.mailbox.executor_beat
        now = time.monotonic()
        if beat != self._beat:
            self._beat, self._beat_seen = beat, now
        return now - self._beat_seen < ALIVE_S

    def close(self) -> None:
        if self._closed.acquire(blocking=False):
            self._executor.close()

    def energized(self) -> frozenset[int]:
        """Axes that hold a position or move."""
        latest = self._executor.feedback.latest()
        if latest is None:
            return frozenset()
        return frozenset(
            index for index, column in self._columns.items() if int(latest.condition[column]) in ENERGIZED
        )

    def positions(self) -> dict[int, float]:
        """Where motion starts from [m, rad]: the setpoint, or the encoder of an axis without energy."""
        latest = self._executor.feedback.latest()
        if latest is None:
            return {}
        live = np.isin(latest.condition, [int(condition) for condition in ENERGIZED])
        start = np.where(live, latest.setpoint, latest.actual)
        return {index: float(start[column]) for index, column in self._columns.items()}

    def _mask(self, axes: frozenset[int]) -> int:
        return sum(1 << self._columns[axis] for axis in axes)
