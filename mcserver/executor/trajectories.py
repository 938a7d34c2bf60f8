"""Trajectories of one axis to a position or to a velocity within its limits, by Ruckig."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError, Trajectory

from mcserver.executor.fault_codes import BarrierFault, FaultCode
from mcserver.machine.axis import Axis

# Position, velocity and acceleration [SI].
State = tuple[float, float, float]

# Factors of a displacement, or of a change of speed, that are tried in this order.
_NEARBY = (1.0, 1.0 + 1e-9, 1.0 - 1e-9, 1.0 + 1e-7, 1.0 - 1e-7)


class TrajectoryError(BarrierFault):
    """Ruckig finds no motion; ``column`` is the axis's."""

    def __init__(self, column: int) -> None:
        super().__init__(FaultCode.NO_TRAJECTORY, column)


@dataclass(frozen=True)
class MotionLimits:
    """Limits of one motion, at most those of its axis; jerk inf: not limited."""

    max_velocity: float
    max_acceleration: float
    max_jerk: float

    @classmethod
    def of(cls, axis: Axis, velocity: float = math.inf) -> MotionLimits:
        """Return the limits of an axis, with its speed bounded by ``velocity``."""
        return cls(min(axis.max_velocity, velocity), axis.max_acceleration, axis.max_jerk)


class TrajectorySolver:
    """Calculates trajectories from any state; each begins at time 0 and position 0."""

    def __init__(self) -> None:
        self._ruckig = Ruckig(1)

    def to_position(
        self, column: int, state: State, target: float, limits: MotionLimits, rate: float = 1.0
    ) -> Trajectory:
        """Calculate the fastest trajectory to rest at ``target`` with a share ``rate`` of the speed limit.

        Raises:
            TrajectoryError: Ruckig finds none; it names ``column``.
        """
        wanted = self._input(limits, state, jerk=True)
        wanted.max_velocity = [limits.max_velocity * rate]
        displacement = target - state[0]
        # where two shapes of profile meet, rounding may miss both: a nearby displacement has a solution
        for share in _NEARBY:
            wanted.target_position = [displacement * share]
            trajectory = self._calculated(wanted)
            if trajectory is not None:
                return trajectory
        raise TrajectoryError(column)

    def to_velocity(
        self, column: int, state: State, velocity: float, limits: MotionLimits, *, jerk: bool
    ) -> Trajectory:
        """Calculate the fastest trajectory to a velocity; without ``jerk`` the jerk is not limited.

        Raises:
            TrajectoryError: Ruckig finds none; it names ``column``.
        """
        wanted = self._input(limits, state, jerk)
        wanted.control_interface = ControlInterface.Velocity
        for share in _NEARBY:
            wanted.target_velocity = [velocity * share]
            wanted.current_velocity = [state[1] * share]
            trajectory = self._calculated(wanted)
            if trajectory is not None:
                return trajectory
        raise TrajectoryError(column)

    def _input(self, axis: MotionLimits, state: State, jerk: bool) -> InputParameter:
        """Return Ruckig's input with the origin at the start, where rounding is least."""
        wanted = InputParameter(1)
        wanted.current_position = [0.0]
        wanted.current_velocity = [state[1]]
        wanted.max_velocity = [axis.max_velocity]
        wanted.max_acceleration = [axis.max_acceleration]
        limited = jerk and math.isfinite(axis.max_jerk)
        wanted.max_jerk = [axis.max_jerk if limited else math.inf]
        # without a jerk limit the initial acceleration does not matter
        wanted.current_acceleration = [_bounded_acceleration(axis, state) if limited else 0.0]
        return wanted

    def _calculated(self, wanted: InputParameter) -> Trajectory | None:
        trajectory = Trajectory(1)
        try:
            result = self._ruckig.calculate(wanted, trajectory)
        except RuckigError:
            return None
        return trajectory if result in (Result.Working, Result.Finished) else None


def _bounded_acceleration(axis: MotionLimits, state: State) -> float:
    """Return a state's acceleration, bounded so that it can come to 0 within the axis's speed limit."""
    _, velocity, acceleration = state
    bound = axis.max_acceleration
    if velocity * acceleration > 0.0:
        room = max(0.0, axis.max_velocity - abs(velocity))
        bound = min(bound, math.sqrt(2.0 * axis.max_jerk * room))
    return max(-bound, min(bound, acceleration))
