"""Torque feed-forward by the machine's dynamic model, for drives that accept it (60B2h).

Inverse dynamics of the setpoints, whatever has set them: a program's rows at any rate, independent motion, a
stop. Torques are at the motor's shaft, as in `AxisBank.torque`.
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
        dynamics: of the machine's joints; not shared, since `choose` changes its payloads.

    Attributes:
        columns: those of its joints, shape (J,).
    """

    def __init__(self, machine: Machine, bank: AxisBank, dynamics: JointDynamics) -> None:
        self._bank = bank
        self._dynamics = dynamics
        axes = [machine.axes[machine.column_of(axis)] for axis in dynamics.axes]
        self.columns: NDArray[np.intp] = np.array([machine.column_of(axis) for axis in dynamics.axes])
        self._fed = np.array([axis.drive.takes_torques for axis in axes])
        # joint and motor have the same power
        self._per_torque: Array = np.array([axis.travel_per_motor_turn / (2.0 * math.pi) for axis in axes])
        self._most = dynamics.efforts
        self._cycle = machine.cycle_s
        self._mask = sum(1 << column for column in self.columns.tolist())
        # the chosen tool by flange
        self._chosen: dict[int, int] = {}
        self._torques: Callable[[Array, Array, Array], Array] = dynamics.live(())
        self._before: Array = np.zeros(len(axes))

    @classmethod
    def of(cls, machine: Machine, bank: AxisBank) -> TorqueFeedForward | None:
        """Return it for a machine with a drive that accepts torques; else None."""
        if not any(axis.drive.takes_torques for axis in machine.axes):
            return None
        kinematics = build_kinematics(machine)
        dynamics = None if kinematics is None else kinematics.dynamics
        return None if dynamics is None else cls(machine, bank, dynamics)

    def choose(self, tools: int) -> None:
        """Set the payloads of chosen tools, given as bits by tool number."""
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
        # the model may be wrong by any amount: clip torques, and drop those that are not finite
        torque = np.clip(np.nan_to_num(torque, nan=0.0), -self._most, self._most)
        fed = held & self._fed
        if fed.any():
            bank.torque[columns[fed]] = (torque * self._per_torque)[fed]
