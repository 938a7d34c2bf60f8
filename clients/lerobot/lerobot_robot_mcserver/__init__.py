"""Machines of the motion server as robots of LeRobot, by its convention for packages of other makers."""

from lerobot_robot_mcserver.config_mcserver_robot import McserverRobotConfig
from lerobot_robot_mcserver.mcserver_robot import McserverRobot

__all__ = ["McserverRobot", "McserverRobotConfig"]
