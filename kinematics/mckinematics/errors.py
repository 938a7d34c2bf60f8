"""Faults of inverse kinematics (D-53).

The tree::

    KinematicsError
     +-- ModelError      the URDF or a tool's definition does not fit (MC30x)
     +-- Unreachable     no joint position gives the pose
     +-- JointLimit      the pose needs a joint past its limit
     +-- Singular        the chain loses a direction there
     +-- BranchJump      no continuous joint path
"""

from __future__ import annotations


class KinematicsError(Exception):
    """Base; carries what is known of the place and a remedy.

    Attributes:
        code: stable code (MC3xx).
        tool: tool number. s: path parameter of the first bad point, None for a single pose.
        position: the tool's point there [m].
        residual: distance not reached [m]: of a path at its end, or where it is furthest out of reach; of
            a joint limit at the end with all joints within their limits.
        axis: axis number of the joint, value: what it would need [rad or m].
    """

    code = "MC300"

    def __init__(
        self,
        message: str,
        hint: str = "",
        *,
        tool: int | None = None,
        s: float | None = None,
        position: tuple[float, float, float] | None = None,
        residual: float | None = None,
        axis: int | None = None,
        value: float | None = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.tool = tool
        self.s = s
        self.position = position
        self.residual = residual
        self.axis = axis
        self.value = value


class ModelError(KinematicsError):
    """The URDF or a tool's definition does not fit."""

    code = "MC301"


class Unreachable(KinematicsError):
    """No joint position gives the pose."""

    code = "MC302"


class JointLimit(KinematicsError):
    """The pose needs a joint past its limit (the narrower of URDF and machine file)."""

    code = "MC303"


class Singular(KinematicsError):
    """The chain loses a direction there."""

    code = "MC304"


class BranchJump(KinematicsError):
    """No continuous joint path exists."""

    code = "MC305"
