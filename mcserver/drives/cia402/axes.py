"""All CiA 402 axes of one bus, a cycle at a time: TPDOs in, states, RPDOs out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.can.pdo_layout import Mode, rpdo1_cycles
from mcserver.drives.bus import Array, DriveFault, DriveMode, DriveState, Feedback, Setpoints
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.drives.cia402.frames import frames_of
from mcserver.drives.cia402.loop_gains import DELAY_CYCLES
from mcserver.drives.cia402.loops import ControlLoops
from mcserver.drives.cia402.power_stages import PowerStages
from mcserver.drives.cia402.profile_position import ProfilePosition, Refusal
from mcserver.drives.cia402.readings import AxisReadings
from mcserver.drives.cia402.rpdos import Rpdos
from mcserver.drives.cia402.scaling import TORQUE_LIMIT, Scaling, wrapped
from mcserver.drives.cia402.state import Controlword
from mcserver.machine.axis import Axis

INT32 = 2.0**31 - 1.0


class Cia402Axes:
    """The CiA 402 axes of a bus, in the order of their columns.

    Args:
        axes: their sections. local: where each is in the arrays of the bus.
        delay: of a reading behind its setpoint [cycles].

    Attributes:
        readings: what their TPDOs have brought. stages: their states. rpdos: what goes out.
    """

    def __init__(
        self, axes: Sequence[Axis], local: Sequence[int], cycle_s: float, delay: int = DELAY_CYCLES
    ) -> None:
        count = len(axes)
        self._delay = delay
        drives = [cia402_drive(axis) for axis in axes]
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
        zeros = [drive.zero_offset * axis.type.si_per_unit for drive, axis in zip(drives, axes, strict=True)]
        self._zero: Array = np.array(zeros)
        frames = [frames_of(axis) for axis in axes]
        self.readings = AxisReadings(axes, self.local, self._where, frames, scales, self._zero, cycle_s)
        self.stages = PowerStages(axes, frames, self.readings, cycle_s)
        self.rpdos = Rpdos(frames, rpdo1_cycles((drive.command_timeout_ms for drive in drives), cycle_s))
        self._loops = ControlLoops(axes, cycle_s, self._counts, delay)
        self._fed_forward = np.array([drive.torque_offset for drive in drives])
        self._any_fed_forward = bool(self._fed_forward.any())
        self._profiles = {
            index: ProfilePosition(cycle_s, sends_speed=frames[index].has_profile_velocity)
            for index, drive in enumerate(drives)
            if drive.profiled
        }
        self._setpoint: Array = np.zeros(count)
        self._velocity: Array = np.zeros(count)

    def restart(self, index: int) -> None:
        """The drive has been switched on again: its next reading is taken as it is."""
        self.readings.restart(index)

    def step(self, setpoints: Setpoints, feedback: Feedback) -> None:
        """States, and what the RPDOs hold."""
        local, stages = self._where, self.stages
        wanted = self._setpoint
        wanted[:] = setpoints.position[local]
        self._velocity[:] = setpoints.velocity[local]
        if stages.step(setpoints.mode[local]):
            stages.report(feedback, local)
            self._loops.begin(stages.captured, wanted, self._velocity)
            self.rpdos.command(stages)
        self.rpdos.next_cycle()
        if stages.any_capturing:
            self._capture(feedback)
        else:
            self.rpdos.target[:] = wrapped(np.rint((wanted - self._zero) * self._counts))
        if self.rpdos.needs_speed:
            self._fill_speeds(setpoints.torque[local])
        if self._profiles:
            self._step_profiles(setpoints)
        if self._any_fed_forward:
            self._fill_offsets(setpoints.torque[local])
        self._loops.keep(wanted)

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
                    int(self.readings.status[index]),
                    fresh=self.readings.came[index] != 0,
                )
                if refusal is not None:
                    following = refusal is Refusal.FOLLOWING
                    self.fail(index, DriveFault.FOLLOWING if following else DriveFault.SETPOINT, refusal)
            if stage.mode is Mode.PROFILE_POSITION:
                enabled = stage.controlword == Controlword.ENABLE_OPERATION
                rpdos = self.rpdos
                rpdos.set_controlword(index, stage.controlword | (profile.bits if enabled else 0))
                reached = self.readings.counts[index]
                rpdos.target[index] = reached if profile.target is None else profile.target
                rpdos.speed[index] = profile.speed

    def _fill_offsets(self, torque: Array) -> None:
        """60B2h: the torque that the motion needs, while the axis follows positions; [N·m], shape (n,)."""
        follows = self._fed_forward & (self.stages.commanded == DriveMode.POSITION) & ~self.stages.capturing
        known = np.where(follows & np.isfinite(torque), torque, 0.0)
        self.rpdos.torque_offset[:] = np.clip(np.rint(known * self._torques), -TORQUE_LIMIT, TORQUE_LIMIT)

    def _capture(self, feedback: Feedback) -> None:
        """A target is where the axis is until its loop is closed: the count itself, not a converted one.

        The target of a coasting axis is where it will be when its drive acts. That is reported, too, in the
        cycle in which it is found energized, so that the setpoints go on from there.
        """
        stages, readings, wanted = self.stages, self.readings, self._setpoint
        capturing = stages.capturing
        coasting = capturing & (self._velocity != 0.0) & (stages.commanded >= DriveMode.POSITION)
        if coasting.any():
            led = readings.position + self._velocity * ((self._delay + readings.ages) * self._cycle)
            np.copyto(wanted, led, where=coasting)
            arrived = coasting & (stages.states == DriveState.ENERGIZED)
            feedback.position[self._where] = np.where(arrived, led, readings.position)
        counts = wrapped(np.rint((wanted - self._zero) * self._counts))
        self.rpdos.target[:] = np.where(capturing & ~coasting, readings.counts, counts)

    def _fill_speeds(self, needed: Array) -> None:
        """60FFh and 6071h; ``needed``: torques that are commanded, or that the motion needs [N·m]."""
        stages, reading, ages = self.stages, self.readings.position, self.readings.ages
        positioned, captured = stages.commanded == DriveMode.POSITION, ~stages.capturing
        motion = self._setpoint, self._velocity, reading
        velocity = self._loops.speeds(*motion, positioned, captured)
        closed, given_up = self._loops.torques(*motion, ages, needed, positioned, captured)
        for index, fault in given_up:
            # its loop gives an axis up in this cycle
            self.fail(index, fault, int(ages[index]))
        torque = np.where(stages.commanded == DriveMode.TORQUE, needed, closed)
        speed = np.clip(np.rint(velocity * self._speeds), -INT32, INT32)
        permille = np.clip(np.rint(torque * self._torques), -TORQUE_LIMIT, TORQUE_LIMIT)
        speed[stages.capturing] = 0.0
        permille[stages.capturing] = 0.0
        self.rpdos.speed[:] = speed
        self.rpdos.torque[:] = permille

    def fail(self, index: int, fault: DriveFault, detail: int = 0) -> bool:
        """Latch a fault of an axis; False: nothing new was latched."""
        return self.stages.fail(index, fault, detail)

    def silence(self) -> None:
        """All axes off: the last frames of a bus that is being closed."""
        self.stages.silence()
        for index in range(len(self.stages)):
            self.rpdos.set_controlword(index, 0)
        self.rpdos.plan(self.stages)
