"""Independent motion: one Ruckig trajectory an axis, sampled each cycle (G00, G1020, G1030, stops).

A trajectory is calculated once, from the axis's setpoint state at the exact moment of the command, so a
command to a moving axis supersedes it within the axis's limits. Feed hold and overrides below 100 % supersede
position motions likewise: a hold by a stop, an override by its share of the axis's speed. So every order
keeps velocity, acceleration and jerk. Speed commands and stops follow neither.
"""

from __future__ import annotations

import contextlib
import enum
import math
from collections.abc import Mapping

from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError, Trajectory

from mcserver.executor.shm.feedback import FeedbackRow
from mcserver.machine.machine_file import Axis, Machine

State = tuple[float, float, float]

# Shares of a way, or of a change of speed, that are tried one after the other.
_NEARBY = (1.0, 1.0 + 1e-9, 1.0 - 1e-9, 1.0 + 1e-7, 1.0 - 1e-7)


class TrajectoryError(ValueError):
    """Ruckig finds no motion; ``column`` is the axis's."""

    def __init__(self, column: int) -> None:
        super().__init__(f"no trajectory for column {column}")
        self.column = column


class MotionKind(enum.Enum):
    """What ends an independent motion."""

    POSITION = enum.auto()  # at its target
    SPEED = enum.auto()  # never: the speed is held
    HALT = enum.auto()  # at standstill


class Motion:
    """One axis under way by itself.

    Attributes:
        slot: whose rate applies, -1: the machine's. elapsed: time on the trajectory [s].
        origin: position at which the trajectory starts. final: position and velocity at its end.
        target: of a position motion. rate: share of the axis's speed that it is planned with; 0: it is held.
    """

    __slots__ = (
        "column",
        "duration",
        "elapsed",
        "final",
        "kind",
        "origin",
        "rate",
        "slot",
        "target",
        "trajectory",
    )

    def __init__(
        self,
        column: int,
        slot: int,
        kind: MotionKind,
        trajectory: Trajectory,
        origin: float,
        final: tuple[float, float],
    ) -> None:
        self.column = column
        self.slot = slot
        self.kind = kind
        self.trajectory = trajectory
        self.duration: float = trajectory.duration
        self.elapsed = 0.0
        self.origin = origin
        self.final = final
        self.target = final[0]
        self.rate = 1.0

    @property
    def held(self) -> bool:
        """Whether it is a position motion that stands in feed hold."""
        return self.kind is MotionKind.POSITION and self.rate <= 0.0 and self.elapsed >= self.duration

    def at(self, elapsed: float) -> State:
        """Position, velocity and acceleration on the trajectory."""
        if elapsed >= self.duration:
            position, velocity = self.final
            return position + velocity * (elapsed - self.duration), velocity, 0.0
        position, velocity, acceleration = self.trajectory.at_time(max(elapsed, 0.0))
        return self.origin + position[0], velocity[0], acceleration[0]


