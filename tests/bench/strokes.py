"""Tool strokes of one second for the figures of inverse kinematics, and how each solver does them."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mckinematics.model import load_model
from mckinematics.pose import Array, ToolPath, Triple
from mckinematics.solver import MachineKinematics
from mckinematics.target_path import TargetPath
from mckinematics.tool import Targets, ToolModel

from mcserver.machine.machine_file import load_machine
from tests.bench.figures import NotAvailable

# of one second at 1 kHz
WAYPOINTS = 1000
# how near the peers come to each waypoint, as the spline does between its knots [m, rad]
PEER_TOLERANCE = 2e-6
# PyKDL of Debian is built for Debian's own Python
DEBIAN_PYTHON = "/usr/bin/python3"
KDL_LIMIT_S = 60.0
NO_KDL = "not installed: apt-get install python3-pykdl python3-numpy"


@dataclass(frozen=True)
class Stroke:
    """A straight tool path of `WAYPOINTS` targets from where the machine starts."""

    urdf: str
    kinematics: MachineKinematics
    tool: ToolModel
    path: ToolPath
    start: dict[int, float]
    joints: Array
    targets: Targets


def stroke(robot: str, number: int, end: Triple, angles: Triple | None) -> Stroke:
    """To ``end`` [m] and the angles A B C [rad] there, None for a tool without orientation."""
    machine = load_machine(robot)
    assert machine.urdf is not None
    kinematics = MachineKinematics(machine)
    start = {axis.index: axis.initial_position for axis in machine.axes}
    tool, pose = kinematics.tool(number), kinematics.pose(number, start)
    first, way = np.array(pose.position), np.subtract(end, pose.position)
    path = ToolPath(
        lambda s: first + s[:, None] * way,
        lambda s: np.tile(way, (len(s), 1)),
        None if angles is None else pose.angles,
        angles,
    )
    joints = np.array([start[axis] for axis in tool.chain.axes])
    targets = TargetPath(tool, path, joints).at(np.linspace(0.0, 1.0, WAYPOINTS))
    return Stroke(machine.urdf, kinematics, tool, path, start, joints, targets)


def solve(stroke: Stroke) -> Array:
    """The product's way: one joint path, evaluated at every waypoint, shape (WAYPOINTS, K)."""
    path = stroke.kinematics.solve_path(stroke.tool.number, stroke.path, stroke.start)
    s = np.linspace(0.0, 1.0, WAYPOINTS)
    cell = np.minimum(np.searchsorted(path.knots, s, side="right") - 1, len(path.knots) - 2)
    x = (s - path.knots[cell])[:, None]
    c3, c2, c1, c0 = path.coefficients[:, cell]
    joints: Array = ((c3 * x + c2) * x + c1) * x + c0
    return joints


class DensePinocchio:
    """Newton at each waypoint from the one before, by Pinocchio's kinematics of the tool's chain alone."""

    def __init__(self, stroke: Stroke) -> None:
        import pinocchio

        self._pinocchio, self._stroke = pinocchio, stroke
        whole = load_model(stroke.urdf).pinocchio_model
        names = stroke.tool.chain.joint_names
        locked = [number for number, name in enumerate(whole.names) if number and name not in names]
        self._model = pinocchio.buildReducedModel(whole, locked, pinocchio.neutral(whole))
        self._frame = self._model.getFrameId(stroke.tool.frame, pinocchio.FrameType.BODY)

    def solve(self) -> Array:
        """Joints at every waypoint, shape (WAYPOINTS, K)."""
        pinocchio, model, frame = self._pinocchio, self._model, self._frame
        targets, rows = self._stroke.targets, self._stroke.tool.rows
        world = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        data = model.createData()
        joints = self._stroke.joints.copy()
        result = np.empty((WAYPOINTS, len(joints)))
        for index in range(WAYPOINTS):
            for _ in range(20):
                pinocchio.framesForwardKinematics(model, data, joints)
                place = data.oMf[frame]
                gap = targets.positions[index] - place.translation
                if targets.rotations is not None:
                    turn = pinocchio.log3(targets.rotations[index] @ place.rotation.T)
                    gap = np.concatenate([gap, turn])
                if np.abs(gap).max() < PEER_TOLERANCE:
                    break
                jacobian = pinocchio.computeFrameJacobian(model, data, joints, frame, world)[:rows]
                joints = joints + np.linalg.solve(jacobian, gap)
            result[index] = joints
        return result


def kdl(stroke: Stroke, runs: int) -> tuple[float, Array]:
    """PyKDL's Levenberg-Marquardt at each waypoint from the one before, in a process of Debian's Python.

    Returns:
        Median processor time [s], and the joints at every waypoint, shape (WAYPOINTS, K).

    Raises:
        NotAvailable: PyKDL is not installed.
    """
    if not os.path.exists(DEBIAN_PYTHON):
        raise NotAvailable(NO_KDL)
    chain, targets = stroke.tool.chain, stroke.targets
    rotations = np.tile(np.eye(3), (WAYPOINTS, 1, 1)) if targets.rotations is None else targets.rotations
    question: dict[str, Any] = {
        "points": chain.points.tolist(),
        "directions": chain.directions.tolist(),
        "tip": [*chain.tip_rotation.ravel().tolist(), *chain.tip_position.tolist()],
        "oriented": stroke.tool.orientation,
        "targets": np.concatenate([rotations.reshape(-1, 9), targets.positions], axis=1).tolist(),
        "start": stroke.joints.tolist(),
        "tolerance": PEER_TOLERANCE,
        "runs": runs,
    }
    answered = subprocess.run(
        [DEBIAN_PYTHON, str(Path(__file__).with_name("kdl_loop.py"))],
        input=json.dumps(question).encode(),
        capture_output=True,
        timeout=KDL_LIMIT_S,
        check=False,
    )
    if answered.returncode:
        raise NotAvailable(NO_KDL)
    answer = json.loads(answered.stdout)
    return float(answer["seconds"]), np.array(answer["joints"])


def largest_error(stroke: Stroke, joints: Array) -> float:
    """Largest distance of the tool from its waypoints [m]."""
    positions, _ = stroke.tool.chain.forward(joints)
    return float(np.linalg.norm(positions - stroke.targets.positions, axis=1).max())
