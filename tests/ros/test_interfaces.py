"""Types of ROS 2: hashes as published, payloads, and what is no payload."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import pytest

from mcserver.ros.definitions import SERVICES
from mcserver.ros.interfaces import Interfaces, MalformedPayload, interfaces
from tests.ros.goal_payloads import ROS_GOAL, ros_goal_payload

ROOT = Path(__file__).parents[2]


# As in the sources that the interface generators of ROS 2 Jazzy and Kilted have made.
@pytest.mark.parametrize(
    ("name", "digest"),
    [
        ("std_msgs/msg/String", "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        ("sensor_msgs/msg/JointState", "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"),
        ("builtin_interfaces/msg/Time", "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197"),
        ("action_msgs/srv/CancelGoal", "573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a"),
    ],
)
def test_a_type_has_the_hash_that_others_know_it_by(name: str, digest: str) -> None:
    assert interfaces().type_hash(name) == f"RIHS01_{digest}"


@pytest.mark.parametrize(
    ("part", "digest"),
    [
        ("SendGoal", "d1a57fb2a4afe8c21e34fb10db206f16ce6729b28531141472df92277c55b557"),
        ("GetResult", "1b0de0d5d29dc955d92f546706568428632771db13ec84c15ec1c1a59f424a57"),
        ("FeedbackMessage", "c1de71afd52e49a89c53d8262366884185bc0a02f78ce051c4e46b0a7fe59bb2"),
    ],
)
def test_what_an_action_is_made_of_has_the_hashes_of_the_generators(part: str, digest: str) -> None:
    fibonacci = "example_interfaces/action/Fibonacci"
    actions = {fibonacci: ("int32 order", "int32[] sequence", "int32[] sequence")}
    assert Interfaces(actions=actions).type_hash(f"{fibonacci}_{part}") == f"RIHS01_{digest}"


def test_what_was_encoded_is_read_again() -> None:
    goal = interfaces().decode(ROS_GOAL, ros_goal_payload()).goal
    assert goal.trajectory.joint_names == ["a", "bcd"]
    assert goal.trajectory.points[1].positions.tolist() == [0.6, 0.1]
    assert (goal.path_tolerance[0].name, goal.path_tolerance[0].position) == ("a", 0.1)


def test_a_request_without_fields_has_one_byte() -> None:
    types = Interfaces(services={"std_srvs/srv/Trigger": ("", "bool success\nstring message")})
    request = "std_srvs/srv/Trigger_Request"
    assert types.encode(request, types.make(request)) == b"\0\1\0\0\0"


def test_every_truncation_is_refused() -> None:
    payload = ros_goal_payload()
    for length in range(len(payload) - 3):
        with pytest.raises(MalformedPayload):
            interfaces().decode(ROS_GOAL, payload[:length])


@pytest.mark.parametrize("count", [2**31 - 1, 2**31, 2**32 - 1, 10**6])
def test_lengths_beyond_the_payload_end_as_a_refusal(count: int) -> None:
    payload = ros_goal_payload()
    for at in range(4, len(payload) - 3, 4):
        changed = payload[:at] + struct.pack("<I", count) + payload[at + 4 :]
        try:
            interfaces().decode(ROS_GOAL, changed)
        except MalformedPayload:
            continue
        # a number that is no length: read as such


def test_the_package_of_services_says_what_is_spoken() -> None:
    text = (ROOT / "deploy" / "ros" / "mcserver_msgs" / "srv" / "RunProgram.srv").read_text("utf-8")
    parts = re.sub(r"\s*#.*", "", text).strip().split("---")
    written = [[" ".join(line.split()) for line in part.strip().splitlines()] for part in parts]
    assert written == [part.splitlines() for part in SERVICES["mcserver_msgs/srv/RunProgram"]]
