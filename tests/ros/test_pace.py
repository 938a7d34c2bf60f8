"""How a trajectory's time passes: override and hold, and where it goes on behind one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mcclient.types import MachineStatus, ProgramState, ProgramStatus

from mcserver.ros.pace import place_of, rate_of
from mcserver.ros.trajectory import Motion, read_trajectory
from tests.ros.goal_payloads import ROS_JOINTS
from tests.ros.wire import trajectory
from tests.wire_values import wire_value


def status(percent: float, **program: Any) -> MachineStatus:
    programs = (wire_value(ProgramStatus, "p-1", **program),)
    return wire_value(MachineStatus, override=percent, programs=programs)


def test_the_rate_is_of_machine_and_program_and_one_at_most() -> None:
    assert rate_of(None, "p-1") == 1.0
    assert rate_of(status(50.0, state=ProgramState.RUNNING, override=50.0), "p-1") == pytest.approx(0.25)
    assert rate_of(status(200.0, state=ProgramState.RUNNING, override=100.0), "p-1") == 1.0
    assert rate_of(status(100.0, state=ProgramState.HELD, override=100.0), "p-1") == 0.0
    assert rate_of(status(50.0, state=ProgramState.HELD, override=100.0), "p-2") == pytest.approx(0.5)


def there_and_back() -> Motion:
    points = [(0.5 * at, [0.2 * (at % 2)]) for at in range(1, 7)]
    return Motion(read_trajectory(trajectory(["a"], *points), ROS_JOINTS), 0.0, np.zeros(1), np.zeros(1))


def test_behind_a_hold_a_trajectory_goes_on_from_where_the_joints_have_stopped() -> None:
    motion = there_and_back()
    stopped, _ = motion.at(np.array([1.25]))
    assert place_of(motion, 1.2, stopped[0]) == pytest.approx(1.25, abs=0.01)


def test_of_a_way_there_and_back_nothing_is_left_out() -> None:
    motion = there_and_back()
    # it is here at 1.25 and again at 1.75
    stopped, _ = motion.at(np.array([1.25]))
    at = 1.25
    for _ in range(100):
        at = place_of(motion, at, stopped[0] + 1e-4)
    assert at == pytest.approx(1.25, abs=0.02)
