"""Torques of a machine's joints along a path, by Pinocchio's recursive Newton-Euler algorithm (RNEA).

With q(σ) a path and v the speed along it, τ = M(q)q̈ + C(q, q̇)q̇ + g(q) is τ = a·v̇ + b·v² + g with a = M·q',
b = M·q'' + C(q, q')q' and g the torque at rest (Bobrow, Dubowsky, Gibson 1985). Friction and the inertia of
motors are not in a URDF that says nothing of them, and not in τ.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mckinematics.description import MachineDescription, PayloadDescription, ToolDescription
from mckinematics.errors import ModelError
from mckinematics.model import RobotModel, frame_id, import_pinocchio
from mckinematics.pose import Array
from mckinematics.tool import ToolModel

# Inertias of a payload may miss the triangle inequality by rounded digits.
TRIANGLE_SLACK = 1e-9


@dataclass(frozen=True)
class PathTorques:
    """Torques of J joints at n samples of a path: τ = inertial·v̇ + square·v² + rest, shape (n, J) each.

    Units: N·m, of prismatic joints N, by the path coordinate's own.
    """

    inertial: Array
    square: Array
    rest: Array


@dataclass(frozen=True)
class _Joint:
    """A joint that an axis moves: its places in Pinocchio's q and v. ``circle``: q holds cos and sin."""

    axis: int
    name: str
    q: int
    v: int
    circle: bool


