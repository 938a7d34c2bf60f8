"""A threading pass: axes move along a line synchronized to the spindle (D-89).

The barrier waits until the spindle is at speed and at the angle where the pass begins; then each cycle sets
the axes to the position of the cam at the measured angle. Override and feed hold do not affect a pass: a hold
takes effect at its end. A spindle that cannot be followed is a fault, which stops the axes.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from mcserver.executor.barriers import Barrier
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import Control
from mcserver.executor.fault_codes import BarrierFault, FaultCode
from mcserver.executor.spindle_following import FollowedTime, MeasuredPlace
from mcserver.motion.thread_cam import MOST_SPEED, least_tapping, plan_cam, stopping_turns
from mcserver.units import TURN

# Shares of S between which a spindle is at speed.
AT_SPEED = (0.9, 1.05)
# Share of S below which it has stopped.
STOPPED = 0.1
# Speed is measured over so many cycles, since an encoder's steps are coarse at low speed; a pass begins once
# the spindle has been at speed for as many.
SPEED_CYCLES = 50
# Longest time that a reversing spindle may be below `STOPPED` [s].
TURNING_S = 1.0
# Time in which the spindle has to come to speed [s].
SPEED_TIMEOUT_S = 10.0


class ThreadPass(Barrier):
    """The barrier at which u waits during a pass.

    Args:
        control: the `THREAD` entry. slot: of its program.
    """

    def __init__(self, cycle: Cycle, control: Control, slot: int) -> None:
        assert control.values is not None
        self._cycle = cycle
        self._slot = slot
        self._axes = control.axes
        columns = cycle.bank.masks.columns(control.axes)
        self._columns = np.array(columns, np.intp)
        self._start = cycle.row.ordered[self._columns].copy()
        self._target = np.array([control.values[column] for column in columns])
        travel = self._target - self._start
        self._spindle = control.channel
        self._forward = math.copysign(1.0, control.value)
        self._speed = abs(control.value)
        self._cam = plan_cam(
            [cycle.machine.axes[column] for column in columns],
            travel.tolist(),
            control.seconds,
            self._speed,
            taps=bool(control.operation),
        )
        # travel of the axes while a reversing spindle comes to rest
        self._stopping = control.seconds * stopping_turns(cycle.machine.axes[self._spindle], self._speed)
        least = 2.0 * self._cam.ramp_length
        if self._cam.taps:
            least = least_tapping(self._cam, self._stopping)
        if self._cam.speed > self._cam.greatest_speed or self._cam.length < least:
            # the axes are not where the line was planned to begin
            raise BarrierFault(FaultCode.NO_TRAJECTORY, columns[0])
        self._way = travel / self._cam.length
        self._greatest = self._speed * MOST_SPEED
        # angle at which the cam begins [turns]: the extended cruise passes the start at angle 0
        self._angle = -0.5 * self._greatest * self._cam.ramp_s
        self._tolerance = cycle.machine.dialect.thread_tolerance
        self._measured = MeasuredPlace(cycle.cycle_s)
        # time from the newest reading to the setpoint
        delayed = bool(cycle.bank.delayed[self._spindle])
        self._ahead = cycle.cycle_s * (1 + (cycle.bank.delay_cycles if delayed else 0))
        self._reversed = False
        self._standing = 0.0
        self._readings: deque[float] = deque(maxlen=SPEED_CYCLES + 1)
        self._steady = 0
        self._waited = 0.0
        self._origin = 0.0
        self._played: FollowedTime | None = None
        self._states = np.zeros((len(columns), 3))
        self._fault: BarrierFault | None = None

    @property
    def in_thread(self) -> bool:
        return self._played is not None

    def before(self, left: float, held: bool) -> float | None:
        """Let a cycle pass; all of ``left`` is left once the axes are at their targets."""
        if left <= 0.0 or self._measured.count == 0:
            # the barrier was made after this cycle's exchange, or has no reading yet
            return None
        turns, speed, acceleration = self._measured.ahead(self._ahead)
        if self._played is None:
            if held or self._steady < SPEED_CYCLES:
                return None
            passed = (turns - self._angle) % 1.0
            if passed > speed * self._cycle.cycle_s:
                return None
            self._origin = turns - passed
            self._played = FollowedTime(
                passed / self._greatest, speed / self._greatest, acceleration / self._greatest
            )
            for state, column in zip(self._states, self._columns.tolist(), strict=True):
                self._cycle.motions.follow(column, self._slot, state)
        else:
            goal = (
                (turns - self._origin) / self._greatest,
                speed / self._greatest,
                acceleration / self._greatest,
            )
            limits = self._cam.rate_limits(self._played.time)
            self._played.step(goal, limits, self._cycle.cycle_s)
            error = abs(goal[0] - self._played.time) * self._cam.speed
            if error > self._tolerance:
                self._fault = BarrierFault(FaultCode.THREAD_ERROR, self._spindle, (error, self._tolerance))
            if self._cam.taps and not self._reversed:
                self._reverse()
        return left if self._set() else None

    def _reverse(self) -> None:
        """Reverse the spindle of a tapping move in time for it to come to rest at the end of the line."""
        assert self._played is not None
        next_cycle = self._cam.speed * self._cycle.cycle_s
        if self._cam.at(self._played.time)[0] + next_cycle + self._stopping >= self._cam.length:
            self._reversed = True
            self._turn(-self._forward)

    def _turn(self, direction: float) -> None:
        self._cycle.motions.speed(self._spindle, self._slot, direction * self._speed * TURN, 0.0)

    def after(self, held: bool) -> bool:
        """Add the reading of this cycle; return False: a pass ends before an exchange, with its setpoints."""
        reading = float(self._cycle.row.actual[self._spindle]) / TURN * self._forward
        self._measured.take(reading)
        self._readings.append(reading)
        share = (reading - self._readings[0]) / (SPEED_CYCLES * self._cycle.cycle_s * self._speed)
        if self._played is None:
            steady = len(self._readings) > SPEED_CYCLES and AT_SPEED[0] <= share <= AT_SPEED[1]
            self._steady = self._steady + 1 if steady else 0
            self._waited += 0.0 if held or steady else self._cycle.cycle_s
        if self._fault is not None:
            raise self._fault
        standing = self._played is not None and abs(share) < STOPPED
        self._standing = self._standing + self._cycle.cycle_s if standing else 0.0
        if self._waited > SPEED_TIMEOUT_S or self._standing > (TURNING_S if self._reversed else 0.0):
            raise BarrierFault(FaultCode.SPINDLE_SPEED, self._spindle, (share, 1.0))
        return False

    def _set(self) -> bool:
        """Set the axes to the cam's position; return whether they are at their targets."""
        played = self._played
        assert played is not None
        row, ended = self._cycle.row, played.time >= self._cam.duration
        back = self._reversed and played.time <= 0.0
        place, by_time, by_time_twice = self._cam.at(played.time)
        velocity = by_time * played.rate
        acceleration = by_time_twice * played.rate**2 + by_time * played.slope
        self._states[:, 0] = self._start + self._way * place
        self._states[:, 1] = self._way * velocity
        self._states[:, 2] = self._way * acceleration
        if ended or back:
            self._states[:, 0] = self._start if back else self._target
            self._states[:, 1:] = 0.0
        row.ordered[self._columns] = self._states[:, 0]
        row.ordered_velocity[self._columns] = self._states[:, 1]
        if back:
            self._turn(self._forward)
        if ended or back:
            self._cycle.motions.drop(self._axes)
        return ended or back
