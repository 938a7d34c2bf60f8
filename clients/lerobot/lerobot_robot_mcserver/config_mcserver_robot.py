"""``--robot.type=mcserver`` of LeRobot's programs, and what is set behind ``--robot.``."""

from __future__ import annotations

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig


@RobotConfig.register_subclass("mcserver")
@dataclass(kw_only=True)
class McserverRobotConfig(RobotConfig):
    """A machine and those of its axes that are one robot.

    Attributes:
        axes: their numbers; features have this order.
        machine: its name; empty: the only one that is there. connect: the server's endpoint; empty: that of
            ``MC_CONNECT``, or this computer's.
        low, high: least and greatest position of each axis that actions lead to [mm or deg]; empty: travel.
            A machine with bodies or zones needs them.
        start_within: how far the axes may be from an action that follows none [mm or deg].
        counts_s: how long an action counts: without a newer one by then the axes stop [s].
        cameras: of LeRobot, by name.
    """

    axes: list[int]
    machine: str = ""
    connect: str = ""
    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)
    start_within: float = 10.0
    counts_s: float = 0.5
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
