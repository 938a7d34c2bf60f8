"""Position loops that are closed here, in the master: onto speeds (csv) and onto torques (cst).

A reading belongs to the setpoint of some cycles ago (`DELAY_CYCLES` on CAN), so that an axis which follows
has no error at any speed. Both loops share the proportional and integral part [1/s · m or rad]; the speed
loop adds the setpoint's own velocity, the torque loop the damping and the torque that the motion needs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.drives.bus import Array, DriveFault
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.drives.cia402.loop_gains import DELAY_CYCLES
from mcserver.machine.axis import Axis

Mask = NDArray[np.bool_]

# Cycles over which the velocity of the error is taken: fewer show more of the encoder's steps, more cost
# phase.
DAMPING_CYCLES = 4
# A speed loop may ask for so much more than the axis's greatest velocity.
SPEED_MARGIN = 1.2
# So many cycles in a row an axis in torque mode may be without a reading, whatever `silence_cycles` is: the
# torque of an open loop accelerates.
BLIND_CYCLES = 10
# An axis runs away when for so many cycles its loop has pulled back with this share of the greatest torque,
# and it still accelerates the other way by more than so many of the encoder's steps.
AGAINST_CYCLES = 5
AGAINST_SHARE = 0.8
AGAINST_COUNTS = 3.0


class PositionPart:
    """Proportional and integral part of n loops, and the setpoints of the cycles before.

    Args:
        axes: of CiA 402 drives, all of a bus; those without a loop stay at 0.
        delay: of a reading behind its setpoint [cycles].
    """

    def __init__(self, axes: Sequence[Axis], cycle_s: float, delay: int = DELAY_CYCLES) -> None:
        count = len(axes)
        self.cycle = cycle_s
        self.delay = delay
        self._gain: Array = np.array([cia402_drive(axis).position_gain for axis in axes])
        times = [cia402_drive(axis).integral_time_s or 0.0 for axis in axes]
        self._integral_gain: Array = np.array([cycle_s / time if time > 0.0 else 0.0 for time in times])
        self._integrates = bool(self._integral_gain.any())
        self.integral: Array = np.zeros(count)
        self._earlier: Array = np.zeros((delay + 1, count))
        self._number = 0

    def begin(self, started: Mask, setpoint: Array, velocity: Array) -> None:
        """Start loops without an error, from setpoints that move with their velocity."""
        for back in range(self.delay + 1):
            row = self._earlier[(self._number - 1 - back) % (self.delay + 1)]
            row[started] = (setpoint - velocity * (self.cycle * (back + 1)))[started]
        self.integral[started] = 0.0

    def before(self, cycles: int) -> Array:
        """Return the setpoints of 1 … `delay` cycles before the present one."""
        row: Array = self._earlier[(self._number - cycles) % (self.delay + 1)]
        return row

    def proportional(self, error: Array) -> Array:
        return self._gain * error

    def integrate(self, proportional: Array, free: Mask, held: Mask) -> None:
        """Go on with the integrals that are `free`; those that are not `held` at all are 0."""
        if self._integrates:
            self.integral += np.where(free, self._integral_gain * proportional, 0.0)
        self.integral[~held] = 0.0

    def keep(self, setpoint: Array) -> None:
        """End a cycle."""
        self._earlier[self._number % (self.delay + 1)] = setpoint
        self._number += 1


class SpeedLoop:
    """Speeds of drives whose position loop is closed here (csv): PI of the error, and the setpoint's own
    velocity.

    Args:
        part: of the same axes.
    """

    def __init__(self, axes: Sequence[Axis], part: PositionPart) -> None:
        self._part = part
        self.mine: Mask = np.array([cia402_drive(axis).mode == "csv" for axis in axes])
        self._feed_forward: Array = np.array([cia402_drive(axis).velocity_feed_forward for axis in axes])
        self._limit: Array = np.array([axis.max_velocity for axis in axes]) * SPEED_MARGIN

    def step(self, setpoint: Array, reading: Array, active: Mask, captured: Mask) -> Array:
        """Return speeds [m/s, rad/s], of use where `active`.

        The integral stands still while the speed is at its limit (anti-windup), and is 0 where not
        `captured`.
        """
        part = self._part
        followed = (setpoint - part.before(1)) / part.cycle
        error = part.proportional(part.before(part.delay) - reading)
        raw = self._feed_forward * followed + error + part.integral
        closed: Array = np.clip(raw, -self._limit, self._limit)
        held = active & captured
        part.integrate(error, held & ((raw == closed) | (raw * error < 0.0)), held | ~self.mine)
        return closed


class TorqueLoop:
    """Torques of drives that take nothing else from here (cst), [N·m] at the motor's shaft.

    torque = feed-forward + velocity gain · (PI of the position error + the error's own velocity), within
    `max_torque`, or the rated torque. The feed-forward is the model's where the machine has one, else
    inertia · acceleration of the setpoints. While a TPDO is missing the axis is taken to go on with its
    velocity.

    Args:
        part: of the same axes.

    Attributes:
        faults: shape (n,), values of `DriveFault`, for which the latest step gives axes up.
    """

    def __init__(self, axes: Sequence[Axis], part: PositionPart, counts_per_si: Array) -> None:
        count = len(axes)
        drives = [cia402_drive(axis) for axis in axes]
        self._part = part
        self.mine: Mask = np.array([cia402_drive(axis).mode == "cst" for axis in axes])
        # angle of the motor's shaft by travel of the axis
        self._motor: Array = np.array([2.0 * math.pi / axis.travel_per_motor_turn for axis in axes])
        self._gain: Array = np.array([drive.velocity_gain for drive in drives]) * self._motor
        inertia = np.array([drive.inertia for drive in drives])
        self._modelled: Mask = np.array([drive.torque_feed_forward for drive in drives])
        self._inertia: Array = np.where(self._modelled, 0.0, inertia) * self._motor
        self._limit: Array = np.array([drive.max_torque or drive.rated_torque for drive in drives])
        self._following: Array = np.array([axis.max_following_error for axis in axes])
        self._noise: Array = AGAINST_COUNTS / np.abs(counts_per_si) / (DAMPING_CYCLES * part.cycle)
        self._active = np.zeros(count, np.bool_)
        self._estimate: Array = np.zeros(count)
        self._errors: Array = np.zeros((DAMPING_CYCLES, count))
        self._readings: Array = np.zeros((DAMPING_CYCLES, count))
        self._rates: Array = np.zeros((DAMPING_CYCLES, count))
        self._rate: Array = np.zeros(count)
        self._number = 0
        self._against = np.zeros(count, np.int64)
        self.faults = np.zeros(count, np.int8)

    def step(
        self,
        setpoint: Array,
        velocity: Array,
        reading: Array,
        ages: NDArray[np.int64],
        model: Array,
        active: Mask,
    ) -> Array:
        """Return torques, 0 where not `active` or given up; `faults` says why.

        Args:
            velocity: of the setpoints, for loops that start. ages: cycles since each reading came.
            model: torques that the motion needs by the machine's model.
        """
        part, cycle = self._part, self._part.cycle
        fresh = ages == 0
        np.copyto(self._estimate, self._estimate + self._rate * cycle, where=~fresh)
        np.copyto(self._estimate, reading, where=fresh)
        started = active & ~self._active
        self._active = active.copy()
        if started.any():
            part.begin(started, setpoint, velocity)
            self._begin(started, velocity)
        error = part.before(part.delay) - self._estimate
        place = self._number % DAMPING_CYCLES
        span = DAMPING_CYCLES * cycle
        moving_off = (error - self._errors[place]) / span
        if started.any():
            moving_off[started] = 0.0
            self._errors[:, started] = error[started]
        self._rate = (self._estimate - self._readings[place]) / span
        if started.any():
            self._rate[started] = velocity[started]
        proportional = part.proportional(error)
        pull = self._gain * (proportional + moving_off)
        acceleration = (setpoint - 2.0 * part.before(1) + part.before(2)) / (cycle * cycle)
        known = np.where(self._modelled, np.nan_to_num(model, nan=0.0), self._inertia * acceleration)
        raw = known + pull + self._gain * part.integral
        torque: Array = np.clip(raw, -self._limit, self._limit)
        part.integrate(
            proportional, active & fresh & ((raw == torque) | (raw * error < 0.0)), active | ~self.mine
        )
        self._judge(error, moving_off, pull, ages, active)
        self._errors[place] = error
        self._readings[place] = self._estimate
        self._rates[place] = self._rate
        self._number += 1
        torque[~active | (self.faults != DriveFault.NONE)] = 0.0
        return torque

    def _begin(self, started: Mask, velocity: Array) -> None:
        for back in range(DAMPING_CYCLES):
            place = (self._number - 1 - back) % DAMPING_CYCLES
            passed = velocity * (self._part.cycle * (back + 1))
            self._readings[place][started] = (self._estimate - passed)[started]
            self._rates[place][started] = velocity[started]
        self._against[started] = 0

    def _judge(
        self, error: Array, moving_off: Array, pull: Array, ages: NDArray[np.int64], active: Mask
    ) -> None:
        """Find axes whose torque must end in this very cycle."""
        way = np.sign(pull)
        gained = (self._rate - self._rates[self._number % DAMPING_CYCLES]) * way
        against = (
            (np.abs(pull) >= AGAINST_SHARE * self._limit) & (moving_off * way > 0.0) & (gained < -self._noise)
        )
        self._against = np.where(active & against, self._against + (ages == 0), 0)
        self.faults[:] = DriveFault.NONE
        if (self._against >= AGAINST_CYCLES).any():
            self.faults[self._against >= AGAINST_CYCLES] = DriveFault.RUNAWAY
        # NaN fails this comparison, too: a reading that is not a number ends the torque
        self.faults[active & ~(np.abs(error) <= self._following)] = DriveFault.FOLLOWING
        self.faults[active & (ages >= BLIND_CYCLES)] = DriveFault.COMMUNICATION


class ControlLoops:
    """The loops of n axes that are closed here: of positions with speeds (csv), and with torques (cst).

    Attributes:
        any: whether an axis has one.
    """

    def __init__(
        self, axes: Sequence[Axis], cycle_s: float, counts_per_si: Array, delay: int = DELAY_CYCLES
    ) -> None:
        self._part = PositionPart(axes, cycle_s, delay)
        self._speed = SpeedLoop(axes, self._part)
        self._torque = TorqueLoop(axes, self._part, counts_per_si)
        self.any = bool((self._speed.mine | self._torque.mine).any())
        self._any_torque = bool(self._torque.mine.any())

    def begin(self, captured: Mask, setpoint: Array, velocity: Array) -> None:
        """Start the loops of axes that have just been captured, without an error."""
        if self.any and captured.any():
            self._part.begin(captured, setpoint, velocity)

    def keep(self, setpoint: Array) -> None:
        """End a cycle."""
        if self.any:
            self._part.keep(setpoint)

    def speeds(
        self, setpoint: Array, velocity: Array, reading: Array, positioned: Mask, captured: Mask
    ) -> Array:
        """Return the velocities that are commanded [m/s, rad/s], shape (n,)."""
        if not self.any:
            return velocity
        active = self._speed.mine & positioned
        return np.where(active, self._speed.step(setpoint, reading, active, captured), velocity)

    def torques(
        self,
        setpoint: Array,
        velocity: Array,
        reading: Array,
        ages: NDArray[np.int64],
        torque: Array,
        positioned: Mask,
        captured: Mask,
    ) -> tuple[Array, list[tuple[int, DriveFault]]]:
        """Return the torques of positioned axes [N·m], shape (n,), and the axes that their loops give up.

        Args:
            torque: that the motion needs.
        """
        loop = self._torque
        if not self._any_torque:
            return np.zeros(len(setpoint)), []
        held = loop.mine & positioned & captured
        closed = loop.step(setpoint, velocity, reading, ages, torque, held)
        given_up = [(index, DriveFault(loop.faults[index])) for index in np.flatnonzero(loop.faults).tolist()]
        return np.where(loop.mine & positioned, closed, 0.0), given_up
