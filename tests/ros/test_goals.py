"""Goals of an action: their states, and which of them a request to cancel means."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest

from mcserver.ros.goals import MAX_ACTIVE, MAX_KEPT, ActionServer, Goal
from mcserver.ros.interfaces import interfaces
from mcserver.ros.outcome import CANCELED, PREEMPTED, Outcome, Status
from mcserver.ros.stamps import stamp_of
from tests.ros.wire import FOLLOW

DONE = Outcome(Status.SUCCEEDED)


class Network:
    """A node whose services are called here, and whose messages are kept."""

    def __init__(self) -> None:
        self.answers: dict[str, Callable[[Any], Awaitable[Any]]] = {}
        self.published: list[Any] = []

    def publisher(self, *_: object) -> Network:
        return self

    def publish(self, message: Any) -> None:
        self.published.append(message)

    def serve(self, service: str, _: str, answer: Callable[[Any], Awaitable[Any]]) -> None:
        self.answers[service.rpartition("/")[2]] = answer


class Action:
    """A server and the goals that it has begun."""

    def __init__(self) -> None:
        self.network = Network()
        self.begun: list[Goal] = []
        self.server = ActionServer(self.network, "c/follow", FOLLOW, self.begun.append)  # type: ignore[arg-type]

    async def send(self, number: int) -> bool:
        request = interfaces().make(f"{FOLLOW}_SendGoal_Request", goal_id=uuid(number))
        return bool((await self.network.answers["send_goal"](request)).accepted)

    async def cancel(self, number: int = 0, stamp_s: float = 0.0) -> tuple[int, list[int]]:
        make = interfaces().make
        info = make("action_msgs/msg/GoalInfo", goal_id=uuid(number), stamp=stamp_of(stamp_s))
        reply = await self.network.answers["cancel_goal"](
            make("action_msgs/srv/CancelGoal_Request", goal_info=info)
        )
        return reply.return_code, [int(each.goal_id.uuid[0]) for each in reply.goals_canceling]

    async def result(self, number: int) -> Any:
        request = interfaces().make(f"{FOLLOW}_GetResult_Request", goal_id=uuid(number))
        return await self.network.answers["get_result"](request)


def uuid(number: int) -> Any:
    value = np.zeros(16, np.uint8)
    value[0], value[1] = number % 256, number // 256
    return interfaces().make("unique_identifier_msgs/msg/UUID", uuid=value)


@pytest.fixture
async def action() -> Action:
    return Action()


async def test_a_goal_goes_from_accepted_to_its_end_and_its_result_is_kept(action: Action) -> None:
    assert await action.send(1)
    goal = action.begun[0]
    goal.execute()
    goal.end(DONE)
    goal.end(CANCELED)
    seen = [status.status for message in action.network.published for status in message.status_list]
    assert seen == [Status.ACCEPTED, Status.EXECUTING, Status.SUCCEEDED]
    assert (await action.result(1)).status == Status.SUCCEEDED
    assert (await action.result(2)).status == Status.UNKNOWN


async def test_one_that_is_preempted_goes_the_way_of_one_that_is_cancelled(action: Action) -> None:
    await action.send(1)
    action.begun[0].execute()
    action.begun[0].end(PREEMPTED)
    seen = [status.status for message in action.network.published for status in message.status_list]
    assert seen[-2:] == [Status.CANCELING, Status.CANCELED]


async def test_an_id_is_taken_once_and_none_is_no_id(action: Action) -> None:
    assert await action.send(1)
    assert not await action.send(1)
    assert not await action.send(0)


async def test_goals_and_results_are_bounded(action: Action) -> None:
    assert all([await action.send(number + 1) for number in range(MAX_ACTIVE)])
    assert not await action.send(1000)
    for number in range(2 * MAX_KEPT):
        for goal in action.server.active:
            goal.end(DONE)
        assert await action.send(2000 + number)
    assert (await action.result(1)).status == Status.UNKNOWN
    assert len(action.network.published[-1].status_list) <= MAX_KEPT + 1


async def test_a_request_to_cancel_means_goals_by_id_and_by_time(action: Action) -> None:
    for number in (1, 2, 3):
        await action.send(number)
    first, second, third = action.begun
    first.stamp_s, second.stamp_s, third.stamp_s = 10.0, 20.0, 30.0
    assert await action.cancel(9) == (2, [])
    assert await action.cancel(0, 20.0) == (0, [1, 2])
    assert [goal.cancelled.is_set() for goal in action.begun] == [True, True, False]
    first.end(CANCELED)
    assert await action.cancel(1) == (3, [])
    assert await action.cancel(3, 5.0) == (0, [3])
    third.end(CANCELED)
    assert await action.cancel() == (0, [2])
