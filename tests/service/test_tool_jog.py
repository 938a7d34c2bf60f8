"""A tool moved while it is held: where it stops, why, and who may; on a virtual executor."""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import pytest

from mcserver.errors import Refused
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.service.tool_reach import ToolDirection, ToolFrame, reachable_move
from tests.service.virtual_cell import VirtualCell

ARM = load_machine("arm6")
KINEMATICS = build_kinematics(ARM)
assert KINEMATICS is not None
CHAIN = KINEMATICS.axes(1)
# away from the positions in which an arm is singular
BENT = dict(zip(CHAIN, (0.0, -0.3, 0.6, 0.2, 0.7, 0.0), strict=True))


def machine() -> Machine:
    return ARM


async def hold(
    cell: VirtualCell,
    word: ToolDirection,
    velocity: float,
    *,
    frame: ToolFrame = "base",
    hold_s: float = 10.0,
    by: str = "",
) -> tuple[str, str]:
    return await cell.jogging.jog_tool(
        "page", 1, word, velocity, frame=frame, by=by, hold_s=hold_s, program_id=None
    )


def joints(cell: VirtualCell) -> dict[int, float]:
    return {axis: cell.position(axis) for axis in CHAIN}


def tip(cell: VirtualCell) -> np.ndarray:
    assert KINEMATICS is not None
    return np.array(KINEMATICS.pose(1, joints(cell)).position)


@pytest.mark.parametrize(("word", "velocity"), [("X", 250.0), ("Z", -250.0), ("B", 90.0)])
async def test_a_tool_goes_straight_until_a_joint_ends_its_way_and_says_which(
    cell: VirtualCell, word: ToolDirection, velocity: float
) -> None:
    start = tip(cell)
    name, obstacle = await hold(cell, word, velocity)
    program = await cell.ended(cell.service.program(name))
    assert (program.state, program.diagnostics) == ("finished", [])
    assert re.search(r"axis \d \(joint '", obstacle), obstacle
    moved = tip(cell) - start
    along = "XYZ".find(word)
    aside = np.delete(moved, along) if along >= 0 else moved
    assert np.abs(aside).max() < 1e-4
    for axis in ARM.axes[:6]:
        assert axis.min_position <= cell.position(axis.index) <= axis.max_position


def test_ways_in_all_directions_can_be_solved_or_name_a_joint() -> None:
    assert KINEMATICS is not None
    ways: tuple[tuple[ToolFrame, ToolDirection], ...] = (
        ("base", "Z"),
        ("tool", "X"),
        ("base", "A"),
        ("tool", "B"),
    )
    obstacles = {}
    for (frame, word), way in itertools.product(ways, (-4.0, 4.0)):
        found = reachable_move(KINEMATICS, 1, BENT, word, frame, way)
        assert found.words.endswith(" T1")
        assert re.search(r"axis \d \(joint '|^-?170 deg are turned", found.obstacle), (frame, word, way)
        obstacles[frame, word, way] = found.obstacle
    assert obstacles["base", "Z", 4.0] == "axis 2 (joint 'joint_3') ends the reach"
    assert obstacles["base", "Z", -4.0] == "axis 1 (joint 'joint_2') is at its limit"


def test_a_tool_whose_joint_is_at_its_limit_is_refused_to_go_on_and_may_go_back() -> None:
    assert KINEMATICS is not None
    ended = BENT | {CHAIN[4]: float(KINEMATICS.tool(1).chain.upper[4])}
    with pytest.raises(Refused, match="axis 4") as refused:
        reachable_move(KINEMATICS, 1, ended, "B", "tool", math.radians(90.0))
    assert refused.value.code == "MC303"
    reachable_move(KINEMATICS, 1, ended, "B", "tool", math.radians(-20.0))


async def test_a_tool_stops_when_it_is_let_go_and_can_be_pressed_again_at_once(cell: VirtualCell) -> None:
    name, _ = await hold(cell, "X", 20.0)
    first = cell.service.program(name)
    start = tip(cell)
    await cell.until(lambda: tip(cell)[0] > start[0] + 1e-3)
    with pytest.raises(Refused, match=r"jog tool 1 X by ada|jog tool 1 X"):
        await hold(cell, "Y", 20.0, by="bob")
    cell.service.abort(name)
    again, _ = await hold(cell, "Z", -20.0)
    assert first.ended
    assert tip(cell)[0] < start[0] + 0.02
    cell.service.abort(again)
    assert (await cell.ended(cell.service.program(again))).state == "aborted"


async def test_what_no_tool_can_do_is_refused(cell: VirtualCell) -> None:
    for velocity in (0.0, math.nan):
        with pytest.raises(Refused, match="MC511"):
            await hold(cell, "X", velocity)
    with pytest.raises(Refused, match="MC310"):
        await cell.jogging.jog_tool("page", 9, "X", 1.0, frame="base", by="", hold_s=None, program_id=None)
