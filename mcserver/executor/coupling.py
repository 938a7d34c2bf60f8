"""An axis that follows another one by a gear or a cam.

In each cycle the place of the leader gives the follower its target, which it goes after as an axis of servo
mode does (`follow_targets`): on it where its own limits allow, and never beyond these. So it comes into step
without a jump, also with a leader that moves, and whatever that one does no limit of the follower is passed.
What is left of the target is held against the tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcserver.executor.axes import AxisBank
from mcserver.executor.entries import Array
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.leading_curves import Gear, curve_of
from mcserver.executor.spindle_following import MeasuredPlace
from mcserver.executor.target_follower import UNBOUNDED, Bounds, tracking_limits
from mcserver.machine.axis import Axis
from mcserver.machine.follow_section import Follow
from mcserver.machine.machine_file import Machine
from mcserver.motion.kernels.target_tracking import MAX_ACCELERATION, MAX_JERK, VELOCITY, follow_targets

# Readings before which the speed of a measured leader is not known well enough to be in step with it.
KNOWN_CYCLES = 50
# In step is also who is not about to leave its tolerance within this time [s].
STEADY_S = 0.02


class Leader:
    """Where a leader is, by what it is ordered or by its encoder.

    Args:
        column: of it. measured: its encoder counts, not what it is ordered. shaped: what its drive gets does,
            not what is to be shaped yet.

    Attributes:
        start: where it was as this was made [m or rad]. shifted: by how much its positions read more since.
    """

    def __init__(
        self, bank: AxisBank, column: int, cycle_s: float, *, measured: bool, shaped: bool = False
    ) -> None:
        self.column, self.measured = column, measured
        self._bank, self._row, self._cycle_s = bank, bank.row, cycle_s
        self._places = bank.row.setpoint if shaped else bank.row.ordered
        self._speeds = bank.row.velocity if shaped else bank.row.ordered_velocity
        self._encoder = MeasuredPlace(cycle_s)
        # from the reading of the cycle before to this cycle's setpoint
        late = bank.delay_cycles if bank.delayed[column] else 0
        self._late_s = cycle_s * (1 + late)
        self._speed = float(self._speeds[column])
        self._place = float(self._places[column])
        self.shifted = 0.0
        self.start = float((self._row.actual if measured else self._places)[column])

    @property
    def known(self) -> bool:
        """Whether its speed is known well enough."""
        return not self.measured or self._encoder.count > KNOWN_CYCLES

    def shift(self, distance: float) -> None:
        """Let its positions read ``distance`` more from now on."""
        self.shifted += distance
        self._place += distance
        self._encoder.place += distance

    def lost(self, silent: int) -> bool:
        """Return whether it is no more known: it is off, has failed or is one of those silent."""
        bank, column = self._bank, self.column
        if (bank.fault | silent) >> column & 1:
            return True
        led = bank.energized & (bank.positioned | bank.speed)
        return not (self.measured or led >> column & 1)

    def look(self) -> tuple[float, float, float]:
        """Take the cycle's reading; return place, speed and acceleration at this cycle's setpoint."""
        row, column = self._row, self.column
        if self.measured:
            encoder = self._encoder
            # while it does not answer it is taken to go on
            fresh = self._bank.fresh[column]
            encoder.take(float(row.actual[column]) if fresh else encoder.ahead(self._cycle_s)[0])
            place, speed, acceleration = encoder.ahead(self._late_s)
            return place - self.shifted, speed, acceleration
        before, self._speed = self._speed, float(self._speeds[column])
        start, self._place = self._place, float(self._places[column])
        # at the end of a cycle of constant jerk
        mean = (self._place - start) / self._cycle_s
        acceleration = (4.0 * self._speed + 2.0 * before - 6.0 * mean) / self._cycle_s
        return self._place - self.shifted, self._speed, acceleration


def coupled_limits(axis: Axis, place: float, within: Bounds, *, free: bool) -> Array:
    """Return limits of a follower at a place [m or rad]; where something else bounds it, its own beside.

    Args:
        within: what bounds it besides its own. free: its travel does not count.
    """
    bounds = (within,) if within == UNBOUNDED else (within, UNBOUNDED)
    return np.array([tracking_limits(axis, place, free=free, within=each) for each in bounds])


class Coupling:
    """A follower and its leader.

    Args:
        follow: what it does. columns: of the follower, or of the tool's joints, at rest. slot, generation: of
            the program that couples it.
        place: where what follows begins [m or rad]. within: what bounds the follower besides its own limits.
        limits: as `coupled_limits`.

    Attributes:
        axes: mask of the columns. column: the first, or the one that the fault of `out_of_step` is of.
        tolerance: [m or rad].
        error: distance from the target in this cycle [m or rad]. in_step: it was within the tolerance.
        ending: it is to end with the cycle that begins.
    """

    # whether it is to take up what has not come yet
    waits = False
    # whether it cannot go on, whatever its error is
    failed = False
    # whether the follower moves by programs, too, and what follows is an offset to these
    superimposed = False

    def __init__(
        self,
        machine: Machine,
        bank: AxisBank,
        follow: Follow,
        columns: Sequence[int],
        slot: int,
        generation: int,
        place: float,
        within: Bounds,
        limits: Array,
    ) -> None:
        self.column, self.slot, self.generation = columns[0], slot, generation
        self.axes = sum(1 << column for column in columns)
        self.tolerance = follow.tolerance
        self._row, self._cycle_s = bank.row, machine.cycle_s
        self._curve = curve_of(follow)
        self.leader = Leader(
            bank,
            machine.column_of(follow.leader),
            machine.cycle_s,
            measured=follow.measured,
            shaped=self.superimposed,
        )
        self._within, self._limits = within, limits
        self._states: Array = np.array([[place, 0.0, 0.0]] * len(limits))
        self.state: Array = self._states[0]
        self._target, self._targets = np.zeros(3), np.zeros_like(self._states)
        # of the follower's positions, against those of the curve
        self._ahead = 0.0
        self.error, self.in_step, self.ending = 0.0, False, False
        value = self._curve.at(self.leader.start)[0]
        if self.superimposed or isinstance(self._curve, Gear):
            # a gear has no place of its own, nor has an offset: it goes on from where the two are
            self._ahead = place - value
        self.apart = place - self._ahead - value

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on."""
        if column == self.column:
            self._ahead += distance
            self._states[:, 0] += distance
            self._limits[:, 3:] += distance
            self._within = self._within.shifted(distance)
        if column == self.leader.column:
            self.leader.shift(distance)

    def step(self) -> None:
        """Let a cycle pass, behind which the follower's setpoint is set."""
        self._go_after()
        self._row.ordered[self.column] = self.state[0]
        self._row.ordered_velocity[self.column] = self.state[VELOCITY]

    def _go_after(self) -> None:
        """Let the states go after where the leader has them in this cycle."""
        target = self._target
        place, speed, acceleration = self.leader.look()
        value, slope, curvature = self._curve.at(place)
        target[:] = value + self._ahead, slope * speed, curvature * speed**2 + slope * acceleration
        # a target that cannot be followed is bounded in place
        self._targets[:] = target
        follow_targets(self._states, self._targets, self._limits, 1.0, self._cycle_s, False)
        self.error = abs(float(self.state[0] - target[0]))
        drifts = abs(float(self.state[VELOCITY] - target[1])) * STEADY_S
        self.in_step |= self.leader.known and self.error + drifts <= self.tolerance

    def out_of_step(self) -> tuple[FaultCode, tuple[float, float]]:
        """Return code and values of the fault: what bounds it besides, where by its own limits it kept up."""
        place, speed, _ = self._states[-1].tolist()
        if len(self._states) == 1 or not abs(place - float(self._target[0])) <= self.tolerance:
            return FaultCode.OUT_OF_STEP, (self.error, self.tolerance)
        most, jerk = self._limits[-1, MAX_ACCELERATION], self._limits[-1, MAX_JERK]
        # it brakes before an end that is not passed yet
        rest = place + 0.5 * speed * (abs(speed) / most + most / jerk)
        low, high = self._within.low, self._within.high
        if not low <= rest <= high:
            return FaultCode.ENVELOPE_POSITION, (rest, low if rest < low else high)
        return FaultCode.ENVELOPE_SPEED, (abs(float(self._target[1])), self._within.speed)

    @property
    def lacks_work(self) -> bool:
        """Whether it waits for what no input has noted yet."""
        return False

    @property
    def rests(self) -> bool:
        """Whether the follower stands on its target."""
        return not (self.error or self.state[1:].any())
