"""Chains read from URDFs: forward kinematics and Jacobians against Pinocchio, and models that do not fit."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from mckinematics.errors import ModelError
from mckinematics.model import built_in_models, load_model, read_urdf
from mckinematics.solver import MachineKinematics

from mcserver.machine.machine_file import parse_machine
from tests.kinematics.tool_machines import Joint, X, Y, Z, chain_machine, chain_urdf, machine_text

MIXED = (
    Joint("revolute", "0.1 0.2 0.3", Z),
    Joint("continuous", "0.4 0 0.1", "1 2 -1"),
    Joint("prismatic", "0 0.1 0.2", "0.6 0 0.8", -0.5, 0.5),
    Joint("revolute", "0 0 0.3", Y),
    Joint("continuous", "0.2 0 0", X),
)


def _pinocchio_joints(model: pinocchio.Model, joints: np.ndarray) -> np.ndarray:
    placed = []
    for joint, value in zip(list(model.joints)[1:], joints, strict=True):
        placed += [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
    return np.array(placed)


def test_forward_kinematics_are_pinocchios(tmp_path: Path) -> None:
    machine = chain_machine(tmp_path, MIXED, orientation=True, offset="[10.0, -20.0, 30.0]")
    chain = MachineKinematics(machine).tool(1).chain
    model = pinocchio.buildModelFromXML(chain_urdf(MIXED))
    tool = pinocchio.SE3(np.eye(3), np.array([0.01, -0.02, 0.03]))
    joints = np.random.default_rng(5).uniform(-2.0, 2.0, (50, 5))
    positions, rotations = chain.forward(joints)
    data = model.createData()
    for row, position, rotation in zip(joints, positions, rotations, strict=True):
        pinocchio.framesForwardKinematics(model, data, _pinocchio_joints(model, row))
        expected = data.oMf[model.getFrameId("tip")] * tool
        np.testing.assert_allclose(position, expected.translation, atol=1e-12)
        np.testing.assert_allclose(rotation, expected.rotation, atol=1e-12)


def test_jacobians_are_pinocchios(tmp_path: Path) -> None:
    chain = MachineKinematics(chain_machine(tmp_path, MIXED, orientation=True)).tool(1).chain
    model = pinocchio.buildModelFromXML(chain_urdf(MIXED))
    joints = np.random.default_rng(6).uniform(-2.0, 2.0, (50, 5))
    for row, jacobian in zip(joints, chain.jacobian(joints)[2], strict=True):
        expected = pinocchio.computeFrameJacobian(
            model,
            model.createData(),
            _pinocchio_joints(model, row),
            model.getFrameId("tip"),
            pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED,
        )
        np.testing.assert_allclose(jacobian, expected, atol=1e-12)


def test_the_jacobian_gives_the_same_place_as_forward_kinematics(tmp_path: Path) -> None:
    chain = MachineKinematics(chain_machine(tmp_path, MIXED)).tool(1).chain
    joints = np.random.default_rng(7).uniform(-2.0, 2.0, (20, 5))
    for one, other in zip(chain.forward(joints), chain.jacobian(joints), strict=False):
        np.testing.assert_allclose(one, other, atol=1e-14)


def test_limits_are_the_narrower_of_urdf_and_machine_file(tmp_path: Path) -> None:
    joints = (Joint("revolute", "0 0 0", Z, -1.0, 2.0), Joint("continuous", "1 0 0", Z))
    machine = chain_machine(tmp_path, joints, limits={0: (-90.0, 90.0), 1: (-400.0, 400.0)})
    chain = MachineKinematics(machine).tool(1).chain
    np.testing.assert_allclose(chain.lower, [-1.0, -np.radians(400.0)])
    np.testing.assert_allclose(chain.upper, [np.pi / 2.0, np.radians(400.0)])


def test_a_continuous_joint_is_not_limited(tmp_path: Path) -> None:
    joints = (Joint("continuous", "0 0 0", Z), Joint("continuous", "1 0 0", Z))
    chain = MachineKinematics(chain_machine(tmp_path, joints)).tool(1).chain
    assert np.isinf(chain.lower).all()
    assert np.isinf(chain.upper).all()


def test_built_in_models_are_found_by_name() -> None:
    assert built_in_models() == ("arm6.urdf", "robot-dog.urdf")
    assert '<robot name="arm6">' in read_urdf("arm6")
    assert load_model("robot-dog.urdf").links[0] == "body"


def test_a_file_beside_the_machine_goes_before_a_built_in(tmp_path: Path) -> None:
    (tmp_path / "arm6.urdf").write_text(chain_urdf(MIXED), "utf-8")
    assert '<robot name="chain">' in read_urdf(str(tmp_path / "arm6.urdf"))


def _refusal(folder: Path, tools: list[str], axes: int, linear: tuple[int, ...] = ()) -> ModelError:
    (folder / "chain.urdf").write_text(chain_urdf(MIXED), "utf-8")
    machine = parse_machine(machine_text("chain.urdf", tools, axes, linear=linear), folder=folder)
    with pytest.raises(ModelError) as caught:
        MachineKinematics(machine)
    return caught.value


def test_a_missing_urdf_is_named(tmp_path: Path) -> None:
    machine = parse_machine(machine_text("nowhere.urdf", ['frame = "tip"\naxes = [0]'], 1), folder=tmp_path)
    with pytest.raises(ModelError, match=r"nowhere\.urdf") as caught:
        MachineKinematics(machine)
    assert "robot-dog.urdf" in caught.value.hint


def test_a_file_that_is_no_urdf_is_refused(tmp_path: Path) -> None:
    (tmp_path / "broken.urdf").write_text("<robot", "utf-8")
    with pytest.raises(ModelError, match="not a URDF"):
        load_model(str(tmp_path / "broken.urdf"))


def test_an_unknown_frame_lists_those_that_there_are(tmp_path: Path) -> None:
    error = _refusal(tmp_path, ['frame = "tipp"\naxes = [0, 1, 2, 3, 4]'], 5, linear=(2,))
    assert error.tool == 1
    assert "did you mean 'tip'?" in error.hint
    assert "link3" in error.hint


def test_another_number_of_joints_than_axes_names_the_joints(tmp_path: Path) -> None:
    error = _refusal(tmp_path, ['frame = "tip"\naxes = [0, 1, 2]'], 3, linear=(2,))
    assert "5 moving joints (joint0, joint1, joint2, joint3, joint4)" in error.message


def test_a_revolute_joint_on_a_linear_axis_is_refused(tmp_path: Path) -> None:
    error = _refusal(tmp_path, ['frame = "tip"\naxes = [0, 1, 2, 3, 4]'], 5)
    assert error.axis == 2
    assert 'type = "linear"' in error.hint


def test_one_joint_with_two_axes_is_refused(tmp_path: Path) -> None:
    tools = ['frame = "link2"\naxes = [0, 1]', 'frame = "link2"\naxes = [0, 2]']
    assert "joint1" in _refusal(tmp_path, tools, 3).message


def test_tools_may_share_joints(tmp_path: Path) -> None:
    (tmp_path / "chain.urdf").write_text(chain_urdf(MIXED), "utf-8")
    tools = ['frame = "link2"\naxes = [4, 1]', 'frame = "tip"\naxes = [4, 1, 2, 3, 0]']
    machine = parse_machine(machine_text("chain.urdf", tools, 5, linear=(2,)), folder=tmp_path)
    kinematics = MachineKinematics(machine)
    assert kinematics.tools == (1, 2)
    assert kinematics.axes(2) == (4, 1, 2, 3, 0)


def test_limits_that_leave_no_travel_are_refused(tmp_path: Path) -> None:
    machine = chain_machine(
        tmp_path, [Joint("revolute", "0 0 0", Z, -1.0, 1.0)], limits={0: (90.0, 180.0)}, start={0: 90.0}
    )
    with pytest.raises(ModelError, match="joint0"):
        MachineKinematics(machine)


def test_a_machine_without_tools_needs_no_pinocchio(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    machine = parse_machine(machine_text("chain.urdf", [], 1), folder=tmp_path)
    assert MachineKinematics(machine).tools == ()


def test_tools_without_pinocchio_say_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with pytest.raises(ModelError) as caught:
        MachineKinematics(chain_machine(tmp_path, MIXED))
    assert "pip install pin scipy" in caught.value.hint


def test_a_tool_that_is_not_there_lists_those_that_are(tmp_path: Path) -> None:
    kinematics = MachineKinematics(chain_machine(tmp_path, MIXED))
    with pytest.raises(ModelError, match="no tool 7") as caught:
        kinematics.axes(7)
    assert "T1" in caught.value.hint


def test_a_tool_whose_point_no_joint_moves_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no joint of its chain moves"):
        MachineKinematics(chain_machine(tmp_path, [Joint("revolute", "0 0 0", Z)], tip="0 0 0.2"))
