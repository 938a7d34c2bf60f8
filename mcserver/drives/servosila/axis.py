"""One Servosila drive: a command streamed in every cycle, telemetry taken as it comes.

The drive reports no state but its fault bits, so an axis counts as energized once a few commands have been
streamed to a drive that answers and has no fault. After a fault only Reset counts. Reset takes the work zone
back to its first turn: with an incremental encoder the count becomes 0, with an absolute one the place within
the turn stays. The count is read again after it, never assumed, and the axis stays where it was on its own
scale.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from mcserver.can.port import CanPort
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.drives.cia402.scaling import Scaling
from mcserver.drives.servosila.codec import (
    COMMAND,
    COMMAND_PACKING,
    LENGTH,
    POSITION,
    STATUS,
    unpack_reading,
    unpack_status,
)
from mcserver.drives.servosila.drive import ServosilaDrive
from mcserver.drives.streamed import StreamedAxis
from mcserver.machine.axis import Axis
from mcserver.units import MINUTE

# A telemetry frame that comes so many cycles after a command may be an answer to it.
ANSWER_CYCLES = 3
# Electrical speed below which a motor stands [Hz].
STANDING_HZ = 0.5
# A reading further from the one before than this multiple of what the axis can do is no motion; and so many
# counts are let pass in any case.
JUMP_FACTOR = 3.0
JUMP_COUNTS = 16.0
# While the drive is reset a step beyond this multiple of the latest speed is no motion.
MOTION_FACTOR = 2.0


class ServosilaAxis(StreamedAxis):
    """State of one axis."""

    def __init__(self, axis: Axis, drive: ServosilaDrive, cycle_s: float, silence_cycles: int) -> None:
        every = drive.answer_cycles(cycle_s)
        super().__init__(axis, every - 1 + silence_cycles)
        self._allowed = every - 1
        scaling = Scaling.of(axis)
        self._node = drive.node
        self._cycle = cycle_s
        self._counts = scaling.counts_per_si
        self._codes = drive.codes
        sign = -1.0 if drive.invert else 1.0
        # motor turns a second, by axis speed
        self._turns = sign / axis.travel_per_motor_turn
        self._pole_pairs = drive.pole_pairs
        self._sign = sign
        self._torque = "torque" in drive.codes
        self._greatest = JUMP_FACTOR * axis.max_velocity * cycle_s * abs(self._counts)
        self._base = axis.initial_position
        self._buffer = bytearray()
        self._since = ANSWER_CYCLES
        self._work_zone = 0.0
        self._known = False
        self._bits = 0
        self._hertz = 0.0
        self._status_age = self._reading_age = 1 << 30
        self._gap = 0
        # cycles after a reset in which the work zone may still be seen to be zeroed
        self._zeroing = 0
        self._before = axis.initial_position

    def open(self, port: CanPort) -> dict[int, Callable[[bytes], None]]:
        self._buffer = port.prepare(COMMAND + self._node, LENGTH)
        self._at = port.payload_offset
        self._send = port.send_prepared
        return {STATUS + self._node: self.take_status, POSITION + self._node: self.take_reading}

    # ------------------------------------------------------------------ what has come

    def take_status(self, payload: bytes) -> None:
        status = unpack_status(payload)
        if status is None:
            self.short += 1
            return
        self._bits = status.fault_bits
        self._hertz = status.electrical_hz
        self._status_age = -1

    def take_reading(self, payload: bytes) -> None:
        reading = unpack_reading(payload)
        if reading is None or not math.isfinite(reading.work_zone):
            self.short += 1
            return
        count = reading.work_zone
        step = count - self._work_zone
        elapsed = max(1, self._reading_age + 1)
        if self._known and self._resetting and self._is_new_zero(count, step, elapsed):
            # the shaft has not moved, its count has: what the new one shows is not assumed, but read
            self._base = self.position - count / self._counts
        elif self._known and abs(step) > self._greatest * elapsed + JUMP_COUNTS:
            self.fail(DriveFault.POSITION_LOST)
        self._work_zone = count
        self._known = True
        self._reading_age = -1
        self.position = self._base + count / self._counts

    def _is_new_zero(self, count: float, step: float, elapsed: int) -> bool:
        """Tell a work zone that Reset took back to its first turn from a shaft that moves on."""
        travelled = MOTION_FACTOR * abs(self.velocity * self._counts) * self._cycle * elapsed
        return abs(count) < abs(step) and (abs(step) > travelled + JUMP_COUNTS or count == 0.0)

    @property
    def _resetting(self) -> bool:
        return self._commanded is DriveMode.RESET or self._zeroing > 0

    @property
    def booted(self) -> bool:
        return self._known and self._status_age <= self._allowed

    def read(self) -> None:
        self._status_age += 1
        self._reading_age += 1
        self.age = max(self._status_age, self._reading_age)
        self.fresh = self.age <= self._allowed
        if self._pole_pairs and self.fresh:
            self.velocity = self._hertz / self._pole_pairs / self._turns
        elif self._reading_age == 0:
            self.velocity = (self.position - self._before) / (self._cycle * max(1, self._gap))
        self._gap = 1 if self._reading_age == 0 else self._gap + 1
        if self._reading_age == 0:
            self._before = self.position
        if self._zeroing:
            self._zeroing -= 1

    # ------------------------------------------------------------------ what goes out

    def step(self, commanded: DriveMode, position: float, velocity: float, torque: float) -> bool:
        """One cycle: the state, and the command; False: it found no room."""
        if commanded is not self._commanded:
            if self._commanded is DriveMode.RESET:
                self._zeroing = ANSWER_CYCLES + self._allowed
            self._commanded = commanded
            self._since = 0
        else:
            self._since += 1
        if commanded is DriveMode.SILENT:
            self.state = DriveState.OFF if self.fault is DriveFault.NONE else DriveState.FAULT
            return True
        if commanded is DriveMode.RESET:
            self._reset()
            return self._stream("reset")
        if self._bits and self._status_age <= self._allowed:
            self.fail(DriveFault.OTHER, self._bits)
        if self.fault is not DriveFault.NONE:
            self.state = DriveState.FAULT
            return self._stream("off")
        if commanded is DriveMode.STOP:
            standing = self._since >= ANSWER_CYCLES and abs(self._hertz) <= STANDING_HZ and self.fresh
            self.state = DriveState.OFF if standing else DriveState.STOPPING
            return self._stream("stop")
        if commanded is DriveMode.OFF:
            self.state = DriveState.OFF
            return self._stream("off")
        started = self.state is DriveState.ENERGIZED
        if not started:
            answered = self._since >= ANSWER_CYCLES + self._allowed and self.fresh
            self.state = DriveState.ENERGIZED if answered else DriveState.STARTING
        return self._drive(commanded, started, position, velocity, torque)

    def _reset(self) -> None:
        if self.fresh and self._since >= ANSWER_CYCLES + self._allowed and not self._bits:
            self.fault, self.detail = DriveFault.NONE, 0
            self.state = DriveState.OFF
            return
        self.state = DriveState.FAULT if self.fault is not DriveFault.NONE else DriveState.STOPPING

    def _drive(
        self, commanded: DriveMode, started: bool, position: float, velocity: float, torque: float
    ) -> bool:
        if commanded is DriveMode.POSITION:
            # until the axis counts as energized its target is where it is
            counts = (position - self._base) * self._counts if started else self._work_zone
            return self._stream("servo", counts)
        if commanded is DriveMode.VELOCITY:
            turns = velocity * self._turns if started else 0.0
            if "rpm" in self._codes:
                return self._stream("rpm", turns * MINUTE)
            if self._pole_pairs:
                return self._stream("speed", turns * self._pole_pairs)
        elif self._torque:
            return self._stream("torque", torque * self._sign if started else 0.0)
        self.fail(DriveFault.NOT_CONFIGURED, int(commanded))
        self.state = DriveState.FAULT
        return self._stream("off")

    def _stream(self, command: str, value: float = 0.0) -> bool:
        COMMAND_PACKING.pack_into(self._buffer, self._at, self._codes[command], value)
        return self._send(self._buffer)
