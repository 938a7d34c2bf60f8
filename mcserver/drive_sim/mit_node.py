"""What simulated motors in MIT mode have in common: they go on by their latest command until their time-out.

After power a motor knows its place within one turn of the output shaft.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable

from mcserver.drive_sim.motor import Hardware
from mcserver.drive_sim.streamed_node import BOOT_S, StreamedNode
from mcserver.drives.mit_numbers import Feedback
from mcserver.units import TURN

# Longest step of the motor's own loop, and the longest time that is made up for [s].
STEP_S = 1e-4
LONGEST_S = 0.05
# Without frames it moves on so often [s].
IDLE_S = 0.005
# Position, velocity, stiffness, damping and torque of a motor that has no command yet.
LIMP = (0.0, 0.0, 0.0, 0.0, 0.0)


class MitNode(StreamedNode):
    """One motor."""

    def __init__(
        self,
        node: int,
        transmit: Callable[[int, bytes], None],
        hardware: Hardware | None = None,
        position: float = 0.0,
    ) -> None:
        """Make a motor that is off; ``position``: of its output shaft [turn]."""
        super().__init__(node, transmit, hardware, position)
        self.wake = math.inf
        self._zero = 0.0
        self._target = LIMP
        self._heard_at = self._stepped_at = 0.0

    @property
    @abstractmethod
    def enabled(self) -> bool: ...

    @property
    @abstractmethod
    def timeout_s(self) -> float:
        """Silence after which it lets go [s]; 0: never."""

    @property
    @abstractmethod
    def greatest_torque(self) -> float:
        """At its output shaft [N·m]."""

    @abstractmethod
    def forget(self) -> None:
        """Lose what its power keeps."""

    @abstractmethod
    def let_go(self) -> None:
        """Do what it does when its time-out is over."""

    def switch_on(self, now: float) -> None:
        """Power comes: nothing is heard for a moment; the shaft is within half a turn of its zero."""
        self._booting = True
        self.forget()
        self._stepped_at = now
        self.wake = now + BOOT_S

    def poll(self, now: float) -> None:
        """Move on; sets `wake`."""
        if self._booting:
            self._booting = False
            self._zero = math.floor(self.motor.position + 0.5)
        self._advance(now)
        self.wake = now + IDLE_S

    def _advance(self, now: float) -> None:
        self._stepped_at = max(self._stepped_at, now - LONGEST_S)
        if 0.0 < self.timeout_s < now - self._heard_at and self.enabled:
            self.let_go()
        left = now - self._stepped_at
        steps = math.ceil(left / STEP_S - 1e-9)
        for _ in range(steps):
            self._step(left / steps)
        self._stepped_at = now

    def _step(self, dt: float) -> None:
        motor = self.motor
        if not self.enabled:
            if not motor.stands:
                motor.coast(dt)
            return
        position, velocity, kp, kd, torque = self._target
        here = self._feedback(0)
        wanted = kp * (position - here.position) + kd * (velocity - here.velocity) + torque
        most = self.greatest_torque
        motor.push(min(max(wanted, -most), most), dt)

    def _feedback(self, status: int) -> Feedback:
        """Return what it measures."""
        motor = self.motor
        place = (motor.position - self._zero) * TURN
        return Feedback(status, place, motor.velocity * TURN, motor.torque, 31, 28)
