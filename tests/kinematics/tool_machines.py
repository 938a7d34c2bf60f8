"""Machines for tests: URDFs and machine files written into a folder and read back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mckinematics.pose import Array
from mckinematics.solver import MachineKinematics

from mcserver.machine.machine_file import Machine, load_machine, parse_machine

X, Y, Z = "1 0 0", "0 1 0", "0 0 1"


@dataclass(frozen=True)
class Joint:
    """A joint of a chain: where it sits on the link before, its axis and its limits [rad or m]."""

    kind: str
    origin: str
    axis: str
    lower: float = -3.0
    upper: float = 3.0


def chain_urdf(joints: Sequence[Joint], tip: str = "0.3 0 0") -> str:
    """A URDF of links ``link0`` …, joints ``joint0`` … and a fixed ``tip`` at ``tip`` on the last link."""
    parts = ['<robot name="chain"><link name="link0"/>']
    for number, joint in enumerate(joints):
        limit = f'<limit lower="{joint.lower}" upper="{joint.upper}" effort="1" velocity="1"/>'
        parts.append(
            f'<joint name="joint{number}" type="{joint.kind}"><parent link="link{number}"/>'
            f'<child link="link{number + 1}"/><origin xyz="{joint.origin}"/><axis xyz="{joint.axis}"/>'
            f'{"" if joint.kind == "continuous" else limit}</joint><link name="link{number + 1}"/>'
        )
    parts.append(
        f'<joint name="tip_joint" type="fixed"><parent link="link{len(joints)}"/><child link="tip"/>'
        f'<origin xyz="{tip}"/></joint><link name="tip"/></robot>'
    )
    return "".join(parts)


def machine_text(
    urdf: str,
    tools: Sequence[str],
    axes: int,
    *,
    linear: Sequence[int] = (),
    start: Mapping[int, float] | None = None,
    limits: Mapping[int, tuple[float, float]] | None = None,
) -> str:
    """A machine file; ``tools``: each tool's keys but its number; ``start``, ``limits``: in mm, deg."""
    text = f'[machine]\nname = "cell"\n[kinematics]\nurdf = "{urdf}"\n'
    for number, tool in enumerate(tools, start=1):
        text += f"[[tool]]\nnumber = {number}\n{tool}\n"
    for index in range(axes):
        kind = "linear" if index in linear else "rotary"
        text += (
            f'[[axis]]\nindex = {index}\ntype = "{kind}"\nmax_velocity = 100.0\nmax_acceleration = 1000.0\n'
        )
        if limits and index in limits:
            text += f"min_position = {limits[index][0]}\nmax_position = {limits[index][1]}\n"
        text += f"[axis.drive]\ninitial_position = {(start or {}).get(index, 0.0)}\n"
    return text


def chain_machine(
    folder: Path,
    joints: Sequence[Joint],
    *,
    tip: str = "0.3 0 0",
    orientation: bool = False,
    euler: str = "ZYX",
    offset: str = "[0.0, 0.0, 0.0]",
    start: Mapping[int, float] | None = None,
    limits: Mapping[int, tuple[float, float]] | None = None,
) -> Machine:
    """A machine with tool 1 at the tip of a chain, axes 0, 1, 2 … in order."""
    (folder / "chain.urdf").write_text(chain_urdf(joints, tip), "utf-8")
    tool = (
        f'frame = "tip"\naxes = {list(range(len(joints)))}\norientation = {str(orientation).lower()}\n'
        f'euler = "{euler}"\noffset_mm = {offset}'
    )
    linear = [number for number, joint in enumerate(joints) if joint.kind == "prismatic"]
    text = machine_text("chain.urdf", [tool], len(joints), linear=linear, start=start, limits=limits)
    return parse_machine(text, folder=folder)


def built_in(name: str) -> tuple[Machine, MachineKinematics, dict[int, float]]:
    """A built-in machine, its kinematics and its start."""
    machine = load_machine(name)
    return machine, MachineKinematics(machine), {axis.index: axis.initial_position for axis in machine.axes}


def leg(kinematics: MachineKinematics, number: int, joints: Mapping[int, float]) -> Array:
    """The joints of one tool's chain as an array."""
    return np.array([joints[axis] for axis in kinematics.axes(number)])
