"""Barriers: conditions at which a program's u waits.

A barrier is checked twice a cycle. Before the exchange with the drives it may be passed within the cycle, so
that a wait without drives costs no whole cycle; after the exchange it sees fresh feedback.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mcserver.executor.coupling import Coupling
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import Array
from mcserver.executor.fault_codes import BarrierFault, FaultCode, code_of_drive_fault
from mcserver.motion.canonical import WaitMode

# Time in which a drive has to carry out a command [s].
DRIVE_TIMEOUT_S = 5.0
NEAR_ZERO = 1e-12
# Time in which a coupled axis has to get into step with its leader [s].
STEP_TIMEOUT_S = 10.0


class Barrier:
    """One reason for u to wait."""

    @property
    def in_thread(self) -> bool:
        """Whether its axes follow a spindle now: a tool is in a thread, or about to enter it."""
        return False

    def before(self, left: float, held: bool) -> float | None:  # noqa: ARG002
        """Return the rest of the cycle after this is passed [cycles]; None: u waits.

        Args:
            left: rest of the cycle when u reaches the barrier. held: the program is in feed hold.
        """
        return None

    def after(self, held: bool) -> bool:  # noqa: ARG002
        """Return whether it is passed, given fresh feedback.

        Raises:
            BarrierFault: it cannot be passed.
        """
        return False

    def idle_cycles(self, limit: int) -> int:  # noqa: ARG002
        """Return how many of the next cycles, up to ``limit``, u surely waits and only time passes.

        Provided that there is no feed hold, no motion ends, and no drive or input changes.
        """
        return 0

    def skip(self, cycles: int) -> None:  # noqa: ARG002
        """Let cycles of `idle_cycles` pass."""
        return


class Dwell(Barrier):
    """G04: time passes, but not in feed hold."""

    def __init__(self, cycle: Cycle, seconds: float) -> None:
        self._cycle = cycle
        self._remaining = seconds

    def before(self, left: float, held: bool) -> float | None:
        if not held:
            self._remaining -= left * self._cycle.cycle_s
        if self._remaining > NEAR_ZERO:
            return None
        return min(left, max(0.0, -self._remaining / self._cycle.cycle_s))

    def idle_cycles(self, limit: int) -> int:
        return int(np.count_nonzero(self._remaining_after(limit) > NEAR_ZERO))

    def skip(self, cycles: int) -> None:
        self._remaining = float(self._remaining_after(cycles)[-1])

    def _remaining_after(self, cycles: int) -> Array:
        """Return the rest of the dwell after each of the next cycles, shape (cycles,) [s].

        Subtracted one by one, to be bit-identical to single cycles.
        """
        steps = np.full(cycles + 1, self._cycle.cycle_s)
        steps[0] = self._remaining
        return np.asarray(np.subtract.accumulate(steps)[1:])


class AtRest(Barrier):
    """Independent motion of some axes has ended, except for constant speeds.

    Args:
        exchanged: whether the drives have to have received the last setpoints.
    """

    def __init__(self, cycle: Cycle, axes: int, *, exchanged: bool = False) -> None:
        self._cycle = cycle
        self._axes = axes
        self._exchanged = exchanged

    def before(self, left: float, held: bool) -> float | None:  # noqa: ARG002
        if self._exchanged or self._moving:
            return None
        return min(left, self._cycle.motions.end_left(self._axes))

    def after(self, held: bool) -> bool:  # noqa: ARG002
        return not self._moving

    def idle_cycles(self, limit: int) -> int:
        return limit if self._moving else 0

    @property
    def _moving(self) -> bool:
        motions = self._cycle.motions
        return (motions.mask & ~motions.speeding | self._cycle.settling) & self._axes != 0


class Settled(Barrier):
    """Shaped setpoints have reached the ordered positions, and the entries delayed with them are done.

    Args:
        settled: returns whether that is so.
    """

    def __init__(self, settled: Callable[[], bool]) -> None:
        self._settled = settled

    def after(self, held: bool) -> bool:
        return not held and self._settled()


class ExactStop(Barrier):
    """Every axis is at rest and its encoder has been within tolerance for some cycles (D-34)."""

    def __init__(self, cycle: Cycle, axes: int, timeout_s: float) -> None:
        self._cycle = cycle
        self._axes = axes
        self._timeout = timeout_s
        self._waited = 0.0
        self._rest = AtRest(cycle, axes)

    def before(self, left: float, held: bool) -> float | None:
        left_at_rest = self._rest.before(left, held)
        bank = self._cycle.bank
        if left_at_rest is None or self._axes & bank.positioned & ~bank.exact:
            return None
        # u goes on with the next cycle: rows are at whole u, and are played exactly only if u is whole at
        # each cycle
        return 0.0

    def after(self, held: bool) -> bool:
        cycle = self._cycle
        bank, row = cycle.bank, cycle.row
        if not self._rest.after(held):
            return False
        worst, excess, settled = -1, 0.0, True
        for column in bank.masks.columns(self._axes & bank.positioned):
            axis = cycle.machine.axes[column]
            distance = self._distance(column)
            if distance == 0.0 and row.actual_velocity[column] == 0.0:
                continue
            if not distance <= axis.in_position:
                settled = False
                if not distance / axis.in_position <= excess:
                    worst, excess = column, distance / axis.in_position
            elif not self._was_within(column, axis.in_position):
                settled = False
                if worst < 0:
                    worst = column
        if settled:
            return True
        if not held:
            self._waited += cycle.cycle_s
        if self._waited > self._timeout:
            axis = cycle.machine.axes[worst]
            distance = self._distance(worst)
            raise BarrierFault(FaultCode.EXACT_STOP_TIMEOUT, worst, (distance, axis.in_position))
        return False

    def idle_cycles(self, limit: int) -> int:
        return self._rest.idle_cycles(limit)

    def _was_within(self, column: int, tolerance: float) -> bool:
        """Return whether the encoder has been in tolerance for the configured cycles, up to this one."""
        cycle = self._cycle
        distance = abs(cycle.history[:, column] - cycle.ordered(column))
        return bool((distance <= tolerance).all())

    def _distance(self, column: int) -> float:
        """How far the encoder is from its target in this cycle, in the frame in which the program works."""
        cycle = self._cycle
        reading = cycle.history[cycle.number % len(cycle.history), column]
        return abs(float(reading - cycle.ordered(column)))


class InStep(Barrier):
    """An axis that has been coupled is in step with its leader."""

    def __init__(self, cycle: Cycle, coupling: Coupling) -> None:
        self._cycle = cycle
        self._coupling = coupling
        self._waited = 0.0

    def before(self, left: float, held: bool) -> float | None:  # noqa: ARG002
        return left if self._coupling.in_step else None

    def after(self, held: bool) -> bool:
        if self._coupling.waits:
            # no time-out: a work piece on a conveyor may come at any time
            return False
        self._waited += 0.0 if held else self._cycle.cycle_s
        if self._waited > STEP_TIMEOUT_S:
            code, values = self._coupling.out_of_step()
            raise BarrierFault(code, self._coupling.column, values)
        return False


class DriveWait(Barrier):
    """Drives have carried out a command, within a time-out."""

    def __init__(self, cycle: Cycle, axes: int) -> None:
        self._cycle = cycle
        self._axes = axes
        self._waited = 0.0

    @property
    def _missing(self) -> int:
        """Columns of drives that have not carried it out."""
        raise NotImplementedError

    def _late(self, column: int) -> BarrierFault:
        """Return the fault of the first of them at the time-out."""
        raise NotImplementedError

    def _not_cleared(self, column: int) -> BarrierFault:
        fault, detail = self._cycle.bank.reported_fault(column)
        if fault:
            # for instance a node that was stopped, which does not receive the reset
            return BarrierFault(code_of_drive_fault(fault), column, (float(fault), float(detail)))
        return BarrierFault(FaultCode.NO_RESET, column, (self._waited, DRIVE_TIMEOUT_S))

    def before(self, left: float, held: bool) -> float | None:  # noqa: ARG002
        return None if self._missing else left

    def after(self, held: bool) -> bool:  # noqa: ARG002
        missing = self._missing
        if missing:
            self._waited += self._cycle.cycle_s
            if self._waited > DRIVE_TIMEOUT_S:
                raise self._late(self._cycle.bank.masks.columns(missing)[0])
        return not missing


class Energized(DriveWait):
    """Drives have energized their axes."""

    @property
    def _missing(self) -> int:
        return self._axes & ~self._cycle.bank.energized

    def _late(self, column: int) -> BarrierFault:
        clearing = bool(self._cycle.bank.resetting >> column & 1)
        # nothing waits for them any more: none may energize by itself later
        self._cycle.bank.latch(self._missing)
        if clearing:
            return self._not_cleared(column)
        return BarrierFault(FaultCode.NO_ENERGIZE, column, (self._waited, DRIVE_TIMEOUT_S))


class DrivesDone(DriveWait):
    """Drives have come to rest after STOP, or have cleared their faults after RESET."""

    @property
    def _missing(self) -> int:
        return self._axes & (self._cycle.bank.resetting | self._cycle.bank.stopping)

    def _late(self, column: int) -> BarrierFault:
        return self._not_cleared(column)


class InputWait(Barrier):
    """M66: wait for a digital input.

    The time-out passes like a dwell: not in feed hold. Edges of the input count in feed hold, too.

    Args:
        report: called when it is passed, with the input's value and the seconds waited.
    """

    def __init__(
        self,
        cycle: Cycle,
        column: int,
        mode: WaitMode,
        timeout_s: float,
        report: Callable[[float, float], None],
    ) -> None:
        self._cycle = cycle
        self._column = column
        self._mode = mode
        self._timeout = timeout_s
        self._report = report
        self._before = cycle.io.value(column) != 0.0
        self._waited = 0.0

    def after(self, held: bool) -> bool:
        on, before = self._cycle.io.value(self._column) != 0.0, self._before
        self._before = on
        if self._mode is WaitMode.RISE:
            done = on and not before
        elif self._mode is WaitMode.FALL:
            done = before and not on
        else:
            done = on is (self._mode is WaitMode.HIGH)
        if done:
            self._report(float(on), self._waited)
        elif self._waited > self._timeout - NEAR_ZERO:
            raise BarrierFault(FaultCode.INPUT_TIMEOUT, -1, (float(self._column), self._timeout))
        elif not held:
            self._waited += self._cycle.cycle_s
        return done


class Paused(Barrier):
    """M00 and M01: wait until the counter of confirmations grows."""

    def __init__(self, seen: int) -> None:
        self.seen = seen
        self.passed = False

    def before(self, left: float, held: bool) -> float | None:
        return left if self.passed and not held else None


class NextCycle(Barrier):
    """Try the entry again in the next cycle."""

    def __init__(self, cycle: Cycle) -> None:
        self._cycle = cycle
        self._number = cycle.number

    def after(self, held: bool) -> bool:  # noqa: ARG002
        return self._cycle.number != self._number
