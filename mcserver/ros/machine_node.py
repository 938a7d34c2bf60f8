"""A machine as a node of ROS 2, as long as its server is there."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from mcclient import Machine
from mcclient.types import MachineStatus

from mcserver.ros.axis_states import AxisStates
from mcserver.ros.follower import Follower
from mcserver.ros.frames import Frames
from mcserver.ros.goals import ActionServer, Goal
from mcserver.ros.graph import ros_name
from mcserver.ros.joints import Joint, joints_of
from mcserver.ros.lane import Surroundings
from mcserver.ros.node import Node, RosSession
from mcserver.ros.program_service import ProgramService
from mcserver.ros.servo_options import DEFAULTS, ServoOptions
from mcserver.ros.servo_topics import ServoTopics
from mcserver.ros.state_topics import StateTopics
from mcserver.ros.trajectory_topic import FOLLOW, TrajectoryTopic
from mcserver.ros.velocity_commands import CommandReader
from mcserver.view.urdf import read_tree

NODE_NAME = "mcserver"
REASONS_KEPT = 64
MODEL_S = 30.0


class NodeOptions(msgspec.Struct, frozen=True):
    """How machines are shown.

    Attributes:
        connect: Zenoh endpoints of the machines; empty: this computer. config_file: a Zenoh configuration for
            TLS, of these alone.
        ros_connect: Zenoh endpoints of the nodes of ROS; empty: those of the machines.
        machine: the only one, whose names stand in the root; None: all, each in a namespace of its name.
        rate_hz: of ``joint_states``. controller: the name before its action and topic. servo: how commands of
            servo mode are meant.
    """

    connect: tuple[str, ...] = ()
    config_file: Path | None = None
    ros_connect: tuple[str, ...] = ()
    domain: int = 0
    machine: str | None = None
    rate_hz: float = 100.0
    controller: str = "joint_trajectory_controller"
    servo: ServoOptions = DEFAULTS

    def namespace(self, machine: str) -> str:
        """Return where a machine's names are."""
        return "" if self.machine is not None else f"/{ros_name(machine)}"


async def serve_machine(
    session: RosSession, name: str, options: NodeOptions, say: Callable[[str], None]
) -> None:
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
            frames = Frames(read_tree(model.urdf), info.tools, prefix) if model.urdf else None
            topics = StateTopics(node, info, model, joints, frames, options.rate_hz)
            view = _View(connected, topics, AxisStates(joints, time.monotonic))
            bases = {} if frames is None else {tool.number: frames.base(tool.number) for tool in info.tools}
            reader = CommandReader(options.servo, joints, info.tools, bases, prefix)
            follower, servo = _serve_motion(node, connected, joints, view, reader, options)
            topic = TrajectoryTopic(node, f"{options.controller}/joint_trajectory", follower)
            ProgramService(node, connected)
            say(f"{name}: {len(joints)} joints in {namespace or '/'}")
            try:
                async with asyncio.TaskGroup() as group:
                    group.create_task(view.watch_samples())
                    group.create_task(view.watch_status(servo))
                    group.create_task(view.watch_ends())
                    group.create_task(topic.run())
                    group.create_task(servo.run())
            finally:
                await follower.close()
        except* _AnotherStart:
            say(f"{name}: its server was started again")
        finally:
            await node.close()


def _serve_motion(
    node: Node,
    machine: Machine,
    joints: tuple[Joint, ...],
    view: _View,
    reader: CommandReader,
    options: NodeOptions,
) -> tuple[Follower, ServoTopics]:
    """Serve what moves the machine: the action of a trajectory controller, and servo mode's topics."""

    def feed(goal: Goal, feedback: Any) -> None:
        action.feed(goal, feedback)

    around = Surroundings(machine, view.states, lambda: view.status, feed, view.reasons)
    follower = Follower(around, joints)
    action = ActionServer(node, f"{options.controller}/follow_joint_trajectory", FOLLOW, follower.start)
    return follower, ServoTopics(node, around, reader, options.servo, joints)


class _View:
    """What a machine tells, and where it goes."""

    def __init__(self, machine: Machine, topics: StateTopics, states: AxisStates) -> None:
        self._machine = machine
        self._topics = topics
        self.states = states
        self.status: MachineStatus | None = None
        self.reasons: dict[str, str] = {}

    async def watch_samples(self) -> None:
        async with self._machine.samples() as samples:
            async for each in samples:
                self.states.take(each)
                self._topics.publish_samples(each)

    async def watch_ends(self) -> None:
        async with self._machine.events() as events:
            async for event in events:
                if event.kind == "program.ended" and event.program and event.reason:
                    self.reasons[event.program] = event.reason
                    while len(self.reasons) > REASONS_KEPT:
                        del self.reasons[next(iter(self.reasons))]

    async def watch_status(self, servo: ServoTopics) -> None:
        instance = self._machine.info.instance
        async with self._machine.telemetry() as states:
            async for status in states:
                if status.instance != instance:
                    raise _AnotherStart
                self.status = status
                self._topics.publish_status(status, servo.said)


class _AnotherStart(Exception):
    """The server was started again, perhaps with another machine file."""
