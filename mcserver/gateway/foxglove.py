"""Live machines for Foxglove's viewers, over its WebSocket protocol: they are shown, and can do nothing.

https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md: JSON says what there is and what is wanted,
binary frames are messages. Each viewer is a client of its own in the key space.
"""

from __future__ import annotations

import asyncio
import base64
import json
import logging
import struct
import tempfile
import time
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError

import msgspec
import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from mcclient import Machine, MotionError
from mcclient.keys import is_name
from mcclient.types import MachineStatus
from mckinematics.rotation import euler_to_matrix
from scipy.spatial.transform import Rotation
from starlette.websockets import WebSocket, WebSocketDisconnect

from mcserver.foxglove import channels
from mcserver.foxglove.channels import NS, WellKnown
from mcserver.foxglove.log import log_message
from mcserver.foxglove.motion import joint_states, moving_frames, standing_frames, transform
from mcserver.foxglove.scene import scene_update
from mcserver.foxglove.shape import Looks, Shape, bare_shape
from mcserver.gateway.tokens import Principal
from mcserver.gateway.websocket import BAD_FRAME, NO_SERVER, TOO_MANY, Sessions, close_socket
from mcserver.service.reports import Event
from mcserver.units import DEGREE, MM
from mcserver.view.solids import Array
from mcserver.web.robot_model import fetch_meshes

log = logging.getLogger(__name__)

PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
LIVE = (
    channels.FRAMES,
    channels.STANDING_FRAMES,
    channels.JOINTS,
    channels.SCENE,
    channels.LOG,
    channels.ROBOT,
)
# each has a Zenoh session of its own, and its frames are computed for it
MOST_VIEWERS = 8
MOST_SUBSCRIPTIONS = 64
# for one message to be taken: who takes longer is gone
SEND_S = 10.0
# of a portal whose axes have no limits [m]
REACH = 0.5


class Viewers:
    """All viewers that are connected.

    Args:
        sessions: knows who may. connect, config_file: where the motion servers are.
    """

    def __init__(self, sessions: Sessions, connect: tuple[str, ...], config_file: Path | None) -> None:
        self._sessions = sessions
        self._connect = connect
        self._config_file = config_file
        self._count = 0

    async def serve(self, socket: WebSocket, name: str) -> None:
        """One connection to a machine of that name, from its handshake to its end."""
        principal = await self._sessions.let_in(socket, PROTOCOLS)
        if principal is None:
            return
        if self._count >= MOST_VIEWERS:
            await close_socket(socket, TOO_MANY, f"{MOST_VIEWERS} viewers are connected")
            return
        self._count += 1
        try:
            await self._show(socket, name, principal)
        except MotionError as error:
            await close_socket(socket, NO_SERVER, f"{error.code} {error.message}"[:120])
        except _BadRequest as error:
            await close_socket(socket, BAD_FRAME, str(error))
        except (WebSocketDisconnect, TimeoutError, RuntimeError) as error:
            log.debug("a viewer is gone: %s", error)
        finally:
            self._count -= 1

    async def _show(self, socket: WebSocket, name: str, principal: Principal) -> None:
        if not is_name(name):
            raise MotionError("MC537", f"{name!r} is no machine's name", "/v1/machines lists them")
        client, endpoints = f"fg-{principal.name}", self._connect or None
        async with Machine.connect(name, endpoints, client=client, config_file=self._config_file) as machine:
            shape = await _fetch_shape(machine)
            viewer = Viewer(socket, machine, shape)
            await viewer.exchange()


class _BadRequest(Exception):
    """What came is no request of the protocol; the connection ends with its reason."""


