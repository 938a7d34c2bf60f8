"""Trajectories beside bodies: a goal runs where all between its joints' bounds stays clear."""

from __future__ import annotations

import signal
from collections.abc import AsyncIterator, Iterator

import pytest

from mcserver.ros.outcome import INVALID_GOAL, Status
from tests.e2e.conftest import served
from tests.e2e.ros_bridge import DOMAIN, start_bridge
from tests.e2e.servers import ServerProcess
from tests.machine_text import axes_text
from tests.ros.wire import FollowClient, WirePeer, trajectory

KEYS = """max_jerk = 100000.0
min_position = 0.0
max_position = 400.0
in_position = 0.01
max_following_error = 10.0"""
MACHINE = (
    '[machine]\nname = "gantry"\ncycle_hz = 500\n'
    + axes_text(range(2), velocity=500.0, acceleration=5000.0, keys=KEYS)
    + """
[clearance]
[[body]]
name = "post"
shape = "box"
size_mm = [40.0, 40.0, 40.0]
at_mm = [200.0, 200.0, 0.0]
[[body]]
name = "tip"
shape = "sphere"
radius_mm = 10.0
carried_by = [0, 1]
"""
)
NAMES = ["axis_0", "axis_1"]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("clearance")
    file = folder / "gantry.toml"
    file.write_text(MACHINE)
    for each in served(folder, str(file), "gantry"):
        bridge = start_bridge(each.endpoint, "--machine", each.name)
        yield each
        bridge.send_signal(signal.SIGTERM)
        assert bridge.wait(30.0) == 0


@pytest.fixture
async def client(server: ServerProcess) -> AsyncIterator[FollowClient]:
    async with WirePeer(server.endpoint, DOMAIN) as peer:
        await peer.token("/SS/", "%send_goal/")
        yield FollowClient(peer, "joint_trajectory_controller/follow_joint_trajectory")


async def test_a_way_that_stays_clear_runs_and_one_through_a_body_moves_nothing(client: FollowClient) -> None:
    # past the post by two legs that each come to rest, then straight through it
    for place in ([0.1, 0.0], [0.1, 0.2]):
        goal, _ = await client.send(trajectory(NAMES, (0.8, place)))
        ended = await client.result(goal)
        assert ended.status == Status.SUCCEEDED, ended.result.error_string
    feedback = client.feedback()
    goal, _ = await client.send(trajectory(NAMES, (1.0, [0.3, 0.2])))
    ended = await client.result(goal)
    assert (ended.status, ended.result.error_code) == (Status.ABORTED, INVALID_GOAL)
    for said in ("MC320", "'tip'", "'post'", "the greatest position of each joint"):
        assert said in ended.result.error_string
    while not feedback.queue.empty():
        assert (await feedback.next()).feedback.actual.positions[0] == pytest.approx(0.1, abs=1e-4)


async def test_a_newer_goal_has_bounds_of_its_own_and_begins_at_rest(client: FollowClient) -> None:
    older, _ = await client.send(trajectory(NAMES, (3.0, [0.0, 0.3])))
    feedback = client.feedback()
    while not (await feedback.next()).feedback.actual.velocities[1] > 0.01:
        pass
    newer, _ = await client.send(trajectory(NAMES, (1.5, [0.1, 0.05])))
    assert (await client.result(older)).status == Status.CANCELED
    ended = await client.result(newer)
    assert ended.status == Status.SUCCEEDED, ended.result.error_string
