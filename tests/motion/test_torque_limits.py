"""Torques of an arm's joints along what the planner makes of a program, recomputed from its setpoints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from mckinematics.dynamics import JointDynamics
from mckinematics.errors import ModelError
from mckinematics.model import load_model

from mcserver.errors import ConfigurationError
from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.geometry.curves import Array
from mcserver.simulation.simulation import Simulation, simulate
from tests.kinematics import arm7
from tests.motion.measure import acceleration_ratio, velocity_ratio
from tests.motion.support import Commit, Motion, Move, at_speed, in_time, line_curve, plan

JOINTS = tuple(range(7))
HOME = np.radians(arm7.START)
# N·m: enough to hold the arm wherever these programs go, little to move it quickly
TORQUES = (25.0, 70.0, 25.0, 30.0, 7.0, 6.0, 0.6)
LOADED = (30.0, 80.0, 30.0, 40.0, 10.0, 10.0, 1.5)
CENTRE = np.array([0.0, 0.01, 0.05])
TOLERATED = 1.02


def dynamics_of(machine: Machine) -> JointDynamics:
    kinematics = build_kinematics(machine)
    assert kinematics is not None
    assert kinematics.dynamics is not None
    return kinematics.dynamics


def torques_of(machine: Machine, positions: Array, mass: float = 0.0, rate: float = 1.0) -> Array:
    """RNEA along positions of each cycle (N, 7), with a point mass at the tip; nothing of the planner's."""
    assert machine.urdf is not None
    model = load_model(machine.urdf).pinocchio_model
    if mass:
        frame = model.frames[model.getFrameId("tip")]
        load = pinocchio.Inertia(mass, CENTRE, np.zeros((3, 3)))
        model.appendBodyToJoint(frame.parentJoint, load, frame.placement)
    data = model.createData()
    speed = rate * (positions[2:] - positions[:-2]) / (2.0 * machine.cycle_s)
    change = rate**2 * np.diff(positions, 2, axis=0) / machine.cycle_s**2
    return np.array(
        [
            pinocchio.rnea(model, data, *each).copy()
            for each in zip(positions[1:-1], speed, change, strict=True)
        ]
    )


def load_of(machine: Machine, positions: Array, mass: float = 0.0, rate: float = 1.0) -> float:
    """Greatest share of a torque limit."""
    limits = [axis.max_torque for axis in machine.axes]
    return float((np.abs(torques_of(machine, positions, mass, rate)) / limits).max())


def random_moves(machine: Machine, rng: np.random.Generator, tolerance: float) -> list[Move]:
    """Lines of the joints from the home position: long and short, with sharp and flat vertices."""
    here = HOME.copy()
    moves = []
    for _ in range(int(rng.integers(2, 6))):
        there = here + rng.normal(size=7) * (rng.random(7) < 0.6) * rng.choice([0.03, 0.3])
        there[0] += 0.02
        there = HOME + np.clip(there - HOME, -0.6, 0.6)
        curve = line_curve(machine, JOINTS, here.tolist(), there.tolist())
        timed = rng.random() < 0.2
        group = in_time(0.2, curve) if timed else at_speed(float(rng.choice([0.5, 4.0])), curve)
        moves.append(Move(group, tolerance=tolerance))
        here = there
    return moves