class Viewer:
    """One viewer: what it has subscribed to, and what there is for it.

    A viewer that reads slowly makes `send` wait meanwhile; the states that come then replace each other.
    """

    def __init__(self, socket: WebSocket, machine: Machine, shape: Shape) -> None:
        self._socket = socket
        self._machine = machine
        self._shape = shape
        self._subscribed: dict[int, WellKnown] = {}
        now = time.time_ns()
        # sent once, to each that subscribes
        self._standing = {
            channels.STANDING_FRAMES.topic: standing_frames(shape, now),
            channels.SCENE.topic: scene_update(shape, now, {}),
        }
        if shape.urdf:
            self._standing[channels.ROBOT.topic] = channels.robot_description(shape.urdf)

    async def exchange(self) -> None:
        """Say what there is, and send what is wanted until the connection ends.

        Raises:
            WebSocketDisconnect, TimeoutError: the viewer is gone. MotionError: the machine is.
        """
        await self._say({"op": "serverInfo", "name": f"mcserver {self._machine.name}", "capabilities": []})
        offered = [_advertisement(number, each) for number, each in enumerate(LIVE)]
        await self._say({"op": "advertise", "channels": offered})
        under_way = (self._receive(), self._send_states(), self._send_events())
        tasks = [asyncio.ensure_future(each) for each in under_way]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for each in done:
                each.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _receive(self) -> None:
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                raise WebSocketDisconnect(message.get("code", 1006))
            await self._take(message.get("text"))

    async def _take(self, text: str | None) -> None:
        """Carry one request out; what the protocol has beside subscriptions is not offered, and passed over.

        Raises:
            _BadRequest: it is no request.
        """
        try:
            request = json.loads(text or "")
            wanted = request["op"]
            if wanted == "subscribe":
                for each in request["subscriptions"]:
                    await self._subscribe(int(each["id"]), int(each["channelId"]))
            elif wanted == "unsubscribe":
                for number in request["subscriptionIds"]:
                    self._subscribed.pop(int(number), None)
        except (ValueError, KeyError, TypeError, RecursionError, OverflowError) as error:
            raise _BadRequest("not a request of the Foxglove WebSocket protocol") from error

    async def _subscribe(self, number: int, channel: int) -> None:
        if not 0 <= number < 2**32 or not 0 <= channel < len(LIVE):
            raise ValueError(number)
        if len(self._subscribed) >= MOST_SUBSCRIPTIONS and number not in self._subscribed:
            raise ValueError(number)
        self._subscribed[number] = LIVE[channel]
        standing = self._standing.get(LIVE[channel].topic)
        if standing is not None:
            await self._send(number, time.time_ns(), standing)

    async def _send_states(self) -> None:
        with_tools = {tool.number: tool.euler for tool in self._machine.info.tools}
        scale = np.array([_si_per_unit(axis.unit) for axis in self._machine.info.axes])
        async with self._machine.telemetry() as states:
            async for state in states:
                if len(state.axes.position) != len(scale):
                    raise MotionError("MC533", "the machine has other axes now", "connect again")
                time_ns = [round(state.wall * NS)]
                position, velocity = np.array([state.axes.position, state.axes.velocity])[:, None] * scale
                frames = moving_frames(self._shape, time_ns, position)[0]
                # messages of Protobuf one behind the other are one with the entries of both
                frames += _tips(self._shape, state, with_tools)
                await self._publish(channels.FRAMES, time_ns[0], frames)
                torque = np.array([state.axes.torque])
                joints = joint_states(self._shape, time_ns, position, velocity, torque)[0]
                await self._publish(channels.JOINTS, time_ns[0], joints)

    async def _send_events(self) -> None:
        async with self._machine.events() as events:
            async for event in events:
                time_ns = round(event.wall * NS) or time.time_ns()
                message = log_message(msgspec.convert(event, Event, from_attributes=True), time_ns)
                if message is not None:
                    await self._publish(channels.LOG, time_ns, message)

    async def _publish(self, channel: WellKnown, time_ns: int, message: bytes) -> None:
        for number, wanted in list(self._subscribed.items()):
            if wanted is channel:
                await self._send(number, time_ns, message)

    async def _send(self, subscription: int, time_ns: int, message: bytes) -> None:
        frame = struct.pack("<BIQ", 1, subscription, time_ns) + message
        await asyncio.wait_for(self._socket.send_bytes(frame), SEND_S)

    async def _say(self, message: dict[str, Any]) -> None:
        await asyncio.wait_for(self._socket.send_text(json.dumps(message)), SEND_S)


def _advertisement(number: int, channel: WellKnown) -> dict[str, Any]:
    """Return how a channel is offered: binary schemas in Base64, others as their text."""
    binary = channel.schema_encoding == "protobuf"
    return {
        "id": number,
        "topic": channel.topic,
        "encoding": channel.encoding,
        "schemaName": channel.schema_name,
        "schemaEncoding": channel.schema_encoding,
        "schema": base64.b64encode(channel.schema).decode() if binary else channel.schema.decode(),
    }


def _tips(shape: Shape, state: MachineStatus, euler: dict[int, str]) -> bytes:
    stamp = channels.timestamp(round(state.wall * NS))
    found = []
    for tool in state.tools:
        a, b, c = (angle * DEGREE for angle in tool.orientation)
        matrix = euler_to_matrix((a, b, c), euler.get(tool.number, "ZYX"))
        turn = Rotation.from_matrix(matrix).as_quat()
        name = f"T{tool.number}"
        found.append(transform(shape.tree.root, name, np.array(tool.position) * MM, turn, stamp))
    written: bytes = FrameTransforms(transforms=found).SerializeToString()
    return written


def _si_per_unit(unit: str) -> float:
    return MM if unit == "mm" else DEGREE


async def _fetch_shape(machine: Machine) -> Shape:
    """Ask a machine what it looks like.

    Raises:
        MotionError: it does not answer, or its URDF cannot be drawn.
    """
    found = await machine.model()
    linear = {axis.index: axis.unit == "mm" for axis in machine.info.axes}
    joints = {int(axis): name for axis, name in found.joints.items()}
    try:
        with tempfile.TemporaryDirectory() as folder:
            looks = Looks(found.urdf, joints, await fetch_meshes(machine, found, Path(folder)))
            # meshes are read by the second
            return await asyncio.to_thread(bare_shape, linear, looks, machine.info.tools, _space(machine))
    except OSError as error:
        raise MotionError("MC061", f"the model cannot be kept: {error.strerror}", "make room") from error
    except (ParseError, ValueError) as error:
        raise MotionError("MC587", f"the URDF cannot be drawn: {error}", "look at the URDF") from error


def _space(machine: Machine) -> Array:
    """Return two corners of the space of the axes 0, 1 and 2, shape (2, 3) [m]."""
    corners = np.array([[-REACH] * 3, [REACH] * 3])
    for axis in machine.info.axes:
        if axis.index < 3 and axis.min_position is not None and axis.max_position is not None:
            corners[:, axis.index] = axis.min_position * MM, axis.max_position * MM
    return corners
