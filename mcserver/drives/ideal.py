"""Drives without inertia: the encoder shows the setpoint in the same exchange."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcserver.drives.bus import BusEvent, DriveMode, DriveState, Feedback, Setpoints
from mcserver.drives.simulated_marks import SimulatedMarks
from mcserver.machine.axis import Axis

_STATE_OF_MODE = np.array(
    [
        DriveState.OFF,
        DriveState.OFF,
        DriveState.OFF,
        DriveState.OFF,
        DriveState.ENERGIZED,
        DriveState.ENERGIZED,
        DriveState.ENERGIZED,
        DriveState.HOMED,
    ],
    np.int8,
)


class IdealBus:
    """actual = setpoint where the drive is energized in position or velocity mode; else the axis stands
    still.

    In torque mode an axis has no setpoint to be at: it stands, and shows the torque. Commanded to home
    by itself, it is at home where it stands.
    """

    follows_exactly = True
    delay_cycles = 0

    def __init__(self, axes: Sequence[Axis], columns: Sequence[int]) -> None:
        self.columns = tuple(columns)
        self._feedback = Feedback.of(len(axes))
        self._feedback.position[:] = [axis.initial_position for axis in axes]
        self._mode = b""
        self._following = np.zeros(len(axes), np.bool_)
        self._torque = np.zeros(len(axes), np.bool_)
        self._any = False
        self._marks = SimulatedMarks(axes)
        self._marks.place(self._feedback.position, self._feedback)

    def boot(self) -> Feedback:
        return self._feedback

    def exchange(self, setpoints: Setpoints) -> Feedback:
        feedback = self._feedback
        mode = setpoints.mode.tobytes()
        if mode != self._mode:
            self._mode = mode
            feedback.state[:] = _STATE_OF_MODE[setpoints.mode]
            self._following = (setpoints.mode == DriveMode.POSITION) | (setpoints.mode == DriveMode.VELOCITY)
            self._torque = setpoints.mode == DriveMode.TORQUE
            self._any = bool((self._following | self._torque).any())
            feedback.velocity[~self._following] = 0.0
            feedback.torque[:] = 0.0
        if self._any:
            np.copyto(feedback.position, setpoints.position, where=self._following)
            np.copyto(feedback.velocity, setpoints.velocity, where=self._following)
            np.copyto(feedback.torque, setpoints.torque, where=self._torque)
        if self._marks.present:
            self._marks.pass_to(feedback.position, feedback)
        return feedback

    def events(self) -> list[BusEvent]:
        return []

    def close(self) -> None:
        """There is nothing to give back."""
