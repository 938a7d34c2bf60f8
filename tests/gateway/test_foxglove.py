"""The gateway's WebSocket for Foxglove, as a viewer of another make sees it."""

from __future__ import annotations

import asyncio
import base64
import json
import signal
import struct
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcclient import Machine
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from mcserver.gateway.foxglove import MOST_VIEWERS
from tests.bench.server import free_port
from tests.e2e.servers import ServerProcess
from tests.gateway.conftest import GatewayProcess
from tests.peers import Peer, foxglove_client
from tests.sdks.languages import ToolMissing

Tokens = tuple[Path, dict[str, str]]
LIMIT_S = 60.0
TOPICS = {"/tf", "/tf_static", "/joint_states", "/scene", "/log", "/robot_description"}


class Viewer:
    """Subscribes by topic and reads messages."""

    def __init__(self, socket: ClientConnection, info: dict[str, Any], channels: dict[str, Any]) -> None:
        self.socket = socket
        self.info = info
        self.channels = channels

    async def subscribe(self, *topics: str) -> None:
        wanted = [
            {"id": 100 + self.channels[each]["id"], "channelId": self.channels[each]["id"]} for each in topics
        ]
        await self.socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    async def message(self, topic: str) -> tuple[int, bytes]:
        """The time [ns] and the payload of the next message on a topic."""
        while True:
            frame = await asyncio.wait_for(self.socket.recv(), LIMIT_S)
            assert isinstance(frame, bytes)
            kind, number, time_ns = struct.unpack_from("<BIQ", frame)
            assert kind == 1
            if number == 100 + self.channels[topic]["id"]:
                return time_ns, frame[13:]


def address(gateway: GatewayProcess, token: str, machine: str = "cell") -> str:
    return gateway.ws.replace("/v1/ws", f"/v1/foxglove/{machine}?token={token}")


@asynccontextmanager
async def viewing(
    gateway: GatewayProcess, token: str, machine: str = "cell", protocol: str = "foxglove.sdk.v1"
) -> AsyncIterator[Viewer]:
    async with connect(address(gateway, token, machine), subprotocols=[protocol]) as socket:  # type: ignore[list-item]
        assert socket.subprotocol == protocol
        info = json.loads(await asyncio.wait_for(socket.recv(), LIMIT_S))
        offered = json.loads(await asyncio.wait_for(socket.recv(), LIMIT_S))
        yield Viewer(socket, info, {each["topic"]: each for each in offered["channels"]})


@pytest.fixture
def token(tokens: Tokens) -> str:
    return tokens[1]["observer"]


