"""`mcserver ros` and a peer of another make (hiroz, in Rust): the graph, joint_states, goals with their ends.

`make ros-peer` builds the peer; it takes minutes, so that where nobody did these tests are skipped.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mcserver.ros.interfaces import interfaces
from tests.e2e.conftest import served
from tests.e2e.ros_bridge import DOMAIN, JOINTS, start_bridge
from tests.e2e.servers import ROOT

ACTION = "/joint_trajectory_controller/follow_joint_trajectory"
FOLLOW = "control_msgs/action/FollowJointTrajectory"
LIMIT_S = 120.0


@pytest.fixture(scope="module")
def peer() -> Path:
    target = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "tests" / "ros" / "peer" / "target")
    program = target / "debug" / "ros-peer"
    if not program.exists():
        pytest.skip("the peer is not built: make ros-peer")
    return program


@pytest.fixture(scope="module")
def endpoint(peer: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:  # noqa: ARG001
    for server in served(tmp_path_factory.mktemp("peer"), "arm6", "arm"):
        bridge = start_bridge(server.endpoint, "--machine", "arm", "--rate", "500")
        yield server.endpoint
        bridge.send_signal(signal.SIGTERM)
        assert bridge.wait(30.0) == 0


def said(peer: Path, endpoint: str, *words: str) -> Any:
    command = [str(peer), endpoint, str(DOMAIN), *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_joints_are_heard_in_the_order_of_their_times(peer: Path, endpoint: str) -> None:
    heard = said(peer, endpoint, "listen", "2")
    assert heard["names"] == JOINTS
    assert heard["messages"] > 0
    assert heard["not_later"] == 0


def test_the_graph_has_the_node_its_topics_services_and_the_action(peer: Path, endpoint: str) -> None:
    graph = said(peer, endpoint, "graph")
    assert ["mcserver", "/"] in graph["nodes"]
    assert ["/joint_states", "sensor_msgs::msg::dds_::JointState_"] in graph["topics"]
    assert "/run_program" in [name for name, _ in graph["services"]]
    assert ACTION in [name for name, _ in graph["actions"]]


def test_goals_end_as_they_were_asked_to(peer: Path, endpoint: str) -> None:
    ended = said(peer, endpoint, "goals", "8", "3")
    assert ended["otherwise"] == []
    assert ended["as_asked"] == 8
    # that it was computed there too: else no goal would have come
    assert ended["send_goal"] == interfaces().type_hash(f"{FOLLOW}_SendGoal")
