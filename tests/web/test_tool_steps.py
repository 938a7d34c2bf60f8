"""Steps of a tool: the line that is sent leads where the frame says."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from mcclient import ToolInfo
from mcclient.types import ToolPose
from mckinematics.rotation import euler_to_matrix

from mcserver.web.tool_steps import opening_lines, pose_line, step_lines

TOOL = ToolInfo(1, "flange", (0, 1, 2, 3, 4, 5), True, "ZYX")
# the tool's X looks along Y of the base
TURNED = ToolPose(1, (300.0, 0.0, 400.0), (0.0, 0.0, 90.0))


def words(line: str) -> dict[str, float]:
    return {word[0]: float(word[1:]) for word in re.findall(r"[XYZABC]-?[\d.]+", line)}


def test_a_step_along_the_base_is_an_increment_at_the_speed_of_the_tip() -> None:
    *captures, settings, move = step_lines(TOOL, TURNED, "X", -5.0, speed=10.0, frame="base")
    assert captures == [f"G1010 P{axis}" for axis in range(6)]
    assert settings == "G21 G94 F600"
    assert move.startswith("G91 G01 ")
    assert move.endswith(" T1")
    assert words(move) == {"X": -5.0, "Y": 0.0, "Z": 0.0}


def test_a_step_along_the_tool_goes_where_the_tool_looks() -> None:
    move = step_lines(TOOL, TURNED, "X", 5.0, speed=10.0, frame="tool")[-1]
    assert words(move) == pytest.approx({"X": 0.0, "Y": 5.0, "Z": 0.0}, abs=1e-4)


@pytest.mark.parametrize("order", ["ZYX", "XYZ"])
@pytest.mark.parametrize("word", ["A", "B", "C"])
@pytest.mark.parametrize("frame", ["base", "tool"])
def test_a_turn_is_about_the_axis_of_the_frame_and_leaves_the_tip(frame: str, word: str, order: str) -> None:
    tool = ToolInfo(1, "flange", (0, 1, 2, 3, 4, 5), True, order)
    angles = (20.0, -35.0, 110.0)
    pose = ToolPose(1, (300.0, 0.0, 400.0), angles)
    move = step_lines(tool, pose, word, 10.0, speed=5.0, frame=frame)[-1]  # type: ignore[arg-type]
    reached = words(move)
    assert set(reached) == {"A", "B", "C"}
    assert move.startswith("G90 G01 ")

    def matrix(values: tuple[float, ...]) -> np.ndarray:
        a, b, c = (math.radians(value) for value in values)
        return euler_to_matrix((a, b, c), order)

    turn = np.eye(3)
    about = "ABC".index(word)
    cosine, sine = math.cos(math.radians(10.0)), math.sin(math.radians(10.0))
    first, second = (about + 1) % 3, (about + 2) % 3
    turn[first, first] = turn[second, second] = cosine
    turn[second, first], turn[first, second] = sine, -sine
    wanted = turn @ matrix(angles) if frame == "base" else matrix(angles) @ turn
    assert matrix((reached["A"], reached["B"], reached["C"])) == pytest.approx(wanted, abs=1e-5)


def test_a_tool_without_orientation_is_taught_by_its_place() -> None:
    foot = ToolInfo(3, "foot", (0, 1, 2), False, "ZYX")
    assert pose_line(foot, ToolPose(3, (1.0, -2.0, 3.5), ()), 25.0) == "G01 X1.0000 Y-2.0000 Z3.5000 T3 F1500"
    assert opening_lines(foot) == ["G1010 P0", "G1010 P1", "G1010 P2", "G21 G94 G90 G64"]
