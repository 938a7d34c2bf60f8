"""Lines of G-code that move a tool by a step, or to the pose where it is now."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from mcclient import ToolInfo
from mcclient.types import ToolPose
from mckinematics.rotation import euler_to_matrix, matrix_to_euler

Frame = Literal["base", "tool"]
# Whose motion a line is, whatever was in force
_SETTINGS = "G21 G94"


def step_lines(
    tool: ToolInfo, pose: ToolPose, word: str, amount: float, *, speed: float, frame: Frame
) -> list[str]:
    """Return the program of one step, from rest.

    Args:
        word: X Y Z to shift the tip along that axis of the frame, A B C to turn about it.
        amount: [mm] or [deg], signed. speed: of the tip [mm/s], of a turn [deg/s].
    """
    angles = (*(math.radians(each) for each in pose.orientation),)
    turned = euler_to_matrix((angles[0], angles[1], angles[2]), tool.euler) if angles else np.eye(3)
    if word in "XYZ":
        shift = amount * np.eye(3)["XYZ".index(word)]
        if frame == "tool":
            shift = turned @ shift
        move = "G91 G01 " + _words("XYZ", shift)
    else:
        about = [0.0, 0.0, 0.0]
        about["ABC".index(word)] = math.radians(amount)
        turn = euler_to_matrix((about[0], about[1], about[2]), tool.euler)
        wanted = turned @ turn if frame == "tool" else turn @ turned
        reached = matrix_to_euler(wanted, tool.euler, (angles[0], angles[1], angles[2]))
        # the words left out keep the tip where it is (D-51)
        move = "G90 G01 " + _words("ABC", np.degrees(reached))
    return [*captured(tool), f"{_SETTINGS} F{60.0 * speed:g}", f"{move} T{tool.number}"]


def pose_line(tool: ToolInfo, pose: ToolPose, speed: float) -> str:
    """Return the line that leads straight to a pose, in absolute millimetres and degrees.

    Args:
        speed: of the tip [mm/s].
    """
    words = _words("XYZ", pose.position)
    if tool.orientation:
        words += " " + _words("ABC", pose.orientation)
    return f"G01 {words} T{tool.number} F{60.0 * speed:g}"


def opening_lines(tool: ToolInfo) -> list[str]:
    """Return what stands before the first pose of a taught program."""
    return [*captured(tool), f"{_SETTINGS} G90 G64"]


def captured(tool: ToolInfo) -> list[str]:
    """Return the lines that energize the tool's axes."""
    return [f"G1010 P{axis}" for axis in tool.axes]


def _words(letters: str, values: np.ndarray | tuple[float, ...]) -> str:
    # without a negative zero
    rounded = (round(float(value), 4) + 0.0 for value in values)
    return " ".join(f"{letter}{value:.4f}" for letter, value in zip(letters, rounded, strict=True))
