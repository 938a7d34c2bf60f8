"""The tools of one machine: forward and inverse kinematics for the dialect and the planner."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from mckinematics.beside import check_beside
from mckinematics.description import MachineDescription, ToolDescription
from mckinematics.dynamics import JointDynamics
from mckinematics.errors import ModelError
from mckinematics.even_path import EvenPaths, solve_even_paths
from mckinematics.model import RobotModel, build_chain, load_model
from mckinematics.path_solver import solve_tool_path
from mckinematics.pose import Array, JointPath, Pose, ToolPath, Triple
from mckinematics.pose_solver import solve_target
from mckinematics.rotation import euler_to_matrix, matrix_to_euler, rotation_vectors
from mckinematics.tip_control import TipControl
from mckinematics.tool import ToolModel, build_tool

# cutters whose tips are kept
MOST_TIPS = 64


class MachineKinematics:
    """`mckinematics.pose.Kinematics` of a machine file.

    Read-only after it is built but for the tips kept: any thread may use it. A machine without tools needs no
    Pinocchio.

    Raises:
        ModelError: the URDF or a tool's definition does not fit;
            `mckinematics.solution_check.check_machine` lists all that does not.
    """

    def __init__(self, machine: MachineDescription) -> None:
        self._tools: dict[int, ToolModel] = {}
        self._dynamics: JointDynamics | None = None
        self._tips: dict[tuple[int, float], TipControl] = {}
        if machine.tools:
            robot = load_machine_model(machine)
            self._tools = {tool.number: build_machine_tool(robot, tool, machine) for tool in machine.tools}
            refuse_shared_joints(self._tools.values())
            self._dynamics = JointDynamics(robot, machine, self._tools)

    @property
    def tools(self) -> tuple[int, ...]:
        """Numbers of the configured tools, sorted."""
        return tuple(sorted(self._tools))

    @property
    def dynamics(self) -> JointDynamics | None:
        """Torques of the tools' joints; None without tools."""
        return self._dynamics

    def tool(self, number: int) -> ToolModel:
        """Return the tool's model.

        Raises:
            ModelError: no tool has that number; lists those that there are.
        """
        try:
            return self._tools[number]
        except KeyError:
            known = ", ".join(f"T{number}" for number in self.tools)
            raise ModelError(
                f"the machine has no tool {number}",
                f"its tools are {known}" if known else "add a [[tool]] section to the machine file",
                tool=number,
            ) from None

    def axes(self, tool: int) -> tuple[int, ...]:
        """Axis numbers of the tool's chain, base to tool."""
        return self.tool(tool).chain.axes

    def has_orientation(self, tool: int) -> bool:
        """Return whether A B C are allowed."""
        return self.tool(tool).orientation

    def pose(self, tool: int, joints: Mapping[int, float], near: Triple | None = None) -> Pose:
        """Forward kinematics.

        Args:
            joints: axis number → position [rad or m], at least those of the chain.
            near: A, B, C [rad] to stay close to: of all triples with this orientation the nearest one, and
                at gimbal lock C as it is there. Without it principal values, and C = 0 at gimbal lock.
        """
        model = self.tool(tool)
        positions, rotations = model.chain.forward(_column(model, joints)[None])
        x, y, z = (float(value) for value in positions[0])
        return Pose((x, y, z), matrix_to_euler(rotations[0], model.euler, near))

    def rotation_angle(self, tool: int, start: Triple, end: Triple) -> float:
        """Angle of the single turn that takes orientation ``start`` to ``end`` [rad], 0 … π (D-30, D-51)."""
        order = self.tool(tool).euler
        turn = euler_to_matrix(end, order) @ euler_to_matrix(start, order).T
        return float(np.linalg.norm(rotation_vectors(turn[None])[0]))

    def jacobians(self, tool: int, joints: Array) -> Array:
        """Rates of the tool's point [m] and, with orientation, of its turn [rad] by those of its joints.

        Args:
            joints: positions of the chain's joints, base to tool, shape (n, K) [rad or m].

        Returns:
            Shape (n, 3 or 6, K), along the base's axes.
        """
        model = self.tool(tool)
        return model.chain.jacobian(joints, model.rows)[2]

    def solve_pose(self, tool: int, pose: Pose, joints: Mapping[int, float]) -> tuple[float, ...]:
        """Joint positions of the chain for a pose, nearest to ``joints``.

        Raises:
            KinematicsError: `JointLimit` or `Unreachable`.
        """
        model = self.tool(tool)
        solution = solve_target(model, model.target(pose), _column(model, joints))
        return tuple(float(value) for value in solution)

    def solve_path(self, tool: int, path: ToolPath, joints: Mapping[int, float]) -> JointPath:
        """Joint path that starts at ``joints`` and keeps the tool on ``path`` within the tolerances.

        Raises:
            KinematicsError: see `mckinematics.path_solver.solve_tool_path`.
        """
        model = self.tool(tool)
        return solve_tool_path(model, path, _column(model, joints))

    def solve_even_paths(
        self, tool: int, points: Array, angles: Array | None, joints: Mapping[int, float]
    ) -> EvenPaths:
        """The joints going evenly from ``joints`` along lines, up to one where `solve_path` has to decide.

        Args:
            points: shape (n+1, 3) [m], and angles: A, B, C, shape (n+1, 3) [rad], of the lines' ends; None
                for a tool without orientation.
        """
        model = self.tool(tool)
        return solve_even_paths(model, points, angles, _column(model, joints))

    def tolerances(self, tool: int) -> tuple[float, float]:
        """How far the tool may be off its path [m, rad] (D-54)."""
        model = self.tool(tool)
        return model.tolerance, model.tolerance_angle

    def check_beside(
        self, tool: int, path: Array, shares: Array, direction: Triple, window: tuple[float, float]
    ) -> None:
        """Refuse a path beside which the tool cannot be shifted anywhere in a window [m].

        Args:
            path: joints of the chain, shape (n, K), at ``shares`` of the path, shape (n,).

        Raises:
            KinematicsError: see `mckinematics.beside.check_beside`.
        """
        check_beside(self.tool(tool), path, shares, direction, window)

    def tip_control(self, tool: int, length: float) -> TipControl:
        """The tool with a cutter of a length [m], led by its tip while its turning joints go as written.

        Raises:
            ModelError: the tool has not three sliding joints.
        """
        found = self._tips.get((tool, length))
        if found is None:
            if len(self._tips) >= MOST_TIPS:
                self._tips.clear()
            found = self._tips[tool, length] = TipControl(self.tool(tool), length)
        return found


