"""Comma lines in the flow: the group that ends last carries its speed, the others rest (D-32)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mcserver.motion.canonical import FeedGroup
from mcserver.units import MM, AxisType
from tests.motion.comma_programs import MIXED_TIMES, TIMES, CommaProgram, comma_program, run
from tests.motion.measure import (
    ACCELERATION_SLACK,
    JERK_SLACK,
    VELOCITY_SLACK,
    acceleration_ratio,
    away_from,
    jerk_ratio,
    velocity_ratio,
)
from tests.motion.support import Motion, edges_of

SEEDS = range(40)
EXACT = 1e-9
# A time that is kept to the microsecond [cycles].
KEPT = 1e-3


def columns_of(program: CommaProgram, group: FeedGroup) -> list[int]:
    return [program.machine.column_of(axis) for axis in group.axes]


def farthest(program: CommaProgram, motion: Motion) -> float:
    """Greatest distance of a group's axes from its own path or that of the same axes in the lines beside it
    while its line is under way [m]."""
    base = np.zeros(len(program.machine.axes))
    bases = []
    for groups in program.lines:
        bases.append(base.copy())
        for group in groups:
            for curve in group.curves:
                base[list(curve.axes)] = curve.position(np.array([1.0]))[0]
    bases.append(base)
    worst = 0.0
    for number, groups in enumerate(program.lines, start=1):
        low, high = math.ceil(motion.starts[number]), math.floor(motion.ends[number])
        rows = motion.position[max(low - 1, 0) : high]
        for group in groups:
            columns = columns_of(program, group)
            distance = np.full(len(rows), math.inf)
            for other in (number, number - 1, number + 1):
                if not 1 <= other <= len(program.lines):
                    continue
                points = np.tile(bases[other - 1], (len(rows), 1))
                points[:, columns] = rows[:, columns]
                for each in program.lines[other - 1]:
                    if set(columns_of(program, each)) & set(columns) and len(rows):
                        away = away_from(program.machine, each, bases[other - 1], points)
                        distance = np.minimum(distance, away)
            resting = np.linalg.norm(
                (rows[:, columns] - bases[number][columns])
                * [MM / program.machine.axes[c].type.si_per_unit for c in columns],
                axis=1,
            )
            worst = max(worst, float(np.minimum(distance, resting).max(initial=0.0)))
    return worst


def fastest_over_f(program: CommaProgram, motion: Motion) -> float:
    """Greatest path speed of a G94 group over its F."""
    worst = 0.0
    rows = np.concatenate([np.zeros((1, motion.position.shape[1])), motion.position])
    for number, groups in enumerate(program.lines, start=1):
        low, high = math.ceil(motion.starts[number]), math.floor(motion.ends[number])
        for group in groups:
            if group.speed is None:
                continue
            axes = group.curves[0].axes
            linear = [axis for axis in axes if program.machine.axes[axis].type is AxisType.LINEAR]
            inside = rows[low : high + 1, list(linear or axes)]
            speed = np.linalg.norm(np.diff(inside, axis=0), axis=1) / program.machine.cycle_s
            worst = max(worst, float(speed.max(initial=0.0)) / group.speed)
    return worst


@pytest.mark.parametrize("seed", SEEDS)
def test_comma_lines_in_the_flow_keep_every_limit_path_and_time(seed: int) -> None:
    check(seed)


@pytest.mark.parametrize("seed", range(12))
def test_short_times_beside_long_ones_end_no_line_before_its_own(seed: int) -> None:
    check(seed, MIXED_TIMES)


def check(seed: int, times: tuple[float, ...] = TIMES) -> None:
    """Hold the program of a seed against its laws, and against that with rest at both ends of each line."""
    program = comma_program(seed, times=times)
    motion, resting = run(program), run(program, at_rest=True)
    assert velocity_ratio(motion) <= VELOCITY_SLACK
    assert acceleration_ratio(motion) <= ACCELERATION_SLACK
    if program.tolerance > 0.0:
        assert jerk_ratio(motion) <= JERK_SLACK
    assert farthest(program, motion) <= program.tolerance + EXACT
    assert fastest_over_f(program, motion) <= VELOCITY_SLACK
    end = np.zeros(len(program.machine.axes))
    for group in (group for groups in program.lines for group in groups):
        end[columns_of(program, group)] = group.curves[0].position(np.array([1.0]))[0]
    assert np.abs(motion.position[-1] - end).max() <= EXACT
    edges = edges_of(motion.pieces)
    order = [(line, ends) for _, line, ends in edges]
    assert order == [(n, ends) for n in range(1, len(program.lines) + 1) for ends in (False, True)]
    assert (np.diff([u for u, _, _ in edges]) >= -1e-6).all()
    kept = all(keeps_time(program, resting, number) for number in range(1, len(program.lines) + 1))
    for number in range(1, len(program.lines) + 1):
        if kept and not program.commits:
            assert keeps_time(program, motion, number)
        assert not ends_early(program, motion, number)
    if kept:
        assert motion.duration <= resting.duration * 1.0005 + 1.5 * motion.cycle


def keeps_time(program: CommaProgram, motion: Motion, number: int) -> bool:
    """Whether a line keeps the T of its groups, if they have one."""
    groups = program.lines[number - 1]
    if any(group.duration is None for group in groups):
        return True
    wanted = max(group.requested for group in groups) / program.machine.cycle_s
    return abs(motion.ends[number] - motion.starts[number] - wanted) <= KEPT


def ends_early(program: CommaProgram, motion: Motion, number: int) -> bool:
    """Whether a line ends more than a cycle before the longest T of its groups."""
    asked = [group.duration for group in program.lines[number - 1] if group.duration is not None]
    took = motion.ends[number] - motion.starts[number]
    return bool(asked) and took < max(asked) / program.machine.cycle_s - 1.0
