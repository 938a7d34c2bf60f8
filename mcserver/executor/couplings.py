"""Axes that follow others by a gear or a cam, from G1060 to G1061 (D-130).

In each cycle the place of the leader gives the follower its target, which it goes after as an axis of servo
mode does (`follow_targets`): on it where its own limits allow, and never beyond these. So it comes into step
without a jump, also with a leader that moves, and whatever that one does no limit of the follower is passed.
What is left of the target is held against the tolerance.

A coupling belongs to its program. It ends with it: once a leader that the program moves has come to rest,
else at once; the follower then stops within its limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mcserver.executor.axes import AxisBank
from mcserver.executor.entries import Array
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.independent import IndependentMotions
from mcserver.executor.leading_curves import Gear, curve_of
from mcserver.executor.spindle_following import MeasuredPlace
from mcserver.executor.target_follower import UNBOUNDED, Bounds, tracking_limits
from mcserver.machine.machine_file import Machine
from mcserver.motion.kernels.target_tracking import MAX_ACCELERATION, MAX_JERK, VELOCITY, follow_targets

if TYPE_CHECKING:
    from mcserver.executor.slot import ProgramSlot

# Readings before which the speed of a measured leader is not known well enough to be in step with it.
KNOWN_CYCLES = 50
# In step is also who is not about to leave its tolerance within this time [s].
STEADY_S = 0.02


class Coupling:
    """A follower and its leader.

    Args:
        column: of the follower, at rest. slot, generation: of the program that couples it.
        within: what bounds the follower besides its own limits. free: its travel does not count.

    Attributes:
        leader: its column. measured: its encoder counts, not what it is ordered. tolerance: [m or rad].
        error: distance from the target in this cycle [m or rad]. in_step: it was within the tolerance.
        ending: it is to end with the cycle that begins.
    """

    def __init__(
        self,
        machine: Machine,
        bank: AxisBank,
        column: int,
        slot: int,
        generation: int,
        within: Bounds,
        *,
        free: bool,
    ) -> None:
        axis = machine.axes[column]
        follow = axis.follow
        assert follow is not None
        self.column, self.slot, self.generation = column, slot, generation
        self.leader = machine.column_of(follow.leader)
        self.measured, self.tolerance = follow.measured, follow.tolerance
        self._bank, self._row, self._cycle_s = bank, bank.row, machine.cycle_s
        self._curve = curve_of(follow)
        place = float(self._row.ordered[column])
        self._within = within
        # beside it where it would be by its own limits alone
        bounds = (within,) if within == UNBOUNDED else (within, UNBOUNDED)
        self._limits = np.array([tracking_limits(axis, place, free=free, within=each) for each in bounds])
        self._states: Array = np.array([[place, 0.0, 0.0]] * len(bounds))
        self.state: Array = self._states[0]
        self._target, self._targets = np.zeros(3), np.zeros_like(self._states)
        self._encoder = MeasuredPlace(machine.cycle_s)
        # from the reading of the cycle before to this cycle's setpoint
        late = bank.delay_cycles if bank.delayed[self.leader] else 0
        self._late_s = machine.cycle_s * (1 + late)
        self._speed = float(self._row.ordered_velocity[self.leader])
        self._place = float(self._row.ordered[self.leader])
        # of the follower's and of the leader's positions, against those of the curve
        self._ahead = self._shifted = 0.0
        self.error, self.in_step, self.ending = 0.0, False, False
        start = float((self._row.actual if self.measured else self._row.ordered)[self.leader])
        value = self._curve.at(start)[0]
        if isinstance(self._curve, Gear):
            # a gear has no place of its own: it goes on from where the two are
            self._ahead = place - value
        self.apart = place - self._ahead - value

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on."""
        if column == self.column:
            self._ahead += distance
            self._states[:, 0] += distance
            self._limits[:, 3:] += distance
            self._within = self._within.shifted(distance)
        if column == self.leader:
            self._shifted += distance
            self._place += distance
            self._encoder.place += distance

    def lost(self, silent: int) -> bool:
        """Return whether the leader is no more known: it is off, has failed or is one of those silent."""
        bank, leader = self._bank, self.leader
        if (bank.fault | silent) >> leader & 1:
            return True
        led = bank.energized & (bank.positioned | bank.speed)
        return not (self.measured or led >> leader & 1)

    def step(self) -> None:
        """Let a cycle pass, behind which the follower's setpoint is set."""
        target, column = self._target, self.column
        place, speed, acceleration = self._of_leader()
        value, slope, curvature = self._curve.at(place - self._shifted)
        target[:] = value + self._ahead, slope * speed, curvature * speed**2 + slope * acceleration
        # a target that cannot be followed is bounded in place
        self._targets[:] = target
        follow_targets(self._states, self._targets, self._limits, 1.0, self._cycle_s, False)
        self.error = abs(float(self.state[0] - target[0]))
        drifts = abs(float(self.state[VELOCITY] - target[1])) * STEADY_S
        known = not self.measured or self._encoder.count > KNOWN_CYCLES
        self.in_step |= known and self.error + drifts <= self.tolerance
        self._row.ordered[column] = self.state[0]
        self._row.ordered_velocity[column] = self.state[VELOCITY]

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
    def rests(self) -> bool:
        """Whether the follower stands on its target."""
        return not (self.error or self.state[1:].any())

    def _of_leader(self) -> tuple[float, float, float]:
        """Return place, speed and acceleration of the leader at this cycle's setpoint."""
        row, leader = self._row, self.leader
        if self.measured:
            encoder = self._encoder
            # while it does not answer it is taken to go on
            fresh = self._bank.fresh[leader]
            encoder.take(float(row.actual[leader]) if fresh else encoder.ahead(self._cycle_s)[0])
            return encoder.ahead(self._late_s)
        before, self._speed = self._speed, float(row.ordered_velocity[leader])
        start, self._place = self._place, float(row.ordered[leader])
        # at the end of a cycle of constant jerk
        mean = (self._place - start) / self._cycle_s
        return self._place, self._speed, (4.0 * self._speed + 2.0 * before - 6.0 * mean) / self._cycle_s


