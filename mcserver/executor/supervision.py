"""Supervise all axes in every cycle: travel limits, following errors, failed or silent drives."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from mcserver.drives.bus import BusEventKind, DriveState
from mcserver.executor.barriers import DRIVE_TIMEOUT_S
from mcserver.executor.column_masks import mask_of
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import Array, EventKind
from mcserver.executor.fault_codes import FaultCode, code_of_drive_fault
from mcserver.executor.gantry import GantryPair
from mcserver.executor.homed import LOSING
from mcserver.executor.shm.feedback import FeedbackRing
from mcserver.executor.slot import ProgramSlot
from mcserver.machine.machine_file import Machine

_OF_EVENT = MappingProxyType(
    {BusEventKind.MESSAGE: FaultCode.DRIVE_MESSAGE, BusEventKind.BUS_BACK: FaultCode.BUS_BACK}
)
# Period of checking for drives that still hold their axis after a command to let go [cycles].
STRAY_CYCLES = 64
# A drive that has not answered for this time is lost [s].
SILENCE_S = 0.01


def patience_cycles(machine: Machine) -> int:
    """Return after how many cycles without an answer a drive that is not on a bus is lost."""
    return max(3, round(SILENCE_S / machine.cycle_s))


class Supervision:
    """Looks for faults and stops the programs that they concern."""

    def __init__(self, cycle: Cycle, slots: Sequence[ProgramSlot], feedback: FeedbackRing) -> None:
        machine = cycle.machine
        count = len(machine.axes)
        self._cycle = cycle
        self._slots = slots
        self._feedback = feedback
        self._lowest = np.array([axis.min_position - axis.in_position for axis in machine.axes])
        self._highest = np.array([axis.max_position + axis.in_position for axis in machine.axes])
        self._homed = 0
        self._count_limits()
        self._greatest_error = np.array([axis.max_following_error for axis in machine.axes])
        self._error = np.zeros(count)
        self._within = np.ones(count, np.bool_)
        self._above = np.ones(count, np.bool_)
        self._silent = np.zeros(count, np.int64)
        self._any_silent = False
        # columns whose drives have been silent for too long
        self._gone = 0
        self._strays = self._reported_strays = 0
        self._stray_cycles = np.zeros(count, np.int64)
        # delayed feedback is also compared with the setpoints of that time
        self._delay = cycle.bank.delay_cycles
        self._delayed = cycle.bank.delayed
        self._past = np.tile(cycle.row.setpoint, (max(1, self._delay), 1))
        self._patience = patience_cycles(machine)

    # ------------------------------------------------------------------ setpoints

    def _count_limits(self) -> None:
        """Update the travel limits, which apply to homed axes only."""
        homed = self._cycle.homed
        self._homed = homed.mask
        counts = self._cycle.bank.masks.bools(homed.mask)
        self._low = np.where(counts, self._lowest, -np.inf)
        self._high = np.where(counts, self._highest, np.inf)
        self._cycle.motions.unlimited = homed.missing

    def shift(self, column: int, distance: float) -> None:
        """Add ``distance`` to a column's positions from now on."""
        self._past[:, column] += distance
        self._cycle.history[:, column] += distance

    def before_exchange(self) -> None:
        """Refuse setpoints outside of an axis's travel."""
        if self._cycle.homed.mask != self._homed:
            self._count_limits()
        if not self._cycle.bank.energized:
            return
        setpoint = self._cycle.row.ordered
        np.less_equal(setpoint, self._high, out=self._within)
        np.greater_equal(setpoint, self._low, out=self._above)
        if b"\x00" in self._within.tobytes() or b"\x00" in self._above.tobytes():
            self._refuse_setpoints()

    def _refuse_setpoints(self) -> None:
        bank, row = self._cycle.bank, self._cycle.row
        shaper = bank.shaper
        before = self._feedback.newest_setpoint(len(row.setpoint)) if shaper is None else shaper.before
        # trajectories keep axes in independent motion inside, or bring them back
        guarded = bank.energized & bank.positioned & ~self._cycle.motions.mask
        outside = mask_of(~(self._within & self._above)) & guarded
        for column in bank.masks.columns(outside):
            low, high = float(self._low[column]), float(self._high[column])
            wanted, old = float(row.ordered[column]), float(before[column])
            excess = max(wanted - high, low - wanted)
            old_excess = max(old - high, low - old)
            if old_excess > 0.0 and excess <= old_excess:
                # it was captured outside, and moves no further out
                continue
            row.ordered[column] = min(max(wanted, low), high) if old_excess <= 0.0 else old
            row.ordered_velocity[column] = 0.0
            limit = high if wanted > high else low
            self._take_out(1 << column, FaultCode.SOFT_LIMIT, column, (wanted, limit))

    def lead_coupled(self) -> None:
        """Set the setpoints of coupled axes; stop the program of an axis that cannot follow its leader."""
        self._cycle.couplings.follow(self._slots, self._gone, urgent=self._cycle.estop)

    def within_travel(self, setpoints: Array) -> int:
        """Return how many setpoints (n, K) from the first on stay within every axis's travel."""
        outside = ((setpoints > self._high) | (setpoints < self._low)).any(axis=1)
        (where,) = np.nonzero(outside)
        return int(where[0]) if len(where) else len(setpoints)

    def within_error(self, setpoints: Array, actual: Array) -> int:
        """Return how many cycles from the first on keep the following errors of axes in position mode.

        Args:
            setpoints, actual: shape (n, K).
        """
        bank = self._cycle.bank
        kept = np.abs(setpoints - actual) <= self._greatest_error
        late = ~(kept | ~bank.masks.bools(bank.positioned)).all(axis=1)
        (where,) = np.nonzero(late)
        return int(where[0]) if len(where) else len(setpoints)

    @property
    def quiet(self) -> bool:
        """Whether no supervision is pending that a block of cycles would skip."""
        return not (self._any_silent or self._delay or self._strays)

    # ------------------------------------------------------------------ feedback

    def after_exchange(self) -> None:
        """Find failed or lost drives, axes with a following error, and axes that a soft limit stops."""
        cycle = self._cycle
        bank, row = cycle.bank, cycle.row
        if self._any_silent or not bank.all_fresh:
            self._count_silence()
        if bank.failed or bank.dropped:
            for column in bank.masks.columns(bank.failed):
                fault, detail = int(bank.drive_fault[column]), int(bank.drive_detail[column])
                self._latch(column, code_of_drive_fault(fault), (float(fault), float(detail)))
            for column in bank.masks.columns(bank.dropped):
                self._latch(column, FaultCode.DRIVE_STATE_LOST, ())
        if bank.energized:
            self._compare_with_setpoints()
        if self._delay:
            self._past[cycle.number % self._delay] = row.setpoint
        if cycle.number % STRAY_CYCLES == 0:
            self._find_strays()
        if cycle.gantries.pairs:
            for pair, skew in cycle.gantries.broken(self._homed):
                self._stop_pair(pair, skew)
        for column in cycle.profiled.late:
            self._latch(column, FaultCode.FOLLOWING_ERROR, (float(self._error[column]), 0.0))
        for column in cycle.motions.limited:
            axis = cycle.machine.axes[column]
            position = float(row.setpoint[column])
            limit = min(axis.min_position, axis.max_position, key=lambda end: abs(end - position))
            self._tell(FaultCode.SPEED_AT_LIMIT, column, (position, limit))

    def _compare_with_setpoints(self) -> None:
        """Latch the energized axes that are too far from their setpoints."""
        bank, row = self._cycle.bank, self._cycle.row
        np.subtract(row.setpoint, row.actual, out=self._error)
        np.abs(self._error, out=self._error)
        np.less_equal(self._error, self._greatest_error, out=self._within)
        if b"\x00" not in self._within.tobytes():
            return
        if self._delay:
            self._allow_delay()
        lost = mask_of(~self._within & bank.fresh) & bank.energized & bank.positioned
        lost &= ~self._cycle.profiled.unsettled
        for column in bank.masks.columns(lost):
            values = (float(self._error[column]), float(self._greatest_error[column]))
            self._latch(column, FaultCode.FOLLOWING_ERROR, values)

    def _allow_delay(self) -> None:
        """Measure following errors of delayed axes from the nearest setpoint during the delay."""
        row, past, delayed = self._cycle.row, self._past, self._delayed
        low = np.minimum(past.min(axis=0), row.setpoint)
        high = np.maximum(past.max(axis=0), row.setpoint)
        outside = np.maximum(np.maximum(row.actual - high, low - row.actual), 0.0)
        np.copyto(self._error, outside, where=delayed)
        np.less_equal(self._error, self._greatest_error, out=self._within)

    def _find_strays(self) -> None:
        """Find drives that hold their axes long after they were commanded to let go."""
        bank = self._cycle.bank
        commanded = (
            bank.energized | bank.starting | bank.stopping | bank.resetting | bank.released | bank.exact
        )
        off = (bank.states == DriveState.OFF) | (bank.states == DriveState.FAULT)
        stray = mask_of(~off & bank.fresh) & ~commanded
        for column in bank.masks.columns(stray & self._strays):
            self._stray_cycles[column] += STRAY_CYCLES
            seconds = float(self._stray_cycles[column]) * self._cycle.cycle_s
            if seconds > DRIVE_TIMEOUT_S and not self._reported_strays >> column & 1:
                self._reported_strays |= 1 << column
                self._latch(column, FaultCode.NOT_OFF, (seconds, DRIVE_TIMEOUT_S))
        self._stray_cycles[bank.masks.bools(bank.all & ~stray)] = 0
        self._strays = stray
        self._reported_strays &= stray

    def report_events(self) -> None:
        """Report further events of buses, which stop nothing."""
        for event in self._cycle.bank.events():
            self._tell(_OF_EVENT[event.kind], event.column, (float(event.kind), float(event.code)))

    def _tell(self, code: FaultCode, column: int, values: tuple[float, ...]) -> None:
        """Report what stops nothing, with the program that has the axis."""
        slot = self._slot_of(column)
        index, line = (-1, 0) if slot is None else (slot.index, slot.shown_line)
        self._cycle.fault(code, index, line, column, values)

    def _count_silence(self) -> None:
        bank = self._cycle.bank
        self._silent[bank.fresh] = 0
        self._silent[~bank.fresh] += 1
        self._any_silent = bool(self._silent.any())
        self._gone = mask_of(self._silent >= self._patience + self._delay * self._delayed)
        self._cycle.row.set_silent(self._gone)
        # a bus with a delay decides itself how long its drives may be silent
        silent = (self._silent >= self._patience) & ~self._delayed
        lost = mask_of(silent) & (bank.energized | bank.starting)
        for column in bank.masks.columns(lost):
            seconds = float(self._silent[column]) * self._cycle.cycle_s
            self._latch(column, FaultCode.DRIVE_SILENT, (seconds, SILENCE_S))

    def _latch(self, column: int, code: FaultCode, values: tuple[float, ...]) -> None:
        """Latch an axis that has failed: switch it off, and stop the motion that it is part of."""
        cycle = self._cycle
        cycle.bank.latch(1 << column)
        both = cycle.bank.both(1 << column)
        if code in LOSING:
            for lost in cycle.bank.masks.columns(cycle.homed.lose(both)):
                cycle.emit(EventKind.UNHOMED, -1, 0, code=int(code), axis=cycle.machine.axes[lost].index)
        self._take_out(both, code, column, values)

    def _stop_pair(self, pair: GantryPair, skew: float) -> None:
        """Let the drives of a pair stop by themselves and switch off: its sides are too far apart.

        A stop within the axis's limits would skew the gantry by its whole distance, since the side that is
        blocked stands still already.
        """
        self._cycle.bank.stop(pair.mask)
        self._take_out(pair.mask, FaultCode.SKEW, pair.leader, (skew, pair.max_skew))

    def _take_out(self, axes: int, code: FaultCode, column: int, values: tuple[float, ...]) -> None:
        """Take axes out of their motion, and stop the program that has ``column`` for its fault."""
        slot = self._slot_of(column)
        if slot is None:
            self._cycle.motions.drop(axes)
            self._cycle.fault(code, -1, 0, column, values)
            return
        for each in self._cycle.bank.masks.columns(axes):
            slot.lose(each)
        slot.fault(code, slot.shown_line, column, values)

    def _slot_of(self, column: int) -> ProgramSlot | None:
        for slot in self._slots:
            if slot.running and slot.axes >> column & 1:
                return slot
        return None
