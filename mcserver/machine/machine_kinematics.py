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
        ConfigurationError: MC301 the URDF contradicts a tool's definition, or Pinocchio is not installed;
            MC094 a tool with follow has redundant joints, or a work frame that its joints move.
    """
    if not machine.tools:
        return None
    # do not load the solvers for a machine without tools
    from mckinematics.solver import MachineKinematics

    try:
        kinematics = MachineKinematics(machine)
    except KinematicsError as error:
        raise as_configuration_error(error) from error
    for tool in machine.tools:
        model = kinematics.tool(tool.number)
        if tool.follow is not None and (model.chain.carried or model.chain.size > model.rank):
            what = "its joints move its work frame" if model.chain.carried else "it has joints to spare"
            raise ConfigurationError(
                "MC094",
                f"T{tool.number} cannot follow another axis: {what}",
                "leave its follow out; with orientation = true an arm has fewer to spare",
            )
    return kinematics


def as_configuration_error(error: KinematicsError) -> ConfigurationError:
    """Convert a fault of the model to one of the machine file."""
    return ConfigurationError(error.code, error.message, error.hint)
