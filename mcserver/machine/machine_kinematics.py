"""A machine with the kinematics of its tools."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mckinematics.errors import KinematicsError

from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import Machine

if TYPE_CHECKING:
    from mckinematics.solver import MachineKinematics


def build_kinematics(machine: Machine) -> MachineKinematics | None:
    """Return the tools' kinematics; None without tools.

    Raises:
        ConfigurationError: MC301 the URDF or a tool's definition does not fit, or Pinocchio is not installed.
    """
    if not machine.tools:
        return None
    # a machine without tools starts without its solvers
    from mckinematics.solver import MachineKinematics

    try:
        return MachineKinematics(machine)
    except KinematicsError as error:
        raise as_configuration_error(error) from error


def as_configuration_error(error: KinematicsError) -> ConfigurationError:
    """Return a model that does not fit, as a fault of the machine file."""
    return ConfigurationError(error.code, error.message, error.hint)
