"""The seam between the executor and drives: one exchange a cycle for all axes of a bus.

Arrays run over the bus's own axes, in the order of `DriveBus.columns`. Everything is SI: m or rad, per
second, N·m at the motor's shaft. Buses keep no reference to the executor; the executor owns the setpoint
arrays, the bus owns the feedback arrays, both for the bus's whole life, so that a cycle allocates nothing.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Bit 2 of 60FDh.
HOME_SWITCH = 4


class DriveMode(enum.IntEnum):
    """What a drive is commanded to do in a cycle."""

    SILENT = 0  # nothing is transmitted: the drive's own heartbeat time-out acts (G1011)
    OFF = 1  # de-energize at once: the axis free-wheels or its brake closes (G1001)
    RESET = 2  # clear the fault latch, then as OFF (G1000)
    STOP = 3  # come to rest under the drive's own control, then as OFF (G1002)
    POSITION = 4  # energize; follow position, with velocity as feed-forward
    VELOCITY = 5  # energize; follow velocity (position is its integral, for information)
    TORQUE = 6  # energize; apply torque
    HOMING = 7  # energize; the drive homes itself, and holds where it ends


class DriveState(enum.IntEnum):
    """What a drive reports."""

    OFF = 0
    STARTING = 1  # commanded to energize, not yet there
    ENERGIZED = 2
    STOPPING = 3
    FAULT = 4  # latched until RESET
    HOMING = 5  # commanded to home, under way
    HOMED = 6  # it stands at its home position, which its reading shows


class DriveFault(enum.IntEnum):
    """Why a drive is in `DriveState.FAULT`; numbers of a vendor go through the bus's own events."""

    NONE = 0
    OTHER = 1
    OVER_TEMPERATURE = 2
    OVER_CURRENT = 3
    VOLTAGE = 4
    ENCODER = 5
    FOLLOWING = 6
    COMMUNICATION = 7
    EMERGENCY = 8  # it sent an emergency message
    REBOOTED = 9
    NOT_OPERATIONAL = 10  # its node has left the NMT state operational
    HEARTBEAT = 11  # its node's heartbeat has stopped
    BUS_DOWN = 12
    MODE = 13  # it is not in the mode of operation that was commanded
    NOT_CONFIGURED = 14  # the machine file lacks what this mode needs
    POSITION_LOST = 15  # its encoder's reading jumped
    HOMING_FAILED = 16  # its own homing ended with an error, or took too long
    SETPOINT = 17  # it does not take a set-point of profile position
    RUNAWAY = 18  # it accelerates against the torque that is to hold it


@dataclass(frozen=True)
class Setpoints:
    """What the executor asks of a bus's drives; shape (n,) each.

    Attributes:
        mode: values of `DriveMode`.
        position, velocity: [m, rad; per second].
        torque: [N·m]; in torque mode the command, in position mode what the motion needs by the model of the
            machine (feed-forward), 0 where nobody knows that.
        goal: where the motion under way ends [m, rad], for drives that make their profiles themselves; NaN:
            the axis is to come to rest where it is. goal_speed: on the way there, at most [per second].
    """

    mode: NDArray[np.int8]
    position: Array
    velocity: Array
    torque: Array
    goal: Array
    goal_speed: Array

    @classmethod
    def of(cls, count: int) -> Setpoints:
        """Everything off and zero, and without a goal."""
        mode = np.full(count, DriveMode.OFF, np.int8)
        goal = np.full(count, np.nan)
        return cls(mode, np.zeros(count), np.zeros(count), np.zeros(count), goal, np.zeros(count))


