"""Goals of FollowJointTrajectory at a real server: how each of them ends, and what the axes have done."""

from __future__ import annotations

import asyncio
import math
import signal
import struct
import subprocess
from collections.abc import AsyncIterator, Iterator

import numpy as np
import pytest
from mcclient import Machine

from mcserver.ros.interfaces import interfaces
from mcserver.ros.outcome import (
    GOAL_TOLERANCE_VIOLATED,
    INVALID_GOAL,
    INVALID_JOINTS,
    PATH_TOLERANCE_VIOLATED,
    SUCCESSFUL,
    Status,
)
from tests.e2e.conftest import served
from tests.e2e.ros_bridge import DOMAIN, JOINTS, start_bridge
from tests.e2e.servers import ServerProcess
from tests.ros.wire import FOLLOW, FollowClient, WirePeer, trajectory

ACTION = "joint_trajectory_controller/follow_joint_trajectory"
RUN = "mcserver_msgs/srv/RunProgram"
HOME = (0.0, 0.0, 0.0, 0.0, math.pi / 2, 0.0)


class Cell:
    """A server, its bridge, and who looks at both."""

    def __init__(self, server: ServerProcess) -> None:
        self.server = server
        self.bridge = self.start_bridge()

    def start_bridge(self) -> subprocess.Popen[bytes]:
        return start_bridge(self.server.endpoint, "--machine", self.server.name)

    def kill_bridge(self) -> None:
        self.bridge.kill()
        self.bridge.wait(30.0)


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    for server in served(tmp_path_factory.mktemp("goals"), "arm6", "arm"):
        made = Cell(server)
        yield made
        made.bridge.send_signal(signal.SIGTERM)
        assert made.bridge.wait(30.0) == 0


@pytest.fixture
async def peer(cell: Cell) -> AsyncIterator[WirePeer]:
    async with WirePeer(cell.server.endpoint, DOMAIN) as made:
        await made.token("/SS/", "%send_goal/")
        yield made


@pytest.fixture
async def client(peer: WirePeer) -> FollowClient:
    """A client of the action; the joints are brought home first."""
    made = FollowClient(peer, ACTION)
    goal, _ = await made.send(trajectory(JOINTS, (0.8, HOME)))
    await ends(made, goal, Status.SUCCEEDED, SUCCESSFUL)
    return made


@pytest.fixture
async def machine(cell: Cell) -> AsyncIterator[Machine]:
    async with Machine.connect(cell.server.name, cell.server.endpoint) as made:
        yield made


async def ends(client: FollowClient, goal: object, status: Status, code: int, said: str = "") -> None:
    ended = await client.result(goal)
    assert (ended.status, ended.result.error_code) == (status, code), ended.result.error_string
    assert said in ended.result.error_string


async def moving(
    client: FollowClient, joint: str = "joint_1", to: float = 1.0, takes_s: float = 4.0
) -> object:
    """A goal that is on its way."""
    feedback = client.feedback()
    goal, accepted = await client.send(trajectory([joint], (takes_s, [to])))
    assert accepted
    while not (await feedback.next()).feedback.actual.velocities[0] > 0.02:
        pass
    return goal


async def positions(peer: WirePeer) -> list[float]:
    found: list[float] = (
        await peer.hear("joint_states", "sensor_msgs/msg/JointState").next()
    ).position.tolist()
    return found


async def test_a_goal_is_accepted_carried_out_and_reached(client: FollowClient, peer: WirePeer) -> None:
    statuses, feedback = client.statuses(), client.feedback()
    goal, accepted = await client.send(trajectory(JOINTS, (0.4, [0.1, *HOME[1:]]), (0.8, [0.2, *HOME[1:]])))
    assert accepted
    await ends(client, goal, Status.SUCCEEDED, SUCCESSFUL)
    assert (await positions(peer))[0] == pytest.approx(0.2, abs=2e-3)
    said = (await feedback.next()).feedback
    assert said.joint_names == JOINTS
    assert np.abs(said.error.positions).max() < 0.02
    seen = []
    while seen[-1:] != [Status.SUCCEEDED]:
        status = (await statuses.next()).status_list
        mine = [each.status for each in status if (each.goal_info.goal_id.uuid == goal.uuid).all()]
        seen += [each for each in mine if seen[-1:] != [each]]
    assert seen[-2:] == [Status.EXECUTING, Status.SUCCEEDED]


async def test_a_goal_that_is_cancelled_stops_where_it_is(client: FollowClient, peer: WirePeer) -> None:
    goal = await moving(client)
    reply = await client.cancel(goal)
    assert (reply.return_code, len(reply.goals_canceling)) == (0, 1)
    await ends(client, goal, Status.CANCELED, SUCCESSFUL)
    assert 0.0 < (await positions(peer))[0] < 0.9
    assert (await client.cancel(goal)).return_code == 3


