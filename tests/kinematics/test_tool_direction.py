"""Where two turning joints have a tool point in a direction (D-111)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from mckinematics.chain import Chain
from mckinematics.errors import ModelError
from mckinematics.tool_direction import turns_towards

from mcserver.machine.machine_kinematics import build_kinematics
from tests.simulation.five_axes import HEAD_HEAD, HEAD_TABLE, TABLE_TABLE, FiveAxes


def chain_of(mill: FiveAxes, folder: Path) -> Chain:
    return build_kinematics(mill.machine(folder)).tool(1).chain


def tool_at(chain: Chain, turns: tuple[float, float]) -> np.ndarray:
    joints = np.zeros((1, chain.size))
    joints[0, np.flatnonzero(chain.revolute)] = turns
    return np.asarray(chain.forward(joints)[1][0, :, 2])


@pytest.mark.parametrize("mill", [TABLE_TABLE, HEAD_TABLE, HEAD_HEAD], ids=["tables", "mixed", "heads"])
def test_each_pair_points_there_and_all_pairs_are_found(mill: FiveAxes, tmp_path: Path) -> None:
    chain = chain_of(mill, tmp_path)
    random = np.random.default_rng(3)
    for _ in range(200):
        turns = tuple(random.uniform(-3.1, 3.1, 2))
        near = random.uniform(-9.0, 9.0, 2)
        direction = tool_at(chain, turns)
        found = turns_towards(chain, direction, near)
        assert len(found) == 2
        for pair in found:
            np.testing.assert_allclose(tool_at(chain, pair), direction, atol=1e-9)
            assert (np.abs(np.array(pair) - near) <= math.pi + 1e-9).all()
        off = [np.abs((np.array(pair) - turns + math.pi) % (2.0 * math.pi) - math.pi).max() for pair in found]
        assert min(off) < 1e-6


def test_where_one_joint_may_stand_anywhere_it_stays(tmp_path: Path) -> None:
    chain = chain_of(TABLE_TABLE, tmp_path)
    ((first, second),) = turns_towards(chain, np.array([0.0, 0.0, 1.0]), np.array([1.234, 0.5]))
    assert (first, second) == pytest.approx((1.234, 0.0), abs=1e-12)


def test_directions_out_of_reach_have_no_pair_and_other_chains_are_refused(tmp_path: Path) -> None:
    chain = chain_of(HEAD_HEAD, tmp_path)
    assert turns_towards(chain, np.array([0.0, 0.0, -1.0]), np.zeros(2)) == []
    # the second axis is at 45 degrees: the horizon is as far as it comes
    assert len(turns_towards(chain, np.array([1.0, 0.0, 0.0]), np.zeros(2))) == 1
    one = FiveAxes(TABLE_TABLE.table[:2], TABLE_TABLE.head)
    with pytest.raises(ModelError, match="two rotary axes"):
        turns_towards(chain_of(one, tmp_path), np.array([0.0, 0.0, 1.0]), np.zeros(1))
