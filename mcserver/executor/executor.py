"""The executor: one call is one cycle, on any clock.

In a cycle: read the mailbox; advance every program's u and set its axes' setpoints; exchange with the drives;
check for faults; check barriers with the fresh feedback; publish the cycle's feedback.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from mcserver.drives.bus import DriveBus, DriveMode
from mcserver.drives.io_bus import IoBus
from mcserver.executor.axes import AxisBank
from mcserver.executor.barriers import Dwell, InputWait
from mcserver.executor.bed_mesh import BedMesh
from mcserver.executor.block import Block
from mcserver.executor.block_playing import play_block
from mcserver.executor.coupling import Coupling
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import Array, EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.holding import stop_independent
from mcserver.executor.independent import IndependentMotions
from mcserver.executor.io_bank import IoBank
from mcserver.executor.process_start import StoredReference
from mcserver.executor.shm.event_ring import EventRing
from mcserver.executor.shm.feedback import (
    CYCLE,
    ESTOP,
    INTERLOCK,
    LATE,
    LINE,
    TIME,
    FeedbackRing,
    FeedbackRow,
    SlotState,
)
from mcserver.executor.shm.mailbox import CommandMailbox
from mcserver.executor.shm.rings import ProgramRing
from mcserver.executor.slot import ProgramSlot
from mcserver.executor.supervision import Supervision
from mcserver.machine.machine_file import Machine

# Flag beside the bits of the columns to reset: a reset was requested.
_RESET_ASKED = 1 << 64
# Longest time in which a simulated drive energizes [cycles].
ASSUME_CYCLES = 10_000


class Executor:
    """Plays programs on drives.

    Args:
        machine: its axes are the columns of all arrays.
        buses: together they drive every column once; `boot` is called here.
        rings: one for each slot; the executor is their reader.
        mailbox, feedback, events: shared with the server.
        references: of axes, from an earlier start, by axis number. assume_homed: every axis counts as homed.

    Attributes:
        time: executor time of the latest cycle [s]. late_cycles: cycles that were missed, set by the clock.
    """

    def __init__(
        self,
        machine: Machine,
        buses: Sequence[DriveBus],
        rings: Sequence[ProgramRing],
        mailbox: CommandMailbox,
        feedback: FeedbackRing,
        events: EventRing,
        *,
        references: Mapping[int, StoredReference] | None = None,
        assume_homed: bool = False,
    ) -> None:
        self.machine = machine
        inputs, outputs = len(machine.inputs), len(machine.outputs)
        self._row = FeedbackRow(len(machine.axes), inputs, outputs)
        self.bank = AxisBank(machine, buses, self._row)
        self.motions = IndependentMotions(machine, self._row)
        on_buses = [bus for bus in self.bank.buses if isinstance(bus, IoBus) and (bus.inputs or bus.outputs)]
        self._io = IoBank(machine, self._row, on_buses)
        self._has_io = bool(inputs or outputs)
        # inputs that held the machine in the last cycle
        self._holding: tuple[int, ...] = ()
        self._cycle = Cycle(machine, self.bank, self.motions, self._io, events, assume_homed=assume_homed)
        self._cycle.bed = BedMesh.of(machine, self.bank.compensator)
        self._cycle.homed.restore(references or {})
        self._slots = tuple(ProgramSlot(index, ring, self._cycle) for index, ring in enumerate(rings))
        # slots that have had a program; only these take time
        self._used: list[ProgramSlot] = []
        self._supervision = Supervision(self._cycle, self._slots, feedback)
        self._cycle.shifted += [self._supervision.shift, self._cycle.profiled.shift]
        self._cycle.shifted += [slot.playback.shift for slot in self._slots]
        self._mailbox = mailbox
        self._feedback = feedback
        self._changes = -1
        self._stop_seen = self._reset_seen = 0
        self._estop_seen = mailbox.estop
        self._reset_wanted = 0
        self._reset_estop = self._estop_seen
        self._hold = False
        self._override = 1.0
        # lines of the latest cycles: the shaped path is later than its rows
        self._lines = deque([0], maxlen=1 if self.bank.shaper is None else self.bank.shaper.delay + 1)
        self._longest_cycle = machine.stall_limit_s + 1.5 * machine.cycle_s
        self.late_cycles = 0

    @property
    def time(self) -> float:
        return self._cycle.time

    @property
    def at_rest(self) -> bool:
        """Whether no program runs, no axis moves to a position by itself, and every output is set."""
        running = any(slot.running for slot in self._slots)
        moving = self.motions.mask & ~self.motions.speeding | self._cycle.settling
        return not (running or moving or self.bank.starting) and self._io.settled

    def u(self, slot: int) -> float:
        """Return u of the program in a slot [cycles]."""
        return self._slots[slot].u

    def line(self) -> int:
        """Return the line that set the latest cycle's row; 0: none."""
        return self._lines[0]

    @property
    def row(self) -> FeedbackRow:
        """Setpoints and feedback of the latest cycle."""
        return self._row

    def cycle(self, time: float) -> None:
        """Run one cycle; ``time``: executor time [s]."""
        cycle = self._cycle
        elapsed, cycle.time = time - cycle.time, time
        if elapsed > self._longest_cycle:
            self._stall(elapsed)
        self._read_mailbox()
        if self._io.zones:
            self._hold_before_zones()
        self._advance()
        self._supervision.before_exchange()
        if cycle.couplings.engaged:
            self._supervision.lead_coupled()
        if cycle.gantries.pairs:
            cycle.gantries.follow()
        for slot in self._used:
            if slot.guard is not None and slot.running:
                slot.guard.before_exchange(slot)
        if self.bank.shaper is not None:
            self.bank.shaper.shape()
            for slot in self._used:
                slot.do_put_off()
        if self._has_io:
            self._io.before_exchange(self._path_speeds)
        profiled = cycle.profiled
        if profiled.mask:
            profiled.before_exchange()
        if cycle.feed_forward is not None:
            cycle.feed_forward.before_exchange()
        if self.bank.compensator is not None:
            self.bank.compensator.homed = self.bank.masks.bools(cycle.homed.mask)
        self.bank.exchange()
        if profiled.mask:
            profiled.after_exchange()
        cycle.note_readings()
        if self._has_io:
            self._read_inputs()
            if cycle.couplings.works:
                cycle.couplings.works.note(self._io)
        self._supervision.after_exchange()
        self._supervision.report_events()
        for slot in self._used:
            if slot.barrier is not None:
                slot.settle()
        if cycle.estop or self._reset_wanted:
            self._care_for_latches()
        self._report()
        cycle.number += 1

    def assume(
        self, *, energized: int, homed: int, inputs: Sequence[float], outputs: Sequence[float]
    ) -> None:
        """Set the machine's state at the start of a simulation, before its first cycle.

        Args:
            energized, homed: masks of columns. inputs, outputs: values; empty: those of the machine file.

        Raises:
            RuntimeError: a drive does not energize.
        """
        bank, cycle = self.bank, self._cycle
        cycle.homed.lose(bank.all & ~homed, absolute_too=True)
        self._io.assume(inputs, outputs)
        if not energized & ~bank.energized:
            return
        bank.power(energized, DriveMode.POSITION)
        for _ in range(ASSUME_CYCLES):
            if not energized & ~bank.energized:
                return
            self.cycle(self.time)
        raise RuntimeError("a simulated drive does not energize")

    def mount(self, tool: int) -> None:
        """Set the tool in the spindle from this cycle on, 0: none."""
        if self.bank.shaper is not None:
            self.bank.shaper.choose(tool)

    def play_block(self, time: float, limit: int) -> Block | None:
        """Play several cycles of the one program that runs, with the same results as `cycle`.

        A single cycle has to follow. Only for simulated drives on a virtual clock.

        Args:
            time: executor time of the first cycle [s]. limit: most cycles.

        Returns:
            The cycles played; None where the next cycle has to be played singly.
        """
        if self.bank.shaper is not None or self.bank.pairs or self._cycle.couplings.engaged:
            # shapers, gantries and couplings act in each cycle
            return None
        running = [slot for slot in self._used if slot.running]
        quiet = self._mailbox.changes == self._changes and self._mailbox.estop == self._estop_seen
        if len(running) != 1 or not quiet or self._cycle.estop or self._reset_wanted:
            return None
        slot = running[0]
        if slot is not self._used[0] or slot.guard is not None or not self._supervision.quiet:
            return None
        rates = self._motion_rates()
        block = play_block(self._cycle, slot, self._supervision, rates, time, limit)
        if block is not None:
            self._feedback.skip(len(block.lines))
            self._lines.append(self._line())
        return block

    def _path_speeds(self, slot: int, axes: int) -> Array:
        """Return the path speed of axes of a slot in this cycle, shape (1,)."""
        velocity = self._row.velocity
        if self.bank.shaper is not None:
            # the work moves with the superimposed motion, so it is no path speed
            velocity = velocity - self.bank.shaper.added_velocity
        return self._slots[slot].path_speeds(velocity[None], axes)

    def stop_all(self, code: FaultCode | None = None) -> None:
        """Stop all motion within its limits, and report why; axes stay energized."""
        if code is not None:
            self.warn(code)
        self._stop(SlotState.STOPPED if code is None else SlotState.FAULTED)

    def warn(self, code: FaultCode) -> None:
        """Report a fault of the machine as a whole."""
        self._cycle.fault(code, -1, 0)

    @property
    def timed(self) -> bool:
        """Whether a program waits at a dwell or for an input."""
        return any(isinstance(slot.barrier, Dwell | InputWait) for slot in self._used if slot.running)

    @property
    def couplings(self) -> tuple[Coupling, ...]:
        """Those in force, of axes and tools that follow others."""
        return self._cycle.couplings.engaged

    @property
    def standing(self) -> bool:
        """Whether no program runs and nothing is commanded to move, speeds included."""
        return not (self.motions.mask | self._cycle.settling) and not any(
            slot.running for slot in self._slots
        )

    def _read_inputs(self) -> None:
        """Read the inputs of this cycle, and hold or stop the machine as they require."""
        io, cycle = self._io, self._cycle
        io.after_exchange(cycle.time)
        if io.lost:
            for column in io.lost:
                cycle.fault(FaultCode.IO_LOST, -1, 0, values=(float(column), 0.0))
            self._fault_all(FaultCode.IO_LOST, (float(io.lost[0]), 0.0))
        if io.holding != self._holding:
            for column in set(io.holding) - set(self._holding):
                cycle.fault(FaultCode.INTERLOCK_HOLD, -1, 0, values=(float(column), io.value(column)))
            for column in set(self._holding) - set(io.holding):
                cycle.fault(FaultCode.INTERLOCK_FREE, -1, 0, values=(float(column), io.value(column)))
            self._holding = io.holding
            if io.holding:
                # motion without a program could not be resumed: stop it
                stop_independent(cycle, self.bank.all & ~self._owned(), -1)
        if io.holding:
            for slot in self._used:
                if slot.running:
                    slot.interlocked = True
        if io.stopping and not cycle.estop:
            self._latch_estop(FaultCode.INTERLOCK_STOP, (float(io.stopping[0]), io.value(io.stopping[0])))

    def _hold_before_zones(self) -> None:
        """Hold programs whose motion enters zones that are on, or is in them."""
        io, cycle = self._io, self._cycle
        met = [slot for slot in self._used if slot.zones_on]
        for slot in met:
            if slot.running and not slot.interlocked:
                column, bit = io.switching(slot.zones_on)
                values = (float(column), float(bit))
                # on a resume while the zone is still on: before anything has moved
                cycle.emit(
                    EventKind.FAULT,
                    slot.index,
                    slot.line,
                    code=FaultCode.ZONE_HOLD,
                    token=slot.moves,
                    values=values,
                )
                slot.interlocked = True
        unowned = self.bank.all & ~self._owned() & self.motions.mask if met else 0
        if unowned:
            # motion without a program could not be resumed: stop it
            stop_independent(cycle, unowned, -1)

    def _stall(self, seconds: float) -> None:
        """End all motion on the spot: drives got no setpoint for longer than they bridge.

        The commanded position has stood still meanwhile, whatever its speed was, and the drives hold or have
        failed. Going on at speed would be a step of velocity; going on from rest would leave a mark in the
        work, after a time in which neither holds nor inputs were read. So it is a fault.
        """
        cycle, limit = self._cycle, self.machine.stall_limit_s
        self.bank.stall(round(seconds / cycle.cycle_s) - 1)
        cycle.fault(FaultCode.CYCLE_STALLED, -1, 0, values=(seconds, limit))
        for slot in self._slots:
            slot.stall(seconds, limit)
        stopped = [each for each in cycle.couplings.engaged if not self._slots[each.slot].goes_on]
        # what was added to setpoints counts as ordered first: they are let go in the next cycle
        cycle.couplings.forget(sum(each.axes for each in stopped) & cycle.couplings.mask)
        unowned = self.bank.all & ~self._owned()
        self.motions.rest(unowned)
        stop_independent(cycle, unowned, -1)
        if self.bank.shaper is not None:
            cycle.couplings.rest()
            self.bank.shaper.rest(self.bank.masks.bools(self.bank.all & ~self.bank.speed))

    def _fault_all(self, code: FaultCode, values: tuple[float, ...]) -> None:
        """Stop all motion within its limits, for a fault of every program."""
        for slot in self._slots:
            if slot.running:
                slot.fault(code, slot.line, -1, values)
        self._stop(SlotState.FAULTED)

    def close(self) -> None:
        """De-energize every drive and close the buses."""
        # break reference cycles: the garbage collector is off in the executor's process
        self._cycle.shifted.clear()
        self._cycle.couplings.forget(self.bank.all)
        self._io.make_safe()
        self._io.before_exchange(self._path_speeds)
        self.bank.close()

    # ------------------------------------------------------------------ orders

    def _read_mailbox(self) -> None:
        mailbox = self._mailbox
        estop = mailbox.estop
        if estop != self._estop_seen:
            self._estop_seen = estop
            self._latch_estop()
        changes = mailbox.changes
        if changes == self._changes:
            return
        self._changes = changes
        machine = mailbox.machine_orders()
        if machine.reset != self._reset_seen:
            self._reset_seen = machine.reset
            self._reset_wanted |= machine.reset_mask & self.bank.all | _RESET_ASKED
            self._reset_estop = machine.reset_estop
            # orders of programs and outputs in this cycle came after it
            self._care_for_latches()
        if self._has_io:
            self._io.obey(mailbox, locked=self._cycle.estop)
        self._hold, self._override = machine.hold, machine.override
        for slot in self._slots:
            orders = mailbox.slot_orders(slot.index)
            if orders.generation != slot.generation:
                if slot.running or self._owned() & orders.axes or orders.axes & ~self.bank.all:
                    slot.refuse(orders)
                else:
                    slot.open(orders)
                    if self._io.holding:
                        slot.interlocked = True
                    if self._io.missing >= 0:
                        slot.fault(FaultCode.IO_LOST, 0, -1, (float(self._io.missing), 0.0))
                if slot not in self._used:
                    self._used.append(slot)
            if slot.running:
                slot.obey(orders, machine, self._owned() & ~slot.axes)
        if machine.stop != self._stop_seen:
            self._stop_seen = machine.stop
            self._stop(SlotState.STOPPED)

    def _stop(self, state: SlotState) -> None:
        self._io.make_safe()
        owned = self._owned()
        for slot in self._slots:
            if slot.running:
                slot.stop(state)
        stop_independent(self._cycle, self.bank.all & ~owned, -1)

    def _owned(self) -> int:
        """Return the columns of running programs."""
        owned = 0
        for slot in self._slots:
            if slot.running:
                owned |= slot.axes
        return owned

    def _latch_estop(
        self, code: FaultCode = FaultCode.EMERGENCY_STOP, values: tuple[float, ...] = ()
    ) -> None:
        if self._cycle.estop:
            return
        self._cycle.estop = True
        self._cycle.fault(code, -1, 0, values=values)
        self._fault_all(code, values)

    def _care_for_latches(self) -> None:
        """De-energize axes that have come to rest in an emergency stop; then carry out requested resets."""
        bank, stopping = self.bank, self._owned()
        if self._cycle.estop:
            moving = bank.both(self.motions.mask | self._cycle.settling)
            still = (bank.energized | bank.starting) & ~stopping & ~moving
            if still:
                bank.off(still)
        if self._reset_estop < self._estop_seen:
            # requested before the latest stop, which it does not reset
            self._reset_wanted = 0
        elif self._reset_estop > self._estop_seen:
            # a stop that came before the reset is seen in the next cycle
            return
        if self._io.stopping:
            # the cause of the stop is still there
            self._reset_wanted = 0
        if self._reset_wanted and not (self._cycle.estop and (stopping or self.motions.mask)):
            mask = self._reset_wanted & bank.fault
            self._reset_wanted = 0
            self._cycle.estop = False
            if mask:
                bank.reset(mask)

    # ------------------------------------------------------------------ the cycle

    def _advance(self) -> None:
        for slot in self._used:
            slot.prepare()
        self.motions.advance(self._motion_rates())
        for slot in self._used:
            slot.advance()

    def _motion_rates(self) -> dict[int, float]:
        """Return the rates of position motions by slot; -1: the machine's, for those without a program."""
        if not self.motions.mask:
            return {}
        rates = {slot.index: slot.rapid_rate for slot in self._slots}
        rates[-1] = 0.0 if self._hold else min(1.0, self._override)
        return rates

    def _line(self) -> int:
        return next((slot.shown_line for slot in self._used if slot.shown_line), 0)

    def _report(self) -> None:
        cells = self._row.cells
        active = self.motions.mask | self._cycle.settling
        for slot in self._used:
            active |= slot.playback.active
            self._row.set_slot(slot.index, slot.u, slot.ramp.rate, slot.state, slot.generation)
        self.bank.show_conditions(self.bank.both(active))
        cells[TIME] = self._cycle.time
        cells[CYCLE] = self._cycle.number
        cells[LATE] = self.late_cycles
        self._lines.append(self._line())
        cells[LINE] = self.line()
        cells[ESTOP] = self._cycle.estop
        if self._has_io:
            cells[INTERLOCK] = bool(self._io.holding) or any(
                slot.running and slot.interlocked for slot in self._used
            )
        self._row.set_homed(self._cycle.homed.mask)
        self._feedback.put(self._row.row)
        self._mailbox.beat_executor()
