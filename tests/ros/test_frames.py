"""Frames of tf: where the tips of tools hang."""

from __future__ import annotations

from mcclient.types import ToolInfo, ToolPose

from mcserver.ros.frames import Frames
from mcserver.ros.stamps import stamp_of
from mcserver.view.urdf import read_tree

ROBOT = """
<robot name="cell">
  <link name="base"/><link name="table"/><link name="hand"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="table"/><axis xyz="0 0 1"/></joint>
  <joint name="reach" type="prismatic"><parent link="base"/><child link="hand"/><axis xyz="1 0 0"/></joint>
</robot>
"""


def test_a_tip_hangs_in_the_frame_that_its_poses_are_in() -> None:
    tools = [ToolInfo(number, "hand", (0,), False, "ZYX", work) for number, work in enumerate(("", "table"))]
    tools.append(ToolInfo(2, "hand", (0,), False, "ZYX", "turn"))
    frames = Frames(read_tree(ROBOT), tools, "cell/")
    poses = [ToolPose(tool.number, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0)) for tool in tools]
    found = frames.tips(stamp_of(0.0), poses).transforms
    assert [each.header.frame_id for each in found] == ["cell/base", "cell/table", "cell/table"]
    assert frames.base(1) == "cell/table"
