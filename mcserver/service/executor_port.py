"""The port over an executor's rings and mailbox, in a process of its own or on a virtual clock."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Protocol

from mcserver.executor.entries import Control, MotionSink
from mcserver.executor.envelope_bounds import Envelope
from mcserver.executor.shm.feedback import LATE, TIME, Block, FeedbackRing, FeedbackState, homed_of
from mcserver.executor.shm.mailbox import CommandMailbox
from mcserver.executor.shm.rings import ProgramRing
from mcserver.executor.shm.target_box import Targets
from mcserver.executor.view import SlotView
from mcserver.machine.machine_file import Machine
from mcserver.service.motion_port import Cycles, Snapshot
from mcserver.service.reports import AxisState

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


class ExecutorFaces(Protocol):
    """What an executor offers its server: `mcserver.executor.client.ExecutorProcess`."""

    @property
    def mailbox(self) -> CommandMailbox: ...
    @property
    def feedback(self) -> FeedbackState: ...
    @property
    def history(self) -> FeedbackRing: ...
    @property
    def epoch(self) -> float: ...
    @property
    def alive(self) -> bool: ...
    @property
    def ending(self) -> str: ...
    def open_slot(
        self,
        slot: int,
        axes_mask: int | None = None,
        *,
        override: float = 1.0,
        hold: bool = False,
        unhomed: bool = False,
        envelope: Envelope | None = None,
    ) -> MotionSink: ...
    def sink(self, slot: int) -> ProgramRing: ...
    def beat(self) -> None: ...
    def stop(self) -> object: ...


class ExecutorPort:
    """One machine's executor.

    Args:
        machine: its axes, in the order of the executor's columns.
        executor: running, with at least one cycle of feedback.
    """

    def __init__(self, machine: Machine, executor: ExecutorFaces) -> None:
        self._columns = {axis.index: column for column, axis in enumerate(machine.axes)}
        self._executor = executor
        self._closing = threading.Lock()

    @property
    def epoch(self) -> float:
        return self._executor.epoch

    def begin(
        self,
        slot: int,
        axes: frozenset[int],
        *,
        ratio: float,
        held: bool,
        unhomed: bool = False,
        controls: Sequence[Control] = (),
        envelope: Envelope | None = None,
    ) -> None:
        sink = self._executor.open_slot(
            slot, self._mask(axes), override=ratio, hold=held, unhomed=unhomed, envelope=envelope
        )
        for control in controls:
            sink.put_control(control)

    def put_targets(self, slot: int, targets: Targets) -> None:
        self._executor.sink(slot).targets.put(targets)

    def close_targets(self, slot: int) -> None:
        self._executor.sink(slot).targets.close()

    def beat(self) -> None:
        self._executor.beat()

    def slots(self) -> list[SlotView]:
        return [SlotView(u, rate) for u, rate, *_ in self._executor.history.newest_slots()]

    def hold(self, slot: int) -> None:
        self._executor.mailbox.set_hold(True, slot)

    def resume(self, slot: int) -> None:
        self._executor.mailbox.resume(slot)

    def end_pause(self, slot: int) -> None:
        self._executor.mailbox.end_pause(slot)

    def override(self, slot: int, ratio: float) -> None:
        self._executor.mailbox.set_override(ratio, slot)

    def abort(self, slot: int) -> None:
        self._executor.mailbox.abort(slot)

    def set_output(self, column: int, value: float) -> None:
        self._executor.mailbox.set_output(column, value)

    def set_input(self, column: int, value: float) -> None:
        self._executor.mailbox.set_input(column, value)

    def stop_all(self) -> None:
        self._executor.mailbox.stop()

    def emergency_stop(self) -> None:
        self._executor.mailbox.emergency_stop()

    def reset(self, axes: frozenset[int]) -> None:
        self._executor.mailbox.reset(self._mask(axes))

    def snapshot(self) -> Snapshot:
        history = self._executor.history
        row = history.newest_row()
        if not row:
            raise RuntimeError("no cycle has passed yet")
        inputs, outputs, owners = history.channels_of(row)
        homed = homed_of(row)
        return Snapshot(
            time=row[TIME],
            setpoint=history.axes_of(row, Block.SETPOINT),
            position=history.axes_of(row, Block.ACTUAL),
            velocity=history.axes_of(row, Block.ACTUAL_VELOCITY),
            torque=history.axes_of(row, Block.TORQUE),
            states=[_STATES[int(each)] for each in history.axes_of(row, Block.CONDITION)],
            late_cycles=int(row[LATE]),
            inputs=inputs,
            outputs=outputs,
            owners=owners,
            homed=[bool(homed >> column & 1) for column in range(len(self._columns))],
        )

    def cycles_since(self, cycle: int, limit: int) -> Cycles | None:
        history = self._executor.history
        if cycle < 0:
            cycle = max(0, history.written - limit)
        if history.written - cycle < limit:
            # a whole message or none
            return None
        first, rows = history.since(cycle, limit)
        if len(rows) == 0:
            return None
        return Cycles(
            first=first,
            start=float(history.time_of(rows)[0]),
            setpoint=history.block(rows, "setpoint"),
            position=history.block(rows, "actual"),
            velocity=history.block(rows, "actual_velocity"),
            torque=history.block(rows, "torque"),
        )

    def ended(self, slot: int) -> bool:
        shown = self._executor.feedback.slots[slot]
        return shown.state.free and shown.generation == self._executor.mailbox.slot_orders(slot).generation

    def ending(self) -> str:
        """How the executor came to its end; empty while it runs."""
        return self._executor.ending

    def alive(self) -> bool:
        return self._executor.alive

    def close(self) -> None:
        if self._closing.acquire(blocking=False):
            self._executor.stop()

    def _mask(self, axes: frozenset[int]) -> int:
        return sum(1 << self._columns[axis] for axis in axes)
