"""The torques that the motion of a cycle needs by the machine's model, for drives that take them (60B2h).

Inverse dynamics of the setpoints themselves, whatever has moved them: a program's rows at any rate, an
independent motion, a stop. What it gives is at the motor's shaft, as `AxisBank.torque` is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.axes import AxisBank
from mcserver.executor.entries import Array
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics

if TYPE_CHECKING:
    from mckinematics.dynamics import JointDynamics


class TorqueFeedForward:
    """Sets the torques of axes in position mode before each exchange.

    Args:
        dynamics: of the machine's joints; of this object alone.

    Attributes:
        columns: those of its joints, shape (J,).
    """

    def __init__(self, machine: Machine, bank: AxisBank, dynamics: JointDynamics) -> None:
        self._bank = bank
        self._dynamics = dynamics
        axes = [machine.axes[machine.column_of(axis)] for axis in dynamics.axes]
        self.columns: NDArray[np.intp] = np.array([machine.column_of(axis) for axis in dynamics.axes])
        self._fed = np.array([axis.drive.takes_torques for axis in axes])
        # the power of joint and motor is the same
        self._per_torque: Array = np.array([axis.travel_per_motor_turn / (2.0 * math.pi) for axis in axes])
        self._most = dynamics.efforts
        self._cycle = machine.cycle_s
        self._mask = 0
        for column in self.columns.tolist():
            self._mask |= 1 << column
        # tools chosen, one for each flange
        self._chosen: dict[int, int] = {}
        self._torques: Callable[[Array, Array, Array], Array] = dynamics.live(())
        self._before: Array = np.zeros(len(axes))

    @classmethod
    def of(cls, machine: Machine, bank: AxisBank) -> TorqueFeedForward | None:
        """Return it for a machine one of whose drives takes torques along; None for any other."""
        if not any(axis.drive.takes_torques for axis in machine.axes):
            return None
        kinematics = build_kinematics(machine)
        dynamics = None if kinematics is None else kinematics.dynamics
        return None if dynamics is None else cls(machine, bank, dynamics)

    def choose(self, tools: int) -> None:
        """Take the payloads of chosen tools, as bits of the machine's tools by number."""
        for number in self._dynamics.tools_of(tools):
            self._chosen[self._dynamics.flange(number)] = number
        self._torques = self._dynamics.live(tuple(self._chosen.values()))

    def before_exchange(self) -> None:
        """Set the torques of this cycle."""
        bank, columns = self._bank, self.columns
        held = bank.masks.bools(bank.positioned & bank.energized & self._mask)[columns]
        q = bank.row.setpoint[columns]
        velocity = np.where(held, bank.row.velocity[columns], 0.0)
        acceleration = (velocity - self._before) / self._cycle
        self._before = velocity
        torque = self._torques(q, velocity, acceleration)
        # a model may be wrong by any amount, and a torque that is not finite is left out
        torque = np.clip(np.nan_to_num(torque, nan=0.0), -self._most, self._most)
        fed = held & self._fed
        if fed.any():
            bank.torque[columns[fed]] = (torque * self._per_torque)[fed]