async def test_a_newer_goal_takes_over_and_the_older_one_says_so(
    client: FollowClient, peer: WirePeer
) -> None:
    older = await moving(client)
    newer, _ = await client.send(trajectory(["joint_1"], (1.5, [-0.1])))
    await ends(client, older, Status.CANCELED, INVALID_GOAL, "new incoming action")
    await ends(client, newer, Status.SUCCEEDED, SUCCESSFUL)
    assert (await positions(peer))[0] == pytest.approx(-0.1, abs=2e-3)


async def test_a_goal_of_other_joints_too_stops_those_in_its_way(client: FollowClient) -> None:
    older = await moving(client)
    newer, _ = await client.send(trajectory(JOINTS, (2.0, HOME)))
    await ends(client, older, Status.CANCELED, INVALID_GOAL)
    await ends(client, newer, Status.SUCCEEDED, SUCCESSFUL)


async def test_goals_of_different_joints_run_side_by_side(client: FollowClient) -> None:
    goals = [(await client.send(trajectory([name], (0.8, [0.1]))))[0] for name in JOINTS[:2]]
    for goal in goals:
        await ends(client, goal, Status.SUCCEEDED, SUCCESSFUL)


async def test_an_unsound_goal_stops_nobody(client: FollowClient) -> None:
    sound = await moving(client, to=0.3, takes_s=1.5)
    wrong, _ = await client.send(trajectory(["joint_7"], (1.0, [0.0])))
    await ends(client, wrong, Status.ABORTED, INVALID_JOINTS, "joint_7")
    quick, _ = await client.send(trajectory(["joint_1"], (0.01, [2.0])))
    await ends(client, quick, Status.ABORTED, INVALID_GOAL, "it can go at")
    await ends(client, sound, Status.SUCCEEDED, SUCCESSFUL)


async def test_a_path_tolerance_that_is_not_kept_ends_the_goal(client: FollowClient) -> None:
    tolerance = interfaces().make("control_msgs/msg/JointTolerance", name="joint_1", position=1e-12)
    goal, _ = await client.send(trajectory(["joint_1"], (1.0, [0.4])), path_tolerance=[tolerance])
    await ends(client, goal, Status.ABORTED, PATH_TOLERANCE_VIOLATED, "joint_1 is at")


async def test_a_goal_tolerance_that_is_not_kept_in_time_ends_the_goal(client: FollowClient) -> None:
    make = interfaces().make
    tolerance = make("control_msgs/msg/JointTolerance", name="joint_1", position=1e-15)
    settle = make("builtin_interfaces/msg/Duration", nanosec=200_000_000)
    moved = trajectory(["joint_1"], (0.6, [0.123456]))
    goal, _ = await client.send(moved, goal_tolerance=[tolerance], goal_time_tolerance=settle)
    await ends(client, goal, Status.ABORTED, GOAL_TOLERANCE_VIOLATED, "0.2 s behind the end")


async def test_a_hold_stops_the_way_and_a_resume_goes_on_with_it(
    client: FollowClient, machine: Machine
) -> None:
    goal = await moving(client, to=0.4, takes_s=2.0)
    await machine.hold()
    waiting = asyncio.ensure_future(client.result(goal))
    # longer than the rest of the way
    done, _ = await asyncio.wait([waiting], timeout=3.0)
    assert not done
    await machine.resume()
    assert (await waiting).status == Status.SUCCEEDED


async def test_an_override_stretches_the_way(client: FollowClient, machine: Machine) -> None:
    feedback = client.feedback()
    await machine.override(50.0)
    try:
        goal, _ = await client.send(trajectory(["joint_1"], (0.6, [0.1])))
        await ends(client, goal, Status.SUCCEEDED, SUCCESSFUL)
    finally:
        await machine.override(100.0)
    # at twice the time, as many again
    assert feedback.queue.qsize() > 17


async def test_an_emergency_stop_ends_the_goal_with_its_code(client: FollowClient, machine: Machine) -> None:
    goal = await moving(client)
    await machine.estop("a test")
    await ends(client, goal, Status.ABORTED, INVALID_GOAL, "MC400: emergency stop: a test")
    refused, _ = await client.send(trajectory(["joint_1"], (1.0, [0.0])))
    await ends(client, refused, Status.ABORTED, INVALID_GOAL, "MC509")
    await machine.reset()


async def test_an_abort_ends_the_goal_and_says_whose_it_was(client: FollowClient, machine: Machine) -> None:
    goal = await moving(client)
    await machine.abort()
    await ends(client, goal, Status.ABORTED, INVALID_GOAL, f"MC535: aborted by {machine.client}")


