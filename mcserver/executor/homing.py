"""Homing: each axis finds its reference by independent moves while u waits.

An axis with a switch or a hard stop approaches it fast, backs off, and approaches again slowly: the second
contact is the reference. If configured, it then moves away from the switch to the encoder's index. Every move
has a longest distance, so that a missing switch is a fault. A feed hold interrupts these moves, an abort ends
them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

from mcserver.drives.bus import HOME_SWITCH, DriveMode, DriveState
from mcserver.executor.barriers import DRIVE_TIMEOUT_S, Barrier
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import EventKind, HomingPhase
from mcserver.executor.fault_codes import BarrierFault, FaultCode
from mcserver.executor.trajectories import MotionLimits
from mcserver.machine.homing_section import Homing

# An axis is at a hard stop if it is slower than this share of its setpoint's speed …
BLOCKED_SHARE = 0.5
# … and its torque is above the threshold for so many cycles.
BLOCKED_CYCLES = 3
# A drive that has homed itself goes back to position mode once it has stood still for so many cycles.
STANDING_CYCLES = 10
# Turns of the motor within which an index has to come.
INDEX_TURNS = 1.5

# Points at which the two sides of a gantry pair wait for each other: before the search, on the switch, after
# backing off, and once both have their references.
_RELEASED, _FOUND, _BACKED_OFF, _REFERRED = 1, 2, 3, 5


class AxisHoming:
    """Homing of one axis.

    Args:
        rate: the slot's share of speed, 0 in feed hold.

    Attributes:
        column: of the axis. partner: the other side of a gantry pair; None: it has none.
        met, seen: waiting points that the two sides have reached, at the last cycle's end.
    """

    def __init__(
        self, cycle: Cycle, column: int, slot: int, homing: Homing, rate: Callable[[], float]
    ) -> None:
        self._cycle = cycle
        self.column = column
        self._bit = 1 << column
        self._slot = slot
        self._homing = homing
        self._rate = rate
        self._axis = cycle.machine.axes[column]
        self._before = float(cycle.row.actual[column])
        self._input = self._input_column()
        self._active = self._switch()
        self._indices = int(cycle.bank.indices[column])
        self._cycles = 0
        self._stops = homing.method == "hard-stop"
        self._contact = 0.0
        self._waited = 0.0
        self.partner: AxisHoming | None = None
        self.met = self.seen = 0
        self._alone = False
        self.phase = HomingPhase.START

    def step(self) -> bool:
        """Advance by one cycle, with fresh feedback; return True once the axis is homed and at rest.

        Raises:
            BarrierFault: it cannot be homed.
        """
        if self.phase is HomingPhase.DONE:
            return True
        was_active, self._active = self._active, self._switch()
        self._edge = self._active != was_active
        following = _STEPS[self.phase](self)
        if following is not None:
            self.phase = following
            self._cycle.emit(EventKind.HOMING, self._slot, 0, axis=self._axis.index, token=int(following))
        self._before = float(self._cycle.row.actual[self.column])
        return self.phase is HomingPhase.DONE

    # ------------------------------------------------------------------ what the axis feels

    def _input_column(self) -> int | None:
        """Return the column of the input that is the switch; None: the switch is the drive's.

        A simulated drive with a switch sets the corresponding simulated input.
        """
        number = self._homing.input
        for column, each in enumerate(self._cycle.machine.inputs):
            if each.digital and each.number == number:
                by_drive = each.source is None and self._axis.drive.home_switch is not None
                return None if by_drive else column
        return None

    def _switch(self) -> bool:
        homing, cycle = self._homing, self._cycle
        if homing.method != "switch":
            return False
        if self._input is not None:
            return cycle.io.value(self._input) > 0.5
        return bool(cycle.bank.inputs[self.column] & HOME_SWITCH) != homing.invert

    def _edge_at(self) -> float:
        """Return the position of the switch's edge: latched by the drive, else between two readings."""
        actual = float(self._cycle.row.actual[self.column])
        latched = float(self._cycle.bank.switch_at[self.column])
        low, high = sorted((self._before, actual))
        if self._input is None and low <= latched <= high:
            return latched
        return 0.5 * (self._before + actual)

    def _blocked(self) -> bool:
        """Return True once the axis has been blocked for `BLOCKED_CYCLES`."""
        row, column = self._cycle.row, self.column
        speed = float(row.velocity[column])
        pushes = float(row.torque[column]) * self._homing.direction >= self._homing.torque
        slow = abs(float(row.actual_velocity[column])) < BLOCKED_SHARE * abs(speed)
        self._cycles = self._cycles + 1 if pushes and slow and speed != 0.0 else 0
        return self._cycles >= BLOCKED_CYCLES

    def _touches(self) -> bool:
        """Return True in the cycle in which contact is made, at `_contact`."""
        if self._stops:
            self._contact = float(self._cycle.row.actual[self.column])
            return self._blocked()
        if self._homing.method == "index":
            return self._passes_index()
        if self._edge and self._active:
            self._contact = self._edge_at()
            return True
        return False

    def _passes_index(self) -> bool:
        bank, column = self._cycle.bank, self.column
        count = int(bank.indices[column])
        if count == self._indices:
            return False
        self._indices = count
        self._contact = float(bank.index_at[column])
        return True

    # ------------------------------------------------------------------ moves

    @property
    def _moving(self) -> bool:
        return bool((self._cycle.motions.mask | self._cycle.settling) & self._bit)

    def _go(self, distance: float, velocity: float) -> None:
        """Move by a distance, positive towards the reference [m or rad]."""
        self._go_to(float(self._cycle.row.ordered[self.column]) + self._homing.direction * distance, velocity)

    def _go_to(self, target: float, velocity: float) -> None:
        limits = MotionLimits.of(self._axis, velocity)
        self._cycle.motions.move(self.column, self._slot, target, 0.0, self._rate(), limits)

    def _halt(self) -> None:
        self._cycle.motions.halt(self.column, self._slot)

    def _meets(self, point: int) -> bool:
        """Return whether the other side of a pair has reached this point too, or there is none."""
        self.met = point
        return self.partner is None or self.seen >= point

    def _fault(self, code: FaultCode, distance: float) -> BarrierFault:
        return BarrierFault(code, self.column, (distance, self._homing.torque))

    @property
    def _missing(self) -> FaultCode:
        """Return the fault of a search that ended without a contact."""
        if self._stops:
            return FaultCode.STOP_NOT_FOUND
        return FaultCode.INDEX_NOT_FOUND if self._homing.method == "index" else FaultCode.SWITCH_NOT_FOUND

    # ------------------------------------------------------------------ phases

    def _start(self) -> HomingPhase | None:
        homing, cycle = self._homing, self._cycle
        if self._moving:
            return None
        for lost in cycle.bank.masks.columns(cycle.homed.lose(self._bit, absolute_too=True)):
            cycle.emit(EventKind.UNHOMED, self._slot, 0, axis=cycle.machine.axes[lost].index)
        self._indices = int(cycle.bank.indices[self.column])
        self._cycles = 0
        if homing.method == "drive":
            cycle.homed.forget_offset(self.column)
            cycle.bank.power(self._bit, DriveMode.HOMING)
            return HomingPhase.DRIVE
        if self._active:
            # one side of a pair moves alone
            alone = self.partner is not None
            self._go(-homing.release_travel, homing.latch_velocity if alone else homing.velocity)
            return HomingPhase.RELEASE
        if not self._meets(_RELEASED):
            return None
        index = homing.method == "index"
        self._go(homing.travel, homing.latch_velocity if index else homing.velocity)
        return HomingPhase.APPROACH

    def _release(self) -> HomingPhase | None:
        if not self._active:
            if self._moving:
                self._halt()
                return None
            return HomingPhase.START
        if not self._moving:
            raise self._fault(FaultCode.SWITCH_STUCK, self._homing.release_travel)
        return None

    def _approach(self) -> HomingPhase | None:
        if self._touches():
            self._halt()
            return HomingPhase.REFERENCE if self._homing.method == "index" else HomingPhase.BACK_OFF
        if not self._moving:
            raise self._fault(self._missing, self._homing.travel)
        if self.partner is not None and self.partner.phase is HomingPhase.BACK_OFF and not self._alone:
            # the other side has stopped at its switch: this one goes on slowly to its own
            self._alone = True
            self._go(self._homing.travel, self._homing.latch_velocity)
        return None

    def _back_off(self) -> HomingPhase | None:
        """Stop after the contact, then move away from it."""
        homing = self._homing
        away = self._contact - homing.direction * homing.back_off
        setpoint = float(self._cycle.row.ordered[self.column])
        if self._moving or not self._meets(_FOUND):
            return None
        if setpoint != away:
            self._go_to(away, homing.velocity)
            return None
        if self._active:
            raise self._fault(FaultCode.SWITCH_STUCK, homing.back_off)
        if not self._meets(_BACKED_OFF):
            return None
        self._cycles = 0
        self._go(2.0 * homing.back_off, homing.latch_velocity)
        return HomingPhase.LATCH

    def _latch(self) -> HomingPhase | None:
        if self._touches():
            self._halt()
            return HomingPhase.INDEX if self._homing.index else HomingPhase.REFERENCE
        if not self._moving:
            raise self._fault(self._missing, 2.0 * self._homing.back_off)
        return None

    def _index(self) -> HomingPhase | None:
        """Stop, then move away from the switch until the index comes."""
        passed = self._passes_index()
        moves_away = float(self._cycle.row.velocity[self.column]) * self._homing.direction < 0.0
        if passed and moves_away:
            self._halt()
            return HomingPhase.REFERENCE
        if self._moving:
            return None
        if self._waited > 0.0:
            raise self._fault(FaultCode.INDEX_NOT_FOUND, self._waited)
        self._waited = INDEX_TURNS * self._axis.travel_per_motor_turn
        self._go(-self._waited, self._homing.latch_velocity)
        return None

    def _reference(self) -> HomingPhase | None:
        if self._moving:
            return None
        homing = self._homing
        if self.met < _REFERRED:
            if not self._meets(_REFERRED - 1):
                return None
            self._refer(homing.position if homing.position is not None else 0.0, self._contact)
        if not self._meets(_REFERRED):
            return None
        target = homing.then_move_to
        if target is None and self.partner is not None and self._axis.gantry is not None:
            # the follower moves to its leader's position
            target = float(self._cycle.row.ordered[self.partner.column])
        if target is None and self._stops:
            # move off the stop, or the axis would keep pushing against it
            target = (homing.position or 0.0) - homing.direction * homing.back_off
        if target is None:
            return HomingPhase.DONE
        self._go_to(target, homing.velocity)
        return HomingPhase.DEPART

    def _depart(self) -> HomingPhase | None:
        return None if self._moving else HomingPhase.DONE

    def _drive(self) -> HomingPhase | None:
        """Wait for the drive's own homing; its fault or the configured time-out ends it."""
        bank, row = self._cycle.bank, self._cycle.row
        if bank.states[self.column] != DriveState.HOMED or not bank.fresh[self.column]:
            return None
        # its reading may jump to the home position shortly before or after that
        still = abs(float(row.actual_velocity[self.column])) <= bank.standing_speed[self.column]
        self._cycles = self._cycles + 1 if still else 0
        if self._cycles < STANDING_CYCLES:
            return None
        bank.power(self._bit, DriveMode.POSITION)
        return HomingPhase.HOLD

    def _hold(self) -> HomingPhase | None:
        cycle = self._cycle
        if not cycle.bank.energized & self._bit:
            self._waited += cycle.cycle_s
            if self._waited > DRIVE_TIMEOUT_S:
                cycle.bank.latch(self._bit)
                raise BarrierFault(FaultCode.NO_ENERGIZE, self.column, (self._waited, DRIVE_TIMEOUT_S))
            return None
        at = float(cycle.row.actual[self.column])
        position = at if self._homing.position is None else self._homing.position
        self._refer(position, at)
        if self._homing.then_move_to is None:
            return HomingPhase.DONE
        self._go_to(self._homing.then_move_to, self._homing.velocity)
        return HomingPhase.DEPART

    def _refer(self, position: float, at: float) -> None:
        cycle = self._cycle
        cycle.homed.refer(self.column, position, at)
        report_homed(cycle, self._slot, self.column)


