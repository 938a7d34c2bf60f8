"""What the kinematics has to know of a machine, and values that say so without a server's machine file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

# Gravity where Z is up [m/s²].
EARTH = (0.0, 0.0, -9.81)


class JointKind(Enum):
    """What an axis moves."""

    LINEAR = "linear"
    ROTARY = "rotary"


class KindDescription(Protocol):
    """``linear`` or ``rotary``."""

    @property
    def value(self) -> str: ...


class AxisDescription(Protocol):
    """An axis that moves a joint; positions in m or rad, infinite where nothing bounds them."""

    @property
    def index(self) -> int: ...
    @property
    def type(self) -> KindDescription: ...
    @property
    def min_position(self) -> float: ...
    @property
    def max_position(self) -> float: ...
    @property
    def initial_position(self) -> float: ...
    @property
    def max_torque(self) -> float | None:
        """Greatest torque of its joint [N·m, N]; infinite: not limited; None: the URDF's effort."""


class PayloadDescription(Protocol):
    """What a tool carries: mass [kg], its centre in the axes of the tool's frame [m], and its inertia about
    that centre, ixx, iyy, izz, ixy, ixz, iyz [kg·m²].
    """

    @property
    def mass(self) -> float: ...
    @property
    def center(self) -> tuple[float, float, float]: ...
    @property
    def inertia(self) -> tuple[float, float, float, float, float, float]: ...


class ToolDescription(Protocol):
    """A tool: a frame of the URDF, the axes of its chain, and what of a pose it keeps.

    ``work`` is the frame in which its poses are and from which its chain goes, None: the base. ``offset`` is
    in m in the frame's own axes; ``euler`` names the order of A B C; ``posture`` is where the axes of a chain
    with joints to spare had best be [rad or m], None without a preference.
    """

    @property
    def number(self) -> int: ...
    @property
    def frame(self) -> str: ...
    @property
    def axes(self) -> tuple[int, ...]: ...
    @property
    def orientation(self) -> bool: ...
    @property
    def euler(self) -> str: ...
    @property
    def offset(self) -> tuple[float, float, float]: ...
    @property
    def payload(self) -> PayloadDescription | None: ...
    @property
    def posture(self) -> tuple[float, ...] | None: ...
    @property
    def work(self) -> str | None: ...


class MachineDescription(Protocol):
    """Axes, tools and the URDF's path; tolerances of a tool's path in m and rad; gravity in the base frame
    [m/s²].
    """

    @property
    def urdf(self) -> str | None: ...
    @property
    def axes(self) -> Sequence[AxisDescription]: ...
    @property
    def tools(self) -> Sequence[ToolDescription]: ...
    @property
    def tool_tolerance(self) -> float: ...
    @property
    def tool_tolerance_angle(self) -> float: ...
    @property
    def gravity(self) -> tuple[float, float, float]: ...


@dataclass(frozen=True)
class JointAxis:
    """An `AxisDescription`."""

    index: int
    type: JointKind = JointKind.ROTARY
    min_position: float = -math.inf
    max_position: float = math.inf
    initial_position: float = 0.0
    max_torque: float | None = math.inf


@dataclass(frozen=True)
class Payload:
    """A `PayloadDescription`."""

    mass: float
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ToolFrame:
    """A `ToolDescription`."""

    number: int
    frame: str
    axes: tuple[int, ...]
    orientation: bool = False
    euler: str = "ZYX"
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    payload: Payload | None = None
    posture: tuple[float, ...] | None = None
    work: str | None = None


@dataclass(frozen=True)
class Robot:
    """A `MachineDescription`."""

    urdf: str | None
    axes: tuple[JointAxis, ...]
    tools: tuple[ToolFrame, ...]
    tool_tolerance: float = 1e-5
    tool_tolerance_angle: float = 1e-4
    gravity: tuple[float, float, float] = EARTH
