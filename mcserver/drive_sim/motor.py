"""A motor with inertia under a servo loop that lags, in turns of its shaft; one step at a time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mcserver.drives.servo_model import loop_coefficients
from mcserver.units import TURN

# A velocity loop forgets what it could not reach beyond this time at the motor's speed limit [s].
WINDUP_S = 0.05
# Below this a motor stands [turn/s].
STANDSTILL = 1e-6


@dataclass(frozen=True)
class Hardware:
    """What cannot be changed over the bus.

    Attributes:
        increments_per_turn: of the encoder. velocity_per_turn: 606Ch at one turn a second; 0: as positions.
        bandwidth_hz: of the position loop. inertia: at the shaft [kg·m²].
        rated_torque: 1000 ‰ [N·m]. max_acceleration [turn/s²]: by the greatest torque. max_speed [turn/s].
        friction: deceleration while free-wheeling [turn/s²]. brake: closes when the motor is off.
        home_switch: from where to where the home switch on the drive's input is active [turn].
    """

    increments_per_turn: float = 65536.0
    velocity_per_turn: float = 0.0
    bandwidth_hz: float = 40.0
    inertia: float = 0.001
    rated_torque: float = 1.0
    max_acceleration: float = 1000.0
    max_speed: float = 100.0
    friction: float = 10.0
    brake: bool = False
    home_switch: tuple[float, float] | None = None


class Motor:
    """State of the shaft.

    Attributes:
        position [turn], velocity [turn/s], torque [N·m]: at the end of the last step.
        limited: whether torque or speed was limited in it. jammed: the shaft cannot turn.
    """

    def __init__(self, hardware: Hardware, position: float) -> None:
        self.hardware = hardware
        self.position = position
        self.velocity = 0.0
        self.torque = 0.0
        self.limited = False
        self.jammed = False
        self._dt = 0.0
        self._coefficients: list[float] = []

    @property
    def stands(self) -> bool:
        return abs(self.velocity) < STANDSTILL

    def follow(self, start: float, end: float, dt: float) -> None:
        """Close the loop on a reference that runs evenly from ``start`` to ``end`` [turn] in ``dt`` [s]."""
        if dt != self._dt:
            self._dt = dt
            table = loop_coefficients(np.array([self.hardware.bandwidth_hz * TURN]), dt)
            self._coefficients = [float(value) for value in table.ravel()]
        rate = (end - start) / dt
        error = self.position - end
        c = self._coefficients
        velocity = c[4] * error + c[5] * self.velocity + (c[6] + c[7]) * rate
        hardware, old = self.hardware, self.velocity
        step = hardware.max_acceleration * dt
        bounded = min(max(velocity, old - step), old + step)
        bounded = min(max(bounded, -hardware.max_speed), hardware.max_speed)
        self.limited = bounded != velocity
        if self.limited:
            position = self.position + 0.5 * (old + bounded) * dt
        else:
            position = end + c[0] * error + c[1] * old + (c[2] + c[3]) * rate
        self._move(position, bounded, dt)

    def push(self, torque: float, dt: float) -> None:
        """Apply a torque [N·m]; friction acts."""
        limit = self.hardware.max_acceleration * self.hardware.inertia * TURN
        applied = min(max(torque, -limit), limit)
        self._slow(applied, self.hardware.friction, dt)
        self.limited = applied != torque or abs(self.velocity) >= self.hardware.max_speed
        self.torque = applied

    def coast(self, dt: float) -> None:
        """Run out: by friction, or by its brake."""
        hardware = self.hardware
        self._slow(0.0, hardware.max_acceleration if hardware.brake else hardware.friction, dt)
        self.limited = False
        self.torque = 0.0

    def _slow(self, torque: float, friction: float, dt: float) -> None:
        pushed = self.velocity + torque / (self.hardware.inertia * TURN) * dt
        # friction takes speed away and never turns it round
        velocity = math.copysign(max(abs(pushed) - friction * dt, 0.0), pushed)
        velocity = min(max(velocity, -self.hardware.max_speed), self.hardware.max_speed)
        self._move(self.position + 0.5 * (self.velocity + velocity) * dt, velocity, dt)

    def _move(self, position: float, velocity: float, dt: float) -> None:
        self.torque = (velocity - self.velocity) / dt * self.hardware.inertia * TURN
        if self.jammed:
            self.velocity = 0.0
            return
        self.position = position
        self.velocity = 0.0 if abs(velocity) < STANDSTILL * 1e-3 else velocity