@pytest.mark.parametrize("seed", range(6))
def test_no_cycle_of_a_random_program_passes_a_torque_limit(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    machine = arm7.machine(
        tmp_path,
        torques=TORQUES,
        acceleration=float(rng.choice([3000.0, 20_000.0])),
        jerk=None if seed % 2 else 200_000.0,
    )
    moves = random_moves(machine, rng, (0.0, 2e-4, 2e-3)[seed % 3])
    commits = [Commit(1, 30.0), Commit(2)] if seed >= 3 else []
    motion = plan(machine, moves, start=HOME, commits=commits, dynamics=dynamics_of(machine))
    assert load_of(machine, motion.rested) <= TOLERATED
    assert velocity_ratio(motion) <= 1.001
    assert acceleration_ratio(motion) <= 1.01
    free = plan(machine, moves, start=HOME, commits=commits)
    # the limits do bind: without them the joints would be asked for more
    assert load_of(machine, free.rested) > TOLERATED
    assert motion.duration > free.duration
    # a constant rate below 1 asks for no more: gravity stays, the rest falls with the rate's square
    assert load_of(machine, motion.rested, rate=0.6) <= TOLERATED


def test_no_vertex_takes_longer_than_a_stop_there(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, torques=TORQUES, jerk=None)
    dynamics = dynamics_of(machine)
    moves = random_moves(machine, np.random.default_rng(3), 0.0)
    stops = [Move(move.group, from_rest=True) for move in moves]
    flowing = plan(machine, moves, start=HOME, dynamics=dynamics)
    assert flowing.duration <= plan(machine, stops, start=HOME, dynamics=dynamics).duration * (1.0 + 1e-9)


def test_a_machine_without_torque_limits_moves_as_if_it_had_no_dynamics(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path)
    moves = random_moves(machine, np.random.default_rng(1), 1e-3)

    def driven(dynamics: JointDynamics | None) -> Motion:
        return plan(machine, moves, start=HOME, dynamics=dynamics)

    np.testing.assert_array_equal(driven(dynamics_of(machine)).position, driven(None).position)


# ---------------------------------------------------------------------- whole programs

TOOLS = ("", "payload = { mass = 2.0, center_mm = [0, 10, 50] }", "payload = { mass = 30.0 }")
LINES = "G01 Y150 Z-100\nG01 X-50 Y-300 Z60\nG02 X0 Y300 R220 C20\nG01 Y-150 Z40\n"


def program(tool: str) -> str:
    """Lines and an arc of the tool from its home position, quicker than the joints can do."""
    return f"G1010\n{tool}\nG91 G94 F90000\n{LINES}"


def ran(machine: Machine, text: str) -> Simulation:
    return simulate(text, machine, kinematics=build_kinematics(machine), record=True)


def feed_rows(simulation: Simulation, first: int) -> Array:
    """Setpoints of the lines from one on [rad]."""
    assert simulation.recording is not None
    found: Array = np.radians(simulation.recording.setpoint[simulation.recording.line >= first])
    return found


def test_a_heavier_payload_makes_lines_slower_and_keeps_the_torques(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, tools=TOOLS, torques=LOADED, acceleration=10_000.0, jerk=400_000.0)
    light, heavy = ran(machine, program("T1")), ran(machine, program("T2"))
    assert (light.exit_code, heavy.exit_code) == (0, 0), heavy.report["diagnostics"]
    times = [sum(each["end_s"] - each["start_s"] for each in run.report["lines"]) for run in (light, heavy)]
    assert times[1] > 1.05 * times[0]
    rows = feed_rows(light, 4), feed_rows(heavy, 4)
    assert load_of(machine, rows[0]) <= TOLERATED
    assert load_of(machine, rows[1], mass=2.0) <= TOLERATED
    # what the light tool does would be too much with the heavy one
    assert load_of(machine, rows[0], mass=2.0) > TOLERATED
    assert any("torque" in (each["bound_by"] or "") for each in heavy.report["lines"])


def test_a_payload_stays_after_g1050_until_another_tool_is_chosen(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, tools=TOOLS, torques=LOADED, acceleration=6000.0)

    def seconds(tools: str) -> float:
        text = f"G1010\n{tools}\nG93 F6000\nG01 X20 Y40 Z10 A60\n"
        report = ran(machine, text).report
        assert report["ok"], report["diagnostics"]
        last = report["lines"][-1]
        return float(last["end_s"] - last["start_s"])

    assert seconds("T2 G1050") > 1.03 * seconds("T1 G1050")
    assert seconds("T2\nT1 G1050") == pytest.approx(seconds("T1 G1050"))


def test_a_payload_that_cannot_be_held_is_refused_with_joint_torque_and_place(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, tools=TOOLS, torques=LOADED)
    (fault,) = check_program("G1010\nT3 G1050\nG93 F60\nG01 Y60", machine, build_kinematics(machine))
    assert (fault.code, fault.line, fault.axis) == ("MC314", 4, 3)
    assert "joint 'joint_4'" in fault.message
    assert "40 N·m" in fault.message
    assert "% of the path" in fault.message
    # nothing was chosen: the heaviest might be there
    assert check_program("G1010\nG93 F60\nG01 Y60", machine, build_kinematics(machine))
    assert not check_program("G1010\nT1 G1050\nG93 F60\nG01 Y60", machine, build_kinematics(machine))


def test_groups_beside_each_other_keep_the_torques_together(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, torques=TORQUES, acceleration=10_000.0, jerk=None)
    text = "G1010\nG93 F600\nG01 [0]10, G01 [1]20, G01 [3]85, G01 [5]60\n"
    simulation = ran(machine, text)
    assert simulation.exit_code == 0, simulation.report["diagnostics"]
    assert load_of(machine, feed_rows(simulation, 3)) <= TOLERATED


# ---------------------------------------------------------------------- what a machine file may say


def test_a_limit_may_be_the_effort_of_the_urdf(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, torques=("urdf", 70.0, 25.0, 30.0, 7.0, "urdf", 0.6))
    np.testing.assert_array_equal(dynamics_of(machine).limits, [160.0, 70.0, 25.0, 30.0, 7.0, 40.0, 0.6])


def test_gravity_is_where_the_machine_file_has_it(tmp_path: Path) -> None:
    def held(gravity: str) -> Array:
        found: Array = dynamics_of(arm7.machine(tmp_path, gravity=gravity)).at_rest(HOME[None])[0]
        return found

    # upside down all torques turn; without gravity there are none
    np.testing.assert_allclose(held("gravity = [0.0, 0.0, 9.81]"), -held(""))
    np.testing.assert_allclose(held("gravity = [0.0, 0.0, 0.0]"), np.zeros(7), atol=1e-12)


@pytest.mark.parametrize(
    ("tools", "old", "new", "message"),
    [
        ("", '<mass value="', '<mass value="0" old="', "moves no mass"),
        ("", 'effort="160.0"', 'effort="0"', "has no effort"),
        ("payload = { mass = 1.0, inertia = [1.0, 0.1, 0.1, 0, 0, 0] }", "", "", "no body has the inertia"),
    ],
)
def test_a_model_that_gives_no_torques_is_refused(
    tmp_path: Path, tools: str, old: str, new: str, message: str
) -> None:
    machine = arm7.machine(tmp_path, tools=(tools,), torques=("urdf",) * 7)
    if old:
        (tmp_path / "arm7.urdf").write_text(arm7.urdf().replace(old, new))
    with pytest.raises((ModelError, ConfigurationError), match=message):
        build_kinematics(machine)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("axes = [0, 1, 2, 3, 4, 5, 6]", "axes = [0, 1, 2, 3, 4, 5]", "moves no joint of a tool"),
        ("max_torque = 30.0", "max_torque = 0.0", "max_torque"),
        ("max_torque = 30.0", 'max_torque = "effort"', "max_torque"),
        ("payload = { mass = 2.0", "payload = { mas = 2.0", "payload.mas: is no key here"),
    ],
)
def test_mistakes_about_torques_in_a_machine_file_are_named(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    arm7.machine(tmp_path, tools=TOOLS, torques=LOADED)
    file = tmp_path / "arm7.toml"
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(ConfigurationError) as raised:
        load_machine(str(file))
    assert message in f"{raised.value} {raised.value.hint}"


def bound_names(motion: Motion) -> Sequence[str]:
    return [piece.bound.kind for piece in motion.bounds.values()]


def test_what_a_torque_stretches_says_so(tmp_path: Path) -> None:
    machine = arm7.machine(tmp_path, torques=TORQUES, jerk=None, acceleration=20_000.0)
    there = HOME + np.array([0.0, -0.1, 0.0, 0.1, 0.0, 0.0, 0.0])
    curve = line_curve(machine, JOINTS, HOME.tolist(), there.tolist())
    for group in (in_time(0.06, curve), at_speed(2.5, curve)):
        motion = plan(machine, [group], start=HOME, dynamics=dynamics_of(machine))
        assert bound_names(motion) == ["torque"]
