"""Where the tools are, in the status and in ``tele/state``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.net.status import EdgeUnits
from tests.net.client import WireClient
from tests.net.conftest import running_rig
from tests.service.fakes import three_axes


def test_the_feet_of_the_dog_stand_where_its_drives_start() -> None:
    machine = load_machine("robot-dog")
    start = np.array([axis.initial_position for axis in machine.axes])
    poses = {pose.number: pose.position for pose in EdgeUnits(machine).tools(start)}
    assert list(poses) == [3, 6, 9, 12]
    np.testing.assert_allclose(poses[3], (-159.0, -400.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(poses[12], (159.0, -400.0, -800.0), atol=1e-9)


def test_a_machine_without_tools_has_no_poses() -> None:
    assert EdgeUnits(three_axes()).tools(np.zeros(3)) == []


async def test_status_and_state_tell_the_tools_poses_at_the_encoders_readings(tmp_path: Path) -> None:
    machine = load_machine("arm6")
    kinematics = build_kinematics(machine)
    assert kinematics is not None
    async with running_rig(tmp_path, machine=machine) as rig:
        expected = kinematics.pose(1, dict(enumerate(rig.port.snapshot().position)))
        client = WireClient(rig.endpoint, "arm6")
        try:
            states = client.subscribe("tele/state")
            status, state = await client.call("status"), await states.first()
        finally:
            await client.close()
    for message in (status, state):
        (pose,) = message["tools"]
        assert pose["number"] == 1
        assert pose["position"] == pytest.approx(np.multiply(expected.position, 1000.0))
        assert pose["orientation"] == pytest.approx(np.degrees(expected.angles))
