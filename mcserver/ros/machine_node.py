"""A machine as a node of ROS 2, as long as its server is there."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

import msgspec
from mcclient import Machine

from mcserver.ros.graph import ros_name
from mcserver.ros.joints import joints_of
from mcserver.ros.node import RosSession
from mcserver.ros.state_topics import StateTopics

log = logging.getLogger(__name__)

NODE_NAME = "mcserver"
MODEL_S = 30.0


class NodeOptions(msgspec.Struct, frozen=True):
    """How machines are shown.

    Attributes:
        connect: Zenoh endpoints; empty: this computer. config_file: a Zenoh configuration for TLS.
        machine: the only one, whose names stand in the root; None: all, each in a namespace of its name.
        rate_hz: of ``joint_states``. controller: the name before its action and topic.
    """

    connect: tuple[str, ...] = ()
    config_file: Path | None = None
    domain: int = 0
    machine: str | None = None
    rate_hz: float = 100.0
    controller: str = "joint_trajectory_controller"

    def namespace(self, machine: str) -> str:
        """Return where a machine's names are."""
        return "" if self.machine is not None else f"/{ros_name(machine)}"


async def serve_machine(session: RosSession, name: str, options: NodeOptions) -> None:
    """Be a machine's node until this is cancelled, or its server is gone or another start of it.

    Raises:
        MotionError: it does not answer.
    """
    machine = Machine.connect(name, options.connect or None, client="ros", config_file=options.config_file)
    async with machine as connected:
        info = connected.info
        model = await connected.model(deadline_s=MODEL_S)
        joints = joints_of(info, model)
        namespace = options.namespace(name)
        node = session.node(namespace, NODE_NAME)
        try:
            prefix = f"{namespace[1:]}/" if namespace else ""
            topics = StateTopics(node, info, model, joints, prefix, options.rate_hz)
            log.info("%s: %d joints in %s", name, len(joints), namespace or "/")
            async with asyncio.TaskGroup() as group:
                group.create_task(_publish_samples(connected, topics))
                group.create_task(_publish_status(connected, topics, info.instance))
        except* _AnotherStart:
            log.info("%s: its server was started again", name)
        finally:
            await node.close()


class _AnotherStart(Exception):
    """The server was started again, perhaps with another machine file."""


async def _publish_samples(machine: Machine, topics: StateTopics) -> None:
    async with machine.samples() as samples:
        async for each in samples:
            topics.publish_samples(each)


async def _publish_status(machine: Machine, topics: StateTopics, instance: str) -> None:
    async with machine.telemetry() as states:
        async for status in states:
            if status.instance != instance:
                raise _AnotherStart
            topics.publish_status(status)
