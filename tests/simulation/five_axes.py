"""Five-axis machines for tests: a URDF, a machine file and forward kinematics of their own from one list; and
programs on them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import Simulation, simulate
from tests.limits import assert_keeps

Array = NDArray[np.float64]
LENGTH = 80.0  # of the cutter [mm]
# of the work piece, by G10 L2 P1 X5 Y-7 Z-200 [mm]
ZERO = (5.0, -7.0, -200.0)
LIMITS = {"linear": (500.0, 4000.0, 80000.0), "rotary": (150.0, 1500.0, 30000.0)}


@dataclass(frozen=True)
class Joint:
    """A joint: its axis's number, its place on the link before [mm], its direction in the bed's frame."""

    axis: int
    origin: tuple[float, float, float]
    direction: tuple[float, float, float]

    @property
    def turns(self) -> bool:
        return self.axis > 2


@dataclass(frozen=True)
class FiveAxes:
    """A machine as two branches of joints from the bed: to the table, and to the spindle's nose."""

    table: tuple[Joint, ...]
    head: tuple[Joint, ...]
    length: float = LENGTH  # of the cutter [mm]

    def urdf(self) -> str:
        parts = ['<robot name="mill"><link name="bed"/>']
        for branch, end in ((self.table, "table"), (self.head, "nose")):
            parent = "bed"
            for joint in branch:
                x, y, z = (each / 1000.0 for each in joint.origin)
                kind = "continuous" if joint.turns else "prismatic"
                bound = "" if joint.turns else '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
                parts.append(
                    f'<joint name="j{joint.axis}" type="{kind}"><parent link="{parent}"/>'
                    f'<child link="l{joint.axis}"/><origin xyz="{x} {y} {z}"/>'
                    f'<axis xyz="{" ".join(map(str, joint.direction))}"/>{bound}</joint>'
                    f'<link name="l{joint.axis}"/>'
                )
                parent = f"l{joint.axis}"
            parts.append(
                f'<joint name="{end}_joint" type="fixed"><parent link="{parent}"/>'
                f'<child link="{end}"/></joint><link name="{end}"/>'
            )
        return "".join(parts) + "</robot>"

    def machine(
        self, folder: Path, dialect: str = 'profile = "cnc"', tolerance: float = 0.02, turntable: str = ""
    ) -> Machine:
        """The machine in the files of a folder; ``turntable``: more keys of axis 5."""
        (folder / "mill.urdf").write_text(self.urdf(), "utf-8")
        order = [each.axis for each in (*self.table[::-1], *self.head)]
        text = (
            f'[machine]\nname = "mill"\n[motion]\npath_tolerance_mm = {tolerance}\n[dialect]\n{dialect}\n'
            f'[kinematics]\nurdf = "mill.urdf"\n[[tool]]\nnumber = 1\nframe = "nose"\nwork = "table"\n'
            f"axes = {order}\n[[cutter]]\nnumber = 1\nlength_mm = {LENGTH}\ndiameter_mm = 6.0\n"
        )
        for index in sorted(order):
            kind = "rotary" if index > 2 else "linear"
            velocity, acceleration, jerk = LIMITS[kind]
            text += (
                f'[[axis]]\nindex = {index}\ntype = "{kind}"\nmax_velocity = {velocity}\n'
                f"max_acceleration = {acceleration}\nmax_jerk = {jerk}\n"
                + ("min_position = -500.0\nmax_position = 500.0\n" if kind == "linear" else "")
                + (turntable if index == 5 else "")
                + '[axis.drive]\nkind = "ideal"\ninitial_position = 0.0\n'
            )
        return parse_machine(text, folder=folder)

    def axes_at(self, points: Array, turns: Mapping[int, Array]) -> dict[int, Array]:
        """Positions of all axes with the tip at points on the table (n, 3) [mm], rotary ones as given."""
        still = {axis: np.zeros(len(points)) for axis in (0, 1, 2)}
        origin = self.tip({**still, **turns})
        moved = [self.tip({**still, axis: np.ones(len(points)), **turns}) - origin for axis in (0, 1, 2)]
        found = np.linalg.solve(np.stack(moved, axis=2), (points - origin)[..., None])[..., 0]
        return {**dict(enumerate(found.T)), **turns}

    def tip(self, positions: Mapping[int, Array]) -> Array:
        """Where the cutter's tip is on the table [mm], shape (n, 3), from axes in mm and degrees."""
        table, head = (_placed(branch, positions) for branch in (self.table, self.head))
        tip = head @ np.array([0.0, 0.0, -self.length, 1.0])
        return np.asarray(np.linalg.solve(table, tip[..., None])[:, :3, 0])


