"""Guard the envelope of an approved run: stop the run before a setpoint leaves it.

Three lines of defence. Rows outside of the envelope are not admitted, so that the motion ends on the rows
before them as if no more had come. Motion of single axes is checked when it begins, and stopped in time where
it would pass a bound. Every setpoint is checked in its cycle. The third finds what the first two cannot
foresee (an axis that coasts as it is captured, a tool's tip under rapids with other timing than simulated):
the run comes to rest within its axes' limits from there on, and exceeds the bound by at most that braking
distance.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mcserver.executor.axis_motion import Motion, MotionKind
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import Array, Control, ControlKind
from mcserver.executor.envelope_bounds import Envelope, TipEnvelope
from mcserver.executor.fault_codes import BarrierFault, FaultCode
from mcserver.executor.shm.feedback import SlotState
from mcserver.executor.shm.rings import ProgramRing
from mcserver.executor.target_follower import Bounds
from mcserver.motion.kernels.envelope import (
    FAST,
    INSIDE,
    find_excess,
    find_tip_outside,
    find_wrong_row,
    tip_positions,
)

if TYPE_CHECKING:
    from mcserver.executor.slot import ProgramSlot


class Breach(NamedTuple):
    """A departure from the envelope: code, column (-1: none), line, value and bound [SI]."""

    code: FaultCode
    column: int
    line: int
    value: float
    bound: float


class _Tip:
    """A tool's tip in the cycle."""

    def __init__(self, tip: TipEnvelope) -> None:
        self.tool = float(tip.tool)
        self._columns = np.array(tip.columns, np.intp)
        self._turning = np.array(tip.turning, np.bool_)
        self._steps = np.array(tip.steps).reshape(-1, 3, 4)
        self._low, self._high = np.array(tip.low), np.array(tip.high)
        self.speed = tip.speed
        self._box = tip.low, tip.high
        self._before: list[float] | None = None

    def first_outside(
        self, ring: ProgramRing, first: int, written: int, setpoint: Array
    ) -> tuple[int, float] | None:
        """Return the number of the first of some rows at which the tip is outside, and how far [m]."""
        if first == written:
            return None
        at = find_tip_outside(
            self._steps,
            self._turning,
            self._columns,
            ring.position,
            ring.row_mask,
            setpoint,
            first,
            written,
            self._low,
            self._high,
        )
        if at == INSIDE:
            return None
        row = (first + at) % ring.rows
        driven = ring.row_mask[row] >> self._columns.astype(np.uint64) & np.uint64(1) != 0
        joints = np.where(driven, ring.position[row, self._columns], setpoint[self._columns])
        return first + at, self._outside(tip_positions(self._steps, self._turning, joints[None])[0].tolist())

    def lose(self) -> None:
        """Forget the last position of the tip: no speed is checked in the next cycle."""
        self._before = None

    def _outside(self, tip: list[float]) -> float:
        """Return how far a position is outside [m]."""
        low, high = self._box
        return max(max(here - above, below - here) for here, below, above in zip(tip, low, high, strict=True))

    def step(self, setpoint: Array) -> tuple[float, float]:
        """Return how far the tip is outside now, at most 0 inside, and its travel in this cycle [m]."""
        tip = tip_positions(self._steps, self._turning, setpoint[self._columns][None])[0].tolist()
        before, self._before = self._before, tip
        went = 0.0 if before is None else math.dist(tip, before)
        return self._outside(tip), went


