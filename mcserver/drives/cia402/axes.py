"""All CiA 402 axes of one bus, a cycle at a time: TPDOs in, states, RPDOs out.

Payloads lie in arenas, 7 bytes an axis for RPDO1 and TPDO1, 8 for RPDO2 and 2 for torque offsets, which
NumPy reads and writes as columns; what is per frame is one copy. States are gone through only where a
statusword, a mode or a command has changed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcserver.can.pdo_layout import RPDO1, RPDO2, Mode, rpdo1_cycles
from mcserver.can.port import CanPort
from mcserver.drives.bus import (
    Array,
    DriveFault,
    DriveMode,
    DriveState,
    Feedback,
    Setpoints,
)
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.drives.cia402.frames import OutgoingPdo, frames_of
from mcserver.drives.cia402.loops import DELAY_CYCLES, LoopFault, PositionPart, SpeedLoop, TorqueLoop
from mcserver.drives.cia402.power_stage import PowerStage
from mcserver.drives.cia402.profile_position import ProfilePosition, Refusal
from mcserver.drives.cia402.readings import AxisReadings
from mcserver.drives.cia402.scaling import TORQUE_LIMIT, Scaling, wrapped
from mcserver.drives.cia402.state import STATE_BITS, STATE_OF_BITS, Controlword
from mcserver.machine.machine_file import Axis

# Counts in `VELOCITY_CYCLES` at which a motor counts as standing.
STANDING_COUNTS = 2
INT32 = 2.0**31 - 1.0

_RPDO1 = np.dtype([("controlword", "<u2"), ("mode", "i1"), ("position", "<i4")])
_RPDO2 = np.dtype([("controlword", "<u2"), ("velocity", "<i4"), ("torque", "<i2")])

# 60B2h and 60FEh:01, which are not among the usual objects
_OFFSET_BYTES, _OUTPUT_BYTES = 2, 4

# pieces of the arenas with their places in the buffer, and the prepared buffer
_Send = tuple[tuple[tuple[memoryview, slice], ...], bytearray]
# bit 4 of the controlword: interpolation on (mode 7), homing starts (mode 6)
_START = 0x0010
_WITH_START = (Mode.INTERPOLATED_POSITION, Mode.HOMING)
_BY_SPEED = (Mode.CYCLIC_VELOCITY, Mode.CYCLIC_TORQUE)


class Cia402Axes:
    """The CiA 402 axes of a bus, in the order of their columns.

    Args:
        axes: their sections. local: where each is in the arrays of the bus.

    Attributes:
        stages: one an axis. readings: what their TPDOs have brought. outputs: shape (n,), 60FEh:01.
    """

    def __init__(self, axes: Sequence[Axis], local: Sequence[int], cycle_s: float) -> None:
        count = len(axes)
        self._axes = tuple(axes)
        self._cycle = cycle_s
        self.local = tuple(local)
        # adjoining axes are a slice, which costs less
        adjoining = self.local == tuple(range(local[0], local[0] + count))
        self._where: slice | NDArray[np.intp] = (
            slice(local[0], local[0] + count) if adjoining else np.array(local, np.intp)
        )
        scales = [Scaling.of(axis) for axis in axes]
        self._counts: Array = np.array([scale.counts_per_si for scale in scales])
        self._speeds: Array = np.array([scale.velocity_per_si for scale in scales])
        self._torques: Array = np.array([scale.permille_per_nm for scale in scales])
        part = PositionPart(axes, cycle_s)
        self._part, self._speed_loop = part, SpeedLoop(axes, part)
        self._torque_loop = TorqueLoop(axes, part, self._counts)
        self._any_loop = bool((self._speed_loop.mine | self._torque_loop.mine).any())
        self._any_torque_loop = bool(self._torque_loop.mine.any())
        self._fed_forward = np.array([cia402_drive(axis).torque_offset for axis in axes])
        self._any_fed_forward = bool(self._fed_forward.any())
        self._zero: Array = np.array(
            [cia402_drive(axis).zero_offset * axis.type.si_per_unit for axis in axes]
        )
        self._frames = [frames_of(axis) for axis in axes]
        self._shows_mode = [frames.shows_mode for frames in self._frames]
        self.readings = AxisReadings(axes, self.local, self._where, self._frames, scales, self._zero, cycle_s)
        self.stages = [_stage_of(axis, cycle_s) for axis in axes]
        self._profiles = {
            index: ProfilePosition(cycle_s, sends_speed=self._frames[index].has_profile_velocity)
            for index, axis in enumerate(axes)
            if axis.profiled
        }
        self._refresh = rpdo1_cycles((cia402_drive(axis).command_timeout_ms for axis in axes), cycle_s)
        self._arrays(count)

    def _arrays(self, count: int) -> None:
        readings = self.readings
        self._came, self._all_came = readings.came, readings.all_came
        self._status, self._shown, self._position = readings.status, readings.shown, readings.counts
        self._reading = readings.position
        self._out1 = bytearray(RPDO1.packing.size * count)
        self._out2 = bytearray(RPDO2.packing.size * count)
        self._out3 = bytearray(_OFFSET_BYTES * count)
        self._out4 = bytearray(_OUTPUT_BYTES * count)
        self.outputs: NDArray[np.uint32] = np.frombuffer(self._out4, "<u4")
        first: Any = np.frombuffer(self._out1, _RPDO1)
        second: Any = np.frombuffer(self._out2, _RPDO2)
        self._controlword1, self._mode, self._target = (
            first["controlword"],
            first["mode"],
            first["position"],
        )
        self._controlword2, self._speed, self._torque = (
            second["controlword"],
            second["velocity"],
            second["torque"],
        )
        self._torque_offset: NDArray[np.int16] = np.frombuffer(self._out3, "<i2")
        self._commanded = np.zeros(count, np.int8)
        self._bits = np.zeros(count, np.uint16)
        self._key: tuple[bytes, bytes, bytes] = (b"", b"", b"")
        self._busy = True
        self._number = 0
        self._capturing = np.ones(count, np.bool_)
        self._any_capturing = True
        self._needs_speed = False
        self._states = np.zeros(count, np.int8)
        self._faults = np.zeros(count, np.int32)
        self._details = np.zeros(count, np.int32)
        self._setpoint: Array = np.zeros(count)
        self._velocity: Array = np.zeros(count)
        self._nm: Array = np.zeros(count)
        self._sends: list[list[_Send]] = [[] for _ in range(self._refresh)]

    def open(self, port: CanPort) -> None:
        """Prepare the frames."""
        self._outgoing = [
            [
                (pdo, self._pieces(index, pdo, port.payload_offset), port.prepare(pdo.cob_id, pdo.length))
                for pdo in frames.rpdos
            ]
            for index, frames in enumerate(self._frames)
        ]
        self._send = port.send_prepared

    def restart(self, index: int) -> None:
        """The drive has been switched on again: its next reading is taken as it is."""
        self.readings.restart(index)

    def _pieces(self, index: int, pdo: OutgoingPdo, offset: int) -> tuple[tuple[memoryview, slice], ...]:
        out = (self._out1, self._out2, self._out3, self._out4)
        arenas = {number: memoryview(arena) for number, arena in enumerate(out, 1)}
        starts = {
            1: index * RPDO1.packing.size,
            2: index * RPDO2.packing.size,
            3: index * _OFFSET_BYTES,
            4: index * _OUTPUT_BYTES,
        }
        return tuple(
            (
                arenas[piece.arena][starts[piece.arena] + piece.first :][: piece.length],
                slice(offset + piece.at, offset + piece.at + piece.length),
            )
            for piece in pdo.pieces
        )

    # ------------------------------------------------------------------ states and setpoints

    def step(self, setpoints: Setpoints, feedback: Feedback) -> None:
        """States, and what the RPDOs hold."""
        local = self._where
        self._commanded[:] = setpoints.mode[local]
        np.bitwise_and(self._status, STATE_BITS, out=self._bits)
        key = (self._commanded.tobytes(), self._bits.tobytes(), self._shown.tobytes())
        if self._busy or key != self._key or self._came != self._all_came:
            self._key = key
            self._step_stages(setpoints)
            feedback.state[local] = self._states
            feedback.fault[local] = self._faults
            feedback.detail[local] = self._details
        self._number += 1
        wanted = self._setpoint
        wanted[:] = setpoints.position[local]
        self._velocity[:] = setpoints.velocity[local]
        if self._any_capturing:
            self._capture(feedback)
        else:
            self._target[:] = wrapped(np.rint((wanted - self._zero) * self._counts))
        if self._needs_speed:
            self._nm[:] = setpoints.torque[local]
            self._fill_speeds()
        if self._profiles:
            self._step_profiles(setpoints)
        if self._any_fed_forward:
            self._fill_offsets(setpoints.torque[local])
        if self._any_loop:
            self._part.keep(wanted)

    def _step_profiles(self, setpoints: Setpoints) -> None:
        """Goals of axes in profile position, which the drive goes to on its own profiles."""
        for index, profile in self._profiles.items():
            stage = self.stages[index]
            if stage.mode is not Mode.PROFILE_POSITION or not stage.running or stage.capturing:
                profile.reset()
            else:
                place = self.local[index]
                goal = (float(setpoints.goal[place]) - self._zero[index]) * self._counts[index]
                speed = float(setpoints.goal_speed[place]) * abs(self._speeds[index])
                refusal = profile.step(
                    None if math.isnan(goal) else round(goal),
                    max(1, math.floor(min(speed, INT32))),
                    int(self._status[index]),
                    fresh=self._came[index] != 0,
                )
                if refusal is not None:
                    following = refusal is Refusal.FOLLOWING
                    self.fail(index, DriveFault.FOLLOWING if following else DriveFault.SETPOINT, refusal)
            if stage.mode is Mode.PROFILE_POSITION:
                enabled = stage.controlword == Controlword.ENABLE_OPERATION
                self._controlword1[index] = stage.controlword | (profile.bits if enabled else 0)
                self._controlword2[index] = self._controlword1[index]
                self._target[index] = self._position[index] if profile.target is None else profile.target
                self._speed[index] = profile.speed

    def _fill_offsets(self, torque: Array) -> None:
        """60B2h: the torque that the motion needs, while the axis follows positions; [N·m], shape (n,)."""
        follows = self._fed_forward & (self._commanded == DriveMode.POSITION) & ~self._capturing
        known = np.where(follows & np.isfinite(torque), torque, 0.0)
        self._torque_offset[:] = np.clip(np.rint(known * self._torques), -TORQUE_LIMIT, TORQUE_LIMIT)

    def _capture(self, feedback: Feedback) -> None:
        """A target is where the axis is until its loop is closed: the count itself, not a converted one.

        The target of a coasting axis is where it will be when its drive acts. That is reported, too, in the
        cycle in which it is found energized, so that the setpoints go on from there.
        """
        capturing, wanted = self._capturing, self._setpoint
        coasting = capturing & (self._velocity != 0.0) & (self._commanded >= DriveMode.POSITION)
        if coasting.any():
            led = self._reading + self._velocity * ((DELAY_CYCLES + self.readings.ages) * self._cycle)
            np.copyto(wanted, led, where=coasting)
            arrived = coasting & (self._states == DriveState.ENERGIZED)
            feedback.position[self._where] = np.where(arrived, led, self._reading)
        counts = wrapped(np.rint((wanted - self._zero) * self._counts))
        self._target[:] = np.where(capturing & ~coasting, self._position, counts)

    def _fill_speeds(self) -> None:
        velocity = self._velocity
        positioned, captured = self._commanded == DriveMode.POSITION, ~self._capturing
        torque = np.where(self._commanded == DriveMode.TORQUE, self._nm, 0.0)
        if self._any_loop:
            active = self._speed_loop.mine & positioned
            closed = self._speed_loop.step(self._setpoint, self._reading, active, captured)
            velocity = np.where(active, closed, velocity)
        if self._any_torque_loop:
            closed = self._close_torques(positioned & captured)
            torque = np.where(self._torque_loop.mine & positioned, closed, torque)
        speed = np.clip(np.rint(velocity * self._speeds), -INT32, INT32)
        permille = np.clip(np.rint(torque * self._torques), -TORQUE_LIMIT, TORQUE_LIMIT)
        speed[self._capturing] = 0.0
        permille[self._capturing] = 0.0
        self._speed[:] = speed
        self._torque[:] = permille

    def _close_torques(self, held: NDArray[np.bool_]) -> Array:
        """Torques of drives in cst [N·m]; an axis that its loop gives up is failed in this cycle."""
        loop = self._torque_loop
        ages = self.readings.ages
        torque = loop.step(self._setpoint, self._velocity, self._reading, ages, self._nm, loop.mine & held)
        if loop.faults.any():
            for index in np.flatnonzero(loop.faults).tolist():
                fault = _OF_LOOP[LoopFault(loop.faults[index])]
                self.fail(index, fault, int(ages[index]))
        return torque

    def _step_stages(self, setpoints: Setpoints) -> None:
        commanded, bits, shown = self._commanded.tolist(), self._bits.tolist(), self._shown.tolist()
        words = self._status.tolist()
        standing = (np.abs(self.readings.moved) <= STANDING_COUNTS).tolist()
        busy = False
        captured = self._any_capturing
        before = self._capturing.copy() if captured else self._capturing
        for index, stage in enumerate(self.stages):
            came = self._came[index] != 0
            state = stage.step(
                _MODES[commanded[index]],
                STATE_OF_BITS[bits[index]],
                shown[index] if self._shows_mode[index] else stage.mode,
                fresh=came,
                standing=standing[index],
                word=words[index],
            )
            self._states[index] = state
            self._faults[index] = stage.fault
            self._details[index] = stage.detail
            command = stage.controlword
            if stage.running and stage.mode in _WITH_START and stage.started:
                command |= _START
            self._controlword1[index] = self._controlword2[index] = command
            self._mode[index] = stage.mode
            self._capturing[index] = stage.capturing
            busy = busy or not stage.settled
        self._busy = busy
        self._any_capturing = bool(self._capturing.any())
        if self._any_loop and (before & ~self._capturing).any():
            # the loops of axes that have just been captured begin without an error
            started = before & ~self._capturing
            self._part.begin(started, setpoints.position[self._where], setpoints.velocity[self._where])
        self._plan_sends()

    def fail(self, index: int, fault: DriveFault, detail: int = 0) -> bool:
        """Latch a fault of an axis; False: nothing new was latched."""
        if self.stages[index].fail(fault, detail):
            self._busy = True
            return True
        return False

    # ------------------------------------------------------------------ what goes out

    def _plan_sends(self) -> None:
        """Which frames go out, by cycle: RPDO1 in position mode, else RPDO2 and now and then RPDO1."""
        sends: list[list[_Send]] = [[] for _ in range(self._refresh)]
        self._needs_speed = False
        for index, stage in enumerate(self.stages):
            if stage.commanded is DriveMode.SILENT:
                continue
            by_speed = stage.commanded >= DriveMode.POSITION and stage.mode in _BY_SPEED
            both = stage.changing or (by_speed and stage.capturing)
            for number, frames in enumerate(sends):
                positions = not by_speed or both or number == index % self._refresh
                for pdo, pieces, buffer in self._outgoing[index]:
                    if (pdo.by_position and positions) or (pdo.by_speed and (by_speed or both)):
                        frames.append((pieces, buffer))
            self._needs_speed = self._needs_speed or by_speed or both
        self._sends = sends

    def send(self) -> int:
        """Send the RPDOs of this cycle; returns how many found no room."""
        lost = 0
        send = self._send
        for pieces, buffer in self._sends[self._number % self._refresh]:
            for payload, where in pieces:
                buffer[where] = payload
            if not send(buffer):
                lost += 1
        return lost

    def silence(self) -> None:
        """All axes off: the last frames of a bus that is being closed."""
        self._commanded[:] = DriveMode.OFF
        self._controlword1[:] = 0
        self._controlword2[:] = 0
        for stage in self.stages:
            stage.step(DriveMode.OFF, STATE_OF_BITS[0x40], stage.mode, fresh=True, standing=True)
        self._plan_sends()


_MODES = tuple(DriveMode)


def _stage_of(axis: Axis, cycle_s: float) -> PowerStage:
    drive = cia402_drive(axis)
    base = _BASE_MODES[drive.mode]
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


_BASE_MODES = {
    "csp": Mode.CYCLIC_POSITION,
    "csv": Mode.CYCLIC_VELOCITY,
    "ip": Mode.INTERPOLATED_POSITION,
    "pp": Mode.PROFILE_POSITION,
    "cst": Mode.CYCLIC_TORQUE,
}
_OF_LOOP = {
    LoopFault.BLIND: DriveFault.COMMUNICATION,
    LoopFault.FOLLOWING: DriveFault.FOLLOWING,
    LoopFault.RUNAWAY: DriveFault.RUNAWAY,
}
