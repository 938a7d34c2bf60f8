"""Servo mode beside Ruckig alone: µs a cycle, and how a sine of 1 Hz is followed that comes at 100 Hz."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import mcclient_gym
import numpy as np
from numpy.typing import NDArray
from ruckig import InputParameter, OutputParameter, Ruckig

from mcserver.executor.shm.target_box import Targets
from mcserver.executor.target_follower import TargetFollower
from mcserver.motion.kernels.target_tracking import follow_reference
from mcserver.service.target_stream import Now, TargetMessage, TargetStream
from tests.bench.figures import Figure, percentiles, processor_seconds
from tests.bench.machines import ideal

Array = NDArray[np.float64]

CYCLE_S, PERIOD = 1e-3, 10
CYCLES = 4000
# The first of them: from rest to what is followed.
SETTLED = 1000
AMPLITUDE = 0.05
# Of an environment's episode.
ACTIONS = 250
VELOCITY, ACCELERATION, JERK = 1.0, 10.0, 200.0


@dataclass(frozen=True)
class Followed:
    """How a sine was followed.

    Attributes:
        delay_s: by which the setpoints are behind, as the sine that is nearest to them.
        error: what is left once they are brought forward by it, at most [m]. jerk: of the setpoints, mean of
            squares, root [m/s³].
    """

    delay_s: float
    error: float
    jerk: float


def measure() -> list[Figure]:
    """The figures of the section."""
    figures = []
    for axes in (6, 64):
        taken, floor = cycles_of(axes), cycles_of_ruckig(axes)
        what, against = f"{axes} axes with new targets in each cycle", f"Ruckig's update of {axes} axes"
        figures += percentiles(what, taken.tolist(), floor.tolist(), against)
    for name, ours, theirs in (
        (
            "positions and velocities",
            followed(with_velocities=True),
            followed_by_ruckig(with_velocities=True),
        ),
        ("positions alone", followed(with_velocities=False), followed_by_ruckig(with_velocities=False)),
    ):
        against = "Ruckig, to each target"
        figures += [
            Figure(f"{name}: delay", 1e3 * ours.delay_s, "ms", 1e3 * theirs.delay_s, against),
            Figure(f"{name}: error behind that delay", 1e6 * ours.error, "µm", 1e6 * theirs.error, against),
            Figure(f"{name}: jerk, rms", ours.jerk, "m/s³", theirs.jerk, f"{against}; the sine has 8.8"),
        ]
    for actions in ("velocities", "twist"):
        what = f"environment of arm6, 50 actions a second, by {actions}"
        figures.append(Figure(what, environment_speed(actions), "x real time", goal="100 and more"))
    return figures


def environment_speed(actions: mcclient_gym.Actions) -> float:
    """How many times as fast as its clock an environment runs, of processor time."""
    env = mcclient_gym.ReachEnv("arm6", actions=actions, tool=1)
    env.action_space.seed(1)
    chosen = [env.action_space.sample() for _ in range(ACTIONS)]

    def episode() -> None:
        env.reset(seed=1)
        for action in chosen:
            env.step(action)

    episode()
    return ACTIONS * env.cycles * env.machine.cycle_s / processor_seconds(episode, runs=15)


def _sine(t: float) -> tuple[float, float]:
    turn = 2.0 * math.pi
    return AMPLITUDE * math.sin(turn * t), AMPLITUDE * turn * math.cos(turn * t)


def cycles_of(axes: int) -> Array:
    """Microseconds that each cycle of axes takes that follow sines, reading the reference included."""
    states, found = np.zeros((axes, 3)), np.zeros((axes, 3))
    limits = np.tile([VELOCITY, ACCELERATION, JERK, -math.inf, math.inf], (axes, 1))
    knots = np.zeros((2, 1 + 2 * axes))
    phases = np.arange(axes)
    taken = np.zeros(CYCLES)
    for cycle in range(CYCLES):
        angle = 2.0 * math.pi * cycle * CYCLE_S + phases
        knots[0], knots[1, 0] = knots[1], cycle * CYCLE_S
        knots[1, 1 : 1 + axes] = AMPLITUDE * np.sin(angle)
        knots[1, 1 + axes :] = AMPLITUDE * 2.0 * math.pi * np.cos(angle)
        begun = time.perf_counter()
        follow_reference(states, found, knots, limits, 1.0, knots[1:, 0].copy(), CYCLE_S, False)
        taken[cycle] = 1e6 * (time.perf_counter() - begun)
    return taken[SETTLED:]


def _ruckig(axes: int) -> tuple[Ruckig, InputParameter, OutputParameter]:
    wanted = InputParameter(axes)
    wanted.max_velocity = [VELOCITY] * axes
    wanted.max_acceleration = [ACCELERATION] * axes
    wanted.max_jerk = [JERK] * axes
    return Ruckig(axes, CYCLE_S), wanted, OutputParameter(axes)


def cycles_of_ruckig(axes: int) -> Array:
    """Microseconds of Ruckig's own update in each cycle, with the same targets."""
    solver, wanted, output = _ruckig(axes)
    phases = np.arange(axes)
    taken = np.zeros(CYCLES)
    for cycle in range(CYCLES):
        angle = 2.0 * math.pi * cycle * CYCLE_S + phases
        wanted.target_position = (AMPLITUDE * np.sin(angle)).tolist()
        wanted.target_velocity = (AMPLITUDE * 2.0 * math.pi * np.cos(angle)).tolist()
        begun = time.perf_counter()
        solver.update(wanted, output)
        output.pass_to_input(wanted)
        taken[cycle] = 1e6 * (time.perf_counter() - begun)
    return taken[SETTLED:]


