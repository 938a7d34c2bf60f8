"""The executor as the service sees it; tests bring one of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Control
from mcserver.executor.envelope_bounds import Envelope
from mcserver.executor.shm.target_box import Targets
from mcserver.executor.view import SlotView
from mcserver.service.reports import AxisState

Array = NDArray[np.float64]


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
    """The machine in its newest cycle, in SI; K numbers each: of so few, plain ones are quicker than arrays.

    Attributes:
        inputs, outputs: in the order of the machine's model. owners: who has set each output last, as
            `mcserver.executor.io_bank` has it.
        homed: whether each axis knows where it is.
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


class MotionPort(Protocol):
    """Commands to the executor and reports from it.

    `beat` belongs to the heartbeat's thread; `emergency_stop` and what only reads may be called from any
    thread; all else belongs to the loop.
    """

    @property
    def epoch(self) -> float:
        """Unix time of executor time 0 [s]."""

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
            ratio: the override. unhomed: the program may move axes that are not homed.
            controls: all of a program that needs no planner. envelope: what it has to stay within.
        """

    def put_targets(self, slot: int, targets: Targets) -> None:
        """Give the slot's axes, which follow targets, the newest ones."""

    def close_targets(self, slot: int) -> None:
        """Say that no more targets come."""

    def beat(self) -> None:
        """Say that the server is alive; without it motion stops."""

    def slots(self) -> Sequence[SlotView]:
        """Where every slot's program is now."""

    def hold(self, slot: int) -> None:
        """Ramp the slot's rate to 0 along the path."""

    def resume(self, slot: int) -> None:
        """Ramp the rate back."""

    def end_pause(self, slot: int) -> None:
        """End M00 and M01."""

    def override(self, slot: int, ratio: float) -> None:
        """Feed override, 1 as programmed."""

    def abort(self, slot: int) -> None:
        """Stop along the path, empty the rings and report STOPPED."""

    def set_output(self, column: int, value: float) -> None:
        """Set an output of the machine."""

    def set_input(self, column: int, value: float) -> None:
        """Set a simulated input of the machine."""

    def stop_all(self) -> None:
        """Abort every program and stop every axis within its limits; axes stay energized."""

    def emergency_stop(self) -> None:
        """Stop every axis as its drive's emergency stop does; latched until `reset`."""

    def reset(self, axes: frozenset[int]) -> None:
        """Clear latched faults of these axes, and the emergency stop."""

    def snapshot(self) -> Snapshot:
        """The newest cycle."""

    def cycles_since(self, cycle: int, limit: int) -> Cycles | None:
        """Up to ``limit`` cycles from number ``cycle`` on, or later where these are gone; None: none yet."""

    def ended(self, slot: int) -> bool:
        """Whether the program that was begun last in the slot has come to its end and to rest."""

    def ending(self) -> str:
        """How the executor came to its end, for a message; empty while it runs."""

    def alive(self) -> bool:
        """Whether the executor runs."""

    def close(self) -> None:
        """Stop motion, release the axes and end the executor."""