class JointDynamics:
    """Inverse dynamics of the joints that the tools' axes move, with the payloads that the tools carry.

    Read-only after it is built, but for buffers of its own: one thread at a time.

    Args:
        robot: the loaded URDF. tools: of the machine, by number.

    Attributes:
        axes: axis numbers of the J joints, sorted. limits: greatest torques, infinite without one, shape (J,)
            [N·m, N]. efforts: the lower ones of these and the URDF's efforts.

    Raises:
        ModelError: a limit without a mass to move or without an effort to take it from, or a payload that no
            body can have.
    """

    def __init__(
        self, robot: RobotModel, machine: MachineDescription, tools: Mapping[int, ToolModel]
    ) -> None:
        self._pinocchio = import_pinocchio()
        self._robot = robot
        model = robot.pinocchio_model
        names = {
            axis: name
            for tool in tools.values()
            for axis, name in zip(tool.chain.axes, tool.chain.joint_names, strict=True)
        }
        self._joints = tuple(self._joint(axis, names[axis]) for axis in sorted(names))
        self.axes = tuple(joint.axis for joint in self._joints)
        described = {axis.index: axis for axis in machine.axes}
        self.limits = np.array(
            [self._limit(joint, described[joint.axis].max_torque) for joint in self._joints]
        )
        self.limits.setflags(write=False)
        effort = np.array([robot.pinocchio_model.upperEffortLimit[joint.v] for joint in self._joints])
        self.efforts = np.minimum(self.limits, np.where(effort > 0.0, effort, np.inf))
        self._tools = {tool.number: tool for tool in machine.tools}
        # tools that share a parent joint carry one payload at a time
        self._flange = {
            tool.number: int(
                model.frames[frame_id(self._pinocchio, robot, tool.number, tool.frame)].parentJoint
            )
            for tool in machine.tools
        }
        self._gravity = np.array(machine.gravity, dtype=float)
        self._loaded: dict[tuple[int, ...], tuple[Any, Any]] = {}
        for tool in machine.tools:
            self._inertia(tool)
        self._refuse_massless()

    @property
    def limited(self) -> bool:
        """Whether any joint has a greatest torque."""
        return bool(np.isfinite(self.limits).any())

    def joint_name(self, axis: int) -> str:
        """Return the URDF's name of the joint that an axis moves."""
        return self._joints[self.axes.index(axis)].name

    # ------------------------------------------------------------------ torques

    def torques(self, q: Array, dq: Array, d2q: Array, carried: Sequence[int] = ()) -> Array:
        """Return the joints' torques, shape (n, J) [N·m, N].

        Args:
            q, dq, d2q: positions, velocities and accelerations of the J joints, shape (n, J) [rad or m, s].
            carried: tools that were chosen, the last one last, see `payloads`.
        """
        model, buffers = self._model(self.payloads(carried))
        places = np.array([joint.v for joint in self._joints])
        rnea = self._pinocchio.rnea
        configurations, first, second = self._configurations(model, q), *self._tangents(model, dq, d2q)
        found = np.empty_like(q)
        for i in range(len(q)):
            found[i] = rnea(model, buffers, configurations[i], first[i], second[i])[places]
        return found

    def along_path(self, q: Array, dq: Array, d2q: Array, carried: Sequence[int] = ()) -> PathTorques:
        """Return what torque depends on along a path.

        Args:
            q, dq, d2q: positions and derivatives by the path coordinate, shape (n, J).
        """
        still = np.zeros_like(q)
        rest = self.torques(q, still, still, carried)
        inertial = self.torques(q, still, dq, carried) - rest
        square = self.torques(q, dq, d2q, carried) - rest
        return PathTorques(inertial, square, rest)

    def live(self, carried: Sequence[int]) -> Callable[[Array, Array, Array], Array]:
        """Return a function from q, dq and d2q, shape (J,) each, to torques (J,), for once a cycle.

        It allocates little: model and buffers of these payloads are made here.
        """
        model, buffers = self._model(self.payloads(carried))
        rnea = self._pinocchio.rnea
        places = np.array([joint.v for joint in self._joints])
        plain = [column for column, joint in enumerate(self._joints) if not joint.circle]
        q_plain = np.array([self._joints[column].q for column in plain], dtype=np.intp)
        circles = [(column, joint.q) for column, joint in enumerate(self._joints) if joint.circle]
        configuration = np.asarray(self._pinocchio.neutral(model), dtype=float)
        first, second = np.zeros(model.nv), np.zeros(model.nv)

        def torques(q: Array, dq: Array, d2q: Array) -> Array:
            configuration[q_plain] = q[plain]
            for column, place in circles:
                configuration[place], configuration[place + 1] = math.cos(q[column]), math.sin(q[column])
            first[places], second[places] = dq, d2q
            found: Array = rnea(model, buffers, configuration, first, second)[places]
            return found

        return torques

    def at_rest(self, q: Array, carried: Sequence[int] = ()) -> Array:
        """Return the torques that hold the joints still at positions (n, J), shape (n, J)."""
        still = np.zeros_like(q)
        return self.torques(q, still, still, carried)

    def flange(self, number: int) -> int:
        """Return what a tool is fixed to: tools of one flange carry one payload at a time."""
        return self._flange[number]

    def bits_of(self, carried: Iterable[int]) -> int:
        """Return the tools chosen last on their flanges as bits, by their order of numbers."""
        last = {self._flange[number]: number for number in carried if number in self._flange}
        return sum(1 << index for index, number in enumerate(sorted(self._tools)) if number in last.values())

    def tools_of(self, bits: int) -> tuple[int, ...]:
        """Return the tools of `bits_of`."""
        return tuple(number for index, number in enumerate(sorted(self._tools)) if bits >> index & 1)

    def payloads(self, carried: Iterable[int]) -> tuple[int, ...]:
        """Return the tools whose payloads are there, one for each flange.

        Args:
            carried: tools that a program has chosen, the last one last. A flange of which none was chosen
                carries the heaviest payload of its tools: what it really carries is not known.
        """
        last: dict[int, int] = {}
        for number in sorted(self._tools, key=lambda number: self._mass(number)):
            last[self._flange[number]] = number
        for number in carried:
            if number in self._flange:
                last[self._flange[number]] = number
        return tuple(sorted(number for number in last.values() if self._mass(number) > 0.0))

    # ------------------------------------------------------------------ the model

    def _joint(self, axis: int, name: str) -> _Joint:
        model = self._robot.pinocchio_model
        joint = int(model.getJointId(name))
        return _Joint(axis, name, int(model.idx_qs[joint]), int(model.idx_vs[joint]), model.nqs[joint] == 2)

    def _limit(self, joint: _Joint, limit: float | None) -> float:
        if limit is not None:
            return limit
        effort = float(self._robot.pinocchio_model.upperEffortLimit[joint.v])
        if not 0.0 < effort < np.inf:
            raise ModelError(
                f'axis {joint.axis} has max_torque = "urdf", but joint {joint.name!r} has no effort in'
                f" {self._robot.name!r}",
                "give its <limit> an effort in N·m, or max_torque = … in the machine file",
                axis=joint.axis,
            )
        return effort

    def _refuse_massless(self) -> None:
        model = self._robot.pinocchio_model
        data = model.createData()
        self._pinocchio.computeSubtreeMasses(model, data)
        loads = [self._flange[number] for number in self._tools if self._mass(number) > 0.0]
        for joint, limit in zip(self._joints, self.limits.tolist(), strict=True):
            index = int(model.getJointId(joint.name))
            loaded = any(index in model.supports[flange] for flange in loads)
            if np.isfinite(limit) and not loaded and not data.mass[index] > 0.0:
                raise ModelError(
                    f"axis {joint.axis} has a max_torque, but joint {joint.name!r} moves no mass in"
                    f" {self._robot.name!r}",
                    "give the links behind it an <inertial>, or leave max_torque out",
                    axis=joint.axis,
                )

    def _mass(self, number: int) -> float:
        payload = self._tools[number].payload
        return 0.0 if payload is None else payload.mass

    def _inertia(self, tool: ToolDescription) -> Any:
        """Return a tool's payload as Pinocchio has it, in the axes of the tool's frame; None without one."""
        payload = tool.payload
        if payload is None or payload.mass == 0.0:
            return None
        matrix = _inertia_matrix(payload)
        moments = np.linalg.eigvalsh(matrix)
        slack = TRIANGLE_SLACK + 1e-6 * float(moments[2])
        if moments[0] < -slack or moments[0] + moments[1] < moments[2] - slack:
            raise ModelError(
                f"tool {tool.number}: no body has the inertia {list(payload.inertia)} of its payload",
                "give ixx, iyy, izz, ixy, ixz, iyz about its centre in kg·m², or leave inertia out",
                tool=tool.number,
            )
        return self._pinocchio.Inertia(payload.mass, np.array(payload.center, dtype=float), matrix)

    def _model(self, loads: tuple[int, ...]) -> tuple[Any, Any]:
        """Return the model with the payloads of some tools, and its buffers."""
        known = self._loaded.get(loads)
        if known is None:
            model = self._pinocchio.Model(self._robot.pinocchio_model)
            for number in loads:
                tool = self._tools[number]
                frame = model.frames[frame_id(self._pinocchio, self._robot, tool.number, tool.frame)]
                model.appendBodyToJoint(self._flange[number], self._inertia(tool), frame.placement)
            model.gravity.linear = self._gravity
            known = self._loaded[loads] = model, model.createData()
        return known

    def _configurations(self, model: Any, q: Array) -> Array:
        found = np.tile(self._pinocchio.neutral(model), (len(q), 1))
        for column, joint in enumerate(self._joints):
            if joint.circle:
                found[:, joint.q], found[:, joint.q + 1] = np.cos(q[:, column]), np.sin(q[:, column])
            else:
                found[:, joint.q] = q[:, column]
        return found

    def _tangents(self, model: Any, dq: Array, d2q: Array) -> tuple[Array, Array]:
        places = [joint.v for joint in self._joints]
        first, second = np.zeros((len(dq), model.nv)), np.zeros((len(dq), model.nv))
        first[:, places], second[:, places] = dq, d2q
        return first, second


def _inertia_matrix(payload: PayloadDescription) -> Array:
    xx, yy, zz, xy, xz, yz = payload.inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
