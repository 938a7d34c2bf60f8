"""Orders while programs of the planner are played: limits where axes join, and what an override is worth."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from mcserver.executor.entries import Control, ControlKind
from mcserver.machine.machine_file import Machine
from mcserver.motion.pieces import Activation, Deactivation, Rows
from tests.executor.rig import Rig
from tests.limits import assert_keeps, limits_of
from tests.motion.measure import bow_of, from_polyline
from tests.motion.support import Motion, Move, alike, arc_curve, at_speed, line_curve, plan

Point = tuple[float, float]


def rig_of(machine: Machine, motion: Motion, feed_scale: Callable[[int], float] = lambda _u: 1.0) -> Rig:
    """All that the planner hands over, ready to be played.

    Args:
        feed_scale: that the row at u is said to be planned for.
    """
    rig = Rig(machine)
    rig.program.capture()
    ring = rig.program.ring
    for piece in motion.pieces:
        if isinstance(piece, Rows):
            scales = np.array([feed_scale(piece.first + index) for index in range(len(piece.line))])
            ring.put_rows(replace(piece, feed_scale=scales))
            rig.program.u = float(piece.first + len(piece.line) - 1)
        elif isinstance(piece, Activation):
            ring.put_control(Control(ControlKind.BEGIN, piece.u, piece.line, axes=piece.mask))
        elif isinstance(piece, Deactivation):
            end = Control(ControlKind.END, piece.u, piece.line, axes=piece.mask, values=piece.position)
            ring.put_control(end)
    rig.program.finish()
    return rig


def lines(machine: Machine, points: Sequence[Point], speed: float) -> list[Move]:
    curves = [line_curve(machine, moving(a, b), *ends(a, b)) for a, b in itertools.pairwise(points)]
    return [Move(at_speed(speed, curve), tolerance=5e-5) for curve in curves]


def moving(a: Point, b: Point) -> tuple[int, ...]:
    """The axes that a line names: those that travel."""
    return tuple(axis for axis in (0, 1) if a[axis] != b[axis])


def ends(a: Point, b: Point) -> tuple[list[float], list[float]]:
    return [a[axis] for axis in moving(a, b)], [b[axis] for axis in moving(a, b)]


def flowing() -> Machine:
    return alike(2, velocity=500.0, acceleration=5000.0, jerk=100_000.0)


@pytest.mark.parametrize("scale", [1.5, 1.8, 2.0])
@pytest.mark.parametrize("speed", [0.12, 0.15])
def test_a_change_of_the_rate_minds_an_axis_that_joins_the_motion(speed: float, scale: float) -> None:
    # until the first corner the second axis is not driven; the change of rate before it goes on behind it
    machine = flowing()
    moves = lines(machine, [(0.0, 0.0), (0.1, 0.0), (0.1, 0.1)], speed)
    motion = plan(machine, moves)
    corner = int(motion.ends[1]) - 20
    rig = rig_of(machine, motion, lambda u: scale if u < corner else 1.0)
    rig.run()
    assert rig.setpoint[-1] == pytest.approx([0.1, 0.1], abs=1e-12)
    points = np.concatenate((rig.setpoint, np.tile(rig.setpoint[-1:], (3, 1))))
    assert_keeps(points, limits_of(machine), machine.cycle_s)


@pytest.mark.parametrize("before", [2, 8])
@pytest.mark.parametrize("urgent", [False, True])
def test_an_axis_that_joins_the_motion_joins_a_stop_too(urgent: bool, before: int) -> None:
    # without the second axis the first one went on from the corner by itself
    machine = flowing()
    motion = plan(machine, lines(machine, [(0.0, 0.0), (0.1, 0.0), (0.2, 0.01)], 0.15))
    *_, joins = (piece.u for piece in motion.pieces if isinstance(piece, Activation))
    rig = rig_of(machine, motion)
    rig.step(int(joins) - before)
    assert rig.setpoint[-1, 1] == 0.0
    if urgent:
        rig.executor.mailbox.emergency_stop()
    else:
        rig.executor.mailbox.abort(0)
    rig.run()
    assert rig.setpoint[-1, 1] > 0.0
    assert from_polyline(rig.setpoint, motion.rested) < bow_of(motion)


def chords(machine: Machine, speed: float) -> list[Move]:
    angles = np.linspace(0.0, 2.0 * math.pi, 201)
    points = 0.02 * np.stack([np.sin(angles), 1.0 - np.cos(angles)], axis=1)
    return lines(machine, np.round(points, 7).tolist(), speed)


def arcs(_machine: Machine, speed: float) -> list[Move]:
    first = arc_curve((0.0, 0.0), (0.0, 0.02), 2.0 * math.pi)
    return [Move(at_speed(speed, first)), Move(at_speed(speed, first))]


@pytest.mark.parametrize("rate", [0.3, 0.7, 0.9])
@pytest.mark.parametrize("cycles", [60, 190])
def test_a_change_back_to_100_percent_ends_on_whole_rows_wherever_it_begins(rate: float, cycles: int) -> None:
    # between rows the vertices of an exact path ask for more acceleration than the rows
    machine = alike(2, velocity=500.0, acceleration=5000.0)
    moves = [Move(move.group) for move in chords(machine, 0.08)]
    rig = rig_of(machine, plan(machine, moves))
    rig.step(150)
    rig.executor.mailbox.set_override(rate, 0)
    rig.step(cycles)
    # amid the change
    rig.executor.mailbox.set_override(0.2, 0)
    rig.step(7)
    rig.executor.mailbox.set_override(1.0, 0)
    rig.step(250)
    assert rig.executor.feedback.slots[0].rate == 1.0
    assert rig.executor.u(0) == pytest.approx(round(rig.executor.u(0)), abs=1e-6)
    rig.run()
    assert_keeps(rig.setpoint, (None, machine.axes[0].max_acceleration), machine.cycle_s)
