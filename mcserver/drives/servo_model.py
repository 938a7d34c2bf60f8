"""How a simulated servo follows its setpoints: a critically damped loop with feed-forward, solved exactly.

With tracking error e = p - p_ref, bandwidth ω and feed-forward shares k_v, k_a, the loop is

    ë + 2ωė + ω²e = -((1 - k_v)·2ω·v_ref + (1 - k_a)·a_ref)

For a right-hand side that is constant over a cycle its solution is linear in the state at the cycle's start,
so one product of coefficients serves any bandwidth at any cycle time and cannot become unstable.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.machine.axis import Axis
from mcserver.units import TURN

Array = NDArray[np.float64]

# Shares of velocity and acceleration that are fed forward: a lag that is not zero, 0.04 mm at 1 m/s and 40
# Hz.
VELOCITY_FEED_FORWARD = 0.995
ACCELERATION_FEED_FORWARD = 0.98
# A drive that names no friction slows down, free-wheeling, at this share of the axis's acceleration limit.
DEFAULT_FRICTION = 0.1
# A drive cuts off speeds above the axis's limit by this factor.
OVERSPEED = 1.2


class ServoModel:
    """Constants of n servos and the step of their loops.

    Attributes:
        coefficients: of the loops, see `loop_coefficients`.
        acceleration_per_torque: shape (n,) [m/s² or rad/s² per N·m]; the inertia is the motor's side.
        step_limit: shape (n,), largest change of speed in a cycle by the largest torque; inf: not limited.
        speed_limit: shape (n,). friction, braking: decelerations, shape (n,), not negative.
    """

    def __init__(self, axes: Sequence[Axis], cycle_s: float) -> None:
        omega = np.array([axis.drive.bandwidth_hz * TURN for axis in axes])
        self.coefficients = loop_coefficients(omega, cycle_s)
        self._terms = np.empty_like(self.coefficients)
        self.acceleration_per_torque = np.array(
            [axis.travel_per_motor_turn / TURN / max(axis.drive.inertia, 1e-12) for axis in axes]
        )
        self.torque_limit = np.array(
            [axis.drive.max_torque if axis.drive.max_torque > 0.0 else np.inf for axis in axes]
        )
        self.torque_per_step = 1.0 / (self.acceleration_per_torque * cycle_s)
        self.step_limit = self.torque_limit / self.torque_per_step
        self.speed_limit = np.array([OVERSPEED * axis.max_velocity for axis in axes])
        self.friction = np.array(
            [
                axis.drive.friction_decel * axis.type.si_per_unit
                if axis.drive.friction_decel > 0.0
                else DEFAULT_FRICTION * axis.max_acceleration
                for axis in axes
            ]
        )
        self.braking = np.array([axis.max_acceleration for axis in axes])
        self.resolution = np.array([axis.drive.encoder_resolution * axis.type.si_per_unit for axis in axes])
        self.quantized = bool((self.resolution > 0.0).any())

    def step(self, state: Array, result: Array) -> None:
        """One cycle of the loops.

        Args:
            state: shape (4, n): position minus new position setpoint, velocity, old and new velocity
                setpoint.
            result: shape (2, n), filled with the new tracking error and the new velocity.
        """
        np.multiply(self.coefficients, state, out=self._terms)
        np.add.reduce(self._terms, axis=1, out=result)

    def encoder(self, position: Array, out: Array) -> None:
        """The encoders' readings of true positions, shape (…, n), in steps of their resolutions."""
        if not self.quantized:
            out[:] = position
            return
        coarse = self.resolution > 0.0
        out[:] = position
        steps = np.round(position[..., coarse] / self.resolution[coarse])
        out[..., coarse] = steps * self.resolution[coarse]


def loop_coefficients(omega: Array, cycle_s: float) -> Array:
    """Shape (2, 4, n): what the new tracking error and the new velocity are made of.

    With a = p - p_ref, v, u0 = old and u1 = new velocity setpoint: the reference moves by (u0 + u1)/2·dt in
    the cycle, so the error at its start is e0 = a + (u0 + u1)/2·dt, its rate v - u0, and the particular
    solution is -(2(1 - k_v)/ω)·u1 - ((1 - k_a)/ω²)·(u1 - u0)/dt.
    """
    decay = np.exp(-omega * cycle_s)
    error_by_error = decay * (1.0 + omega * cycle_s)
    error_by_rate = decay * cycle_s
    rate_by_error = -decay * omega * omega * cycle_s
    rate_by_rate = decay * (1.0 - omega * cycle_s)
    half = 0.5 * cycle_s
    by_acceleration = (1.0 - ACCELERATION_FEED_FORWARD) / (omega * omega * cycle_s)
    particular_old = by_acceleration
    particular_new = -2.0 * (1.0 - VELOCITY_FEED_FORWARD) / omega - by_acceleration
    error = [
        error_by_error,
        error_by_rate,
        error_by_error * (half - particular_old) - error_by_rate + particular_old,
        error_by_error * (half - particular_new) + particular_new,
    ]
    velocity = [
        rate_by_error,
        rate_by_rate,
        rate_by_error * (half - particular_old) - rate_by_rate,
        rate_by_error * (half - particular_new) + 1.0,
    ]
    return np.array([error, velocity])
