"""Goals of one machine: which axes they need, and who has them."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from typing import Any

from mcserver.ros.goals import Goal
from mcserver.ros.joints import Joint
from mcserver.ros.lane import Job, Lane, Surroundings, motion_from_here
from mcserver.ros.outcome import CANCELED, INVALID_GOAL, LEAVING, InvalidGoal, Outcome, Status
from mcserver.ros.stamps import seconds_of
from mcserver.ros.tolerances import read_tolerances
from mcserver.ros.trajectory import read_trajectory

log = logging.getLogger(__name__)

# that have no axes yet, or are on their way
MOST_GOALS = 32


class Follower:
    """Carries goals out; a goal takes its axes over from those that have any of them, as soon as it is sound.

    Args:
        joints: of the machine.
    """

    def __init__(self, around: Surroundings, joints: Sequence[Joint]) -> None:
        self._around = around
        self._known = {joint.name: joint for joint in joints}
        self._lanes: dict[Lane, asyncio.Task[Job | None]] = {}
        self._goals: dict[Goal, asyncio.Task[None]] = {}
        # one goal at a time decides about axes
        self._turn = asyncio.Lock()

    def start(self, goal: Goal) -> None:
        """Begin with a goal; it gets its outcome."""
        if len(self._goals) >= MOST_GOALS:
            goal.end(Outcome(Status.ABORTED, INVALID_GOAL, f"{MOST_GOALS} goals wait already"))
            return
        task = asyncio.ensure_future(self.begin(goal))
        self._goals[goal] = task
        task.add_done_callback(lambda _: self._goals.pop(goal, None))

    async def close(self) -> None:
        """End all goals; axes that move are stopped."""
        tasks = [*self._goals.values(), *self._lanes.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def begin(self, goal: Goal) -> None:
        """Bring a goal to where it is carried out, or refuse it."""
        try:
            job = await asyncio.to_thread(self._read, goal)
            async with self._turn:
                await self._place(job)
        except InvalidGoal as invalid:
            log.info("a goal is refused: %s", invalid)
            goal.end(invalid.outcome)
        except asyncio.CancelledError:
            goal.end(LEAVING)
            raise
        except Exception as error:
            log.exception("a goal failed")
            goal.end(Outcome(Status.ABORTED, INVALID_GOAL, f"{type(error).__name__}: {error}"))

    def _read(self, goal: Goal) -> Job:
        message: Any = goal.message
        trajectory = read_trajectory(message.trajectory, self._known)
        tolerances = read_tolerances(message, trajectory.joints)
        return Job(goal, trajectory, tolerances, seconds_of(message.trajectory.header.stamp))

    async def _place(self, job: Job) -> None:
        """Hand a job to the lane of its axes, or stop those in the way and open one."""
        axes = frozenset(job.trajectory.axes)
        for lane in self._lanes:
            if lane.axes == axes and lane.offer(job):
                return
        in_the_way = [lane for lane in self._lanes if lane.axes & axes]
        if in_the_way:
            # it is refused before others make way for it
            motion_from_here(self._around, job)
        for lane in in_the_way:
            lane.leave()
        if in_the_way:
            await asyncio.wait([self._lanes[lane] for lane in in_the_way])
        if job.goal.cancelled.is_set():
            job.goal.end(CANCELED)
            return
        lane = Lane(self._around, job)
        task = asyncio.ensure_future(lane.run())
        self._lanes[lane] = task
        task.add_done_callback(lambda ended: self._on_end(lane, ended))

    def _on_end(self, lane: Lane, ended: asyncio.Task[Job | None]) -> None:
        self._lanes.pop(lane, None)
        late = None if ended.cancelled() else ended.result()
        if late is not None:
            self.start(late.goal)
