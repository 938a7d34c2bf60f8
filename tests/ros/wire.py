"""A peer of ROS 2 on plain Zenoh: it writes and reads keys, attachments and payloads, and uses no bridge.

Only the types are shared; another implementation of all of it is `tests/ros/peer` (Rust).
"""

from __future__ import annotations

import asyncio
import secrets
import struct
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import zenoh
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from mcserver.ros.interfaces import interfaces
from mcserver.ros.stamps import duration_of, stamp_of
from tests.zenoh_sessions import opened

GID = bytes(range(16))


def key(domain: int, name: str, kind: str) -> str:
    package, middle, last = kind.split("/")
    return f"{domain}/{name}/{package}::{middle}::dds_::{last}_/{interfaces().type_hash(kind)}"


class Heard:
    """Messages of a topic, as they come."""

    def __init__(self) -> None:
        self.queue: asyncio.Queue[tuple[Any, int]] = asyncio.Queue()

    async def next(self, timeout_s: float = 30.0) -> Any:
        async with asyncio.timeout(timeout_s):
            return (await self.queue.get())[0]


class WirePeer:
    """A session; use it from one loop."""

    def __init__(self, endpoint: str, domain: int = 0) -> None:
        self.session = opened(
            {"mode": "client", "connect/endpoints": [endpoint], "timestamping/enabled": True}
        )
        self.domain = domain
        self._loop = asyncio.get_running_loop()
        self._number = 0

    async def __aenter__(self) -> WirePeer:
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.session.close)

    def tokens(self) -> list[str]:
        """Keys of the graph's tokens in this domain."""
        replies = self.session.liveliness().get(f"@ros2_lv/{self.domain}/**", timeout=5.0)
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    async def token(self, *parts: str, there: bool = True) -> str:
        """Wait for a token that has all of the parts; with ``there`` false, until there is none."""
        async with asyncio.timeout(60.0):
            while True:
                found = [
                    each for each in await asyncio.to_thread(self.tokens) if all(p in each for p in parts)
                ]
                if bool(found) == there:
                    return found[0] if found else ""
                await asyncio.sleep(0.1)

    def hear(self, name: str, kind: str, *, latched: bool = False) -> Heard:
        """Subscribe; ``latched``: transient local."""
        heard = Heard()

        def on_sample(sample: zenoh.Sample) -> None:
            assert sample.attachment is not None
            number, _, count, _ = struct.unpack("<qqB16s", sample.attachment.to_bytes())
            assert count == 16
            message = interfaces().decode(kind, sample.payload.to_bytes())
            self._loop.call_soon_threadsafe(heard.queue.put_nowait, (message, number))

        where = key(self.domain, name, kind)
        if latched:
            history = HistoryConfig(detect_late_publishers=True)
            heard.subscriber = declare_advanced_subscriber(self.session, where, on_sample, history=history)
        else:
            heard.subscriber = self.session.declare_subscriber(where, on_sample)
        return heard

    def put(self, name: str, kind: str, message: Any) -> None:
        """Publish one message."""
        payload = interfaces().encode(kind, message)
        self.session.put(key(self.domain, name, kind), payload, attachment=self._attachment())

    async def call(self, name: str, kind: str, request: Any, timeout_s: float = 60.0) -> Any:
        """Ask a service; None: it gave an error, or did not answer."""
        payload = request if isinstance(request, bytes) else interfaces().encode(f"{kind}_Request", request)
        return await asyncio.to_thread(self._ask, name, kind, payload, timeout_s)

    def _ask(self, name: str, kind: str, payload: bytes, timeout_s: float) -> Any:
        asked = self._attachment()
        for reply in self.session.get(
            key(self.domain, name, kind),
            payload=payload,
            attachment=asked,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout_s,
        ):
            if reply.ok is None:
                return None
            assert reply.ok.attachment is not None
            answered = reply.ok.attachment.to_bytes()
            # the number and the sender of the request
            assert (answered[:8], answered[16:]) == (asked[:8], asked[16:])
            return interfaces().decode(f"{kind}_Response", reply.ok.payload.to_bytes())
        return None

    def _attachment(self) -> bytes:
        self._number += 1
        return struct.pack("<qqB16s", self._number, time.time_ns(), 16, GID)


