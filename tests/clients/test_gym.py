"""Machines in servo mode as Gymnasium environments."""

from __future__ import annotations

from typing import Any

import gymnasium
import mcclient_gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.limits import assert_keeps, limits_of


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {"actions": "velocities", "tool": None, "machine": "cartesian"},
        {"actions": "positions", "tool": 1},
        {"machine": "robot-dog", "tool": 3},
    ],
)
def test_gymnasium_s_own_check_finds_nothing(keys: dict[str, Any]) -> None:
    check_env(gymnasium.make("mcclient_gym/Reach-v0", **keys).unwrapped)


@pytest.mark.parametrize("actions", ["velocities", "positions", "twist"])
def test_no_action_breaks_a_limit(actions: mcclient_gym.Actions) -> None:
    env = mcclient_gym.ReachEnv(actions=actions, period_s=0.001)
    env.reset(seed=7)
    rng, rows = np.random.default_rng(7), [env.positions.copy()]
    for step in range(600):
        if step % 40 == 0:
            action = rng.choice([-1.0, -0.2, 0.0, 0.5, 1.0], 6)
        env.step(action)
        rows.append(env.positions.copy())
    assert_keeps(rows, limits_of(env.machine), most=(1.0 + 1e-5,) * 3)
    assert env.servo.taken + env.servo.jumped == 600


def test_a_velocity_is_reached_and_an_action_that_is_no_number_stops() -> None:
    env = mcclient_gym.ServoEnv("cartesian")
    env.reset()
    action = np.zeros(env.action_space.shape)
    action[0] = 0.5
    for _ in range(20):
        env.step(action)
    assert env.velocities[0] == pytest.approx(0.5 * env.machine.axes[0].max_velocity)
    for _ in range(20):
        env.step(np.full(len(action), np.nan))
    assert env.servo.refused == 20
    assert not env.velocities.any()


def test_a_tool_led_straight_to_its_goal_ends_the_episode() -> None:
    env = mcclient_gym.ReachEnv()
    observation, _ = env.reset(seed=3)
    total, terminated = 0.0, False
    for _ in range(500):
        way = observation[-3:] - observation[12:15]
        action = np.concatenate((np.clip(4.0 * way, -1.0, 1.0), np.zeros(3)))
        observation, reward, terminated, _, info = env.step(action)
        total += reward
        if terminated:
            break
    assert terminated
    assert total > 0.0
    assert info["servo"].refused == 0


def test_episodes_begin_alike_with_a_seed_and_where_they_are_told_to() -> None:
    vector = gymnasium.make_vec("mcclient_gym/Reach-v0", num_envs=2, vectorization_mode="sync")
    first, _ = vector.reset(seed=5)
    vector.step(vector.action_space.sample())
    again, _ = vector.reset(seed=5)
    assert (first == again).all()
    env = mcclient_gym.ServoEnv(actions="velocities")
    observation, _ = env.reset(options={"positions": np.full(6, 0.1)})
    assert observation.tolist() == [0.1] * 6 + [0.0] * 6


def test_actions_that_a_machine_has_not_are_refused() -> None:
    with pytest.raises(ValueError, match="travel"):
        mcclient_gym.ServoEnv("cartesian", actions="positions")
    with pytest.raises(ValueError, match="tool"):
        mcclient_gym.ServoEnv(actions="twist")
