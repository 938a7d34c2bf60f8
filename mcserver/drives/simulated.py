"""Simulated servo drives: inertia, a lag that is not zero, states, time-outs, and faults on demand."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.drives.bus import (
    Array,
    BusEvent,
    DriveFault,
    DriveMode,
    DriveState,
    Feedback,
    Foreseen,
    Setpoints,
)
from mcserver.drives.flexible_loads import FlexibleLoads
from mcserver.drives.servo_model import ServoModel
from mcserver.drives.simulated_marks import SimulatedMarks
from mcserver.machine.axis import Axis

# Exchanges from the first command to energize until a drive holds.
START_CYCLES = 2
# Cycles after which what is left of a decayed error is set to zero, before it becomes denormal and slow.
FLUSH_CYCLES = 256
FLUSH_BELOW = 1e-15
# Exchanges that a drive's own homing takes: the axis is at home where it stands, and its reading stays.
HOMING_CYCLES = 20
# A drive in velocity mode forgets what it could not reach beyond this time at the axis's speed limit [s].
VELOCITY_WINDUP_S = 0.05
# Exchanges that are computed of a stall beyond the longest time-out: drives stand or coast by then, and a
# stall is not to be made longer by its model.
STALL_CYCLES = 100


class SimulatedBus:
    """All simulated drives of a machine, computed together.

    Faults on demand: `jam`, `load`, `push`, `trip`, `silence`; columns are the machine's.
    """

    follows_exactly = False
    delay_cycles = 0

    def __init__(self, axes: Sequence[Axis], columns: Sequence[int], cycle_s: float) -> None:
        count = len(axes)
        self.columns = tuple(columns)
        self._cycle = cycle_s
        self._model = ServoModel(axes, cycle_s)
        self._brake = np.array([axis.drive.brake for axis in axes])
        self._timeout = np.array(
            [max(1, math.ceil(axis.drive.heartbeat_timeout_s / cycle_s - 1e-9)) for axis in axes]
        )
        self._windup = np.array([axis.max_velocity * VELOCITY_WINDUP_S for axis in axes])
        self._position = np.array([axis.initial_position for axis in axes])
        # rows: position minus setpoint, velocity, old velocity setpoint, new velocity setpoint
        self._loop = np.zeros((4, count))
        self._result = np.zeros((2, count))
        self._change = np.zeros(count)
        self._within = np.ones(count, np.bool_)
        self._feedback = Feedback.of(count)
        self._true_state = np.zeros(count, np.int8)
        self._mode = np.full(count, DriveMode.OFF, np.int8)
        self._mode_bytes = b""
        self._countdown = np.zeros(count, np.int64)
        self._quiet = np.zeros(count, np.int64)
        self._last_position = self._position.copy()
        self._following = np.zeros(count, np.bool_)
        self._free = np.ones(count, np.bool_)
        self._any_free = True
        self._speeding = np.zeros(count, np.bool_)
        self._any_speeding = False
        self._simple = False
        self._changing = True
        self._jammed = np.zeros(count, np.bool_)
        self._any_jammed = False
        self._mute = np.zeros(count, np.int64)
        self._any_mute = False
        self._cycles = 0
        self._marks = SimulatedMarks(axes)
        self._loads = FlexibleLoads(axes, cycle_s)
        self._homing = np.zeros(count, np.int64)
        # what a load takes of the speed in each cycle
        self._load = np.zeros(count)
        self._any_load = False

    # ------------------------------------------------------------------ the bus

    def boot(self) -> Feedback:
        self._model.encoder(self._position, self._feedback.position)
        self._marks.place(self._position, self._feedback)
        return self._feedback

    def exchange(self, setpoints: Setpoints) -> Feedback:
        mode = setpoints.mode.tobytes()
        if mode != self._mode_bytes or self._changing:
            self._mode_bytes = mode
            self._change_states(setpoints.mode)
        if self._simple:
            self._follow_simply(setpoints)
        else:
            self._follow_some(setpoints)
        self._cycles += 1
        if self._cycles % FLUSH_CYCLES == 0:
            velocity = self._loop[1]
            velocity[np.abs(velocity) < FLUSH_BELOW] = 0.0
            self._position[np.abs(self._position) < FLUSH_BELOW] = 0.0
        if self._marks.present:
            self._marks.pass_to(self._position, self._feedback)
        if self._loads.present:
            self._loads.follow(self._position)
        self._report()
        return self._feedback

    def stall(self, cycles: int) -> None:
        silence = Setpoints.of(len(self.columns))
        silence.mode[:] = DriveMode.SILENT
        for _ in range(min(cycles, int(self._timeout.max()) + STALL_CYCLES)):
            self.exchange(silence)

    def events(self) -> list[BusEvent]:
        return []

    def close(self) -> None:
        """There is nothing to give back."""

    # ------------------------------------------------------------------ many exchanges

    @property
    def foreseeable(self) -> bool:
        """Whether every axis follows its setpoints or stands, and nothing changes by itself."""
        disturbed = self._any_jammed or self._any_mute or self._any_load
        plain = self._simple and not (self._changing or self._loads.present)
        return plain and not (disturbed or self._marks.present or self._marks.stops)

    def foresee(self, position: Array, velocity: Array) -> Foreseen:
        """Compute exchanges with these setpoints, shape (m, n) each, up to the first that meets a limit."""
        # the server makes buses to check a machine, and needs no compiled code for it
        from mcserver.motion.kernels.servo_loop import follow_cycles

        model = self._model
        state = np.concatenate(
            (self._position[None], self._loop, self._change[None], self._last_position[None])
        )
        moved = np.empty(position.shape)
        count = follow_cycles(
            state,
            model.coefficients,
            np.array([model.step_limit, model.speed_limit, self._windup]),
            np.where(self._speeding, 2, self._following).astype(np.int8),
            np.ascontiguousarray(position),
            np.ascontiguousarray(velocity),
            (self._cycles, FLUSH_CYCLES, FLUSH_BELOW),
            self._cycle,
            moved,
        )
        actual = np.empty((count, len(state[0])))
        model.encoder(moved[:count], actual)
        return Foreseen(actual, state)

    def arrive(self, foreseen: Foreseen) -> None:
        """Let exchanges that were foreseen have happened."""
        state = foreseen.state
        self._position[:], self._loop[:], self._change[:] = state[0], state[1:5], state[5]
        self._last_position[:] = state[6]
        self._cycles += len(foreseen.actual)

    # ------------------------------------------------------------------ faults on demand

    def jam(self, column: int, jammed: bool = True) -> None:
        """Block an axis mechanically, or free it: its encoder stands whatever the drive does."""
        self._jammed[self.columns.index(column)] = jammed
        self._any_jammed = bool(self._jammed.any())

    def trip(self, column: int, fault: DriveFault = DriveFault.OVER_TEMPERATURE) -> None:
        """Let a drive fail: it de-energizes and latches the fault."""
        index = self.columns.index(column)
        self._true_state[index] = DriveState.FAULT
        self._feedback.fault[index] = fault
        self._changing = True

    def push(self, column: int, velocity: float) -> None:
        """Give an axis a speed at once, as a blow would [m/s, rad/s]."""
        self._loop[1, self.columns.index(column)] = velocity
        self._changing = True

    def load(self, column: int, deceleration: float) -> None:
        """Let a torque slow an axis from now on; 0: none does any more [m/s² or rad/s²]."""
        self._load[self.columns.index(column)] = deceleration * self._cycle
        self._any_load = bool(self._load.any())

    def silence(self, column: int, cycles: int | None = None) -> None:
        """Let a drive not answer for a number of cycles (None: for good; 0: answers again)."""
        self._mute[self.columns.index(column)] = -1 if cycles is None else cycles
        self._any_mute = bool((self._mute != 0).any())

    # ------------------------------------------------------------------ states

    def _change_states(self, commanded: NDArray[np.int8]) -> None:
        state = self._true_state
        silent = commanded == DriveMode.SILENT
        self._quiet[~silent] = 0
        self._quiet[silent] += 1
        expired = silent & (self._quiet >= self._timeout)
        # a drive that hears nothing goes on with what it heard last, until its time-out
        self._mode = np.where(silent, self._mode, commanded).astype(np.int8)
        self._mode[expired] = DriveMode.OFF
        mode = self._mode
        healthy = state != DriveState.FAULT
        reset = mode == DriveMode.RESET
        self._feedback.fault[reset] = 0
        off = ((mode == DriveMode.OFF) & healthy) | reset
        state[off] = DriveState.OFF
        holding = (state == DriveState.ENERGIZED) | (state == DriveState.STARTING)
        stop = (mode == DriveMode.STOP) & (holding | (state >= DriveState.HOMING))
        state[stop] = DriveState.STOPPING
        standing = self._loop[1] == 0.0
        state[(state == DriveState.STOPPING) & standing & (mode == DriveMode.STOP)] = DriveState.OFF
        wanted = mode >= DriveMode.POSITION
        asleep = wanted & ((state == DriveState.OFF) | (state == DriveState.STOPPING))
        state[asleep] = DriveState.STARTING
        self._countdown[asleep] = START_CYCLES
        starting = state == DriveState.STARTING
        self._countdown[starting] -= 1
        state[starting & (self._countdown <= 0)] = DriveState.ENERGIZED
        self._home_by_themselves(mode)
        energized = state == DriveState.ENERGIZED
        self._following = energized & ((mode == DriveMode.POSITION) | (mode == DriveMode.VELOCITY))
        self._speeding = energized & (mode == DriveMode.VELOCITY)
        self._any_speeding = bool(self._speeding.any())
        self._free = ~self._following
        self._any_free = bool(self._free.any())
        self._simple = self._is_simple()
        self._changing = bool(
            ((state == DriveState.STARTING) | (state == DriveState.STOPPING)).any()
        ) or bool((silent & ~expired).any() or (state == DriveState.HOMING).any())

    def _home_by_themselves(self, mode: NDArray[np.int8]) -> None:
        """States of drives that are commanded to home, or not any more."""
        state = self._true_state
        homing, commanded = state >= DriveState.HOMING, mode == DriveMode.HOMING
        if not (homing.any() or commanded.any()):
            return
        begins = commanded & (state == DriveState.ENERGIZED)
        self._homing[begins] = HOMING_CYCLES
        state[begins] = DriveState.HOMING
        self._homing[homing] -= 1
        state[homing & commanded & (self._homing <= 0)] = DriveState.HOMED
        state[homing & ~commanded & (mode >= DriveMode.POSITION)] = DriveState.ENERGIZED

    def _is_simple(self) -> bool:
        """Return whether every axis either follows setpoints that are transmitted, or stands without its
        drive.
        """
        following = self._following & (self._quiet == 0)
        standing = self._free & (self._loop[1] == 0.0) & (self._mode != DriveMode.TORQUE)
        return bool((following | standing).all())

    # ------------------------------------------------------------------ motion

    def _follow_simply(self, setpoints: Setpoints) -> None:
        reference = self._last_position
        self._loop[3] = setpoints.velocity
        integrated = self._integrated() if self._any_speeding else None
        reference[:] = setpoints.position
        if integrated is not None:
            np.copyto(reference, integrated, where=self._speeding)
        if self._any_free:
            np.copyto(reference, self._position, where=self._free)
            np.copyto(self._loop[3], 0.0, where=self._free)
        np.subtract(self._position, reference, out=self._loop[0])
        if self._any_load or np.count_nonzero(self._loop):
            self._follow(reference)
        else:
            # all stand where they are to be: a server that idles spends little on them
            self._change.fill(0.0)

    def _integrated(self) -> Array:
        """Position setpoints of drives in velocity mode, which integrate their speed setpoints themselves,
        and forget what they could not follow.
        """
        integral = self._last_position + 0.5 * (self._loop[2] + self._loop[3]) * self._cycle
        behind = np.clip(self._position - integral, -self._windup, self._windup)
        return np.asarray(self._position - behind)

    def _follow(self, reference: Array) -> None:
        """Loops of all axes; ``reference``: the position setpoints that row 0 of the loop was taken
        against.
        """
        loop = self._loop
        if self._any_load:
            loop[1] -= self._load
        self._model.step(loop, self._result)
        velocity = self._result[1]
        change = self._change
        np.subtract(velocity, loop[1], out=change)
        np.less_equal(np.abs(change), self._model.step_limit, out=self._within)
        bounded = b"\x00" not in self._within.tobytes()
        np.less_equal(np.abs(velocity), self._model.speed_limit, out=self._within)
        bounded = bounded and b"\x00" not in self._within.tobytes()
        if bounded and not self._any_jammed and not self._marks.stops:
            np.add(reference, self._result[0], out=self._position)
        else:
            self._follow_within_limits(reference)
        loop[1] = velocity
        loop[2] = loop[3]

    def _follow_within_limits(self, reference: Array) -> None:
        model, old = self._model, self._loop[1]
        velocity, change = self._result[1], self._change
        step = np.clip(change, -model.step_limit, model.step_limit)
        limited = np.clip(old + step, -model.speed_limit, model.speed_limit)
        # an axis that is too fast already is not braked harder than its torque allows
        limited = np.where(np.abs(old) > model.speed_limit, old + step, limited)
        saturated = limited != velocity
        moved = np.where(
            saturated, self._position + 0.5 * (old + limited) * self._cycle, reference + self._result[0]
        )
        blocked = self._jammed | (moved < self._marks.low) | (moved > self._marks.high)
        stopped = np.where(self._jammed, self._position, moved)
        self._position = np.clip(stopped, self._marks.low, self._marks.high)
        velocity[:] = np.where(blocked, 0.0, limited)
        np.copyto(change, limited - old)

    def _follow_some(self, setpoints: Setpoints) -> None:
        """Some axes follow, others coast, brake or obey a torque."""
        loop, model = self._loop, self._model
        free, old = self._free, loop[1].copy()
        heard = self._following & (setpoints.mode != DriveMode.SILENT)
        reference = np.where(heard, setpoints.position, self._last_position)
        loop[3] = np.where(heard, setpoints.velocity, 0.0)
        if self._any_speeding:
            reference = np.where(self._speeding, self._integrated(), reference)
        error = self._position - reference
        loop[0] = error
        start = self._position.copy()
        self._follow(reference)
        if self._any_free:
            velocity = self._coast(old, setpoints.torque)
            position = start + 0.5 * (old + velocity) * self._cycle
            if self._marks.stops:
                beyond = (position < self._marks.low) | (position > self._marks.high)
                velocity = np.where(beyond, 0.0, velocity)
                position = np.clip(position, self._marks.low, self._marks.high)
            np.copyto(self._position, position, where=free)
            np.copyto(loop[1], velocity, where=free)
            # the loop starts from the axis as it is once it closes
            np.copyto(loop[2], velocity, where=free)
            np.copyto(self._change, velocity - old, where=free & (self._true_state == DriveState.STOPPING))
            drive_torque = np.clip(setpoints.torque, -model.torque_limit, model.torque_limit)
            applied = free & (self._mode == DriveMode.TORQUE) & (self._true_state == DriveState.ENERGIZED)
            np.copyto(self._change, np.where(applied, drive_torque / model.torque_per_step, 0.0), where=free)
        self._last_position = np.where(self._following, reference, self._position)
        self._simple = self._is_simple()

    def _coast(self, velocity: Array, torque: Array) -> Array:
        """Velocities after a cycle in which no loop is closed: torque, friction, brake or stop act."""
        model = self._model
        off = self._true_state != DriveState.ENERGIZED
        stopping = (self._true_state == DriveState.STOPPING) | (off & self._brake)
        slowing = np.where(stopping, np.maximum(model.braking, model.friction), model.friction) * self._cycle
        applied = np.where(
            (self._mode == DriveMode.TORQUE) & ~off,
            np.clip(torque, -model.torque_limit, model.torque_limit),
            0.0,
        )
        pushed = velocity + applied * model.acceleration_per_torque * self._cycle
        # friction takes speed away and never turns it round
        slowed = np.sign(pushed) * np.maximum(np.abs(pushed) - slowing, 0.0)
        slowed = np.clip(slowed, -model.speed_limit, model.speed_limit)
        result: Array = np.where(self._jammed, 0.0, slowed)
        return result

    # ------------------------------------------------------------------ feedback

    def _measured(self) -> tuple[Array, Array]:
        """Return positions and velocities where encoders read: those of the loads."""
        if not self._loads.present:
            return self._position, self._loop[1]
        swing, rate = self._loads.swing
        return self._position + swing, self._loop[1] + rate

    def _report(self) -> None:
        feedback = self._feedback
        feedback.state[:] = self._true_state
        if self._any_mute:
            self._report_answering()
            return
        position, feedback.velocity[:] = self._measured()
        self._model.encoder(position, feedback.position)
        np.multiply(self._change, self._model.torque_per_step, out=feedback.torque)

    def _report_answering(self) -> None:
        """Report the drives that answer; what the others have said stays."""
        feedback = self._feedback
        position = np.empty_like(self._position)
        measured, velocity = self._measured()
        self._model.encoder(measured, position)
        answering = self._mute == 0
        np.copyto(feedback.position, position, where=answering)
        np.copyto(feedback.velocity, velocity, where=answering)
        np.copyto(feedback.torque, self._change * self._model.torque_per_step, where=answering)
        feedback.fresh[:] = answering
        self._mute[self._mute > 0] -= 1
        self._any_mute = bool((self._mute != 0).any()) or not answering.all()
