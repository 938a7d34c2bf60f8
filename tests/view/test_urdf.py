"""The tree of a URDF: links where the kinematics has them, looks, meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mckinematics.model import read_urdf

from mcserver.machine.mesh_files import find_mesh
from mcserver.view.robot import robot_parts
from mcserver.view.solids import Solid, ball
from mcserver.view.urdf import read_tree
from tests.kinematics.tool_machines import built_in

ELBOW = """<robot name="r">
  <material name="paint"><color rgba="1 0.5 0 1"/></material>
  <link name="base"><visual><geometry><box size="1 2 3"/></geometry><material name="paint"/></visual></link>
  <link name="arm"><visual><origin xyz="0 0 1"/><geometry><mesh filename="package://kit/arm.stl"
    scale="0.001 0.001 0.001"/></geometry></visual></link>
  <link name="twin"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
    <origin xyz="1 0 0" rpy="0.1 0.2 0.3"/><axis xyz="0 0 2"/><limit effort="1" velocity="1"/></joint>
  <joint name="copy" type="prismatic"><parent link="arm"/><child link="twin"/><axis xyz="0 1 0"/>
    <mimic joint="turn" multiplier="2" offset="0.5"/></joint>
</robot>"""


def no_mesh(path: Path, colour: object) -> list[Solid]:
    raise ValueError(f"{path} {colour}")


@pytest.mark.parametrize(("machine", "tool"), [("robot-dog", 3), ("robot-dog", 12), ("arm6", 1)])
def test_links_are_where_the_kinematics_has_them(machine: str, tool: int) -> None:
    described, kinematics, _ = built_in(machine)
    assert described.urdf is not None
    model = kinematics.tool(tool)
    tree = read_tree(read_urdf(described.urdf))
    random = np.random.default_rng(tool)
    for _ in range(5):
        joints = random.uniform(-2.0, 2.0, model.chain.size)
        link = tree.poses(dict(zip(model.chain.joint_names, joints.tolist(), strict=True)))[model.frame]
        position, rotation = model.chain.forward(joints[None])
        np.testing.assert_allclose(link[:3, 3], position[0], atol=1e-12)
        np.testing.assert_allclose(link[:3, :3], rotation[0], atol=1e-12)


def test_a_joint_that_copies_another_follows_it() -> None:
    poses = read_tree(ELBOW).poses({"turn": 0.3})
    inside = np.linalg.inv(poses["arm"]) @ poses["twin"]
    np.testing.assert_allclose(inside[:3, 3], (0.0, 2.0 * 0.3 + 0.5, 0.0), atol=1e-12)


def test_roll_pitch_and_yaw_turn_about_fixed_axes() -> None:
    cos, sin = np.cos, np.sin
    roll = np.array([[1, 0, 0], [0, cos(0.1), -sin(0.1)], [0, sin(0.1), cos(0.1)]])
    pitch = np.array([[cos(0.2), 0, sin(0.2)], [0, 1, 0], [-sin(0.2), 0, cos(0.2)]])
    yaw = np.array([[cos(0.3), -sin(0.3), 0], [sin(0.3), cos(0.3), 0], [0, 0, 1]])
    arm = read_tree(ELBOW).poses({})["arm"]
    np.testing.assert_allclose(arm[:3, :3], yaw @ pitch @ roll, atol=1e-12)


def test_looks_have_the_named_material_s_colour() -> None:
    (look,) = read_tree(ELBOW).links["base"].looks
    assert (look.kind, look.size, look.colour) == ("box", (1.0, 2.0, 3.0), (255, 128, 0))


@pytest.mark.parametrize("meshes", [{}, {"package://kit/arm.stl": Path("arm.stl")}])
def test_a_link_whose_mesh_cannot_be_had_is_drawn_as_bones(meshes: dict[str, Path]) -> None:
    assert all(part.solids for part in robot_parts(read_tree(ELBOW), meshes, no_mesh))


def test_a_mesh_that_is_found_is_scaled_and_placed() -> None:
    parts = robot_parts(
        read_tree(ELBOW),
        {"package://kit/arm.stl": Path("arm.stl")},
        lambda path, _: [ball(100.0, (0, 0, 0))] if path.name == "arm.stl" else [],
    )
    (arm,) = next(part.solids for part in parts if part.name == "arm")
    np.testing.assert_allclose(np.ptp(arm.vertices, axis=0), 0.2, atol=1e-3)
    assert arm.vertices[:, 2].mean() == pytest.approx(1.0)


def test_meshes_are_looked_for_in_other_packages_last(tmp_path: Path) -> None:
    away = tmp_path / "share"
    (away / "kit").mkdir(parents=True)
    (away / "kit" / "arm.stl").write_bytes(b"")
    urdf = tmp_path / "mine" / "r.urdf"
    assert find_mesh("package://kit/arm.stl", urdf, ()) is None
    assert find_mesh("package://kit/arm.stl", urdf, (away,)) == away / "kit" / "arm.stl"


def test_a_mesh_may_stand_beside_the_urdf(tmp_path: Path) -> None:
    (tmp_path / "arm.obj").write_bytes(b"")
    assert find_mesh("arm.obj", tmp_path / "r.urdf", ()) == tmp_path / "arm.obj"
    assert find_mesh(f"file://{tmp_path}/arm.obj", tmp_path / "r.urdf", ()) == tmp_path / "arm.obj"
