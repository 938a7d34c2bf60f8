"""An action server: goals and their states, results, feedback and cancelling, as rcl_action has them.

An action is three services (``send_goal``, ``get_result``, ``cancel_goal``) and two topics (``feedback``,
``status``) below ``NAME/_action``.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from mcserver.ros.graph import Qos
from mcserver.ros.interfaces import interfaces
from mcserver.ros.node import Node
from mcserver.ros.outcome import Outcome, Status
from mcserver.ros.stamps import seconds_of, stamp_of

CANCEL = "action_msgs/srv/CancelGoal"
STATUSES = "action_msgs/msg/GoalStatusArray"
# of the answer to a cancel request
NONE, REJECTED, UNKNOWN_GOAL, TERMINATED = 0, 1, 2, 3
# Goals that have not ended, and results that are kept for who asks later; the oldest go first.
MAX_ACTIVE = 16
MAX_KEPT = 64

ZERO = bytes(16)


class Goal:
    """One goal.

    Attributes:
        message: of the action's goal, until it has ended. stamp_s: when it was accepted, Unix time [s].
        cancelled: is set once somebody has asked for its end.
        ended: its outcome, once there is one.
    """

    def __init__(self, goal_id: bytes, message: Any, stamp_s: float, changed: Callable[[], None]) -> None:
        self.id = goal_id
        self.message = message
        self.stamp_s = stamp_s
        self.status = Status.ACCEPTED
        self.cancelled = asyncio.Event()
        self.ended: asyncio.Future[Outcome] = asyncio.get_running_loop().create_future()
        self._changed = changed

    @property
    def active(self) -> bool:
        return not self.ended.done()

    def execute(self) -> None:
        """Say that it is carried out."""
        if self.status is Status.ACCEPTED:
            self._become(Status.EXECUTING)

    def cancel(self) -> None:
        """Ask for its end."""
        if self.active and not self.cancelled.is_set():
            self._become(Status.CANCELING)
            self.cancelled.set()

    def end(self, outcome: Outcome) -> None:
        """Say how it ended; what comes later does not count."""
        if not self.active:
            return
        if outcome.status is Status.CANCELED and self.status is not Status.CANCELING:
            # one that is preempted goes the way of one that is cancelled
            self._become(Status.CANCELING)
        elif self.status is Status.ACCEPTED:
            self._become(Status.EXECUTING)
        # a result is kept, 10 000 points are not
        self.message = None
        self.ended.set_result(outcome)
        self._become(outcome.status)

    def _become(self, status: Status) -> None:
        self.status = status
        self._changed()


class ActionServer:
    """Goals of one action; each that is accepted is given to ``start``.

    Args:
        kind: such as ``control_msgs/action/FollowJointTrajectory``.
        start: begins to carry a goal out, and ends it later.
    """

    def __init__(self, node: Node, name: str, kind: str, start: Callable[[Goal], None]) -> None:
        self._kind = kind
        self._start = start
        self._goals: dict[bytes, Goal] = {}
        self._statuses = node.publisher(
            f"{name}/_action/status", STATUSES, Qos(depth=1, transient_local=True)
        )
        self._feedback = node.publisher(f"{name}/_action/feedback", f"{kind}_FeedbackMessage")
        node.serve(f"{name}/_action/cancel_goal", CANCEL, self._cancel)
        node.serve(f"{name}/_action/get_result", f"{kind}_GetResult", self._result)
        node.serve(f"{name}/_action/send_goal", f"{kind}_SendGoal", self._send)
        self._publish_statuses()

    @property
    def active(self) -> tuple[Goal, ...]:
        return tuple(goal for goal in self._goals.values() if goal.active)

    def feed(self, goal: Goal, feedback: Any) -> None:
        """Publish a goal's feedback; of one that did not come here nothing is said."""
        if goal.id not in self._goals:
            return
        make = interfaces().make
        kind = f"{self._kind}_FeedbackMessage"
        self._feedback.publish(make(kind, goal_id=_uuid(goal.id), feedback=feedback))

    async def _send(self, request: Any) -> Any:
        make = interfaces().make
        goal_id = request.goal_id.uuid.tobytes()
        now = time.time()
        accepted = goal_id != ZERO and goal_id not in self._goals and len(self.active) < MAX_ACTIVE
        if accepted:
            goal = Goal(goal_id, request.goal, now, self._publish_statuses)
            self._goals[goal_id] = goal
            self._forget()
            self._publish_statuses()
            self._start(goal)
        return make(f"{self._kind}_SendGoal_Response", accepted=accepted, stamp=stamp_of(now))

    async def _result(self, request: Any) -> Any:
        goal = self._goals.get(request.goal_id.uuid.tobytes())
        outcome = Outcome(Status.UNKNOWN) if goal is None else await asyncio.shield(goal.ended)
        make = interfaces().make
        result = make(f"{self._kind}_Result", error_code=outcome.code, error_string=outcome.text)
        return make(f"{self._kind}_GetResult_Response", status=int(outcome.status), result=result)

    async def _cancel(self, request: Any) -> Any:
        goal_id, stamp = request.goal_info.goal_id.uuid.tobytes(), seconds_of(request.goal_info.stamp)
        known = self._goals.get(goal_id)
        chosen = [goal for goal in self._chosen(goal_id, stamp) if goal.active]
        for goal in chosen:
            goal.cancel()
        code = NONE
        if not chosen and goal_id != ZERO:
            code = UNKNOWN_GOAL if known is None else TERMINATED
        infos = [_info(goal) for goal in chosen]
        return interfaces().make(f"{CANCEL}_Response", return_code=code, goals_canceling=infos)

    def _chosen(self, goal_id: bytes, stamp: float) -> Iterable[Goal]:
        """Yield the goals that a request means: of no id and time all, of a time those accepted by then."""
        for goal in self._goals.values():
            if goal.id == goal_id or (stamp and goal.stamp_s <= stamp) or (goal_id == ZERO and not stamp):
                yield goal

    def _forget(self) -> None:
        ended = [goal.id for goal in self._goals.values() if not goal.active]
        for goal_id in ended[: max(0, len(ended) - MAX_KEPT)]:
            del self._goals[goal_id]

    def _publish_statuses(self) -> None:
        make = interfaces().make
        found = [
            make("action_msgs/msg/GoalStatus", goal_info=_info(goal), status=int(goal.status))
            for goal in self._goals.values()
        ]
        self._statuses.publish(make(STATUSES, status_list=found))


def _uuid(goal_id: bytes) -> Any:
    return interfaces().make("unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(goal_id, np.uint8))


def _info(goal: Goal) -> Any:
    info = "action_msgs/msg/GoalInfo"
    return interfaces().make(info, goal_id=_uuid(goal.id), stamp=stamp_of(goal.stamp_s))