def load_machine_model(machine: MachineDescription) -> RobotModel:
    """Return the machine's URDF.

    Raises:
        ModelError: the model is missing, or cannot be read.
    """
    if machine.urdf is None:
        raise ModelError("the machine has tools but no URDF", "name it in [kinematics] urdf")
    return load_model(machine.urdf)


def build_machine_tool(robot: RobotModel, tool: ToolDescription, machine: MachineDescription) -> ToolModel:
    """One tool of the machine file over the loaded robot.

    Raises:
        ModelError: see `mckinematics.model.build_chain`.
    """
    chain = build_chain(robot, tool, {axis.index: axis for axis in machine.axes})
    return build_tool(
        tool.number,
        tool.frame,
        chain,
        orientation=tool.orientation,
        euler=tool.euler,
        tolerance=machine.tool_tolerance,
        tolerance_angle=machine.tool_tolerance_angle,
        posture=tool.posture,
    )


def refuse_shared_joints(tools: Iterable[ToolModel]) -> None:
    """Raises:
    ModelError: two tools give one joint two axes, or one axis two joints.
    """
    joint_of: dict[int, str] = {}
    axis_of: dict[str, int] = {}
    for tool in tools:
        for axis, joint in zip(tool.chain.axes, tool.chain.joint_names, strict=True):
            if joint_of.setdefault(axis, joint) != joint or axis_of.setdefault(joint, axis) != axis:
                raise ModelError(
                    f"tool {tool.number} has joint {joint!r} as axis {axis}, but another tool has"
                    f" axis {axis_of[joint]} for it, or joint {joint_of[axis]!r} for that axis",
                    "give each joint one axis in all tools",
                    tool=tool.number,
                    axis=axis,
                )


def _column(model: ToolModel, joints: Mapping[int, float]) -> Array:
    return np.array([joints[axis] for axis in model.chain.axes], dtype=float)