_STEPS: Mapping[HomingPhase, Callable[[AxisHoming], HomingPhase | None]] = MappingProxyType(
    {
        HomingPhase.START: AxisHoming._start,
        HomingPhase.RELEASE: AxisHoming._release,
        HomingPhase.APPROACH: AxisHoming._approach,
        HomingPhase.BACK_OFF: AxisHoming._back_off,
        HomingPhase.LATCH: AxisHoming._latch,
        HomingPhase.INDEX: AxisHoming._index,
        HomingPhase.REFERENCE: AxisHoming._reference,
        HomingPhase.DEPART: AxisHoming._depart,
        HomingPhase.DRIVE: AxisHoming._drive,
        HomingPhase.HOLD: AxisHoming._hold,
    }
)


class Homes(Barrier):
    """The barrier at which u waits while axes are homed together."""

    def __init__(self, cycle: Cycle, axes: int, slot: int, rate: Callable[[], float]) -> None:
        self._homings: list[AxisHoming] = []
        for column in cycle.bank.masks.columns(axes):
            homing = cycle.machine.axes[column].homing
            if homing is None or not homing.finds:
                raise BarrierFault(FaultCode.NO_HOMING, column)
            drive = cycle.machine.axes[column].drive
            if homing.method == "drive" and not drive.has_mode(DriveMode.HOMING):
                raise BarrierFault(FaultCode.MODE_NOT_CONFIGURED, column, (float(DriveMode.HOMING), 0.0))
            self._homings.append(AxisHoming(cycle, column, slot, homing, rate))
        by_column = {each.column: each for each in self._homings}
        for pair in cycle.gantries.pairs:
            if pair.leader in by_column:
                one, other = by_column[pair.leader], by_column[pair.follower]
                one.partner, other.partner = other, one

    def after(self, held: bool) -> bool:  # noqa: ARG002
        for each in self._homings:
            each.seen = 0 if each.partner is None else each.partner.met
        # step all of them in every cycle: an axis that is left out would miss its switch
        done = [each.step() for each in self._homings]
        return all(done)


