"""The service's interface to the executor, over its rings and mailbox."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.executor.client import ExecutorProcess
from mcserver.executor.entries import Control
from mcserver.executor.envelope_bounds import Envelope
from mcserver.executor.shm.feedback import LATE, TIME, Block, SlotView, homed_of, silent_of
from mcserver.executor.shm.mailbox import CommandMailbox
from mcserver.executor.shm.target_box import TargetBox
from mcserver.machine.machine_file import Machine
from mcserver.service.reports import AxisState

Array = NDArray[np.float64]
# index: value of `AxisCondition`
_STATES: tuple[AxisState, ...] = get_args(AxisState)


class Cycles(msgspec.Struct, frozen=True):
    """A run of consecutive cycles, as the drives reported them, in SI.

    Attributes:
        first: number of the first cycle. start: its executor time [s].
        setpoint, position, velocity, torque: shape (n, K) over the machine's axes [m, rad; per s; N·m].
    """

    first: int
    start: float
    setpoint: Array
    position: Array
    velocity: Array
    torque: Array


class Snapshot(msgspec.Struct, frozen=True):
    """State of the machine in its newest cycle, in SI; sequences of K numbers: for so few faster than arrays.

    Attributes:
        inputs, outputs: in the order of the machine's model. owners: who set each output last, as in
            `mcserver.executor.io_bank`.
        homed: whether each axis knows its position. turning: whether each axis is commanded a speed.
        silent: whether each axis's drive does not answer, so that its values are old.
    """

    time: float
    setpoint: list[float]
    position: list[float]
    velocity: list[float]
    torque: list[float]
    states: list[AxisState]
    late_cycles: int
    inputs: list[float] = []
    outputs: list[float] = []
    owners: list[int] = []
    homed: list[bool] = []
    turning: list[bool] = []
    silent: list[bool] = []


class ExecutorPort:
    """Commands to one machine's executor, and reports from it.

    The command mailbox and reading methods may be used from any thread, everything else only in the loop.

    Args:
        machine: its axes, in the order of the executor's columns.
        executor: running, with at least one cycle of feedback.
    """

    def __init__(self, machine: Machine, executor: ExecutorProcess) -> None:
        self._machine = machine
        self._executor = executor
        self._closing = threading.Lock()

    @property
    def epoch(self) -> float:
        """Unix time of executor time 0 [s]."""
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
        """Empty the slot's rings and start its time axis at 0.

        Args:
            ratio: of the feed override. unhomed: the program may move axes that are not homed.
            controls: the whole of a program without planner. envelope: to enforce.
        """
        sink = self._executor.open_slot(
            slot, self._machine.mask_of(axes), override=ratio, hold=held, unhomed=unhomed, envelope=envelope
        )
        for control in controls:
            sink.put_control(control)

    @property
    def orders(self) -> CommandMailbox:
        """Mailbox of commands for program slots and the machine."""
        return self._executor.mailbox

    def targets(self, slot: int) -> TargetBox:
        """Return the box for the newest targets of the slot's axes."""
        return self._executor.sink(slot).targets

    def slots(self) -> list[SlotView]:
        """Return the present state of every slot's program."""
        return [SlotView(u, rate) for u, rate, *_ in self._executor.history.newest_slots()]

    def reset(self, axes: frozenset[int]) -> None:
        """Clear latched faults of these axes, and the emergency stop."""
        self._executor.mailbox.reset(self._machine.mask_of(axes))

    def snapshot(self) -> Snapshot:
        """Return the newest cycle."""
        history = self._executor.history
        row = history.newest_row()
        if not row:
            raise RuntimeError("no cycle has passed yet")
        inputs, outputs, owners = history.channels_of(row)
        homed, silent, columns = homed_of(row), silent_of(row), range(len(self._machine.axes))
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
            homed=[bool(homed >> column & 1) for column in columns],
            silent=[bool(silent >> column & 1) for column in columns] if silent else [],
            turning=[speed != 0.0 for speed in history.axes_of(row, Block.VELOCITY)],
        )

    def cycles_since(self, cycle: int, limit: int) -> Cycles | None:
        """Return up to ``limit`` cycles from ``cycle`` on, or later if these are gone; None: none yet."""
        history = self._executor.history
        if cycle < 0:
            cycle = max(0, history.written - limit)
        if history.written - cycle < limit:
            # only whole messages
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
        """Return whether the last program in the slot has ended and is at rest."""
        shown = self._executor.feedback.slots[slot]
        return shown.state.free and shown.generation == self._executor.mailbox.slot_orders(slot).generation

    def ending(self) -> str:
        """Return how the executor ended, for a message; empty while it runs."""
        return self._executor.ending

    def alive(self) -> bool:
        """Return whether the executor runs."""
        return self._executor.alive

    def close(self) -> None:
        """Stop motion, release the axes and end the executor."""
        if self._closing.acquire(blocking=False):
            self._executor.stop()
