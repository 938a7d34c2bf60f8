"""Torques of an arm under feed hold, resume, overrides and rows that come late, by RNEA of the setpoints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mckinematics.dynamics import JointDynamics

from mcserver.executor.entries import ControlKind
from mcserver.machine.machine_file import Machine
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.torque_limits import TorqueLimits
from mcserver.motion.pieces import Rows
from tests.executor.rig import CYCLE_S, Rig, give
from tests.kinematics import arm7
from tests.motion.support import Move, at_speed, in_time, line_curve, plan
from tests.motion.test_torque_limits import dynamics_of

JOINTS = tuple(range(7))
HOME = np.radians(arm7.START)
# N·m: enough to hold the arm wherever these programs go, little to move it quickly
TORQUES = (25.0, 70.0, 25.0, 30.0, 7.0, 6.0, 0.6)
ALL = 0x7F
TOLERATED = 1.02
ORDERS = ("hold", "resume", 0.0, 0.2, 0.5, 0.8, 0.97, 1.0, 1.5, 2.0)


def load_of(dynamics: JointDynamics, points: Array) -> Array:
    """Shares of the torque limits at setpoints (N, 7), from their differences alone."""
    points = np.concatenate((np.tile(points[:1], (2, 1)), points, np.tile(points[-1:], (2, 1))))
    speed = (points[2:] - points[:-2]) / (2.0 * CYCLE_S)
    change = np.diff(points, 2, axis=0) / CYCLE_S**2
    shares: Array = np.abs(dynamics.torques(points[1:-1], speed, change)) / dynamics.limits
    return shares.max(axis=1)


def random_rows(machine: Machine, rng: np.random.Generator, dynamics: JointDynamics) -> list[Rows]:
    """What the planner makes of lines of the joints, with corners sharp and rounded."""
    here, moves = HOME.copy(), []
    tolerance = float(rng.choice([0.0, 2e-4, 5e-3]))
    for _ in range(int(rng.integers(1, 6))):
        there = here + rng.normal(size=7) * (rng.random(7) < 0.6) * rng.choice([0.05, 0.3, 0.6])
        there[0] += 0.02
        there = HOME + np.clip(there - HOME, -0.6, 0.6)
        curve = line_curve(machine, JOINTS, here.tolist(), there.tolist())
        speed = float(rng.choice([0.3, 1.0, 4.0]))
        timed = rng.random() < 0.2
        moves.append(Move(in_time(0.3, curve) if timed else at_speed(speed, curve), tolerance=tolerance))
        here = there
    motion = plan(machine, moves, start=HOME, dynamics=dynamics)
    return [piece for piece in motion.pieces if isinstance(piece, Rows)]


def at_home(machine: Machine) -> Rig:
    rig = Rig(machine)
    program = rig.program
    program.capture()
    program.rapid(dict(enumerate(HOME.tolist())))
    program.wait(ALL)
    rig.step(10)
    for _ in range(20_000):
        if rig.executor.at_rest:
            break
        rig.step()
    assert rig.setpoint[-1] == pytest.approx(HOME)
    rig.setpoints.clear()
    program.u = float(np.ceil(rig.executor.u(0))) + 2.0
    program.position = HOME.copy()
    return rig


def play(rig: Rig, rows: list[Rows], rng: np.random.Generator, *, trickle: bool, torques: bool) -> None:
    """Play rows under random orders to their end."""
    program = rig.program
    program.control(ControlKind.BEGIN, axes=ALL)
    parts: list[Rows] = []
    for piece in rows:
        size = int(rng.integers(40, 400)) if trickle else len(piece.line)
        for low in range(0, len(piece.line), size):
            part = slice(low, low + size)
            torque = piece.torque[part] if torques and piece.torque is not None else None
            parts.append(Rows(0, piece.position[part], piece.velocity[part], piece.axes, piece.line, torque))

    def put() -> None:
        part = parts.pop(0)
        program.rows(part.position, part.velocity, ALL, part.torque)
        if not parts:
            program.control(ControlKind.END, axes=ALL)
            program.finish()

    put()
    quick = rng.random() < 0.3
    for _ in range(int(rng.integers(3, 60 if quick else 12))):
        rig.step(int(rng.integers(1, 10 if quick else 300)))
        give(rig, ORDERS[int(rng.integers(len(ORDERS)))])
        if parts and rig.program.ring.row_room() > 1000:
            put()
    give(rig, "resume")
    give(rig, 1.0)
    while parts:
        if rig.program.ring.row_room() > 1000:
            put()
        rig.step(int(rng.integers(1, 500)) if trickle else 100)
    rig.run(60_000)


def arm(folder: Path, rng: np.random.Generator) -> Machine:
    return arm7.machine(
        folder,
        torques=TORQUES,
        acceleration=float(rng.choice([1500.0, 3000.0, 20_000.0])),
        jerk=None if rng.random() < 0.5 else 200_000.0,
    )


@pytest.mark.parametrize("seed", [2, 4, 7, 10])
def test_any_orders_keep_the_torques_wherever_the_rows_keep_them(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    machine = arm(tmp_path, rng)
    dynamics = dynamics_of(machine)
    rows = random_rows(machine, rng, dynamics)
    own = load_of(dynamics, np.concatenate([HOME[None], *(piece.position for piece in rows)]))
    assert own.max() <= TOLERATED
    rig = at_home(machine)
    play(rig, rows, rng, trickle=rng.random() < 0.3, torques=True)
    assert rig.setpoint[-1] == pytest.approx(rows[-1].position[-1], abs=1e-12)
    assert load_of(dynamics, rig.setpoint).max() <= TOLERATED
    acceleration = np.abs(np.diff(rig.setpoint, 2, axis=0)).max(axis=0) / CYCLE_S**2
    assert (acceleration <= [1.01 * axis.max_acceleration for axis in machine.axes]).all()


def one_line(machine: Machine, dynamics: JointDynamics, speed: float) -> list[Rows]:
    there = HOME + np.array([0.6, 0.4, -0.3, -0.4, 0.3, 0.3, 0.5])
    curve = line_curve(machine, JOINTS, HOME.tolist(), there.tolist())
    motion = plan(machine, [at_speed(speed, curve)], start=HOME, dynamics=dynamics)
    return [piece for piece in motion.pieces if isinstance(piece, Rows)]


def started(machine: Machine, rows: list[Rows]) -> Rig:
    rig = at_home(machine)
    rig.program.control(ControlKind.BEGIN, axes=ALL)
    for piece in rows:
        rig.program.rows(piece.position, piece.velocity, ALL, piece.torque)
    rig.program.control(ControlKind.END, axes=ALL)
    rig.program.finish()
    return rig


def test_a_hold_is_as_quick_as_the_torques_allow(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, torques=TORQUES, acceleration=20_000.0, jerk=None)
    dynamics = dynamics_of(machine)
    rows = one_line(machine, dynamics, 0.5)
    rig = started(machine, rows)
    rig.step(500)
    give(rig, "hold")
    cycles = 0
    while rig.executor.feedback.slots[0].rate > 0.0:
        rig.step()
        cycles += 1
        assert cycles < 1000
    # the motion's own stop at its end takes all of a torque, and may last 1.5 times as long
    speed = np.linalg.norm(np.concatenate([piece.velocity for piece in rows]), axis=1)
    own = len(speed) - 1 - int(np.nonzero(speed >= 0.999 * speed.max())[0][-1])
    assert cycles <= 1.5 * own + 10
    load = load_of(dynamics, rig.setpoint)
    assert load.max() <= TOLERATED


def test_numbers_of_rows_give_the_torques_at_any_rate_and_change_of_it(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, torques=TORQUES)
    dynamics = dynamics_of(machine)
    rng = np.random.default_rng(1)
    q, dq, d2q = (rng.normal(size=(4, 7)) for _ in range(3))
    limits = TorqueLimits.of(machine, dynamics)
    assert limits is not None
    rest, motion, change = np.moveaxis(limits.of_rows(q, dq, d2q, dq / CYCLE_S, ()), 1, 0)
    for rate, slope in ((1.0, 0.0), (0.4, 0.003), (1.6, -0.02)):
        expected = dynamics.torques(q, rate * dq, rate**2 * d2q + slope / CYCLE_S * dq) / dynamics.limits
        assert rest + rate**2 * motion + slope * change == pytest.approx(expected)
