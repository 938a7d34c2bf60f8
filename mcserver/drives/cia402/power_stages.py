"""The power stages of all CiA 402 axes of one bus, gone through only where something has changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.can.pdo_layout import Mode
from mcserver.drives.bus import DriveFault, DriveMode, Feedback
from mcserver.drives.cia402.drive import BASE_MODES, cia402_drive
from mcserver.drives.cia402.frames import AxisFrames
from mcserver.drives.cia402.power_stage import PowerStage
from mcserver.drives.cia402.readings import AxisReadings
from mcserver.drives.cia402.state import STATE_BITS, STATE_OF_BITS
from mcserver.machine.axis import Axis

# Counts in `VELOCITY_CYCLES` at which a motor counts as standing.
STANDING_COUNTS = 2


class PowerStages:
    """A power stage for each of n axes.

    Args:
        frames: of the axes. readings: what their TPDOs bring.

    Attributes:
        commanded: shape (n,), `DriveMode` of each. states: shape (n,), `DriveState`.
        capturing: shape (n,), the target of an axis is where it is, until its loop is closed; captured: those
            for which that has ended in the latest step. any_capturing: there are some.
    """

    def __init__(
        self, axes: Sequence[Axis], frames: Sequence[AxisFrames], readings: AxisReadings, cycle_s: float
    ) -> None:
        count = len(axes)
        self._stages = [_stage_of(axis, cycle_s) for axis in axes]
        self._shows_mode = [each.shows_mode for each in frames]
        self._readings = readings
        self._bits = np.zeros(count, np.uint16)
        self._key: tuple[bytes, bytes, bytes] = (b"", b"", b"")
        self._busy = True
        self._faults = np.zeros(count, np.int32)
        self._details = np.zeros(count, np.int32)
        self.commanded = np.zeros(count, np.int8)
        self.states = np.zeros(count, np.int8)
        self.capturing = np.ones(count, np.bool_)
        self.captured = np.zeros(count, np.bool_)
        self.any_capturing = True

    def __iter__(self) -> Iterator[PowerStage]:
        return iter(self._stages)

    def __getitem__(self, index: int) -> PowerStage:
        return self._stages[index]

    def __len__(self) -> int:
        return len(self._stages)

    def step(self, commanded: NDArray[np.int8]) -> bool:
        """Take the modes that are commanded, shape (n,); return whether anything may have changed."""
        readings = self._readings
        self.commanded[:] = commanded
        np.bitwise_and(readings.status, STATE_BITS, out=self._bits)
        key = (self.commanded.tobytes(), self._bits.tobytes(), readings.shown.tobytes())
        if not self._busy and key == self._key and readings.came == readings.all_came:
            return False
        self._key = key
        self._step_each()
        return True

    def report(self, feedback: Feedback, where: slice | NDArray[np.intp]) -> None:
        """Fill in states and faults; ``where``: the axes in the arrays of the bus."""
        feedback.state[where] = self.states
        feedback.fault[where] = self._faults
        feedback.detail[where] = self._details

    def fail(self, index: int, fault: DriveFault, detail: int = 0) -> bool:
        """Latch a fault of an axis; False: nothing new was latched."""
        if self._stages[index].fail(fault, detail):
            self._busy = True
            return True
        return False

    def silence(self) -> None:
        """Switch all axes off."""
        self.commanded[:] = DriveMode.OFF
        for stage in self._stages:
            stage.step(DriveMode.OFF, STATE_OF_BITS[0x40], stage.mode, fresh=True, standing=True)

    def _step_each(self) -> None:
        readings = self._readings
        commanded, bits, shown = self.commanded.tolist(), self._bits.tolist(), readings.shown.tolist()
        words = readings.status.tolist()
        standing = (np.abs(readings.moved) <= STANDING_COUNTS).tolist()
        before = self.capturing.copy()
        busy = False
        for index, stage in enumerate(self._stages):
            self.states[index] = stage.step(
                _MODES[commanded[index]],
                STATE_OF_BITS[bits[index]],
                shown[index] if self._shows_mode[index] else stage.mode,
                fresh=readings.came[index] != 0,
                standing=standing[index],
                word=words[index],
            )
            self._faults[index] = stage.fault
            self._details[index] = stage.detail
            self.capturing[index] = stage.capturing
            busy = busy or not stage.settled
        self._busy = busy
        self.any_capturing = bool(self.capturing.any())
        np.logical_and(before, ~self.capturing, out=self.captured)


_MODES = tuple(DriveMode)


def _stage_of(axis: Axis, cycle_s: float) -> PowerStage:
    drive = cia402_drive(axis)
    base = BASE_MODES[drive.mode]
    modes = {DriveMode.POSITION: base}
    for mode, operation in (
        (DriveMode.VELOCITY, Mode.CYCLIC_VELOCITY),
        (DriveMode.TORQUE, Mode.CYCLIC_TORQUE),
        (DriveMode.HOMING, Mode.HOMING),
    ):
        if drive.has_mode(mode):
            modes[mode] = operation
    homing = drive.homing
    return PowerStage(base, modes, cycle_s, 0.0 if homing is None else homing.timeout_s)
