"""One program in the executor: its time axis u, its control entries, its rate.

A cycle lets u pass by the rate. Control entries on the way are passed at their exact moments; one that has to
wait puts up a barrier, and u stands there. ``left`` is what remains of the cycle at that moment, in
cycles: 1 at its beginning, 0 at the exchange with the drives.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.barriers import Barrier, Paused, Settled
from mcserver.executor.block import LineEvents, Passing, passing_cycles, passing_times
from mcserver.executor.control_queue import WAITING, ControlQueue
from mcserver.executor.control_rules import pass_control
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import Array, Control, ControlKind, EventKind
from mcserver.executor.envelope import EnvelopeGuard
from mcserver.executor.fault_codes import BarrierFault, FaultCode
from mcserver.executor.holding import stop_independent
from mcserver.executor.playback.playback import Playback
from mcserver.executor.playback.rate_control import RateControl
from mcserver.executor.shaped_entries import AT_THEIR_PLACE, GOING_ON, ShapedEntries
from mcserver.executor.shm.feedback import SlotState
from mcserver.executor.shm.mailbox import MachineOrders, SlotOrders
from mcserver.executor.shm.rings import ProgramRing
from mcserver.motion.kernels.rate_changes import NEAR_U

# This close to an edge u is put onto it [cycles]: at 1 m/s that is a nanometre, of a jerk of 1 m/s³ at 1 kHz.
LANDING = 1e-6
# Rows that a motion begins, or goes on, with at the least while its end is not known.
START_ROWS = 16.0
# A rate below this is standstill [1].
STANDSTILL = 1e-6

_ALWAYS = (ControlKind.LINE_END, ControlKind.END, ControlKind.PASSED)
# What a stop passes on its way: axes that join the motion keep the others on the path.
_IN_A_STOP = (*_ALWAYS, ControlKind.LINE_START, ControlKind.BEGIN)


class ProgramSlot:
    """One slot and the program in it.

    Attributes:
        index: of the slot. axes: mask of the columns that the program may move; at a pause only of those that
            move by themselves, the others are for whoever is to move them meanwhile.
        u: on the program's time axis [cycles]. running: a program is played, or being stopped.
        line: of the line under way, 0 for none. shown_line: the line that set this cycle's row.
        override: the feed override in force, 1 as programmed.
        interlocked: an input holds the program, or has held it and nobody has resumed it since.
    """

    def __init__(self, index: int, ring: ProgramRing, cycle: Cycle) -> None:
        self.index = index
        self.cycle = cycle
        self.ring = ring
        self.playback = Playback(ring, cycle.row, cycle.bank.masks, cycle.machine)
        self._queue = ControlQueue(ring, self.playback)
        self.ramp = RateControl(ring, self.playback, cycle.machine)
        self.rapid_rate = 1.0
        self.axes = 0
        self.u = 0.0
        self._state = SlotState.IDLE
        self.running = False
        self.line = 0
        self.shown_line = 0
        # holds an approved run within its envelope; None: nobody has to approve what runs here
        self.guard: EnvelopeGuard | None = None
        self._put_off = ShapedEntries(cycle.bank.shaper)
        self.generation = 0
        self.orders: SlotOrders | None = None
        self._begin(0)

    def _begin(self, base: int) -> None:
        self._queue.open(base)
        self._put_off.clear()
        self.barrier: Barrier | None = None
        # least positions of streamed targets that come next
        self.follow_from: tuple[float, ...] | None = None
        self.pending: Control | None = None
        self._started = False
        self._left = -1.0
        self._mean_rate = 0.0
        # columns that an entry under way energizes; whether it has acted on the drives
        self.captured = 0
        self.acted = False
        # entries known as the ring ran dry; None: it has not
        self._starved: int | None = None
        self._held = False
        self._stop_state = SlotState.STOPPED
        self._stop_line = 0
        self._in_thread = False
        self.override = 1.0
        self._hold = False
        self.interlocked = False
        self._resumes: tuple[int, int] | None = None

    # ------------------------------------------------------------------ opening and orders

    @property
    def state(self) -> SlotState:
        """For feedback."""
        return self._state

    @state.setter
    def state(self, state: SlotState) -> None:
        if state is not self._state:
            self._state = state
            self.running = not state.free

    def open(self, orders: SlotOrders) -> None:
        """Begin a new program; nothing that was put for another one is played."""
        self._begin(orders.controls_base)
        guard = EnvelopeGuard(orders.envelope, self.cycle, self.ring) if orders.envelope else None
        self.guard = self.playback.guard = guard
        self.playback.open(orders.rows_base)
        self.ring.free_rows(orders.rows_base)
        self.ring.free_controls(orders.controls_base)
        self.axes = orders.axes
        self.generation = orders.generation
        self.u = 0.0
        self.line = self.shown_line = 0
        self.orders = None
        self.state = SlotState.RUNNING

    def refuse(self, orders: SlotOrders) -> None:
        """Fault a program that cannot be opened, before it begins."""
        self.generation = orders.generation
        # a program that runs here has lost its rows to the other one: its axes stand where they are
        self.playback.leave(self.playback.active)
        self._queue.open(orders.controls_base)
        self.playback.open(orders.rows_base)
        self.axes = 0
        self.state = SlotState.FAULTED
        self.cycle.fault(FaultCode.SLOT_REFUSED, self.index, 0)
        self.cycle.emit(EventKind.STOPPED, self.index, 0)

    def obey(self, orders: SlotOrders, machine: MachineOrders, others: int) -> None:
        """Take the newest orders for this generation; ``others``: mask of the columns of other programs."""
        seen = self.orders
        self.orders = orders
        self._hold = orders.hold or machine.hold
        self.override = orders.override * machine.override
        resumes = (orders.resume, machine.resume)
        if resumes != self._resumes and not self.cycle.io.holding:
            self.interlocked = False
        self._resumes = resumes
        if not self._started:
            self.rapid_rate = self._ordered_rate(1.0)
            self.ramp.jump(self.rapid_rate)
        if orders.abort != (seen.abort if seen else 0):
            self.stop(SlotState.STOPPED)
        barrier = self.barrier
        if isinstance(barrier, Paused) and orders.confirm != barrier.seen and not barrier.passed:
            if orders.axes & ~self.axes & others:
                self.fault(FaultCode.SLOT_REFUSED, self.line)
                return
            barrier.passed = True
            self.axes = orders.axes

    @property
    def lends(self) -> bool:
        """Whether others may move some of the program's columns now."""
        return isinstance(self.barrier, Paused) and not self.barrier.passed

    def lend(self) -> int:
        """Let others move the columns that are at rest, until the pause is confirmed; return their mask."""
        bank, moving = self.cycle.bank, self.cycle.motions.mask | self.playback.active
        lent = self.axes & ~(moving | bank.speed | bank.torque_mode | self.cycle.couplings.tied)
        self.axes &= ~lent
        return lent

    @property
    def held(self) -> bool:
        """Feed hold is asked for, by an order or by an input."""
        return self._hold or self.interlocked

    @property
    def zones_on(self) -> int:
        """Bits of the switched zones that lie ahead and are on."""
        return self.cycle.io.zones & self.ring.zones_ahead

    def _ordered_rate(self, feed_scale: float) -> float:
        """Return the rate at which rows of a feed scale are to be played, 0 to 1."""
        if self.held or self._state is SlotState.STOPPING:
            return 0.0
        return min(self.override / feed_scale, 1.0)

    def path_speeds(self, velocity: Array, axes: int) -> Array:
        """Return the speeds of some of its axes together along the path of a line, 0 where they rest, move by
        themselves, or are on the way to the first line, shape (n,) [m/s or rad/s].

        Args:
            velocity: of cycles, shape (n, K). axes: mask of columns; 0: all that it moves.
        """
        playback = self.playback
        driven = playback.active if playback.line else 0
        if self.cycle.bank.shaper is not None:
            driven = self._put_off.driven
        if not driven:
            return np.zeros(len(velocity))
        columns = self.cycle.bank.masks.bools(driven & (axes or driven))
        speeds: Array = np.sqrt(np.square(velocity[:, columns]).sum(axis=-1))
        return speeds

    # ------------------------------------------------------------------ stopping

    def stop(self, state: SlotState) -> None:
        """Ramp down along the path, then drop all that is left and enter ``state``."""
        if not self.running:
            return
        if self._state is not SlotState.STOPPING:
            self.state = SlotState.STOPPING
            self._stop_line = self.line
            self._stop_state = state
            self._in_thread = self.barrier is not None and self.barrier.in_thread
            self.barrier = None
            self.pending = None
            self.cycle.io.make_safe(self.index)
            self._put_off.drop_outputs()
            self.cycle.couplings.uncouple(self.cycle.couplings.superimposed(self.index))
            mask = self.cycle.motions.owned_by(self.index) | self.axes & ~self.cycle.motions.mask
            # what follows others stops with these
            stop_independent(self.cycle, mask & ~self.cycle.couplings.mask, self.index)
        elif state is SlotState.FAULTED:
            self._stop_state = state

    def fault(self, code: FaultCode, line: int, column: int = -1, values: tuple[float, ...] = ()) -> None:
        """Report a fault and stop the program."""
        self.cycle.fault(code, self.index, line, column, values)
        self.stop(SlotState.FAULTED)

    def stall(self, seconds: float, limit: float) -> None:
        """End the program where it is: the drives got no setpoint for a time, and stand.

        One that is held, or has nothing that moves (paused, or out of lines), goes on.
        """
        motions = self.cycle.motions
        if not self.running or not self._started or not self.moves:
            return
        motions.rest(motions.owned_by(self.index))
        # from rest in real time: the next setpoint is the last one
        self.ramp.jump(0.0)
        self.fault(FaultCode.CYCLE_STALLED, self.line, -1, (seconds, limit))
        if self.cycle.bank.shaper is not None:
            # drives stand behind the rows: these are not gone to any more
            self.playback.leave(self.playback.active)

    @property
    def goes_on(self) -> bool:
        """Whether a program is played, and not being stopped."""
        return self.running and self._state is not SlotState.STOPPING

    @property
    def moves(self) -> bool:
        """Whether axes are on their way; not while the program is held, or waits."""
        on_the_way = self.playback.active or self.cycle.motions.owned_by(self.index) or self._settling
        return bool(on_the_way) and self._state is not SlotState.HELD

    def lose(self, column: int) -> None:
        """Take axis ``column``, which has faulted, out of the program's motion."""
        self.playback.leave(1 << column)
        self.cycle.motions.drop(1 << column)

    def _finish_stop(self) -> None:
        cycle = self.cycle
        if cycle.motions.mask & cycle.motions.owned_by(self.index) or self.playback.active:
            return
        if self._put_off or self._settling:
            return
        self.state = self._stop_state
        self.line = 0
        self._drop()
        cycle.emit(EventKind.STOPPED, self.index, self._stop_line, token=int(self._in_thread))

    def _drop(self) -> None:
        self.playback.drop()
        self._queue.drop()
        self._put_off.clear()

    # ------------------------------------------------------------------ the cycle

    def prepare(self) -> None:
        """Note new entries and step the rates of this cycle, before independent motion advances."""
        self._mean_rate = 0.0
        if not self.running:
            return
        self._queue.note(self.u)
        self._left = 1.0
        if not self._started:
            nothing = self._queue.head is None and self.playback.empty
            if nothing and self.state is not SlotState.STOPPING:
                self._left = -1.0
                return
            # the first cycle plays u = 0
            self._started = True
            self._left = 0.0
        self._mean_rate = self._step_rate()

    def advance(self) -> None:
        """Advance u by one cycle and set the setpoints for the exchange with the drives."""
        self.shown_line = self.line
        if not self.running or self._left < 0.0:
            return
        self._run(self._left, self._mean_rate)
        if self.playback.active:
            self.playback.play(self.u, self.ramp.rate)
            self.shown_line = self.playback.line or self.line
            if self.playback.unchecked:
                self._check_first_row()
            # a cycle at rest first: drives see the last setpoint before they are switched off
            stands = self.ramp.rate <= STANDSTILL and self._mean_rate <= STANDSTILL
            if self._state is SlotState.STOPPING and stands:
                self.playback.leave(self.playback.active)
        elif self.line:
            self.shown_line = self.line
        self.playback.note(self.cycle.row.ordered[None])
        if self._state is SlotState.STOPPING:
            self._finish_stop()
        elif self.running:
            self._note_state()

    # ------------------------------------------------------------------ blocks of cycles

    def idle_cycles(self, limit: int) -> int:
        """Return how many of the next cycles, up to ``limit``, play one row each, or stand at a barrier.

        They pass no entry but where lines begin and end and where outputs change.
        """
        if self._state is not SlotState.RUNNING or not self._started or self._starved is not None:
            return 0
        if self.held or self.override != 1.0:
            return 0
        queue = self._queue
        if self.barrier is not None:
            queue.note()
            return 0 if self.playback.active else self.barrier.idle_cycles(limit)
        if not self.playback.active or self.playback.at_start or not self.ramp.steady:
            return 0
        if self.u != round(self.u):
            return 0
        queue.note()
        self.playback.seek(self.u)
        edge, _ = queue.edge(self.u)
        if edge is not None:
            limit = min(limit, self.ramp.rows_before(self.u, edge))
        return self.playback.whole_rows(self.u, min(limit, queue.edges_until(self.u, limit)))

    def ahead(self, count: int, setpoint: Array, velocity: Array) -> NDArray[np.int64]:
        """Write what `advance` would set in the next cycles, ``count`` of its `idle_cycles`.

        Args:
            setpoint, velocity: shape (count, K); written in the columns that rows drive.

        Returns:
            The lines that are shown, shape (count,).
        """
        if self.barrier is None:
            return self.playback.ahead(count, setpoint, velocity)
        return np.full(count, self.line)

    def skip(self, setpoints: Array, time: float) -> Passing:
        """Let cycles pass, some of the `idle_cycles`.

        Args:
            setpoints: of them, shape (n, K). time: executor time of the first one [s].

        Returns:
            What was passed, of which nothing has been reported or set.
        """
        if self.barrier is not None:
            self.barrier.skip(len(setpoints))
            self.playback.note(setpoints)
            self.shown_line = self.line
            return Passing(LineEvents.none(self.index))
        start, cycle_s = self.u, self.cycle.cycle_s
        self.u = start + len(setpoints)
        taken = self._queue.take_until(self.u + NEAR_U)
        times = passing_times(taken.u, start, round(time / cycle_s), cycle_s)
        cycles = passing_cycles(taken.u, start)
        edges = taken.kind <= ControlKind.LINE_END
        events = LineEvents(
            self.index, taken.line[edges], times[edges], taken.kind[edges] == ControlKind.LINE_END
        )
        if len(events):
            self.line = events.line_after(self.line)
        self.playback.skip(self.u, setpoints)
        self.shown_line = self.playback.line
        return Passing(events, tuple((int(cycles[at]) - 1, each) for at, each in taken.outputs.items()))

    def finish(self, line: int, left: float) -> None:
        """End the program; axes that move by themselves go on."""
        self.state = SlotState.FINISHED
        self.line = 0
        self.cycle.motions.disown(self.index)
        self.cycle.io.disown(self.index)
        self._drop()
        self.cycle.emit(EventKind.FINISHED, self.index, line, left)

    def settle(self) -> None:
        """Look at the barrier with the feedback of this cycle's exchange."""
        while self.barrier is not None and self.running:
            try:
                if not self.barrier.after(self._held):
                    return
            except BarrierFault as fault:
                line = self.pending.line if self.pending else self.line
                self.fault(fault.code, line, fault.column, fault.values)
                return
            self._clear_barrier(0.0)
            self._run(0.0, 0.0)

    def _run(self, left: float, rate: float) -> None:
        """Let what is left of the cycle pass: control entries on the way, then u."""
        reach = self._reach(self.u + rate * left)
        while True:
            barrier = self.barrier
            if barrier is not None:
                rest = barrier.before(left, self._held)
                if rest is None:
                    return
                self._clear_barrier(rest)
                if rest != left:
                    left = rest
                    reach = self._reach(self.u + rate * left)
                continue
            if not self.running:
                return
            control = self._queue.head
            if control is None:
                break
            if control.u > reach + NEAR_U or not self._may_pass(control):
                break
            if control.u > self.u:
                if rate > 0.0:
                    left = max(0.0, left - (control.u - self.u) / rate)
                self.u = control.u
            self._queue.pop()
            if self._state is SlotState.STOPPING and control.kind not in _IN_A_STOP:
                continue
            if not self._waits_for_shape(control, left):
                self._pass(control, left)
            # a motion that begins or ends in this cycle changes how far u may go
            if control.kind in (ControlKind.BEGIN, ControlKind.END):
                reach = self._reach(self.u + rate * left)
        if reach > self.u:
            whole = round(reach)
            self.u = float(whole) if abs(reach - whole) < NEAR_U else reach

    # ------------------------------------------------------------------ shaped setpoints

    @property
    def _settling(self) -> int:
        return self.cycle.settling & self.axes

    @property
    def _settled(self) -> bool:
        """Whether shaped setpoints are where the program has ordered its axes, and nothing waits for that."""
        return not (self._put_off or self._settling)

    def _waits_for_shape(self, control: Control, left: float) -> bool:
        """Put off an entry to where the shaped path is at its place; False: it is done now."""
        if self.cycle.bank.shaper is None or control.kind in GOING_ON:
            return False
        if control.kind not in AT_THEIR_PLACE:
            if self._settled:
                return False
            self.barrier, self.pending = Settled(lambda: self._settled), control
            return True
        if control.kind is not ControlKind.OUTPUT and self._settled and not self.playback.active:
            return False
        self._put_off.put_off(self.cycle.number, control, left)
        return True

    def do_put_off(self) -> None:
        """Do what is due, in order; the end of a line at rest once its shaped setpoints have arrived."""
        shown, playback = self.shown_line, self.playback
        driven = playback.active if playback.line else 0
        settling = not playback.active and self._settling != 0
        for control, left in self._put_off.pass_cycle(self.cycle.number, driven, settling=settling):
            self._pass(control, left)
        # that of the row which is ordered now
        self.shown_line = shown

    def _pass(self, control: Control, left: float, waited: bool = False) -> None:
        try:
            barrier = pass_control(self, control, left, waited)
        except BarrierFault as fault:
            # an axis that cannot join a stop is left out of it
            if self._state is not SlotState.STOPPING or control.kind is not ControlKind.BEGIN:
                self.fault(fault.code, control.line, fault.column, fault.values)
            return
        if barrier is not None:
            self.barrier = barrier
            self.pending = control

    def _clear_barrier(self, left: float) -> None:
        # only now it is begun with
        waited = not isinstance(self.barrier, Settled)
        control, self.barrier, self.pending = self.pending, None, None
        if control is not None:
            self._pass(control, left, waited)

    def _may_pass(self, control: Control) -> bool:
        """Tell whether an entry may be passed: in feed hold nothing new begins, in a stop no other motion."""
        if self._state is SlotState.STOPPING:
            return self.playback.active != 0 and control.kind not in WAITING
        return not self._held or control.kind in _ALWAYS

    def _check_first_row(self) -> None:
        jump = self.playback.jump()
        if jump is None:
            return
        row, start = self.cycle.row, self.playback.start_of(jump.column)
        row.ordered[jump.column] = start
        row.ordered_velocity[jump.column] = 0.0
        self.playback.leave(1 << jump.column)
        self.fault(FaultCode.SETPOINT_JUMP, self.line, jump.column, (jump.distance, jump.allowed))

    # ------------------------------------------------------------------ how far and how fast

    def _too_dry(self, edge: float | None, dry: bool) -> bool:
        """Return whether a motion at rest should wait for more rows before it starts."""
        if edge is None or not dry or edge - self.u >= START_ROWS:
            return False
        return self.playback.at_start or self.ramp.rate <= STANDSTILL

    def _step_rate(self) -> float:
        """Step the rates of this cycle; return the rows that u passes in it."""
        ordered = self.rapid_rate = self._ordered_rate(1.0)
        ramp = self.ramp
        mean = ramp.rate
        if self.barrier is not None and self.playback.active:
            # u stands in the midst of a motion, which came to rest there
            ramp.jump(0.0)
            mean = 0.0
        elif not self.playback.active:
            if ramp.rate != ordered:
                ramp.jump(ordered)
            mean = ramp.rate
        else:
            ordered = self._ordered_rate(self.playback.feed_scale(self.u))
            edge, dry = self._queue.edge(self.u)
            if self._too_dry(edge, dry):
                ramp.jump(0.0)
                mean = 0.0
            else:
                begins = self.playback.unmoved(self.u)
                if begins and ramp.rate != ordered:
                    ramp.jump(ordered)
                mean = ramp.advance(self.u, ordered, edge, urgent=self.cycle.estop, begins=begins)
            self._note_starved(dry, ordered)
        self._held = (self.held or self.override <= 0.0) and ramp.rate <= STANDSTILL
        return mean

    def _note_starved(self, dry: bool, ordered: float) -> None:
        """Report once that rows are missing, and again once entries have come that u cannot go to with so few
        rows: whoever has put them waits for them.
        """
        if self.ramp.rate > STANDSTILL:
            self._starved = None
        elif ordered > 0.0 and dry and self._starved != self._queue.noted:
            self._starved = self._queue.noted
            self.cycle.emit(EventKind.STARVED, self.index, self.line)

    def _reach(self, goal: float) -> float:
        """Return how far u may go to ``goal``: never past the rows of a motion, nor all that is known."""
        playback = self.playback
        last = playback.last_u
        if not playback.active:
            return max(self.u, min(goal, max(self._queue.last_u, last)))
        edge, dry = self._queue.edge(self.u)
        if edge is None:
            return max(self.u, min(goal, max(self._queue.last_u, last)))
        # the last cycle of a stop ends with a rate of 0, and yet u passes
        if (playback.at_start or self._mean_rate <= 0.0) and self._too_dry(edge, dry):
            return self.u
        if goal >= edge - LANDING:
            goal = edge
            self.ramp.jump(0.0)
        return max(self.u, goal)

    def _note_state(self) -> None:
        if isinstance(self.barrier, Paused):
            self.state = SlotState.PAUSED
        elif self._held and self.cycle.motions.stands(self.index) and not self._settling:
            self.state = SlotState.HELD
        elif self._starved is not None:
            self.state = SlotState.STARVED
        else:
            self.state = SlotState.RUNNING
