"""The robot's model: a URDF read by Pinocchio, and the chains that its tools need of it.

Pinocchio reads the file and places the joints; `Chain` evaluates them. The G-code frame is the URDF's base
frame (its root link).
"""

from __future__ import annotations

import difflib
import importlib
import math
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from mckinematics.chain import Chain
from mckinematics.description import AxisDescription, ToolDescription
from mckinematics.errors import ModelError
from mckinematics.pose import Array


@dataclass(frozen=True)
class RobotModel:
    """A loaded URDF.

    Attributes:
        name: where it came from, for messages.
        links: names of the links, base first.
        pinocchio_model: ``pinocchio.Model``; read-only.
    """

    name: str
    links: tuple[str, ...]
    pinocchio_model: Any


def import_pinocchio() -> Any:
    """Import Pinocchio when a machine with tools asks for it, and SciPy, which the solver needs.

    Raises:
        ModelError: one of them is not installed.
    """
    try:
        importlib.import_module("scipy.linalg.lapack")
        return importlib.import_module("pinocchio")
    except ImportError as error:
        raise ModelError(
            f"tools need the packages pin (Pinocchio) and scipy, which cannot be imported: {error}",
            "install them with: pip install pin scipy; on Windows, which pin is not made for: conda",
        ) from error


def built_in_models() -> tuple[str, ...]:
    """File names of the URDFs that come with this package."""
    folder = resources.files("mckinematics").joinpath("models")
    return tuple(sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".urdf")))


def read_urdf(urdf: str) -> str:
    """Text of a URDF given by path or by a built-in name such as ``robot-dog.urdf``.

    A file of that path goes before a built-in of that name, unless the name is bare.

    Raises:
        ModelError: neither is there, or the file cannot be read.
    """
    path = Path(urdf)
    name = path.name if path.suffix else f"{path.name}.urdf"
    bare = path.name == urdf
    if name in built_in_models() and (bare or not path.exists()):
        return resources.files("mckinematics").joinpath("models", name).read_text("utf-8")
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(
            f"the URDF {urdf!r} cannot be read: {getattr(error, 'strerror', None) or error}",
            "give kinematics.urdf as a path relative to the machine file, or a built-in name: "
            + ", ".join(built_in_models()),
        ) from error


def load_model(urdf: str) -> RobotModel:
    """Return the robot of a URDF, by path or built-in name; its base is fixed to the world.

    Raises:
        ModelError: no such file, not a URDF, or Pinocchio is missing.
    """
    pinocchio = import_pinocchio()
    text = read_urdf(urdf)
    try:
        model = pinocchio.buildModelFromXML(text)
    except (ValueError, RuntimeError) as error:
        raise ModelError(
            f"{urdf!r} is not a URDF that can be read: {error}",
            "check it with check_urdf: joints need a parent, a child and, unless continuous, a limit",
        ) from error
    links = tuple(frame.name for frame in model.frames if frame.type == pinocchio.FrameType.BODY)
    return RobotModel(urdf, links, model)


