"""Independent motion: one Ruckig trajectory per axis, sampled each cycle (G00, G1020, G1030, stops).

A trajectory is calculated once, from the axis's setpoint state at the exact time of the command, so a command
to a moving axis supersedes its motion within the axis's limits. Feed hold and overrides below 100 % supersede
position motions likewise: a hold by a stop, an override by a trajectory with its share of the axis's speed.
So all of them keep velocity, acceleration and jerk. Feed hold and override do not affect speed commands and
stops.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping

import numpy as np
from ruckig import Trajectory

from mcserver.executor.axis_motion import FollowingMotion, Motion, MotionKind
from mcserver.executor.entries import Array
from mcserver.executor.shm.feedback import FeedbackRow
from mcserver.executor.trajectories import MotionLimits, State, TrajectoryError, TrajectorySolver
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import SurfaceSpeed

# constant surface speed commands a spindle again when its speed has to change by this share
SURFACE_SHARE = 0.002


class IndependentMotions:
    """The independent motions of all axes.

    Attributes:
        mask: columns in motion. speeding: those that hold a speed. halting: those that come to a halt.
        unlimited: columns whose soft limits do not apply.
        goals: by column, target and greatest speed of the latest position motion, also after its end; none
            after any other motion, and while it is held.
        pending: columns whose motion ends only once their drives have finished theirs.
        limited: columns that a soft limit stops since this cycle.
        greatest_speeds: by column, commanded so far [m/s or rad/s].
    """

    def __init__(self, machine: Machine, row: FeedbackRow) -> None:
        self._cycle = machine.cycle_s
        self._axes = machine.axes
        self._limits = [MotionLimits.of(axis) for axis in machine.axes]
        self._row = row
        self.unlimited = 0
        self.goals: dict[int, tuple[float, float]] = {}
        self.pending = 0
        self._profiled = sum(1 << column for column, axis in enumerate(machine.axes) if axis.profiled)
        self._solver = TrajectorySolver()
        self._motions: dict[int, Motion] = {}
        self._left: dict[int, float] = {}
        self.mask = 0
        self.speeding = 0
        self.halting = 0
        self.limited: list[int] = []
        self.greatest_speeds = [0.0] * len(machine.axes)

    # ------------------------------------------------------------------ commands

    def move(
        self,
        column: int,
        slot: int,
        target: float,
        left: float,
        rate: float,
        limits: MotionLimits | None = None,
    ) -> None:
        """Move to a position; ``left``: rest of this cycle [cycles], ``rate``: the slot's, up to 1.

        Args:
            limits: of this motion; None: the axis's.
        """
        state = self.state(column, left)
        if column not in self._motions and state[0] == target:
            return
        self._go(column, slot, state, target, rate, limits or self._limits[column])
        self._pass(self._motions[column], left)

    def move_line(
        self, slot: int, targets: Mapping[int, float], left: float, rate: float, limits: MotionLimits
    ) -> None:
        """Move along a straight line: the column with the longest travel leads, the others are proportional.

        Args:
            targets: by column, all at rest [m or rad]; at least one differs from its position.
            limits: of the leading column.
        """
        start = {column: float(self._row.ordered[column]) for column in targets}
        lead = max(targets, key=lambda column: abs(targets[column] - start[column]))
        travel = targets[lead] - start[lead]
        self._go(lead, slot, (start[lead], 0.0, 0.0), targets[lead], rate, limits)
        motion = self._motions[lead]
        motion.anchor = start[lead]
        motion.followers = {
            column: (start[column], (target - start[column]) / travel)
            for column, target in targets.items()
            if column != lead
        }
        self._remask()
        self._pass(motion, left)

    def speed(
        self,
        column: int,
        slot: int,
        velocity: float,
        left: float,
        surface: tuple[int, SurfaceSpeed] | None = None,
    ) -> None:
        """Change to a speed within the axis's limit, and hold it until superseded.

        Args:
            surface: axis and constant surface speed that set the speed in each cycle, in the direction of
                ``velocity``.
        """
        if surface is not None:
            velocity = math.copysign(surface[1].at(float(self._row.ordered[surface[0]])), velocity)
        top = self._axes[column].max_velocity
        velocity = max(-top, min(top, velocity))
        self.greatest_speeds[column] = max(self.greatest_speeds[column], abs(velocity))
        state = self.state(column, left)
        limits = self._limits[column]
        trajectory = self._solver.to_velocity(column, state, velocity, limits, jerk=True)
        self._start(column, slot, MotionKind.SPEED, trajectory, state[0], velocity, limits)
        self._motions[column].surface = surface
        self._guard(self._motions[column])
        self._pass(self._motions[column], left)

    def follow(self, column: int, slot: int, state: Array, limits: MotionLimits | None = None) -> None:
        """Let the caller move an axis from rest, until it is halted or dropped.

        Args:
            state: that the caller sets in every cycle (`FollowingMotion`), with the row's setpoints.
            limits: of a halt; None: the axis's.
        """
        self._motions[column] = FollowingMotion(column, slot, limits or self._limits[column], state)
        self._remask()

    def halt(self, column: int, slot: int, left: float = 0.0, *, jerk: bool = True) -> None:
        """Stop as fast as the limits allow; without ``jerk`` the jerk is not limited."""
        motion = self._motions.get(column)
        if motion is not None:
            self.halt_from(column, slot, self.state(column, left), left, motion.limits, jerk=jerk)

    def halt_from(
        self,
        column: int,
        slot: int,
        state: State,
        left: float = 0.0,
        limits: MotionLimits | None = None,
        *,
        jerk: bool = True,
    ) -> None:
        """Stop from a given state, for instance of an axis that coasts as it is captured."""
        limits = limits or self._limits[column]
        trajectory = self._solver.to_velocity(column, state, 0.0, limits, jerk=jerk)
        self._start(column, slot, MotionKind.HALT, trajectory, state[0], 0.0, limits)
        self.pending |= self._profiled & 1 << column
        self._pass(self._motions[column], left)

    def rest(self, mask: int) -> None:
        """End position motions and halts at their present setpoints, where the drives stand already.

        Speeds, and axes whose drives generate the profile, are left alone: these have gone on.
        """
        mask &= self.mask & ~self.speeding & ~self._profiled
        for column, bit in enumerate(1 << column for column in range(len(self._axes))):
            if mask & bit:
                self._row.ordered_velocity[column] = 0.0
        self.drop(mask)

    def drop(self, mask: int) -> None:
        """Drop motions; setpoints stay where they are. Other columns of a line go on."""
        for column in [column for column in self.goals if mask >> column & 1]:
            del self.goals[column]
        for column, motion in list(self._motions.items()):
            motion.followers = {
                other: place for other, place in motion.followers.items() if not mask >> other & 1
            }
            if mask >> column & 1:
                motion.lost = True
            if motion.lost and not motion.followers:
                del self._motions[column]
        self._remask()

    def disown(self, slot: int) -> None:
        """Hand the motions of a program that has ended to the machine, whose rate applies from then on."""
        for motion in self.of_slot(slot):
            motion.slot = -1
            # a spindle keeps its speed when the axis that set it is jogged later
            motion.surface = None

    # ------------------------------------------------------------------ states

    def state(self, column: int, left: float) -> State:
        """Return the axis's setpoint state, ``left`` cycles before the end of this cycle."""
        motion = self._motions.get(column)
        if motion is None:
            return float(self._row.ordered[column]), 0.0, 0.0
        return motion.at(motion.elapsed - left * self._cycle)

    def stands(self, slot: int) -> bool:
        """Return whether all position motions of a slot, and axes that follow targets, stand in feed hold."""
        return all(
            motion.stands if isinstance(motion, FollowingMotion) else motion.held
            for motion in self._motions.values()
            if motion.slot == slot and motion.kind in (MotionKind.POSITION, MotionKind.FOLLOW)
        )

    def end_left(self, mask: int) -> float:
        """Return the rest of this cycle when the last of these axes came to rest [cycles]."""
        return min((left for column, left in self._left.items() if mask >> column & 1), default=1.0)

    def turning(self) -> int:
        """Return the mask of the axes with a commanded speed other than 0."""
        speeds = (each for each in self._motions.values() if each.kind is MotionKind.SPEED)
        return sum(1 << each.column for each in speeds if each.final[1] != 0.0)

    def owned_by(self, slot: int) -> int:
        """Return the mask of the axes whose motion belongs to a slot."""
        mask = 0
        for motion in self.of_slot(slot):
            mask |= motion.columns
        return mask

    def of_slot(self, slot: int) -> list[Motion]:
        """Return the motions of a slot's program."""
        return [motion for motion in self._motions.values() if motion.slot == slot]

    def rest_behind_next(self, motion: Motion) -> float:
        """Return the position at which a motion would rest if it were halted in the next cycle [m or rad]."""
        ahead = motion.at(motion.elapsed + self._cycle)
        stop = self._solver.to_velocity(motion.column, ahead, 0.0, motion.limits, jerk=True)
        return float(ahead[0] + stop.at_time(stop.duration)[0][0])

    # ------------------------------------------------------------------ blocks of rows

    def idle_cycles(self, rates: Mapping[int, float], limit: int) -> int:
        """Return how many of the next cycles, up to ``limit``, pass without an end or change of a motion.

        Args:
            rates: as in `advance`, in all of these cycles.
        """
        for motion in self._motions.values():
            if not limit:
                break
            if motion.kind is MotionKind.FOLLOW:
                return 0
            if motion.surface is not None:
                return 0
            if motion.kind is MotionKind.SPEED:
                axis = self._axes[motion.column]
                if math.isfinite(axis.min_position) or math.isfinite(axis.max_position):
                    # soft limits are checked in each cycle
                    return 0
                continue
            if motion.kind is MotionKind.POSITION and rates[motion.slot] != motion.rate:
                return 0
            limit = int(np.count_nonzero(self._elapsed(motion, limit) < motion.duration))
        return limit

    def ahead(self, count: int, setpoint: Array, velocity: Array) -> None:
        """Write the setpoints of the next ``count`` of `idle_cycles`, bit-identical to `advance`.

        Args:
            setpoint, velocity: shape (count, K); written in the columns of motions.
        """
        for motion in self._motions.values():
            positions, velocities = motion.along(self._elapsed(motion, count))
            if not motion.lost:
                setpoint[:, motion.column], velocity[:, motion.column] = positions, velocities
            for column, (start, share) in motion.followers.items():
                setpoint[:, column] = start + share * (positions - motion.anchor)
                velocity[:, column] = share * velocities

    def skip(self, count: int) -> None:
        """Let cycles pass, some of the `idle_cycles`."""
        self._left.clear()
        self.limited.clear()
        for motion in self._motions.values():
            motion.elapsed = float(self._elapsed(motion, count)[-1])
            self._set(motion, *motion.at(motion.elapsed)[:2])

    def _elapsed(self, motion: Motion, count: int) -> Array:
        """Return times on the trajectory in the next cycles, shape (count,) [s], summed one by one."""
        steps = np.full(count + 1, self._cycle)
        steps[0] = motion.elapsed
        return np.asarray(np.add.accumulate(steps)[1:])

    # ------------------------------------------------------------------ the cycle

    def advance(self, rates: Mapping[int, float]) -> None:
        """Step one cycle; ``rates``: of position motions, up to 1, by slot."""
        self._left.clear()
        self.limited.clear()
        for motion in tuple(self._motions.values()):
            if motion.kind is MotionKind.FOLLOW:
                continue
            if motion.kind is MotionKind.SPEED:
                if motion.surface is not None and self._is_off(motion, motion.surface):
                    # the new motion begins in the present state: no time passes
                    self.speed(motion.column, motion.slot, motion.final[1], 0.0, motion.surface)
                    motion = self._motions[motion.column]
                self._guard(motion)
            elif motion.kind is MotionKind.POSITION and rates[motion.slot] != motion.rate:
                state = motion.at(motion.elapsed)
                # if no trajectory is found the present one goes on, and the next cycle tries again
                with contextlib.suppress(TrajectoryError):
                    rate = rates[motion.slot]
                    self._go(motion.column, motion.slot, state, motion.target, rate, motion.limits)
            self._pass(self._motions[motion.column], 1.0)

    def _is_off(self, motion: Motion, surface: tuple[int, SurfaceSpeed]) -> bool:
        """Return whether a motion's final speed is off the constant surface speed at the present radius."""
        wanted = surface[1].at(float(self._row.ordered[surface[0]]))
        return abs(abs(motion.final[1]) - wanted) > SURFACE_SHARE * wanted

    def _go(
        self, column: int, slot: int, state: State, target: float, rate: float, limits: MotionLimits
    ) -> None:
        """Start a position motion from a state with a share of the axis's speed; 0: stop on the way."""
        if rate > 0.0:
            trajectory = self._solver.to_position(column, state, target, limits, rate)
            self._start(column, slot, MotionKind.POSITION, trajectory, state[0], target, limits)
        else:
            trajectory = self._solver.to_velocity(column, state, 0.0, limits, jerk=True)
            rest = state[0] + trajectory.at_time(trajectory.duration)[0][0]
            self._start(column, slot, MotionKind.POSITION, trajectory, state[0], rest, limits)
        self._motions[column].target = target
        self._motions[column].rate = rate
        if rate > 0.0:
            self.goals[column] = target, limits.max_velocity * rate
            self.pending |= self._profiled & 1 << column

    def _pass(self, motion: Motion, share: float) -> None:
        """Advance a motion by ``share`` of a cycle, and end it when it is over."""
        column = motion.column
        # if the motion before it came to rest in this cycle, it starts then
        share = min(share, self._left.get(column, share))
        motion.elapsed += self._cycle * share
        position, velocity, _ = motion.at(motion.elapsed)
        if motion.elapsed >= motion.duration and motion.kind is not MotionKind.SPEED:
            self._set(motion, motion.final[0], 0.0)
            if self.pending >> column & 1:
                return
            if motion.held and (motion.final[0] != motion.target or self._profiled >> column & 1):
                return
            over = (motion.elapsed - motion.duration) / self._cycle
            del self._motions[column]
            for each in (column, *motion.followers):
                self._left[each] = min(over, share)
            self._remask()
            return
        self._set(motion, position, velocity)

    def _set(self, motion: Motion, position: float, velocity: float) -> None:
        row = self._row
        if not motion.lost:
            row.ordered[motion.column] = position
            row.ordered_velocity[motion.column] = velocity
        for column, (start, share) in motion.followers.items():
            row.ordered[column] = start + share * (position - motion.anchor)
            row.ordered_velocity[column] = share * velocity

    def _start(
        self,
        column: int,
        slot: int,
        kind: MotionKind,
        trajectory: Trajectory,
        origin: float,
        goal: float,
        limits: MotionLimits,
    ) -> None:
        """``goal``: the target of a position motion, else the velocity at the end."""
        if kind is MotionKind.POSITION:
            final = (goal, 0.0)
        else:
            final = (origin + trajectory.at_time(trajectory.duration)[0][0], goal)
        motion = Motion(column, slot, kind, trajectory, origin, final, limits)
        before = self._motions.get(column)
        if before is not None:
            motion.follow(before)
        self.goals.pop(column, None)
        self._motions[column] = motion
        self._remask()

    def _remask(self) -> None:
        self.mask = self.speeding = self.halting = 0
        for motion in self._motions.values():
            bit = motion.columns
            self.mask |= bit
            if motion.kind is MotionKind.SPEED:
                self.speeding |= bit
            elif motion.kind is MotionKind.HALT:
                self.halting |= bit

    def _guard(self, motion: Motion) -> None:
        """Stop an axis that holds a speed at its soft limit, while it still can."""
        axis = self._axes[motion.column]
        if self.unlimited >> motion.column & 1:
            return
        state = motion.at(motion.elapsed)
        ahead = motion.at(motion.elapsed + self._cycle)
        direction = math.copysign(1.0, ahead[1] or motion.final[1])
        limit = axis.max_position if direction > 0.0 else axis.min_position
        if not math.isfinite(limit) or (ahead[1] == 0.0 and motion.final[1] == 0.0):
            return
        if (self.rest_behind_next(motion) - limit) * direction <= 0.0:
            return
        self.limited.append(motion.column)
        trajectory = self._solver.to_position(motion.column, state, limit, motion.limits)
        self._start(motion.column, motion.slot, MotionKind.HALT, trajectory, state[0], 0.0, motion.limits)
        self._motions[motion.column].final = (limit, 0.0)