class IndependentMotions:
    """All axes that move by themselves.

    Attributes:
        mask: their columns. speeding: those among them that hold a speed. halting: those that come to a halt.
        ended: columns that came to rest in this cycle. limited: columns that a soft limit stops since this
            cycle.
    """

    def __init__(self, machine: Machine, row: FeedbackRow) -> None:
        self._cycle = machine.cycle_s
        self._axes = machine.axes
        self._row = row
        self._ruckig = Ruckig(1)
        self._motions: dict[int, Motion] = {}
        self._left: dict[int, float] = {}
        self.mask = 0
        self.speeding = 0
        self.halting = 0
        self.ended = 0
        self.limited: list[int] = []

    # ------------------------------------------------------------------ commands

    def move(self, column: int, slot: int, target: float, left: float, rate: float) -> None:
        """To a position; ``left``: what is left of this cycle [cycles], ``rate``: the slot's, up to 1."""
        state = self.state(column, left)
        if column not in self._motions and state[0] == target:
            return
        self._go(column, slot, state, target, rate)
        self._pass(self._motions[column], left)

    def speed(self, column: int, slot: int, velocity: float, left: float) -> None:
        """To a speed, within the axis's limit of speed; it is held until superseded."""
        top = self._axes[column].max_velocity
        velocity = max(-top, min(top, velocity))
        state = self.state(column, left)
        trajectory = self._to_velocity(column, state, velocity, jerk=True)
        self._start(column, slot, MotionKind.SPEED, trajectory, state[0], velocity)
        self._guard(self._motions[column])
        self._pass(self._motions[column], left)

    def halt(self, column: int, slot: int, left: float = 0.0, *, jerk: bool = True) -> None:
        """To standstill as soon as the limits allow; without ``jerk`` at full deceleration at once."""
        if column in self._motions:
            self.halt_from(column, slot, self.state(column, left), left, jerk=jerk)

    def halt_from(
        self, column: int, slot: int, state: State, left: float = 0.0, *, jerk: bool = True
    ) -> None:
        """To standstill from a given state, for instance that of a captured axis that coasts."""
        trajectory = self._to_velocity(column, state, 0.0, jerk=jerk)
        self._start(column, slot, MotionKind.HALT, trajectory, state[0], 0.0)
        self._pass(self._motions[column], left)

    def drop(self, mask: int) -> None:
        """Forgets motions; the setpoints stay where they are."""
        for column in list(self._motions):
            if mask >> column & 1:
                del self._motions[column]
        self._remask()

    def disown(self, slot: int) -> None:
        """The program has ended; its axes go on at the machine's rate."""
        for motion in self._motions.values():
            if motion.slot == slot:
                motion.slot = -1

    # ------------------------------------------------------------------ states

    def state(self, column: int, left: float) -> State:
        """Return the axis's setpoint state, ``left`` cycles before the end of this cycle."""
        motion = self._motions.get(column)
        if motion is None:
            return float(self._row.setpoint[column]), 0.0, 0.0
        return motion.at(motion.elapsed - left * self._cycle)

    def stands(self, slot: int) -> bool:
        """Return whether all position motions of a slot stand in feed hold."""
        return all(
            motion.held
            for motion in self._motions.values()
            if motion.slot == slot and motion.kind is MotionKind.POSITION
        )

    def end_left(self, mask: int) -> float:
        """How much of this cycle was left when the last of these axes came to rest [cycles]."""
        if not mask & self.ended:
            return 1.0
        return min(left for column, left in self._left.items() if mask >> column & 1)

    def owned_by(self, slot: int) -> int:
        """Mask of the axes whose motion belongs to a slot."""
        mask = 0
        for motion in self._motions.values():
            if motion.slot == slot:
                mask |= 1 << motion.column
        return mask

    # ------------------------------------------------------------------ the cycle

    def advance(self, rates: Mapping[int, float]) -> None:
        """Step one cycle; ``rates``: of position motions, up to 1, by slot."""
        self.ended = 0
        self._left.clear()
        self.limited.clear()
        for motion in tuple(self._motions.values()):
            if motion.kind is MotionKind.SPEED:
                self._guard(motion)
            elif motion.kind is MotionKind.POSITION and rates[motion.slot] != motion.rate:
                state = motion.at(motion.elapsed)
                # where there is no such motion the one under way goes on, and the next cycle tries again
                with contextlib.suppress(TrajectoryError):
                    self._go(motion.column, motion.slot, state, motion.target, rates[motion.slot])
            self._pass(self._motions[motion.column], 1.0)

    def _go(self, column: int, slot: int, state: State, target: float, rate: float) -> None:
        """Start a position motion from a state with a share of the axis's speed; 0: to a stop on the way."""
        if rate > 0.0:
            trajectory = self._to_position(column, state, target, rate)
            self._start(column, slot, MotionKind.POSITION, trajectory, state[0], target)
        else:
            trajectory = self._to_velocity(column, state, 0.0, jerk=True)
            rest = state[0] + trajectory.at_time(trajectory.duration)[0][0]
            self._start(column, slot, MotionKind.POSITION, trajectory, state[0], rest)
        self._motions[column].target = target
        self._motions[column].rate = rate

    def _pass(self, motion: Motion, share: float) -> None:
        """Let ``share`` of a cycle pass on a motion, and end it where it is over."""
        motion.elapsed += self._cycle * share
        column = motion.column
        position, velocity, _ = motion.at(motion.elapsed)
        row = self._row
        if motion.elapsed >= motion.duration and motion.kind is not MotionKind.SPEED:
            row.setpoint[column] = motion.final[0]
            row.velocity[column] = 0.0
            if motion.held and motion.final[0] != motion.target:
                return
            over = (motion.elapsed - motion.duration) / self._cycle
            del self._motions[column]
            self.ended |= 1 << column
            self._left[column] = min(over, share)
            self._remask()
            return
        row.setpoint[column] = position
        row.velocity[column] = velocity

    def _start(
        self, column: int, slot: int, kind: MotionKind, trajectory: Trajectory, origin: float, goal: float
    ) -> None:
        """``goal``: the target of a position motion, else the velocity at the end."""
        if kind is MotionKind.POSITION:
            final = (goal, 0.0)
        else:
            final = (origin + trajectory.at_time(trajectory.duration)[0][0], goal)
        self._motions[column] = Motion(column, slot, kind, trajectory, origin, final)
        self.ended &= ~(1 << column)
        self._left.pop(column, None)
        self._remask()

    def _remask(self) -> None:
        self.mask = self.speeding = self.halting = 0
        for motion in self._motions.values():
            bit = 1 << motion.column
            self.mask |= bit
            if motion.kind is MotionKind.SPEED:
                self.speeding |= bit
            elif motion.kind is MotionKind.HALT:
                self.halting |= bit

    # ------------------------------------------------------------------ trajectories

    def _input(self, column: int, state: State, jerk: bool) -> InputParameter:
        """The start of a trajectory, in coordinates that have their origin there: rounding is least then."""
        axis = self._axes[column]
        wanted = InputParameter(1)
        wanted.current_position = [0.0]
        wanted.current_velocity = [state[1]]
        wanted.max_velocity = [axis.max_velocity]
        wanted.max_acceleration = [axis.max_acceleration]
        limited = jerk and math.isfinite(axis.max_jerk)
        wanted.max_jerk = [axis.max_jerk if limited else math.inf]
        # without a limit of jerk the acceleration of the start does not bind
        wanted.current_acceleration = [_bounded_acceleration(axis, state) if limited else 0.0]
        return wanted

    def _calculated(self, wanted: InputParameter) -> Trajectory | None:
        trajectory = Trajectory(1)
        try:
            result = self._ruckig.calculate(wanted, trajectory)
        except RuckigError:
            return None
        return trajectory if result in (Result.Working, Result.Finished) else None

    def _to_position(self, column: int, state: State, target: float, rate: float = 1.0) -> Trajectory:
        wanted = self._input(column, state, jerk=True)
        wanted.max_velocity = [self._axes[column].max_velocity * rate]
        way = target - state[0]
        # where two shapes of profile meet, rounding may find neither: a way next to it has one
        for share in _NEARBY:
            wanted.target_position = [way * share]
            trajectory = self._calculated(wanted)
            if trajectory is not None:
                return trajectory
        raise TrajectoryError(column)

    def _to_velocity(self, column: int, state: State, velocity: float, *, jerk: bool) -> Trajectory:
        wanted = self._input(column, state, jerk)
        wanted.control_interface = ControlInterface.Velocity
        for share in _NEARBY:
            wanted.target_velocity = [velocity * share]
            wanted.current_velocity = [state[1] * share]
            trajectory = self._calculated(wanted)
            if trajectory is not None:
                return trajectory
        raise TrajectoryError(column)

    def _guard(self, motion: Motion) -> None:
        """Lets an axis that holds a speed stop on its soft limit, while it still can."""
        axis = self._axes[motion.column]
        state = motion.at(motion.elapsed)
        ahead = motion.at(motion.elapsed + self._cycle)
        direction = math.copysign(1.0, ahead[1] or motion.final[1])
        limit = axis.max_position if direction > 0.0 else axis.min_position
        if not math.isfinite(limit) or (ahead[1] == 0.0 and motion.final[1] == 0.0):
            return
        stop = self._to_velocity(motion.column, ahead, 0.0, jerk=True)
        rest = ahead[0] + stop.at_time(stop.duration)[0][0]
        if (rest - limit) * direction <= 0.0:
            return
        self.limited.append(motion.column)
        trajectory = self._to_position(motion.column, state, limit)
        self._start(motion.column, motion.slot, MotionKind.HALT, trajectory, state[0], 0.0)
        self._motions[motion.column].final = (limit, 0.0)


def _bounded_acceleration(axis: Axis, state: State) -> float:
    """Return the acceleration of a state, bounded so that it can be taken back within the axis's speed."""
    _, velocity, acceleration = state
    bound = axis.max_acceleration
    if velocity * acceleration > 0.0:
        room = max(0.0, axis.max_velocity - abs(velocity))
        bound = min(bound, math.sqrt(2.0 * axis.max_jerk * room))
    return max(-bound, min(bound, acceleration))