class Couplings:
    """The couplings of a machine that are in force.

    Attributes:
        engaged: all of them. mask: columns of the followers. tied: with those of leaders that are ordered.
    """

    def __init__(self, machine: Machine, bank: AxisBank, motions: IndependentMotions) -> None:
        self._machine, self._bank, self._motions = machine, bank, motions
        self.engaged: tuple[Coupling, ...] = ()
        self.mask = self.tied = 0

    def prepare(self, column: int, slot: int, generation: int, within: Bounds) -> Coupling:
        """Return a coupling for `couple`; nothing follows yet."""
        free = bool(self._motions.unlimited >> column & 1)
        return Coupling(self._machine, self._bank, column, slot, generation, within, free=free)

    def couple(self, coupling: Coupling) -> None:
        """Let a column follow its leader from this cycle on."""
        self._hold((*self.engaged, coupling))

    def uncouple(self, axes: int) -> None:
        """End the couplings of some followers; those that move come to rest within their limits."""
        for coupling in self.engaged:
            coupling.ending |= bool(axes >> coupling.column & 1)
        self.forget(axes & ~self._motions.mask)

    def forget(self, axes: int) -> None:
        """End the couplings of some followers, which stand or are off."""
        self._hold(tuple(each for each in self.engaged if not axes >> each.column & 1))

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on."""
        for coupling in self.engaged:
            coupling.shift(column, distance)

    def follow(self, slots: Sequence[ProgramSlot], silent: int, *, urgent: bool) -> None:
        """Set the setpoints of all followers in this cycle, and end what has to end.

        Args:
            slots: of the programs, by number. silent: mask of columns whose drives answer no more. urgent:
                the emergency stop is latched.
        """
        for coupling in self.engaged:
            slot, bit = slots[coupling.slot], 1 << coupling.column
            if bit & ~(self._bank.energized & self._bank.positioned):
                self.forget(bit)
                continue
            gone = not slot.running or slot.generation != coupling.generation
            lost = coupling.lost(silent)
            if coupling.ending or gone or urgent or lost or self._stops(coupling, slot):
                if self._motions.mask & bit:
                    # its state is that before this cycle
                    self._motions.halt(coupling.column, -1 if gone else slot.index, 1.0, jerk=not urgent)
                self.forget(bit)
                if lost and slot.goes_on and not gone:
                    slot.fault(FaultCode.LEADER_LOST, slot.shown_line, coupling.leader)
                continue
            coupling.step()
            registered = bool(self._motions.mask & bit)
            if coupling.rests and registered:
                self._motions.drop(bit)
            elif not (coupling.rests or registered):
                self._motions.follow(coupling.column, coupling.slot, coupling.state)
            if coupling.in_step and slot.goes_on and not coupling.error <= coupling.tolerance:
                code, values = coupling.out_of_step()
                slot.fault(code, slot.shown_line, coupling.column, values)

    def _stops(self, coupling: Coupling, slot: ProgramSlot) -> bool:
        """Return whether a stop of the program ends a coupling now."""
        if slot.goes_on:
            return False
        leads = not coupling.measured and slot.axes >> coupling.leader & 1
        return not leads or not (self._motions.mask | slot.playback.active) >> coupling.leader & 1

    def _hold(self, engaged: tuple[Coupling, ...]) -> None:
        self.engaged = engaged
        self.mask = sum(1 << each.column for each in engaged)
        self.tied = self.mask
        for each in engaged:
            self.tied |= 0 if each.measured else 1 << each.leader