def build_chain(robot: RobotModel, tool: ToolDescription, axes: dict[int, AxisDescription]) -> Chain:
    """Return the chain from the tool's work frame, or from the base, to its frame.

    Joints that move the work frame come first, from it to the base: the tool moves against them, so that
    their directions are reversed. Joints that carry both frames move neither against the other and are left
    out.

    Args:
        robot: the loaded URDF.
        tool: the tool of the machine file; ``tool.axes`` are the moving joints' axis numbers, in this order.
        axes: the machine's axes by number.

    Raises:
        ModelError: unknown frame, another number of moving joints than axes, a joint of several degrees,
            an axis of the wrong type, or limits that leave no travel.
    """
    pinocchio = import_pinocchio()
    model = robot.pinocchio_model
    frame = model.frames[frame_id(pinocchio, robot, tool.number, tool.frame)]
    carrying, carried = _supports(model, frame), []
    base = pinocchio.SE3.Identity()
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, pinocchio.neutral(model))
    pinocchio.computeJointJacobians(model, data, pinocchio.neutral(model))
    where, lengths = "the base", [carrying]
    if tool.work is not None:
        number = frame_id(pinocchio, robot, tool.number, tool.work)
        base, where = data.oMf[number], repr(tool.work)
        below = _supports(model, model.frames[number])
        shared = sum(one == other for one, other in zip(below, carrying, strict=False))
        carried, carrying = below[shared:][::-1], carrying[shared:]
        lengths = [carried[::-1], carrying]
    joints = [*carried, *carrying]
    names = tuple(model.names[joint] for joint in joints)
    if len(joints) != len(tool.axes):
        raise ModelError(
            f"tool {tool.number}: from {where} to {tool.frame!r} there are {len(joints)} moving joints"
            f" ({', '.join(names) or 'none'}), but axes lists {len(tool.axes)}",
            "list one axis number for each of these joints, in this order",
            tool=tool.number,
        )
    count = len(joints)
    revolute = np.zeros(count, dtype=bool)
    directions, points = np.zeros((count, 3)), np.zeros((count, 3))
    lower, upper = np.empty(count), np.empty(count)
    for column, joint in enumerate(joints):
        axis = axes[tool.axes[column]]
        if model.nvs[joint] != 1:
            raise ModelError(
                f"tool {tool.number}: joint {names[column]!r} has {model.nvs[joint]} degrees of freedom",
                "replace it by revolute and prismatic joints, one for each axis",
                tool=tool.number,
            )
        jacobian = pinocchio.getJointJacobian(model, data, joint, pinocchio.ReferenceFrame.WORLD)
        motion = pinocchio.Motion(jacobian.reshape(6, -1)[:, model.idx_vs[joint]])
        screw = base.actInv(motion).vector * (-1.0 if column < len(carried) else 1.0)
        spin = float(np.linalg.norm(screw[3:]))
        revolute[column] = spin > 0.5
        if revolute[column] != (axis.type.value == "rotary"):
            kind, wanted = ("revolute", "rotary") if revolute[column] else ("prismatic", "linear")
            raise ModelError(
                f"tool {tool.number}: joint {names[column]!r} is {kind}, but axis {axis.index} is"
                f" {axis.type.value}",
                f'set type = "{wanted}" for axis {axis.index}, or give the joint another axis',
                tool=tool.number,
                axis=axis.index,
            )
        directions[column] = screw[3:] if revolute[column] else screw[:3]
        if revolute[column]:
            points[column] = np.cross(screw[3:], screw[:3])
        lower[column], upper[column] = _limits(model, joint, names[column], axis, tool.number)
    tip = base.actInv(data.oMf[model.getFrameId(frame.name, frame.type)])
    rotation, offset = tip.rotation.copy(), np.asarray(tool.offset)
    for shared_array in (revolute, directions, points, lower, upper):
        shared_array.setflags(write=False)
    return Chain(
        axes=tuple(tool.axes),
        joint_names=names,
        revolute=revolute,
        directions=directions,
        points=points,
        tip_rotation=rotation,
        tip_position=tip.translation + rotation @ offset,
        lower=lower,
        upper=upper,
        reach=_reach(model, lengths, frame, offset, (upper - lower)[~revolute]),
        carried=len(carried),
    )


def _supports(model: Any, frame: Any) -> list[int]:
    """Return the moving joints from the base to a frame."""
    return [int(joint) for joint in model.supports[frame.parentJoint] if joint != 0]


def frame_id(pinocchio: Any, robot: RobotModel, tool: int, name: str) -> int:
    """Return the index of a frame that a tool names.

    Raises:
        ModelError: no frame has that name.
    """
    # a link and a joint may share a name: the link is meant
    model = robot.pinocchio_model
    for kind in (pinocchio.FrameType.BODY, pinocchio.FrameType.FIXED_JOINT, pinocchio.FrameType.JOINT):
        if model.existFrame(name, kind):
            return int(model.getFrameId(name, kind))
    near = difflib.get_close_matches(name, robot.links, n=1, cutoff=0.5)
    raise ModelError(
        f"tool {tool}: {robot.name!r} has no frame {name!r}",
        (f"did you mean {near[0]!r}? " if near else "") + f"its links are: {', '.join(robot.links)}",
        tool=tool,
    )


def _limits(model: Any, joint: int, name: str, axis: AxisDescription, tool: int) -> tuple[float, float]:
    lower, upper = axis.min_position, axis.max_position
    if model.nqs[joint] == 1:
        place = model.idx_qs[joint]
        lower = max(lower, float(model.lowerPositionLimit[place]))
        upper = min(upper, float(model.upperPositionLimit[place]))
    if not lower < upper:
        raise ModelError(
            f"tool {tool}: no position of joint {name!r} is within both the URDF's limits and those of"
            f" axis {axis.index}",
            "give the joint's limit lower and upper, and compare them with min_position and max_position",
            tool=tool,
            axis=axis.index,
        )
    return lower, upper


def _reach(model: Any, branches: list[list[int]], frame: Any, offset: Array, travel: Array) -> float:
    """Sum of the distances from joint to joint to tool, along each branch, and of all travel."""
    lengths = [
        float(np.linalg.norm(model.jointPlacements[joint].translation))
        for branch in branches
        for joint in branch[1:]
    ]
    placement = frame.placement
    lengths.append(float(np.linalg.norm(placement.translation + placement.rotation @ offset)))
    lengths += [float(span) for span in travel if np.isfinite(span)]
    length = math.fsum(lengths)
    return length if length > 1e-6 else 1.0
