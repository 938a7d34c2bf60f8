"""Tools whose poses are in a frame that moves: inv(T_work)·T_tool, by Pinocchio of the whole URDF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio
import pytest
from mckinematics.errors import ModelError
from mckinematics.solver import MachineKinematics

from mcserver.machine.machine_file import Machine, parse_machine

from .tool_machines import machine_text
from .tool_paths import follow, line

# an arm of three joints and a positioner of two, both on one rail
_BRANCHES = {
    "rail": ("bed", "prismatic", "0 0 0.1", "1 0 0"),
    "tilt": ("rail", "revolute", "0.5 0.1 0.2", "0 0.6 0.8"),
    "plate": ("tilt", "continuous", "0.02 0 0.1", "0 0 1"),
    "turn": ("rail", "revolute", "-0.3 0 0.4", "0 0 1"),
    "lift": ("turn", "revolute", "0.1 0 0.2", "0 1 0"),
    "reach": ("lift", "prismatic", "0.3 0 0", "1 0 0"),
}


def cell(folder: Path, axes: list[int], work: str = "plate") -> Machine:
    parts = ['<robot name="cell"><link name="bed"/>']
    for name, (parent, kind, origin, axis) in _BRANCHES.items():
        parts.append(
            f'<link name="{name}"/><joint name="j_{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{name}"/><origin xyz="{origin}" rpy="0.1 -0.2 0.3"/><axis xyz="{axis}"/>'
            '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        )
    (folder / "cell.urdf").write_text("".join(parts) + "</robot>", "utf-8")
    tool = f'frame = "reach"\nwork = "{work}"\naxes = {axes}\noffset_mm = [100.0, 20.0, 0.0]'
    start = {1: 10.0, 2: 20.0, 3: 15.0, 4: -30.0, 5: 100.0}
    return parse_machine(machine_text("cell.urdf", [tool], 6, linear=(0, 5), start=start), folder=folder)


def test_its_pose_and_rates_are_those_against_the_moving_frame(tmp_path: Path) -> None:
    kinematics = MachineKinematics(cell(tmp_path, [2, 1, 3, 4, 5]))
    chain = kinematics.tool(1).chain
    assert chain.joint_names == ("j_plate", "j_tilt", "j_turn", "j_lift", "j_reach")
    model = pinocchio.buildModelFromXML((tmp_path / "cell.urdf").read_text("utf-8"))
    data = model.createData()

    def expected(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        whole = pinocchio.neutral(model)
        named = dict(zip(chain.joint_names, q.tolist(), strict=True)) | {"j_rail": 0.7}
        for name, value in named.items():
            joint = model.joints[model.getJointId(name)]
            both = (np.cos(value), np.sin(value)) if joint.nq == 2 else (value,)
            whole[joint.idx_q : joint.idx_q + joint.nq] = both
        pinocchio.framesForwardKinematics(model, data, whole)
        found = data.oMf[model.getFrameId("plate")].actInv(data.oMf[model.getFrameId("reach")])
        return found.translation + found.rotation @ [0.1, 0.02, 0.0], found.rotation

    for q in np.random.default_rng(3).uniform(-1.5, 1.5, (20, 5)):
        positions, rotations, rates = chain.jacobian(q[None])
        point, rotation = expected(q)
        assert np.abs(positions[0] - point).max() < 1e-12
        assert np.abs(rotations[0] - rotation).max() < 1e-12
        steps = [(expected(q + step)[0] - expected(q - step)[0]) / 2e-6 for step in 1e-6 * np.eye(5)]
        assert np.abs(rates[0, :3] - np.transpose(steps)).max() < 1e-8
        single = chain.single.linearise(q.tolist())
        assert np.abs(np.array(single.position) - point).max() < 1e-12


def test_its_path_is_solved_like_that_of_any_tool(tmp_path: Path) -> None:
    machine = cell(tmp_path, [2, 1, 3, 4, 5])
    kinematics = MachineKinematics(machine)
    joints = {axis.index: axis.initial_position for axis in machine.axes}
    start = np.array(kinematics.pose(1, joints).position)
    wanted = line(start, start + np.array([0.05, -0.1, 0.08]))
    follow(kinematics, 1, wanted, joints)


def test_joints_of_another_order_number_or_frame_are_refused_with_those_that_there_are(
    tmp_path: Path,
) -> None:
    with pytest.raises(ModelError) as refused:
        MachineKinematics(cell(tmp_path, [0, 1, 2, 3, 4, 5]))
    assert "from 'plate' to 'reach' there are 5 moving joints (j_plate, j_tilt, j_turn" in str(refused.value)
    with pytest.raises(ModelError) as refused:
        MachineKinematics(cell(tmp_path, [2, 1, 3, 4, 5], work="plat"))
    assert "plate" in refused.value.hint
