"""`mcserver ros` beside a real server, heard by a session of Zenoh that speaks as a node of ROS 2 does."""

from __future__ import annotations

import json
import math
import signal
from collections.abc import AsyncIterator, Iterator

import pytest
import zenoh

from tests.bench.server import free_port
from tests.e2e.conftest import served
from tests.e2e.ros_bridge import DOMAIN, JOINTS, start_bridge
from tests.e2e.servers import ServerProcess
from tests.ros.wire import WirePeer


@pytest.fixture(scope="module")
def arm_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    yield from served(tmp_path_factory.mktemp("arm"), "arm6", "arm-1")


@pytest.fixture(scope="module")
def bridge(arm_server: ServerProcess) -> Iterator[None]:
    process = start_bridge(arm_server.endpoint)
    yield
    process.send_signal(signal.SIGTERM)
    assert process.wait(30.0) == 0


@pytest.fixture
async def peer(arm_server: ServerProcess, bridge: None) -> AsyncIterator[WirePeer]:  # noqa: ARG001
    async with WirePeer(arm_server.endpoint, DOMAIN) as made:
        await made.token("/MP/", "%joint_states/")
        yield made


async def test_joints_are_named_and_measured_as_in_the_urdf(peer: WirePeer) -> None:
    heard = peer.hear("arm_1/joint_states", "sensor_msgs/msg/JointState")
    first, second = await heard.next(), await heard.next()
    assert first.name == JOINTS
    assert first.position.tolist() == pytest.approx([0.0, 0.0, 0.0, 0.0, math.pi / 2, 0.0], abs=1e-3)
    assert (second.header.stamp.sec, second.header.stamp.nanosec) > (
        first.header.stamp.sec,
        first.header.stamp.nanosec,
    )


async def test_the_description_and_fixed_frames_are_there_for_who_comes_later(peer: WirePeer) -> None:
    described = peer.hear("arm_1/robot_description", "std_msgs/msg/String", latched=True)
    assert "<robot" in (await described.next()).data
    fixed = await peer.hear("tf_static", "tf2_msgs/msg/TFMessage", latched=True).next()
    assert fixed.transforms[0].child_frame_id == "arm_1/tip"


async def test_a_tip_is_where_the_links_have_it(peer: WirePeer) -> None:
    heard = peer.hear("tf", "tf2_msgs/msg/TFMessage")
    while True:
        (transform, *_) = (await heard.next()).transforms
        if transform.child_frame_id == "arm_1/tool_1":
            break
    at = transform.transform.translation
    assert (at.x, at.y, at.z) == pytest.approx((0.46, 0.0, 0.675), abs=1e-6)


async def test_nodes_of_ros_may_be_on_a_network_of_their_own(arm_server: ServerProcess) -> None:
    config = zenoh.Config()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    for name, value in (("mode", "router"), ("listen/endpoints", [endpoint])):
        config.insert_json5(name, json.dumps(value))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config):
        bridge = start_bridge(arm_server.endpoint, "--domain", str(DOMAIN + 2), "--ros-connect", endpoint)
        try:
            async with WirePeer(endpoint, DOMAIN + 2) as peer:
                await peer.token("/SS/", "%send_goal/")
            async with WirePeer(arm_server.endpoint, DOMAIN + 2) as other:
                assert other.tokens() == []
        finally:
            bridge.send_signal(signal.SIGTERM)
            assert bridge.wait(30.0) == 0


async def test_another_domain_has_none_of_it(arm_server: ServerProcess, peer: WirePeer) -> None:
    assert peer.tokens()
    async with WirePeer(arm_server.endpoint, DOMAIN + 1) as other:
        assert other.tokens() == []
