"""What a program's time axis can stand at: each barrier says when it is passed.

A barrier is asked twice a cycle. Before the exchange with the drives it may be passed in the midst of the
cycle, so that what needs no drive costs no cycle; after the exchange it sees fresh feedback.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mcserver.executor.coupling import Coupling
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import Array
from mcserver.executor.fault_codes import FaultCode, code_of_drive_fault
from mcserver.motion.canonical import WaitMode

# A drive that does not follow its command within this time is at fault [s].
DRIVE_TIMEOUT_S = 5.0
NEAR_ZERO = 1e-12
# Within which a coupled axis comes into step with its leader [s].
STEP_TIMEOUT_S = 10.0


class BarrierFault(Exception):
    """The barrier cannot be passed: the program is at fault."""

    def __init__(self, code: FaultCode, column: int, values: tuple[float, ...] = ()) -> None:
        super().__init__(code.name)
        self.code = code
        self.column = column
        self.values = values


class Barrier:
    """One reason for u to stand."""

    @property
    def in_thread(self) -> bool:
        """Whether its axes follow a spindle now: a tool is in a thread, or on its way into one."""
        return False

    def before(self, left: float, held: bool) -> float | None:  # noqa: ARG002
        """Return how much of the cycle is left once this is passed [cycles]; None: it stands.

        Args:
            left: what is left of the cycle at the moment from which the barrier counts.
        """
        return None

    def after(self, held: bool) -> bool:  # noqa: ARG002
        """Return whether it is passed, by fresh feedback.

        Raises:
            BarrierFault: it will never be.
        """
        return False

    def idle_cycles(self, limit: int) -> int:  # noqa: ARG002
        """Return in how many of the next cycles, up to ``limit``, it surely stands and nothing but time
        passes: without a feed hold, and while no motion ends and no drive or input changes.
        """
        return 0

    def skip(self, cycles: int) -> None:  # noqa: ARG002
        """Let such cycles pass."""
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
        """Return what remains after each of the next cycles, subtracted one by one, shape (cycles,) [s]."""
        steps = np.full(cycles + 1, self._cycle.cycle_s)
        steps[0] = self._remaining
        return np.asarray(np.subtract.accumulate(steps)[1:])


class AtRest(Barrier):
    """Independent motion of some axes has ended; speeds that are held do not count.

    Args:
        exchanged: the drives have to have got the last setpoints.
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
    """Shaped setpoints have come to where axes were ordered, and what was put off to them is done.

    Args:
        settled: whether that is so.
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
        # u goes on with the next cycle: rows stand at whole u, and are played as they are only while u is
        # whole at each cycle
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
        """Whether the encoder has been within tolerance of the target for the configured cycles, this one
        included.
        """
        cycle = self._cycle
        distance = abs(cycle.history[:, column] - cycle.ordered(column))
        return bool((distance <= tolerance).all())

    def _distance(self, column: int) -> float:
        """How far the encoder is from its target in this cycle, in the frame in which the program works."""
        cycle = self._cycle
        reading = cycle.history[cycle.number % len(cycle.history), column]
        return abs(float(reading - cycle.ordered(column)))


class InStep(Barrier):
    """An axis that has been coupled has come to where its leader has it."""

    def __init__(self, cycle: Cycle, coupling: Coupling) -> None:
        self._cycle = cycle
        self._coupling = coupling
        self._waited = 0.0

    def before(self, left: float, held: bool) -> float | None:  # noqa: ARG002
        return left if self._coupling.in_step else None

    def after(self, held: bool) -> bool:
        if self._coupling.waits:
            # a work comes when it comes
            return False
        self._waited += 0.0 if held else self._cycle.cycle_s
        if self._waited > STEP_TIMEOUT_S:
            code, values = self._coupling.out_of_step()
            raise BarrierFault(code, self._coupling.column, values)
        return False


class DriveWait(Barrier):
    """Drives have done what they were told; they have a time for it."""

    def __init__(self, cycle: Cycle, axes: int) -> None:
        self._cycle = cycle
        self._axes = axes
        self._waited = 0.0

    @property
    def _missing(self) -> int:
        """Columns of drives that have not done it."""
        raise NotImplementedError

    def _late(self, column: int) -> BarrierFault:
        """Return the fault of the first of them when their time is over."""
        raise NotImplementedError

    def _not_cleared(self, column: int) -> BarrierFault:
        fault, detail = self._cycle.bank.reported_fault(column)
        if fault:
            # such as a node that was stopped: it hears no reset
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
        # nobody waits for them any more: none must begin to hold by itself later
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
    """M66: until a digital input is as its mode says.

    The time-out passes like a dwell: not in feed hold. The input's edges count there, too.

    Args:
        report: called as it is passed, with the input's value and the seconds waited.
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
    """M00 and M01: until the counter of confirmations grows."""

    def __init__(self, seen: int) -> None:
        self.seen = seen
        self.passed = False

    def before(self, left: float, held: bool) -> float | None:
        return left if self.passed and not held else None


class NextCycle(Barrier):
    """The entry is tried again in each cycle."""

    def __init__(self, cycle: Cycle) -> None:
        self._cycle = cycle
        self._number = cycle.number

    def after(self, held: bool) -> bool:  # noqa: ARG002
        return self._cycle.number != self._number