class Refers(Barrier):
    """The barrier that gives axes at rest their positions, in the cycle after it was made."""

    def __init__(self, cycle: Cycle, axes: int, values: tuple[float, ...], slot: int) -> None:
        self._cycle = cycle
        self._axes = axes
        self._values = values
        self._slot = slot

    def after(self, held: bool) -> bool:  # noqa: ARG002
        cycle = self._cycle
        for column in cycle.bank.masks.columns(self._axes):
            at_rest = abs(float(cycle.row.actual_velocity[column])) <= cycle.bank.standing_speed[column]
            if cycle.motions.mask >> column & 1 or not at_rest:
                raise BarrierFault(FaultCode.REFERENCE_MOVING, column)
        for column in cycle.bank.masks.columns(self._axes):
            value = self._values[column]
            if math.isfinite(value):
                cycle.homed.refer(column, value, float(cycle.row.ordered[column]))
                report_homed(cycle, self._slot, column)
        return True


def report_homed(cycle: Cycle, slot: int, column: int) -> None:
    """Report that a column has its reference, with its offset and what its encoder reads."""
    values = (float(cycle.bank.offset[column]), cycle.homed.reading(column))
    cycle.emit(EventKind.HOMED, slot, 0, axis=cycle.machine.axes[column].index, values=values)
