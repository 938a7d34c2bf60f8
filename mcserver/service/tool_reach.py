"""Find how far a tool can move in one direction, and which joint ends the move."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from mckinematics.errors import JointLimit, KinematicsError, Singular, Unreachable
from mckinematics.pose import Array, JointPath, Pose, ToolPath
from mckinematics.rotation import euler_to_matrix, matrix_to_euler
from mckinematics.solver import MachineKinematics
from mckinematics.tool import ToolModel

from mcserver.errors import Refused
from mcserver.units import DEGREE, MM

ToolFrame = Literal["base", "tool"]
ToolDirection = Literal["X", "Y", "Z", "A", "B", "C"]

# A line turns the shorter way (D-51), so longer turns cannot be programmed.
LONGEST_TURN = math.radians(170.0)
# Share by which a failed move is shortened for another try, and number of tries: a joint may end it earlier.
SHORTER = 0.98
TRIES = 12
# Shortest move [m, rad].
NO_WAY = 1e-4


@dataclass(frozen=True)
class ReachableMove:
    """A straight move of a tool, or a turn about its tip.

    Attributes:
        words: its line of G-code after ``F``. obstacle: what ends it, for people; empty: its length.
    """

    words: str
    obstacle: str = ""


def reachable_move(
    kinematics: MachineKinematics,
    number: int,
    joints: dict[int, float],
    word: ToolDirection,
    frame: ToolFrame,
    way: float,
) -> ReachableMove:
    """Return the longest move along (X Y Z) or about (A B C) an axis of a frame that the joints can follow.

    Args:
        joints: positions of the tool's axes, by number [m, rad].
        way: greatest length wanted, signed [m, rad].

    Raises:
        Refused: MC311 the tool has no orientation; as `MachineKinematics.solve_path` if it cannot move.
    """
    tool = kinematics.tool(number)
    if word in "ABC" and not tool.orientation:
        raise Refused("MC311", f"T{number} takes no orientation", "jog it along X Y Z")
    end = ""
    if word in "ABC" and abs(way) > LONGEST_TURN:
        way = math.copysign(LONGEST_TURN, way)
        end = f"{way / DEGREE:.0f} deg are turned: press again"
    pose = kinematics.pose(number, joints)
    lost: KinematicsError | None = None
    for _ in range(TRIES):
        words, path = _line(tool, pose, word, frame, way)
        try:
            joint_path = kinematics.solve_path(number, path, joints)
        except KinematicsError as error:
            lost = error
            way *= SHORTER * (error.s or 0.0)
            if abs(way) < NO_WAY:
                break
        else:
            return ReachableMove(words, end if lost is None else _obstacle(tool, lost, joint_path))
    assert lost is not None
    raise Refused(lost.code, lost.message, lost.hint, axis=lost.axis)


def _line(
    tool: ToolModel, pose: Pose, word: ToolDirection, frame: ToolFrame, length: float
) -> tuple[str, ToolPath]:
    """Return a move's words and its path."""
    start = np.array(pose.position)
    shift, end = np.zeros(3), pose.angles
    turned = euler_to_matrix(pose.angles, tool.euler)
    if word in "XYZ":
        along = np.eye(3)["XYZ".index(word)]
        shift = length * (turned @ along if frame == "tool" else along)
        words = "G91 G01 " + _words("XYZ", shift / MM)
    else:
        about = [0.0, 0.0, 0.0]
        about["ABC".index(word)] = length
        turn = euler_to_matrix((about[0], about[1], about[2]), tool.euler)
        end = matrix_to_euler(turned @ turn if frame == "tool" else turn @ turned, tool.euler, pose.angles)
        # omitted words keep the tip in place (D-51)
        words = "G90 G01 " + _words("ABC", np.array(end) / DEGREE)
    turns = (pose.angles, end) if tool.orientation else (None, None)
    path = ToolPath.straight(start, shift, *turns)
    return f"{words} T{tool.number}", path


def _words(letters: str, values: Array) -> str:
    # adding 0 avoids a negative zero
    return " ".join(
        f"{letter}{round(float(value), 6) + 0.0:.6f}" for letter, value in zip(letters, values, strict=True)
    )


def _obstacle(tool: ToolModel, error: KinematicsError, path: JointPath) -> str:
    """Name the joint that ends a move: at its limit, or the one that would have to be fastest beyond it."""
    chain = tool.chain
    if isinstance(error, JointLimit) and error.axis is not None:
        column = chain.axes.index(error.axis)
        return f"axis {error.axis} (joint {chain.joint_names[column]!r}) is at its limit"
    # beginning of the last piece of the path, which is close to its end
    slope = path.coefficients[2, -1]
    column = int(np.argmax(np.abs(slope) / tool.unit))
    joint = f"axis {chain.axes[column]} (joint {chain.joint_names[column]!r})"
    if isinstance(error, Unreachable):
        return f"{joint} ends the reach"
    why = "is singular" if isinstance(error, Singular) else "would fold over"
    return f"{joint} would have to move ever faster: the arm {why} there"
