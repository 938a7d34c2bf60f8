"""Interfaces that the type library does not have, as their packages define them for ROS 2 Jazzy.

Constants are left out, as they are no part of a type's hash.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

MESSAGES: Mapping[str, str] = MappingProxyType(
    {
        "control_msgs/msg/JointJog": """
std_msgs/msg/Header header
string[] joint_names
float64[] displacements
float64[] velocities
float64 duration
""",
        "control_msgs/msg/JointTolerance": """
string name
float64 position
float64 velocity
float64 acceleration
""",
        "control_msgs/msg/JointComponentTolerance": """
string joint_name
uint16 component
float64 position
float64 velocity
float64 acceleration
""",
    }
)

EVENT_INFO = """
uint8 event_type
builtin_interfaces/msg/Time stamp
uint8[16] client_gid
int64 sequence_number
"""

# request and response
SERVICES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "action_msgs/srv/CancelGoal": (
            "action_msgs/msg/GoalInfo goal_info",
            "int8 return_code\naction_msgs/msg/GoalInfo[] goals_canceling",
        ),
        # no standard service takes a text and says how its execution ended; deploy/ros has the package
        "mcserver_msgs/srv/RunProgram": (
            "string text\nstring name",
            "bool success\nstring code\nstring message",
        ),
    }
)

# goal, result and feedback
ACTIONS: Mapping[str, tuple[str, str, str]] = MappingProxyType(
    {
        "control_msgs/action/FollowJointTrajectory": (
            """
trajectory_msgs/msg/JointTrajectory trajectory
trajectory_msgs/msg/MultiDOFJointTrajectory multi_dof_trajectory
control_msgs/msg/JointTolerance[] path_tolerance
control_msgs/msg/JointComponentTolerance[] component_path_tolerance
control_msgs/msg/JointTolerance[] goal_tolerance
control_msgs/msg/JointComponentTolerance[] component_goal_tolerance
builtin_interfaces/msg/Duration goal_time_tolerance
""",
            "int32 error_code\nstring error_string",
            """
std_msgs/msg/Header header
string[] joint_names
trajectory_msgs/msg/JointTrajectoryPoint desired
trajectory_msgs/msg/JointTrajectoryPoint actual
trajectory_msgs/msg/JointTrajectoryPoint error
string[] multi_dof_joint_names
trajectory_msgs/msg/MultiDOFJointTrajectoryPoint multi_dof_desired
trajectory_msgs/msg/MultiDOFJointTrajectoryPoint multi_dof_actual
trajectory_msgs/msg/MultiDOFJointTrajectoryPoint multi_dof_error
""",
        ),
    }
)