class EnvelopeGuard:
    """Holds the program of one slot within its envelope.

    Args:
        envelope: from `enforced`. ring: of its rows.
    """

    def __init__(self, envelope: Envelope, cycle: Cycle, ring: ProgramRing) -> None:
        self._cycle = cycle
        self._ring = ring
        self._envelope = envelope
        self._override = envelope.override
        self._low, self._high = np.array(envelope.low), np.array(envelope.high)
        self._speed = np.array(envelope.speed)
        self._step = self._speed * cycle.cycle_s
        self._tips = [_Tip(tip) for tip in envelope.tips]
        self._before = cycle.row.ordered.copy()
        self._followed = 0
        self._left = envelope.seconds
        self._checked = -1
        self._limit: int | None = None
        self._breach: Breach | None = None
        self._said = False

    # ------------------------------------------------------------------ before anything begins

    def admit(self, first: int, written: int) -> int:
        """Return one past the last admitted row: the number of the first row outside, or ``written``.

        Args:
            first: number of the first row that has not been played. written: of the row after the last.
        """
        number = max(first, self._checked)
        if number < written and self._limit is None:
            self._look_at_rows(number, written)
            self._checked = written
        return written if self._limit is None else min(written, self._limit)

    def _look_at_rows(self, first: int, written: int) -> None:
        ring = self._ring
        found = find_wrong_row(
            ring.position,
            ring.velocity,
            ring.row_mask,
            ring.feed_scale,
            first,
            written,
            self._low,
            self._high,
            self._speed,
        )
        if found != INSIDE:
            row, column = divmod(found >> 1, ring.axes)
            written = first + row
            at = written % ring.rows
            line = int(ring.row_line[at])
            if found & 1 == FAST:
                speed = abs(float(ring.velocity[at, column])) / float(ring.feed_scale[at])
                bound = float(self._speed[column])
                self._breach = Breach(FaultCode.ENVELOPE_SPEED, column, line, speed, bound)
            else:
                self._breach = self._outside(column, line, float(ring.position[at, column]))
            self._limit = written
        for tip in self._tips:
            wrong = tip.first_outside(ring, first, written, self._cycle.row.ordered)
            if wrong is not None:
                written, excess = wrong
                line = int(ring.row_line[written % ring.rows])
                self._breach = Breach(FaultCode.ENVELOPE_TIP, -1, line, excess, tip.tool)
                self._limit = written

    def _outside(self, column: int, line: int, value: float) -> Breach:
        low, high = float(self._low[column]), float(self._high[column])
        bound = high if not value <= high else low
        return Breach(FaultCode.ENVELOPE_POSITION, column, line, value, bound)

    def admit_control(self, control: Control) -> None:
        """Refuse an entry that an approved run does not have.

        Raises:
            BarrierFault: the program is at fault; nothing of the entry has been done.
        """
        kind = control.kind
        columns = self._cycle.bank.masks.columns(control.axes)
        if kind in (ControlKind.TORQUE, ControlKind.HOME, ControlKind.REFERENCE):
            # a torque motion has no bounds, and a new reference would shift the approved ones
            raise BarrierFault(FaultCode.ENVELOPE_COMMAND, columns[0] if columns else -1)
        # targets of rapids, and positions at which rows end
        if kind in (ControlKind.RAPID, ControlKind.END) and control.values is not None:
            for column in columns:
                target = control.values[column]
                if not self._low[column] <= target <= self._high[column]:
                    found = self._outside(column, control.line, target)
                    raise BarrierFault(found.code, column, (target, found.bound))
        if kind is ControlKind.SPEED and control.values is not None:
            for column in columns:
                if not self._envelope.turning >> column & 1:
                    raise BarrierFault(FaultCode.ENVELOPE_COMMAND, column)
                wanted, bound = abs(control.values[column]), float(self._speed[column])
                if not wanted <= bound:
                    raise BarrierFault(FaultCode.ENVELOPE_SPEED, column, (wanted, bound))

    def bounds(self, column: int) -> Bounds:
        """Return the bounds within which a column may follow another axis."""
        speed = max(1.0, self._override) * float(self._speed[column])
        return Bounds(float(self._low[column]), float(self._high[column]), speed)

    # ------------------------------------------------------------------ the cycle

    def before_exchange(self, slot: ProgramSlot) -> None:
        """Check the setpoints of this cycle before they are sent; stop the program on a breach."""
        breach = self._breach or self._look(slot)
        if breach is None or self._said:
            return
        self._said = True
        slot.fault(breach.code, breach.line, breach.column, (breach.value, breach.bound))

    def _look(self, slot: ProgramSlot) -> Breach | None:
        cycle = self._cycle
        bank, row = cycle.bank, cycle.row
        held = slot.axes & bank.energized & (bank.positioned | bank.speed)
        line = slot.shown_line
        factor = self._override if not cycle.motions.mask & held else max(1.0, self._override)
        found = find_excess(
            row.ordered,
            self._before,
            self._low,
            self._high,
            self._step,
            factor,
            bank.masks.bools(held & ~bank.speed),
            bank.masks.bools(held & self._followed),
        )
        np.copyto(self._before, row.ordered)
        self._followed = held
        breach = None
        if found != INSIDE:
            column = found >> 1
            if found & 1 == FAST:
                speed = abs(float(row.ordered_velocity[column]))
                bound = factor * float(self._speed[column])
                breach = Breach(FaultCode.ENVELOPE_SPEED, column, line, speed, bound)
            else:
                breach = self._outside(column, line, float(row.ordered[column]))
        for tip in self._tips:
            if slot.lends:
                # at a pause other programs may move its joints
                tip.lose()
                continue
            excess, went = tip.step(row.ordered)
            if excess > 0.0 or went > factor * tip.speed * cycle.cycle_s:
                breach = breach or Breach(FaultCode.ENVELOPE_TIP, -1, line, excess, tip.tool)
        # a program that neither moves nor waits at an entry waits for its planner
        works = slot.barrier is not None or slot.playback.active
        if works and slot.state is SlotState.RUNNING:
            # a lower override makes the run take longer
            self._left -= cycle.cycle_s * min(1.0, slot.override)
            if self._left < 0.0:
                breach = breach or Breach(
                    FaultCode.ENVELOPE_TIME, -1, line, -self._left, self._envelope.seconds
                )
        if cycle.motions.mask & slot.axes:
            breach = breach or self._look_at_motions(slot, line)
        return breach

    def _look_at_motions(self, slot: ProgramSlot, line: int) -> Breach | None:
        """Stop motions of single axes that would pass a bound, while they can still stop before it."""
        motions = self._cycle.motions
        for motion in motions.of_slot(slot.index):
            if motion.kind is not MotionKind.POSITION:
                continue
            if all(self._beyond(motion, place) is None for place in motion.extremes()):
                continue
            rest = motions.rest_behind_next(motion)
            column = self._beyond(motion, rest)
            if column is not None:
                return self._outside(column, line, motion.place_of(column, rest))
        return None

    def _beyond(self, motion: Motion, place: float) -> int | None:
        """Return a column that is outside with the motion's own axis at ``place``; None without one."""
        for column in self._cycle.bank.masks.columns(motion.columns):
            if not self._low[column] <= motion.place_of(column, place) <= self._high[column]:
                return column
        return None
