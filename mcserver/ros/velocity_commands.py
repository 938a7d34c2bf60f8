"""Commands of servo mode as MoveIt Servo takes them: twists of a tool, and velocities of joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from mcclient.types import ToolInfo
from numpy.typing import NDArray

from mcserver.ros.joints import Joint
from mcserver.ros.servo_options import CommandType, ServoOptions
from mcserver.units import DEGREE, MM

Array = NDArray[np.float64]

TWIST = "geometry_msgs/msg/TwistStamped"
JOG = "control_msgs/msg/JointJog"


class UnfitCommand(ValueError):
    """A command that nothing moves for."""


class Command(NamedTuple):
    """Velocities as `mcclient.Servo.send` takes them.

    Attributes:
        axes: that it moves, of a joint command in the order of ``velocities``.
        velocities: of the axes, or the tool's twist, shape (3,) or (6,) [mm, deg, per s].
        tool: whose twist it is; None: of axes. frame: of a twist.
    """

    axes: tuple[int, ...]
    velocities: Array
    tool: int | None = None
    frame: Literal["base", "tool"] = "base"

    @property
    def rests(self) -> bool:
        """Whether it asks for no motion."""
        return not self.velocities.any()

    def row(self, axes: Sequence[int]) -> Array:
        """Return what is sent to a program of these axes.

        Raises:
            UnfitCommand: one of its axes takes no targets of its own.
        """
        if self.tool is not None:
            return self.velocities
        row = np.zeros(len(axes))
        for axis, velocity in zip(self.axes, self.velocities, strict=True):
            if axis not in axes:
                raise UnfitCommand(f"axis {axis} is led by another one: name that one's joint")
            row[axes.index(axis)] = velocity
        return row


class CommandReader:
    """Reads the commands for one machine.

    Args:
        bases: of each tool, by its number, the frame in which its poses are.
        prefix: of the names of frames.
    """

    def __init__(
        self,
        options: ServoOptions,
        joints: Sequence[Joint],
        tools: Sequence[ToolInfo],
        bases: Mapping[int, str],
        prefix: str,
    ) -> None:
        self._options = options
        self._joints = {joint.name: joint for joint in joints}
        chosen = [tool for tool in tools if options.tool in (None, tool.number)][:1]
        self._frames: dict[str, tuple[ToolInfo, Literal["base", "tool"]]] = {
            f"{prefix}tool_{tool.number}": (tool, "tool") for tool in tools
        }
        self._frames |= {bases[tool.number]: (tool, "base") for tool in chosen}

    def twist(self, message: Any) -> Command:
        """Read a `TWIST`.

        Raises:
            UnfitCommand: its frame is none of the machine's, or its numbers cannot be meant.
        """
        frame = message.header.frame_id
        if frame not in self._frames:
            known = ", ".join(self._frames) or "none: the machine has no tool"
            raise UnfitCommand(f"frame_id is {frame[:80]!r}; it can be {known}")
        tool, which = self._frames[frame]
        twist, options = message.twist, self._options
        linear = np.array([twist.linear.x, twist.linear.y, twist.linear.z])
        angular = np.array([twist.angular.x, twist.angular.y, twist.angular.z])
        velocities = self._scaled(linear, options.linear) / MM
        turned = self._scaled(angular, options.rotational) / DEGREE
        if tool.orientation:
            velocities = np.concatenate((velocities, turned))
        elif turned.any():
            raise UnfitCommand(f"tool {tool.number} has no orientation: angular has to be 0")
        return Command(tool.axes, velocities, tool.number, which)

    def jog(self, message: Any) -> Command:
        """Read a `JOG`; joints that it does not name stand.

        Raises:
            UnfitCommand: its joints are not the machine's, or its numbers cannot be meant.
        """
        names = message.joint_names
        if len(message.displacements):
            raise UnfitCommand("displacements are not followed: send velocities, or a trajectory")
        if not names or len(message.velocities) != len(names):
            raise UnfitCommand(f"{len(message.velocities)} velocities of {len(names)} joints")
        unknown = [name for name in names if name not in self._joints]
        if unknown or len(set(names)) < len(names):
            raise UnfitCommand(f"no joint {unknown[0][:80]!r}" if unknown else "a joint is named twice")
        joints = [self._joints[name] for name in names]
        velocities = self._scaled(np.array(message.velocities, np.float64), self._options.joint)
        units = np.array([joint.si_per_unit for joint in joints])
        return Command(tuple(joint.axis for joint in joints), velocities / units)

    def _scaled(self, values: Array, scale: float) -> Array:
        """Return velocities [SI]."""
        if not np.isfinite(values).all():
            raise UnfitCommand("its velocities are not all finite")
        if self._options.command_in_type is CommandType.SPEED_UNITS:
            return values
        if (np.abs(values) > 1.0).any():
            raise UnfitCommand(
                "a velocity is beyond 1: commands are unitless (--command-in-type speed_units: m/s and rad/s)"
            )
        return values * scale
