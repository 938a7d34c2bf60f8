"""Random chains of G93 lines that are handed over bit by bit: each plan goes on from the speed that a line
was entered with, whatever T it and those behind it have.
"""

from __future__ import annotations

import math

import numpy as np

from mcserver.machine.machine_file import Machine
from tests.motion.support import Commit, Move, at_speed, in_time, line_curve

# Sections of a program, and shares of the slowest axis's velocity that their lines ask for in the mean.
SECTIONS, SPEEDS = 2, (0.05, 0.3, 0.9, 1.5)
# Lengths of lines [m], how far steps of a section differ as a share of these, and how far times do.
LENGTHS, BENDS, SPREADS = (2e-4, 2e-3, 2e-2), (0.0, 0.01, 0.1), (0.1, 0.3, 0.8)
AHEAD = (1.0, 20.0, 50.0, 200.0, 1000.0, math.inf)


def timed_moves(rng: np.random.Generator, machine: Machine, tolerance: float) -> list[Move]:
    """Draw sections of lines that go the same way, or any, nearly all with a T; ``tolerance`` in m."""
    width = len(machine.axes)
    fastest = min(axis.max_velocity for axis in machine.axes)
    moves: list[Move] = []
    here = np.zeros(width)
    for _ in range(SECTIONS):
        speed = fastest * float(rng.choice(SPEEDS))
        length, count = float(rng.choice(LENGTHS)), int(rng.integers(4, 20))
        if rng.random() < 0.6:
            steps = rng.normal(size=width) * length
            steps = steps + length * rng.normal(size=(count, width)) * float(rng.choice(BENDS))
        else:
            steps = rng.normal(size=(count, width)) * length
        spread = float(rng.choice(SPREADS))
        for step in steps:
            line = line_curve(machine, tuple(range(width)), here.tolist(), (here + step).tolist())
            if rng.random() < 0.9:
                seconds = max(line.length, 1e-6) / speed * math.exp(spread * rng.normal())
                group = in_time(seconds, line)
            else:
                group = at_speed(speed, line)
            moves.append(Move(group, rng.random() < 0.01, tolerance))
            here = here + step
    return moves


def many_commits(rng: np.random.Generator, moves: int) -> list[Commit]:
    """Draw moments at which the planner hands over, behind some of so many moves."""
    after = np.sort(rng.integers(1, moves + 1, size=int(rng.integers(3, 12)))).tolist()
    return [Commit(number, float(rng.choice(AHEAD)), rng.random() < 0.05) for number in after]