@pytest.mark.parametrize("protocol", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
async def test_an_observer_is_told_what_there_is(gateway: GatewayProcess, token: str, protocol: str) -> None:
    async with viewing(gateway, token, protocol=protocol) as viewer:
        assert viewer.info["op"] == "serverInfo"
        assert viewer.info["capabilities"] == []
        assert set(viewer.channels) == TOPICS


async def test_messages_are_read_by_the_schemas_that_were_sent(gateway: GatewayProcess, token: str) -> None:
    async with viewing(gateway, token) as viewer:
        await viewer.subscribe("/joint_states")
        time_ns, payload = await viewer.message("/joint_states")
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(
        base64.b64decode(viewer.channels["/joint_states"]["schema"])
    ).file:
        pool.Add(file)
    message = GetMessageClass(pool.FindMessageTypeByName("foxglove.JointStates")).FromString(payload)
    assert [each.name for each in message.joints] == ["X", "Y", "Z"]
    assert message.timestamp.ToNanoseconds() == time_ns


async def test_the_machine_moves(gateway: GatewayProcess, token: str, server: ServerProcess) -> None:
    async with viewing(gateway, token) as viewer:
        await viewer.subscribe("/tf", "/joint_states", "/log")
        before = JointStates.FromString((await viewer.message("/joint_states"))[1]).joints[0].position
        goal = 0.0 if before > 0.01 else 20.0
        async with Machine.connect("cell", server.endpoint) as machine, machine.program("goes") as program:
            await program.send(f"G00 X{goal}")
        while True:
            frames = FrameTransforms.FromString((await viewer.message("/tf"))[1]).transforms
            (x,) = (each.translation.x for each in frames if each.child_frame_id == "X")
            if abs(x - goal * 1e-3) < 1e-6:
                break


async def test_what_stands_still_comes_with_the_subscription(gateway: GatewayProcess, token: str) -> None:
    async with viewing(gateway, token) as viewer:
        await viewer.subscribe("/scene", "/tf_static")
        scene = SceneUpdate.FromString((await viewer.message("/scene"))[1])
        assert {each.frame_id for each in scene.entities} == {"machine", "Y", "X", "Z"}
        frames = FrameTransforms.FromString((await viewer.message("/tf_static"))[1]).transforms
        assert ("world", "machine") in {(each.parent_frame_id, each.child_frame_id) for each in frames}


@pytest.mark.parametrize(
    "sent",
    [
        "",
        "[]",
        "null",
        "{" * 5000,
        b"\x01\x02",
        '{"op": "subscribe"}',
        '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 0}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 1e999, "channelId": 0}]}',
        json.dumps({"op": "subscribe", "subscriptions": [{"id": n, "channelId": 0} for n in range(65)]}),
        '{"op": "unsubscribe", "subscriptionIds": 5}',
    ],
)
async def test_what_is_no_request_ends_the_connection(
    gateway: GatewayProcess, token: str, sent: str | bytes
) -> None:
    async with viewing(gateway, token) as viewer:
        await viewer.socket.send(sent)
        await asyncio.wait_for(viewer.socket.wait_closed(), LIMIT_S)
        assert viewer.socket.close_code == 4000


async def test_requests_that_are_not_offered_are_passed_over(gateway: GatewayProcess, token: str) -> None:
    async with viewing(gateway, token) as viewer:
        await viewer.socket.send('{"op": "setParameters", "parameters": []}')
        await viewer.subscribe("/joint_states")
        assert (await viewer.message("/joint_states"))[1]


@pytest.mark.parametrize("token", ["", "wrong"])
async def test_without_a_token_nothing_is_shown(gateway: GatewayProcess, token: str) -> None:
    with pytest.raises(InvalidStatus):
        async with viewing(gateway, token):
            pass


async def test_a_token_in_the_address_opens_nothing_else(gateway: GatewayProcess, token: str) -> None:
    with pytest.raises(InvalidStatus):
        async with connect(f"{gateway.ws}?token={token}", subprotocols=["mc.v1"]):  # type: ignore[list-item]
            pass


async def test_a_page_of_another_origin_is_not_let_in(gateway: GatewayProcess, token: str) -> None:
    with pytest.raises(InvalidStatus):
        async with connect(
            address(gateway, token), subprotocols=["foxglove.sdk.v1"], origin="https://x.example"
        ):  # type: ignore[list-item,arg-type]
            pass


@pytest.mark.parametrize(("machine", "said"), [("nobody", "MC530"), ("no%20name", "MC537")])
async def test_a_machine_that_is_not_there_is_named(
    gateway: GatewayProcess, token: str, machine: str, said: str
) -> None:
    with pytest.raises(ConnectionClosed) as ended:
        async with viewing(gateway, token, machine):
            pass
    assert ended.value.rcvd is not None
    assert ended.value.rcvd.code == 4010
    assert said in ended.value.rcvd.reason


async def test_viewers_are_counted_and_make_room_again(gateway: GatewayProcess, token: str) -> None:
    opened = []
    try:
        for _ in range(MOST_VIEWERS):
            manager = viewing(gateway, token)
            await manager.__aenter__()
            opened.append(manager)
        with pytest.raises(ConnectionClosed) as ended:
            async with viewing(gateway, token):
                pass
        assert ended.value.rcvd is not None
        assert ended.value.rcvd.code == 4008
    finally:
        for manager in opened:
            await manager.__aexit__(None, None, None)
    while True:
        # its place is free once its Zenoh session is closed
        try:
            async with viewing(gateway, token) as viewer:
                assert viewer.channels
                return
        except ConnectionClosed:
            continue


async def test_a_viewer_that_reads_nothing_keeps_nobody_from_seeing(
    gateway: GatewayProcess, token: str
) -> None:
    async with connect(
        address(gateway, token),
        subprotocols=["foxglove.sdk.v1"],  # type: ignore[list-item]
        max_queue=1,
    ) as deaf:
        await deaf.recv()
        wanted = [{"id": number, "channelId": 0} for number in range(60)]
        await deaf.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        async with viewing(gateway, token) as viewer:
            await viewer.subscribe("/joint_states")
            for _ in range(20):
                await viewer.message("/joint_states")


async def test_a_machine_is_shown_again_after_its_server_was_killed(
    gateway: GatewayProcess, token: str, server: ServerProcess
) -> None:
    async with viewing(gateway, token) as viewer:
        await viewer.subscribe("/joint_states")
        await viewer.message("/joint_states")
        server.end(signal.SIGKILL)
        server.start()
        started_ns = time.time_ns()
        while (await viewer.message("/joint_states"))[0] < started_ns:
            pass


@pytest.fixture
def foxglove() -> Peer:
    try:
        return Peer(foxglove_client())
    except ToolMissing as missing:
        pytest.skip(str(missing))


async def test_the_client_of_foxglove_sees_all_and_comes_back_after_a_kill_of_server_and_gateway(
    foxglove: Peer, server: ServerProcess, tokens: Tokens
) -> None:
    options = ("--tokens", str(tokens[0]), "--port", str(free_port()))
    gateway = GatewayProcess(server.endpoint, *options)
    await foxglove.start(address(gateway, tokens[1]["observer"]))
    try:
        said = await foxglove.says("info mcserver cell", "message /joint_states", "message /joint_states")
        assert not [each for each in said if each.startswith(("error", "closed"))]
        server.end(signal.SIGKILL)
        server.start()
        started_ns = time.time_ns()
        while True:
            last = (await foxglove.says("message /tf "))[-1]
            if int(last.split()[2]) > started_ns:
                break
        gateway.process.kill()
        await foxglove.says("closed")
        gateway.close()
        gateway = GatewayProcess(server.endpoint, *options)
        said = await foxglove.says("info mcserver cell", "message /joint_states")
        assert {"/tf_static", "/scene"} <= {each.split()[1] for each in said if each.startswith("message")}
    finally:
        await foxglove.stop()
        gateway.close()
