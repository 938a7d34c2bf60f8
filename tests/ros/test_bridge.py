"""Which machines are shown to ROS, and what a person is told."""

from __future__ import annotations

import pytest

from mcserver.cli.app import run_command_line
from mcserver.ros.bridge import Bridge
from mcserver.ros.machine_node import NodeOptions


def test_of_machines_with_one_name_in_ros_the_first_is_shown_and_the_other_named_once() -> None:
    said: list[str] = []
    bridge = Bridge(NodeOptions(), said.append)
    for _ in range(2):
        assert bridge.shown(["cell-1", "cell_1", "mill"]) == ["cell-1", "mill"]
    assert said == ["MC083: cell_1 is /cell_1 in ROS, as cell-1 is: it is not shown"]


def test_the_only_machine_is_waited_for() -> None:
    said: list[str] = []
    bridge = Bridge(NodeOptions(machine="arm"), said.append)
    assert bridge.shown(["mill"]) == []
    assert bridge.shown(["arm", "mill"]) == ["arm"]
    assert said == ["waiting for arm; there are mill"]


def test_a_controller_that_is_no_name_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["ros", "--controller", "my controller"]) == 3
    assert "MC083" in capsys.readouterr().err
