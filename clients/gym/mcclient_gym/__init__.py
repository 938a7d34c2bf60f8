"""Gymnasium environments of machines in servo mode, on a virtual clock."""

import gymnasium

from mcclient_gym.reach import ReachEnv
from mcclient_gym.servo import Actions, ServoEnv

__all__ = ["Actions", "ReachEnv", "ServoEnv"]

gymnasium.register("mcclient_gym/Reach-v0", "mcclient_gym.reach:ReachEnv", max_episode_steps=250)