FOLLOW = "control_msgs/action/FollowJointTrajectory"


class FollowClient:
    """A client of the trajectory action; ``name`` without ``/_action``."""

    def __init__(self, peer: WirePeer, name: str) -> None:
        self._peer = peer
        self._name = f"{name}/_action"

    async def send(self, trajectory: Any, **fields: Any) -> tuple[Any, bool]:
        """Send a goal; returns its id and whether it was accepted."""
        make = interfaces().make
        goal_id = make(
            "unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(secrets.token_bytes(16), np.uint8)
        )
        goal = make(f"{FOLLOW}_Goal", trajectory=trajectory, **fields)
        request = make(f"{FOLLOW}_SendGoal_Request", goal_id=goal_id, goal=goal)
        reply = await self._peer.call(f"{self._name}/send_goal", f"{FOLLOW}_SendGoal", request)
        return goal_id, bool(reply.accepted)

    async def result(self, goal_id: Any) -> Any:
        """Return the answer of ``get_result``: ``status`` and ``result``."""
        request = interfaces().make(f"{FOLLOW}_GetResult_Request", goal_id=goal_id)
        return await self._peer.call(f"{self._name}/get_result", f"{FOLLOW}_GetResult", request)

    async def cancel(self, goal_id: Any = None) -> Any:
        """Cancel a goal; None: all."""
        make = interfaces().make
        info = make("action_msgs/msg/GoalInfo", **({} if goal_id is None else {"goal_id": goal_id}))
        request = make("action_msgs/srv/CancelGoal_Request", goal_info=info)
        return await self._peer.call(f"{self._name}/cancel_goal", "action_msgs/srv/CancelGoal", request)

    def feedback(self) -> Heard:
        return self._peer.hear(f"{self._name}/feedback", f"{FOLLOW}_FeedbackMessage")

    def statuses(self) -> Heard:
        return self._peer.hear(f"{self._name}/status", "action_msgs/msg/GoalStatusArray", latched=True)


def trajectory(names: Sequence[str], *points: tuple[float, Sequence[float]], stamp_s: float = 0.0) -> Any:
    """Return a trajectory of positions at times [s]."""
    make = interfaces().make
    made = [
        make(
            "trajectory_msgs/msg/JointTrajectoryPoint",
            positions=np.array(positions, np.float64),
            time_from_start=duration_of(time_s),
        )
        for time_s, positions in points
    ]
    header = make("std_msgs/msg/Header", stamp=stamp_of(stamp_s))
    return make("trajectory_msgs/msg/JointTrajectory", header=header, joint_names=list(names), points=made)


def twist(
    frame: str, linear: Sequence[float], angular: Sequence[float] = (0.0, 0.0, 0.0), *, stamp_s: float = 0.0
) -> Any:
    """Return a twist with its frame."""
    make = interfaces().make
    parts = {
        name: make("geometry_msgs/msg/Vector3", **dict(zip("xyz", values, strict=True)))
        for name, values in (("linear", linear), ("angular", angular))
    }
    header = make("std_msgs/msg/Header", frame_id=frame, stamp=stamp_of(stamp_s))
    return make(
        "geometry_msgs/msg/TwistStamped", header=header, twist=make("geometry_msgs/msg/Twist", **parts)
    )


def jog(names: Sequence[str], velocities: Sequence[float], displacements: Sequence[float] = ()) -> Any:
    """Return velocities of joints."""
    return interfaces().make(
        "control_msgs/msg/JointJog",
        joint_names=list(names),
        velocities=np.array(velocities, np.float64),
        displacements=np.array(displacements, np.float64),
    )
