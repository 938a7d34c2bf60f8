"""An arm of seven revolute joints, shoulder and wrist spherical, with masses; and its machine file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from mcserver.machine.machine_file import Machine, load_machine

# Of each joint: its place on the link before [m], its axis, its limits [deg], its effort [N·m]; of the link
# behind it: mass [kg], centre of mass [m].
JOINTS = (
    ("0 0 0.33", "0 0 1", 168.0, 160.0, 3.4, "0 0.02 -0.06"),
    ("0 0 0", "0 1 0", 118.0, 160.0, 3.6, "0 -0.03 0.11"),
    ("0 0 0.39", "0 0 1", 168.0, 90.0, 2.9, "0 0.03 -0.07"),
    ("0 0 0", "0 -1 0", 118.0, 90.0, 2.7, "0 0.03 0.1"),
    ("0 0 0.41", "0 0 1", 168.0, 50.0, 1.9, "0 0.02 -0.09"),
    ("0 0 0", "0 1 0", 118.0, 40.0, 1.6, "0 0 0.01"),
    ("0 0 0.08", "0 0 1", 172.0, 40.0, 0.4, "0 0 0.02"),
)
# Bent at shoulder, elbow and wrist, far from singular [deg].
START = (0.0, 30.0, 0.0, 70.0, 0.0, 40.0, 0.0)


def urdf() -> str:
    """The arm, with its ``tip`` 110 mm beyond the last axis."""
    parts = ['<robot name="arm7"><link name="base"/>']
    parent = "base"
    for number, (origin, axis, limit, effort, mass, centre) in enumerate(JOINTS, start=1):
        moment = 0.006 * mass
        radians = limit * 3.141592653589793 / 180.0
        parts.append(
            f'<joint name="joint_{number}" type="revolute"><parent link="{parent}"/>'
            f'<child link="link_{number}"/><origin xyz="{origin}"/><axis xyz="{axis}"/>'
            f'<limit lower="{-radians}" upper="{radians}"'
            f' effort="{effort}" velocity="2"/></joint><link name="link_{number}"><inertial>'
            f'<origin xyz="{centre}"/><mass value="{mass}"/><inertia ixx="{moment}" iyy="{moment}"'
            f' izz="{0.4 * moment}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        parent = f"link_{number}"
    parts.append(
        f'<joint name="tip_joint" type="fixed"><parent link="{parent}"/><child link="tip"/>'
        '<origin xyz="0 0 0.11"/></joint><link name="tip"/></robot>'
    )
    return "".join(parts)


def machine(
    folder: Path,
    *,
    tools: Sequence[str] = ("",),
    torques: Sequence[float | str] | None = None,
    acceleration: float = 1500.0,
    jerk: float | None = 40_000.0,
    tolerance_mm: float = 0.0,
    start: Sequence[float] = START,
    gravity: str = "",
    drive: str = 'kind = "ideal"',
    units_per_motor_rev: float = 360.0,
) -> Machine:
    """The arm.

    Args:
        drive: keys of each axis's drive, where ``{node}`` counts from 1 and ``{bus}`` is for two axes each.
        tools: further keys of T1, T2 … torques: ``max_torque`` of the axes; None: not limited.
    """
    (folder / "arm7.urdf").write_text(urdf())
    text = (
        f'[machine]\nname = "arm7"\n[motion]\npath_tolerance_mm = {tolerance_mm}\n'
        f'[kinematics]\nurdf = "arm7.urdf"\n{gravity}\n'
    )
    for number, keys in enumerate(tools, start=1):
        text += (
            f'[[tool]]\nnumber = {number}\nframe = "tip"\naxes = [0, 1, 2, 3, 4, 5, 6]\norientation = true\n'
            f"{keys}\n"
        )
    for index, (_, _, limit, *_) in enumerate(JOINTS):
        text += (
            f'[[axis]]\nindex = {index}\ntype = "rotary"\nmax_velocity = 200.0\n'
            f"max_acceleration = {acceleration}\nmin_position = {-limit}\nmax_position = {limit}\n"
        )
        text += f"units_per_motor_rev = {units_per_motor_rev}\n"
        text += "" if jerk is None else f"max_jerk = {jerk}\n"
        if torques is not None:
            text += f"max_torque = {json.dumps(torques[index])}\n"
        keys = drive.format(node=index + 1, bus=index // 2)
        text += f"[axis.drive]\n{keys}\ninitial_position = {start[index]}\n"
    (folder / "arm7.toml").write_text(text)
    return load_machine(str(folder / "arm7.toml"))
