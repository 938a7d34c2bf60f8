"""`mcserver ros` beside a real server, heard by a session of Zenoh that speaks as a node of ROS 2 does."""

from __future__ import annotations

import asyncio
import math
import signal
from collections.abc import AsyncIterator, Iterator

import numpy as np
import pytest
from mcclient import Machine

from mcserver.ros.servo_topics import RELEASE_S
from mcserver.ros.velocity_commands import JOG, TWIST
from tests.bench.server import free_port
from tests.e2e.conftest import served
from tests.e2e.ros_bridge import DOMAIN, JOINTS, start_bridge
from tests.e2e.servers import ServerProcess
from tests.ros.wire import Heard, WirePeer, jog, twist
from tests.zenoh_sessions import opened

PERIOD_S = 0.02
REST = jog(["joint_1"], [0.0])


@pytest.fixture(scope="module")
def arm_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    yield from served(tmp_path_factory.mktemp("arm"), "arm6", "arm-1")


@pytest.fixture(scope="module")
def bridge(arm_server: ServerProcess) -> Iterator[None]:
    # on a busy computer the publisher, and the bridge, get no processor for most of a second now and then
    process = start_bridge(arm_server.endpoint, "--command-timeout", "2", "--joint-scale", "2")
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
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with opened({"mode": "router", "listen/endpoints": [endpoint]}):
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


# ---------------------------------------------------------------------- servo mode


class Stick:
    """A publisher, and what it is told."""

    def __init__(self, peer: WirePeer) -> None:
        self._peer = peer
        self._told: Heard = peer.hear("diagnostics", "diagnostic_msgs/msg/DiagnosticArray")

    def put(self, command: object) -> None:
        topic, kind = (
            ("delta_joint_cmds", JOG) if hasattr(command, "joint_names") else ("delta_twist_cmds", TWIST)
        )
        self._peer.put(f"arm_1/servo_node/{topic}", kind, command)

    async def push(self, command: object, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.put(command)
            await asyncio.sleep(PERIOD_S)

    async def until_told(self, text: str, command: object) -> None:
        """Push until the diagnostics say something."""
        async with asyncio.timeout(30.0):
            while True:
                await self.push(command, PERIOD_S)
                while not self._told.queue.empty():
                    said = (await self._told.next()).status
                    if any(each.name.endswith("servo mode") and text in each.message for each in said):
                        return


@pytest.fixture
async def machine(arm_server: ServerProcess) -> AsyncIterator[Machine]:
    async with Machine.connect(arm_server.name, arm_server.endpoint) as made:
        yield made


@pytest.fixture
async def stick(peer: WirePeer, machine: Machine) -> Stick:
    """A stick that was let go, beside a machine that stands."""
    await peer.token("/MS/", "%delta_twist_cmds/")
    await until_nobody_leads(machine)
    await asyncio.sleep(RELEASE_S + 0.2)
    return Stick(peer)


async def until_nobody_leads(machine: Machine) -> None:
    async with asyncio.timeout(30.0):
        while any(each.state in ("running", "ending") for each in await machine.programs()):
            await asyncio.sleep(0.05)


async def tip(machine: Machine) -> np.ndarray:
    return np.array((await machine.status()).tools[0].position)


async def test_a_twist_leads_the_tip_along_its_frame_until_the_commands_cease(
    stick: Stick, machine: Machine
) -> None:
    for frame, direction in (("base", (0.0, 0.02, 0.0)), ("tool_1", (0.02, 0.0, 0.0))):
        before = await tip(machine)
        await stick.push(twist(f"arm_1/{frame}", direction), 0.6)
        await until_nobody_leads(machine)
        moved = np.abs(await tip(machine) - before)
        assert sorted(moved > 5.0) == [False, False, True], moved
    assert {each.state for each in await machine.programs() if each.name == "ROS servo"} == {"finished"}


async def test_joints_are_led_by_name_in_the_stream_of_a_twist(stick: Stick, machine: Machine) -> None:
    before = (await machine.status()).axes.position
    await stick.push(twist("arm_1/base", (0.0, 0.0, 0.05)), 0.4)
    await stick.push(jog(["joint_6"], [-0.3]), 0.5)
    await until_nobody_leads(machine)
    assert (await machine.status()).axes.position[5] < before[5] - 2.0


async def test_diagnostics_say_whose_axes_they_are_and_a_pushed_stick_waits(
    stick: Stick, machine: Machine
) -> None:
    async with machine.program(axes=[0]):
        await stick.until_told("MC512", jog(["joint_1"], [0.2]))
    before = (await machine.status()).axes.setpoint[0]
    await stick.push(jog(["joint_1"], [0.2]), 0.5)
    assert (await machine.status()).axes.setpoint[0] == before
    await stick.push(REST, RELEASE_S + 0.2)
    await stick.until_told("commands are followed", jog(["joint_1"], [0.2]))


async def test_a_reset_behind_an_emergency_stop_moves_nothing(stick: Stick, machine: Machine) -> None:
    push = jog(["joint_2"], [0.1])
    await stick.until_told("commands are followed", push)
    await machine.estop("a test")
    await stick.until_told("MC400", push)
    await machine.reset()
    before = (await machine.status()).axes.setpoint[1]
    await stick.push(push, 0.5)
    assert (await machine.status()).axes.setpoint[1] == before
    assert not [each for each in await machine.programs() if each.state == "running"]


async def test_at_the_end_of_travel_the_diagnostics_name_the_joint(stick: Stick) -> None:
    await stick.until_told("joint_5 is at the end of its travel", jog(["joint_5"], [1.0]))