@dataclass(frozen=True)
class Feedback:
    """What a bus's drives last reported; shape (n,) each.

    Attributes:
        position, velocity: of the encoder [m, rad; per second].
        torque: [N·m].
        state: values of `DriveState`. fault: values of `DriveFault`. detail: the vendor's or the standard's
            number for that fault, such as an emergency message's code; 0 where it has no number.
        fresh: whether the drive has answered in this cycle; where not, the other values are old.
        inputs: of the drive, bits as in 60FDh: `HOME_SWITCH`. switch_at: where the home switch last changed
            [m, rad], NaN where the drive does not latch that.
        indices: counts the passages of the encoder's index. index_at: where the last one was [m, rad].
    """

    position: Array
    velocity: Array
    torque: Array
    state: NDArray[np.int8]
    fault: NDArray[np.int32]
    fresh: NDArray[np.bool_]
    detail: NDArray[np.int32]
    inputs: NDArray[np.int32]
    switch_at: Array
    indices: NDArray[np.int64]
    index_at: Array

    @classmethod
    def of(cls, count: int) -> Feedback:
        """Everything off, at zero, answered."""
        return cls(
            np.zeros(count),
            np.zeros(count),
            np.zeros(count),
            np.zeros(count, np.int8),
            np.zeros(count, np.int32),
            np.ones(count, np.bool_),
            np.zeros(count, np.int32),
            np.zeros(count, np.int32),
            np.full(count, np.nan),
            np.zeros(count, np.int64),
            np.full(count, np.nan),
        )


@dataclass(frozen=True)
class Foreseen:
    """Exchanges of a simulated bus that have been computed ahead.

    Attributes:
        actual: readings of the encoders after each, shape (m, n) [m or rad]. state: the bus's own, after the
            last.
    """

    actual: Array
    state: Array


@runtime_checkable
class ForeseeingBus(Protocol):
    """A bus of simulated drives that can compute many exchanges in one go, to the same effect."""

    @property
    def foreseeable(self) -> bool:
        """Whether every axis follows its setpoints or stands, and nothing changes by itself."""

    def foresee(self, position: Array, velocity: Array) -> Foreseen:
        """Compute exchanges up to the first in which a drive reaches a limit of its own.

        Args:
            position, velocity: setpoints, shape (m, n).
        """

    def arrive(self, foreseen: Foreseen) -> None:
        """Let these exchanges have happened, all of them."""


@runtime_checkable
class UnclockedBus(Protocol):
    """A bus of simulated drives, whose time passes by exchanges alone."""

    def stall(self, cycles: int) -> None:
        """Let cycles pass in which drives hear nothing: they hold, and at their time-outs switch off."""


@runtime_checkable
class ClockedBus(Protocol):
    """A bus whose devices may have a clock of their own, which the cycle has to follow."""

    @property
    def clock_error_ns(self) -> int | None:
        """How late the latest cycle was by that clock; None: there is none."""


class BusEventKind(enum.IntEnum):
    """What a `BusEvent` is about."""

    MESSAGE = 0  # an emergency message that latches nothing new; code 0: the drive's error is gone
    BUS_BACK = 1  # a bus that was away is there again


@dataclass(frozen=True)
class BusEvent:
    """Something that a bus has to say besides the feedback; what stops an axis is in the feedback.

    Attributes:
        column: which axis of the machine; the first one of the bus where all are meant.
        code: the vendor's or the standard's number, 0 where it has no number.
    """

    column: int
    code: int
    text: str
    kind: BusEventKind = BusEventKind.MESSAGE


class DriveBus(Protocol):
    """Drives that are exchanged with together."""

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the machine that this bus drives, ascending."""

    @property
    def follows_exactly(self) -> bool:
        """Whether actual = setpoint in the same exchange and energizing takes no cycle (``ideal``)."""

    @property
    def delay_cycles(self) -> int:
        """How many cycles a drive that follows without error is behind its setpoint in the feedback.

        A bus that has such a delay reports drives that are silent as faults of theirs.
        """

    def boot(self) -> Feedback:
        """Bring the drives up, not energized; return the feedback's arrays with the encoders' readings.

        Raises:
            RuntimeFault: a drive that does not answer.
        """

    def exchange(self, setpoints: Setpoints) -> Feedback:
        """One cycle, in the realtime thread: must neither wait nor raise; returns the arrays of `boot`."""

    def events(self) -> list[BusEvent]:
        """Return what happened since the last call; bounded."""

    def close(self) -> None:
        """Leave the drives de-energized and give the bus back."""
