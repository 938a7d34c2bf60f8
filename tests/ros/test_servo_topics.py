"""Commands of servo mode: how they are meant, whose count, and what does not."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcclient.types import ToolInfo

from mcserver.ros.interfaces import interfaces
from mcserver.ros.joints import Joint
from mcserver.ros.lane import Surroundings
from mcserver.ros.node import Node
from mcserver.ros.servo_options import CommandType, ServoOptions, read_bounds
from mcserver.ros.servo_topics import RELEASE_S, ServoTopics
from mcserver.ros.velocity_commands import JOG, TWIST, CommandReader, UnfitCommand
from tests.clock import Clock
from tests.ros.wire import jog, twist

JOINTS = (
    Joint("turn", 0, True, math.radians(1.0), -2.0, 2.0, 3.0, 1e-4),
    Joint("lift", 4, False, 1e-3, -math.inf, math.inf, 1.0, 1e-5),
)
TOOLS = (
    ToolInfo(1, "flange", (0, 4), True, "ZYX"),
    ToolInfo(2, "foot", (0, 4), False, "ZYX"),
)
SPEED = ServoOptions(command_in_type=CommandType.SPEED_UNITS)


def reader(options: ServoOptions = SPEED) -> CommandReader:
    return CommandReader(options, JOINTS, TOOLS, {1: "cell/base", 2: "cell/table"}, "cell/")


def test_twists_are_of_the_tool_or_the_base_in_units_of_the_wire() -> None:
    own = reader().twist(twist("cell/tool_2", (0.1, 0.0, -0.2)))
    assert (own.tool, own.frame, own.axes) == (2, "tool", (0, 4))
    assert own.velocities.tolist() == pytest.approx([100.0, 0.0, -200.0])
    base = reader().twist(twist("cell/base", (0.0, 0.0, 0.0), (0.0, 0.0, math.pi)))
    assert (base.tool, base.frame, base.rests) == (1, "base", False)
    assert base.velocities.tolist() == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 180.0])
    chosen = CommandReader(
        ServoOptions(tool=2), JOINTS, TOOLS, {1: "cell/base", 2: "cell/table"}, "cell/"
    ).twist(twist("cell/table", (1.0, 0.0, 0.0)))
    assert (chosen.tool, chosen.velocities.tolist()) == (2, pytest.approx([400.0, 0.0, 0.0]))


def test_joints_are_led_by_name_and_the_others_of_the_program_stand() -> None:
    command = reader().jog(jog(["lift", "turn"], [0.25, math.pi]))
    assert command.row([0, 3, 4]).tolist() == pytest.approx([180.0, 0.0, 250.0])
    with pytest.raises(UnfitCommand, match="axis 4 is led by another"):
        command.row([0])


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("cell/tool_1, cell/tool_2, cell/base", twist("", (0.1, 0.0, 0.0))),
        ("frame_id", twist("tool_1", (0.1, 0.0, 0.0))),
        ("not all finite", twist("cell/base", (math.nan, 0.0, 0.0))),
        ("beyond 1", twist("cell/base", (1.01, 0.0, 0.0))),
        ("no orientation", twist("cell/tool_2", (0.0, 0.0, 0.0), (0.1, 0.0, 0.0))),
        ("no joint 'elbow'", jog(["elbow"], [0.1])),
        ("named twice", jog(["turn", "turn"], [0.1, 0.1])),
        ("1 velocities of 2 joints", jog(["turn", "lift"], [0.1])),
        ("displacements", jog(["turn"], [], [0.1])),
    ],
)
def test_what_cannot_be_meant_is_refused_with_its_reason(said: str, message: Any) -> None:
    unitless = reader(ServoOptions())
    with pytest.raises(UnfitCommand, match=said):
        (unitless.twist if hasattr(message, "twist") else unitless.jog)(message)


class Topics:
    """Topics on a clock of the test, without a machine: what is taken is not sent anywhere."""

    def __init__(self, options: ServoOptions = SPEED) -> None:
        self.clock = Clock()
        self.deliver: dict[str, Callable[[bytes, bytes], None]] = {}
        node = SimpleNamespace(subscribe=lambda name, _kind, take: self.deliver.update({name: take}))
        around = cast("Surroundings", SimpleNamespace())
        self.topics = ServoTopics(cast("Node", node), around, reader(), options, JOINTS, self.clock)

    def send(self, message: Any, sender: bytes = b"stick") -> str:
        """Return what is said right behind it, beside the counts."""
        kind = JOG if hasattr(message, "joint_names") else TWIST
        topic = "delta_joint_cmds" if kind is JOG else "delta_twist_cmds"
        self.deliver[f"servo_node/{topic}"](interfaces().encode(kind, message), sender)
        return str(self.said().why)

    def said(self) -> Any:
        return self.topics.said(cast("Any", SimpleNamespace(programs=())))


def test_a_stick_that_is_pushed_as_the_bridge_begins_moves_nothing_until_it_was_let_go() -> None:
    topics = Topics()
    for _ in range(20):
        assert "MC193" in topics.send(jog(["turn"], [0.1]))
        topics.clock.now += 0.1
    for _ in range(6):
        topics.send(jog(["turn"], [0.0]))
        topics.clock.now += 0.1
    topics.send(jog(["turn"], [0.1]))
    assert topics.said().values == {"commands": 1, "dropped": 20}


def test_one_publisher_is_followed_and_one_that_rests_takes_nothing_over() -> None:
    topics = Topics()
    topics.clock.now += RELEASE_S
    assert topics.send(jog(["turn"], [0.0]), b"idle") == ""
    assert topics.send(twist("cell/base", (0.1, 0.0, 0.0)), b"policy") == ""
    assert "MC192" in topics.send(jog(["turn"], [0.1]), b"stick")
    assert topics.said().values == {"commands": 1, "dropped": 1}


def test_old_commands_and_those_of_a_clock_ahead_do_not_count() -> None:
    topics = Topics()
    topics.clock.now += RELEASE_S
    now = time.time()
    assert "s old" in topics.send(twist("cell/base", (0.1, 0.0, 0.0), stamp_s=now - 9.0))
    assert "s ahead" in topics.send(twist("cell/base", (0.1, 0.0, 0.0), stamp_s=now + 9.0))
    topics.clock.now += 10.0
    assert topics.said().why == ""


def test_bounds_are_read_and_go_to_the_server_in_units_of_the_wire() -> None:
    within = dict(map(read_bounds, ["turn=-0.5:0.25", "lift=0:1e-1", "elsewhere=1:2"]))
    topics = Topics(ServoOptions(within=within)).topics
    assert topics._within[0] == pytest.approx((math.degrees(-0.5), math.degrees(0.25)))
    assert topics._within[4] == pytest.approx((0.0, 100.0))
    assert sorted(topics._within) == [0, 4]
    for wrong in ("turn", "turn=1", "turn=1:1", "turn=nan:1", "=0:1", "turn=-inf:1"):
        with pytest.raises(ValueError, match=r"turn|=0:1|convert"):
            read_bounds(wrong)


@given(st.binary(max_size=300), st.integers(0, 200), st.integers(0, 255))
def test_no_payload_gets_through_that_asks_for_no_number(noise: bytes, at: int, byte: int) -> None:
    topics = Topics()
    topics.clock.now += RELEASE_S
    changed = bytearray(interfaces().encode(JOG, jog(["turn", "lift"], [0.1, 0.2])))
    changed[at % len(changed)] = byte
    for payload in (noise, bytes(changed)):
        for deliver in topics.deliver.values():
            deliver(payload, b"")
    newest = topics.topics._newest
    assert newest is None or np.isfinite(newest.velocities).all()
