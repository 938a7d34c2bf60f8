"""A goal of two joints as it comes over the network."""

from __future__ import annotations

import math

from mcserver.ros.interfaces import interfaces
from mcserver.ros.joints import Joint
from tests.ros.wire import FOLLOW, trajectory

ROS_GOAL = f"{FOLLOW}_SendGoal_Request"
ROS_JOINTS = {
    "a": Joint("a", 0, True, math.radians(1.0), -2.0, 2.0, 3.0, 1e-4),
    "bcd": Joint("bcd", 1, False, 1e-3, -math.inf, math.inf, 1.0, 1e-5),
}


def ros_goal_payload() -> bytes:
    """Return a request of ``send_goal``."""
    make = interfaces().make
    tolerance = make("control_msgs/msg/JointTolerance", name="a", position=0.1)
    way = trajectory(["a", "bcd"], (1.0, [0.5, -0.1]), (2.0, [0.6, 0.1]))
    goal = make(f"{FOLLOW}_Goal", trajectory=way, path_tolerance=[tolerance])
    return interfaces().encode(ROS_GOAL, make(ROS_GOAL, goal=goal))
