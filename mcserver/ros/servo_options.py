"""How commands of servo mode are meant, by the names of MoveIt Servo's parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType

import msgspec


class CommandType(StrEnum):
    """What the numbers of a command are: shares from -1 to 1 of the scales, or m/s and rad/s."""

    UNITLESS = "unitless"
    SPEED_UNITS = "speed_units"


class ServoOptions(msgspec.Struct, frozen=True):
    """How commands are meant.

    Attributes:
        name: before the topics.
        linear, rotational: scales of twists [m/s, rad/s]. joint: of joints [rad/s, of linear ones m/s].
        timeout_s: without a newer command for so long the axes stop.
        tool: whose twists in the base's frame are meant; None: the machine's first one.
        within: least and greatest position of joints, by name [rad or m]; empty: their travel.
    """

    name: str = "servo_node"
    command_in_type: CommandType = CommandType.UNITLESS
    linear: float = 0.4
    rotational: float = 0.8
    joint: float = 0.5
    timeout_s: float = 0.1
    tool: int | None = None
    within: Mapping[str, tuple[float, float]] = MappingProxyType({})


DEFAULTS = ServoOptions()


def read_bounds(text: str) -> tuple[str, tuple[float, float]]:
    """Return joint and bounds of ``joint_1=-0.5:0.5``.

    Raises:
        ValueError: it is not of this form.
    """
    name, _, bounds = text.partition("=")
    low, _, high = bounds.partition(":")
    found = float(low), float(high)
    if not name or not -math.inf < found[0] < found[1] < math.inf:
        raise ValueError(text)
    return name, found
