"""The topic of a trajectory controller: what comes on it is followed as a goal is, without an answer."""

from __future__ import annotations

import asyncio
import logging
import time

from mcserver.ros.follower import Follower
from mcserver.ros.goals import Goal
from mcserver.ros.interfaces import MalformedPayload, interfaces
from mcserver.ros.node import Node, decoded
from mcserver.ros.outcome import Outcome, Status

log = logging.getLogger(__name__)

FOLLOW = "control_msgs/action/FollowJointTrajectory"
KIND = "trajectory_msgs/msg/JointTrajectory"


class TrajectoryTopic:
    """Trajectories as they come: the newest counts, what came before it and has not begun does not."""

    def __init__(self, node: Node, name: str, follower: Follower) -> None:
        self._follower = follower
        self._newest = b""
        self._came = asyncio.Event()
        node.subscribe(name, KIND, self._take)

    async def run(self) -> None:
        """Begin with what comes, until this is cancelled."""
        while True:
            await self._came.wait()
            self._came.clear()
            try:
                trajectory = await decoded(KIND, self._newest)
            except MalformedPayload as error:
                log.warning("a trajectory of the topic was not understood: %s", error)
                continue
            message = interfaces().make(f"{FOLLOW}_Goal", trajectory=trajectory)
            goal = Goal(b"", message, time.time(), lambda: None)
            goal.ended.add_done_callback(_say_failed)
            await self._follower.begin(goal)

    def _take(self, payload: bytes, _sender: bytes) -> None:
        self._newest = payload
        self._came.set()


def _say_failed(ended: asyncio.Future[Outcome]) -> None:
    outcome = ended.result()
    if outcome.status is Status.ABORTED:
        log.warning("a trajectory of the topic: %s", outcome.text)