def _placed(branch: Sequence[Joint], positions: Mapping[int, Array]) -> Array:
    count = len(next(iter(positions.values())))
    found = np.tile(np.eye(4), (count, 1, 1))
    for joint in branch:
        step = np.tile(np.eye(4), (count, 1, 1))
        u, q = np.array(joint.direction), positions[joint.axis]
        step[:, :3, 3] = joint.origin
        if joint.turns:
            angle = np.radians(q)[:, None, None]
            cross = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
            step[:, :3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
        else:
            step[:, :3, 3] += q[:, None] * u
        found = found @ step
    return found


_X, _Y, _Z = Joint(0, (0, 0, 0), (1, 0, 0)), Joint(1, (0, 0, 0), (0, 1, 0)), Joint(2, (0, 0, 300), (0, 0, 1))
# positions are those of the tool against the work piece: what the table's joints move goes the other way
TABLE_TABLE = FiveAxes(
    table=(
        Joint(1, (0, 0, -200), (0, -1, 0)),
        Joint(3, (0, 0, 230), (-1, 0, 0)),
        Joint(5, (0, 2, -30), (0, 0, -1)),
    ),
    head=(_X, Joint(2, (0, 2, 300), (0, 0, 1))),
)
HEAD_TABLE = FiveAxes(
    table=(Joint(5, (10, 5, 0), (0, 0, -1)),), head=(_X, _Y, _Z, Joint(4, (10, 5, 90), (0, 1, 0)))
)
# a fork head whose second axis is at 45 degrees, on a machine that carries the table
HEAD_HEAD = FiveAxes(
    table=(Joint(0, (0, 0, 0), (-1, 0, 0)),),
    head=(
        _Y,
        _Z,
        Joint(5, (0, 0, 60), (0, 0, 1)),
        Joint(4, (0, 30, 30), (0, 0.7071067811865476, 0.7071067811865476)),
    ),
)
MILLS = {"tables": TABLE_TABLE, "mixed": HEAD_TABLE, "heads": HEAD_HEAD}


def reader(machine: Machine, *lines: str) -> Interpreter:
    """An interpreter that has read lines."""
    found = Interpreter(machine, kinematics=build_kinematics(machine))
    for number, line in enumerate("\n".join(lines).splitlines(), start=1):
        parsed = found.parse(line, number)
        if found.capture_before(parsed) is not None:
            found.sync_positions(found.positions)
        found.interpret(parsed)
    return found


def place(machine: Machine, found: Interpreter) -> dict[int, float]:
    """Positions of the axes [mm or deg]."""
    units = {axis.index: axis.type.si_per_unit for axis in machine.axes}
    return {axis: value / units[axis] for axis, value in found.positions.items()}


def at_end(machine: Machine, found: Interpreter) -> dict[int, Array]:
    return {axis: np.array([value]) for axis, value in place(machine, found).items()}


def run(machine: Machine, text: str) -> Simulation:
    found = simulate(text, machine, kinematics=build_kinematics(machine), record=True)
    assert found.report["ok"], found.report["diagnostics"]
    return found


def rows(found: Simulation, machine: Machine) -> dict[int, Array]:
    """Setpoints by axis, in mm and degrees."""
    assert found.recording is not None
    return {axis.index: found.recording.setpoint[:, at] for at, axis in enumerate(machine.axes)}


def tips(mill: FiveAxes, positions: Mapping[int, Array]) -> Array:
    """The tip in the program's coordinates: with all rotary axes at zero they are those of the axes."""
    still = {axis: np.zeros(1) for axis in positions}
    origin = mill.tip({**still, **{axis: np.array([each]) for axis, each in enumerate(ZERO)}})[0]
    # the program's zero is where the spindle's point is there, without a cutter
    return mill.tip(positions) - (origin + np.array([0.0, 0.0, LENGTH]))


def assert_within_limits(found: Simulation, machine: Machine) -> None:
    for axis, values in rows(found, machine).items():
        assert_keeps(values, LIMITS["rotary" if axis > 2 else "linear"], most=(1.0001, 1.001, 1.05))