async def test_axes_that_a_program_has_are_refused_and_idle_ones_are_nobodys(
    client: FollowClient, machine: Machine
) -> None:
    async with machine.program(axes=[0]):
        goal, _ = await client.send(trajectory(["joint_1"], (1.0, [0.0])))
        await ends(client, goal, Status.ABORTED, INVALID_GOAL, "MC512")
    assert not [each for each in await machine.programs() if each.state == "running"]


async def test_a_trajectory_of_the_topic_is_followed(client: FollowClient, peer: WirePeer) -> None:  # noqa: ARG001
    kind = "trajectory_msgs/msg/JointTrajectory"
    heard = peer.hear("joint_states", "sensor_msgs/msg/JointState")
    peer.put("joint_trajectory_controller/joint_trajectory", kind, trajectory(["joint_2"], (0.5, [0.2])))
    while abs((await heard.next()).position[1] - 0.2) > 2e-3:
        pass


async def test_a_program_runs_and_says_how_it_ended(client: FollowClient, peer: WirePeer) -> None:  # noqa: ARG001
    make = interfaces().make
    reply = await peer.call("run_program", RUN, make(f"{RUN}_Request", text="G1010 P0\nG00 [0]5\nG00 [0]0\n"))
    assert reply.success, reply.message
    reply = await peer.call("run_program", RUN, make(f"{RUN}_Request", text="G1010 P0\nG77\n"))
    assert (reply.success, reply.code[:2]) == (False, "MC")
    assert "line 2" in reply.message


async def test_requests_that_are_none_get_an_error(client: FollowClient, peer: WirePeer) -> None:
    make = interfaces().make
    kind = f"{FOLLOW}_SendGoal"
    goal = make(f"{FOLLOW}_Goal", trajectory=trajectory(JOINTS, (1.0, HOME)))
    payload = interfaces().encode(f"{kind}_Request", make(f"{kind}_Request", goal=goal))
    cut = [payload[:length] for length in range(0, len(payload) - 4, 41)]
    grown = [payload[:at] + struct.pack("<I", 2**32 - 1) + payload[at + 4 :] for at in (28, 36, 40)]
    for wrong in [*cut, *grown, b"", bytes(500)]:
        assert await peer.call(f"{ACTION}/_action/send_goal", kind, wrong) is None
    # no id: a request, but none that is accepted
    assert not (await peer.call(f"{ACTION}/_action/send_goal", kind, payload)).accepted
    assert (await client.result(make("unique_identifier_msgs/msg/UUID"))).status == Status.UNKNOWN


async def test_a_bridge_that_stands_still_is_late_and_the_axes_have_stopped(
    cell: Cell, client: FollowClient, machine: Machine
) -> None:
    goal = await moving(client, takes_s=6.0)
    cell.bridge.send_signal(signal.SIGSTOP)
    try:
        async with asyncio.timeout(10.0):
            while any(each.state == "running" for each in await machine.programs()):
                await asyncio.sleep(0.05)
        assert 0.0 < (await machine.status()).axes.position[0] < math.degrees(0.9)
    finally:
        cell.bridge.send_signal(signal.SIGCONT)
    await ends(client, goal, Status.ABORTED, INVALID_GOAL, "MC465")


async def test_a_bridge_that_is_killed_leaves_axes_that_stop_and_are_free(
    cell: Cell, client: FollowClient, peer: WirePeer, machine: Machine
) -> None:
    await moving(client, takes_s=6.0)
    cell.kill_bridge()
    async with asyncio.timeout(10.0):
        while (await machine.status()).programs and any(
            each.state in ("running", "ending") for each in await machine.programs()
        ):
            await asyncio.sleep(0.05)
    before = (await machine.status()).axes.position[0]
    await asyncio.sleep(0.3)
    after = (await machine.status()).axes.position[0]
    assert 0.0 < before < math.degrees(0.5)
    assert after == pytest.approx(before, abs=0.01)
    await peer.token("%send_goal/", there=False)
    cell.bridge = cell.start_bridge()
    await peer.token("%send_goal/")


async def test_a_server_that_is_killed_comes_back_as_a_node(cell: Cell, client: FollowClient) -> None:
    await moving(client, takes_s=6.0)
    cell.server.end(signal.SIGKILL)
    cell.server.start()
    async with WirePeer(cell.server.endpoint, DOMAIN) as another:
        await another.token("/SS/", "%send_goal/")
        anew = FollowClient(another, ACTION)
        goal, _ = await anew.send(trajectory(JOINTS, (3.0, HOME)))
        await ends(anew, goal, Status.SUCCEEDED, SUCCESSFUL)
