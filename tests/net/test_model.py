"""What a machine looks like, as clients get it."""

from __future__ import annotations

import asyncio
from pathlib import Path

import msgspec
import pytest

from mcserver.errors import Refused
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.net import model_messages as wire
from mcserver.net.model_methods import ModelMethods, look
from tests.clearance.machines import mill

URDF = """<robot name="one">
<link name="base"><visual><geometry><mesh filename="{}"/></geometry></visual></link>
<link name="arm"/><link name="tip"/>
<joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="1 0 0"/></joint>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<origin xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""
FILE = """[machine]
name = "one"
[[axis]]
index = 0
type = "rotary"
max_velocity = 100.0
max_acceleration = 100.0
min_position = -100.0
max_position = 100.0
[axis.drive]
kind = "ideal"
[kinematics]
urdf = "one.urdf"
[[tool]]
number = 1
frame = "tip"
axes = [0]
"""


def machine_with(folder: Path, mesh: str) -> Machine:
    (folder / "one.urdf").write_text(URDF.format(mesh))
    (folder / "one.toml").write_text(FILE)
    return load_machine(str(folder / "one.toml"))


def test_a_robot_sends_its_urdf_its_joints_and_its_meshes_piece_by_piece(tmp_path: Path) -> None:
    (tmp_path / "base.stl").write_bytes(bytes(range(256)) * 10)
    methods = ModelMethods(machine_with(tmp_path, "base.stl"))
    found = asyncio.run(methods.model("ada", wire.ModelRequest()))
    assert "<robot" in found.urdf
    assert found.joints == {"0": "turn"}
    assert found.meshes == [wire.MeshInfo("base.stl", 2560)]
    part = asyncio.run(methods.model_mesh("ada", wire.ModelMeshRequest(mesh=0, offset=2500, size=1000)))
    assert (part.size, part.data) == (2560, (bytes(range(256)) * 10)[2500:])


@pytest.mark.parametrize("mesh", ["/etc/passwd", "one.toml", "gone.stl", "file:///etc/hostname"])
def test_no_other_file_leaves_by_the_name_of_a_mesh(tmp_path: Path, mesh: str) -> None:
    methods = ModelMethods(machine_with(tmp_path, mesh))
    assert asyncio.run(methods.model("ada", wire.ModelRequest())).meshes == [wire.MeshInfo(mesh, 0)]
    with pytest.raises(Refused, match="no mesh 0"):
        asyncio.run(methods.model_mesh("ada", wire.ModelMeshRequest(mesh=0)))


def test_a_portal_has_no_model(tmp_path: Path) -> None:
    machine = msgspec.structs.replace(load_machine("cartesian"), name=tmp_path.name)
    found = asyncio.run(ModelMethods(machine).model("ada", wire.ModelRequest()))
    assert (found.urdf, found.meshes) == ("", [])


def test_bodies_and_zones_are_told_with_what_carries_and_switches_them(tmp_path: Path) -> None:
    (tmp_path / "vise.stl").write_bytes(b"solid\n")
    machine = mill(
        f'[[body]]\nname = "vise"\nshape = "mesh"\nfile = "{tmp_path}/vise.stl"\ntool = 2\n',
        '[[input]]\nnumber = 3\nname = "curtain"\n'
        '[[zone]]\nname = "door"\ninput = 3\nactive = "low"\nsize_mm = [1.0, 2.0, 3.0]\n',
        '[dialect]\nprofile = "cnc"\n',
    )
    found, paths = look(machine)
    tool, vise, door = found.bodies
    assert (tool.shape, tool.size_mm, tool.carried_by, tool.directions) == (
        "cylinder",
        [5.0, 60.0],
        [0, 1, 2],
        [0, 1, 2],
    )
    assert (vise.mesh, vise.tool, paths) == (0, 2, [tmp_path / "vise.stl"])
    assert (door.zone, door.input, door.high, door.size_mm) == ("keep_out", "curtain", False, [1.0, 2.0, 3.0])
