"""Build the kinematics of a machine's tools."""

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
        ConfigurationError: MC301 the URDF contradicts a tool's definition, or Pinocchio is not installed.
    """
    if not machine.tools:
        return None
    # do not load the solvers for a machine without tools
    from mckinematics.solver import MachineKinematics

    try:
        return MachineKinematics(machine)
    except KinematicsError as error:
        raise as_configuration_error(error) from error


def as_configuration_error(error: KinematicsError) -> ConfigurationError:
    """Convert a fault of the model to one of the machine file."""
    return ConfigurationError(error.code, error.message, error.hint)