def followed(*, with_velocities: bool) -> Followed:
    """Stream the sine through the filter of the server and follow it as the executor does."""
    machine = ideal(axes=1, velocity=1000.0, acceleration=10_000.0, jerk=200_000.0)
    stream = TargetStream(machine.axes, CYCLE_S)
    follower = TargetFollower(machine.axes, np.zeros(1), at=0.0, cycle_s=CYCLE_S)

    def step(cycle: int, position: float, velocity: float) -> float:
        now = cycle * CYCLE_S
        if cycle % PERIOD == 0:
            speeds = np.array([[velocity]]) if with_velocities else None
            message = TargetMessage(cycle // PERIOD + 1, now, 1.0, np.array([[position]]), speeds, None)
            targets = stream.take(message, Now(now))
            assert isinstance(targets, Targets)
            follower.take(targets)
        follower.step(np.array([now + CYCLE_S]), 1.0)
        return float(follower.states[0, 0])

    return _followed(step)


def followed_by_ruckig(*, with_velocities: bool) -> Followed:
    """Give Ruckig each target as it comes, with its velocity or at rest."""
    solver, wanted, output = _ruckig(1)

    def step(cycle: int, position: float, velocity: float) -> float:
        if cycle % PERIOD == 0:
            wanted.target_position = [position]
            wanted.target_velocity = [velocity if with_velocities else 0.0]
        solver.update(wanted, output)
        output.pass_to_input(wanted)
        return float(output.new_position[0])

    return _followed(step)


def _followed(step: Callable[[int, float, float], float]) -> Followed:
    """Play the sine, and find the delay of the setpoints by their own first harmonic."""
    setpoints = np.array([step(cycle, *_sine(cycle * CYCLE_S)) for cycle in range(CYCLES)])[SETTLED:]
    t = np.arange(SETTLED, CYCLES) * CYCLE_S + CYCLE_S
    turn = 2.0 * math.pi
    waves = np.column_stack((np.sin(turn * t), np.cos(turn * t)))
    (a, b), *_ = np.linalg.lstsq(waves, setpoints, rcond=None)
    delay = math.atan2(-b, a) / turn
    error = float(np.abs(setpoints - AMPLITUDE * np.sin(turn * (t - delay))).max())
    jerk = float(np.sqrt((np.diff(setpoints, 3) ** 2).mean())) / CYCLE_S**3
    return Followed(delay, error, jerk)
