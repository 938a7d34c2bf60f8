"""A trajectory on its way: axes of one servo mode, led along it chunk by chunk.

Each chunk reaches a second ahead and replaces the one before: this process, the network and the server may be
late by that, and the axes go on along a way that is known anyway. Where no more come (this process dies, the
network is cut), the server stops the axes on their limits: they are never led further than the last chunk.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from mcclient import Machine, MotionError, NobodyAnswers, RequestRefused
from mcclient.servo import Servo
from mcclient.types import ENDED, AxisState, MachineStatus
from numpy.typing import NDArray

from mcserver.ros.axis_states import AxisStates
from mcserver.ros.goals import Goal
from mcserver.ros.interfaces import interfaces
from mcserver.ros.joints import units_of
from mcserver.ros.outcome import (
    CANCELED,
    GOAL_TOLERANCE_VIOLATED,
    INVALID_GOAL,
    LEAVING,
    OLD_HEADER_TIMESTAMP,
    PATH_TOLERANCE_VIOLATED,
    PREEMPTED,
    InvalidGoal,
    Outcome,
    Status,
    ended_by,
)
from mcserver.ros.pace import place_of, rate_of
from mcserver.ros.stamps import duration_of, stamp_of
from mcserver.ros.tolerances import Tolerances
from mcserver.ros.trajectory import Motion, Trajectory

log = logging.getLogger(__name__)

Array = NDArray[np.float64]
Feed = Callable[[Goal, Any], None]

# A chunk is sent so often, has points so far apart, and reaches so far [s].
TICK_S, STEP_S, REACH_S = 0.025, 0.02, 1.0
# behind its last point
COUNTS_S = 0.1
FEEDBACK_TICKS = 2
# how long drives may take until they are energized
ENERGIZE_S = 30.0
# Codes of a contact, and what is judged for it.
CONTACTS = frozenset({"MC320", "MC321", "MC322"})
IN_BOUNDS = (
    "judged are all places between the least and the greatest position of each joint on its way: "
    "send it in parts, each to rest, or send a program"
)
# How far ahead a trajectory may be asked to begin [s].
LONGEST_WAIT_S = 60.0
ENERGIZED = frozenset({AxisState.STANDSTILL, AxisState.MOVING})


class Job(NamedTuple):
    """A goal that was found to be one; ``stamp_s``: Unix time at which it begins, 0: now."""

    goal: Goal
    trajectory: Trajectory
    tolerances: Tolerances
    stamp_s: float


class Surroundings(NamedTuple):
    """What lanes of a machine share.

    Attributes:
        status: returns the newest state, or None. reasons: of programs that have ended, by id.
    """

    machine: Machine
    states: AxisStates
    status: Callable[[], MachineStatus | None]
    feed: Feed
    reasons: Mapping[str, str]


def begin_of(job: Job) -> float:
    """Return where on its trajectory a job is now [s], by its stamp.

    Raises:
        InvalidGoal: it is over, or more than `LONGEST_WAIT_S` ahead.
    """
    if not job.stamp_s:
        return 0.0
    begin_s = time.time() - job.stamp_s
    if begin_s > job.trajectory.duration_s:
        ago = begin_s - job.trajectory.duration_s
        raise InvalidGoal(OLD_HEADER_TIMESTAMP, f"it would have ended {ago:.3f} s ago")
    if begin_s < -LONGEST_WAIT_S:
        raise InvalidGoal(INVALID_GOAL, f"it begins in {-begin_s:.0f} s; {LONGEST_WAIT_S:.0f} s are possible")
    return begin_s


def motion_from_here(around: Surroundings, job: Job) -> Motion:
    """Return a job's motion from where its joints stand.

    Raises:
        InvalidGoal: as `begin_of` and `Motion`.
    """
    position = around.states.setpoint[around.states.columns(job.trajectory.joints)]
    return Motion(job.trajectory, begin_of(job), position, np.zeros_like(position), looked_at=True)


class Lane:
    """Axes that are led, from the first job that needs them to the end of the last one."""

    def __init__(self, around: Surroundings, job: Job) -> None:
        self.axes = frozenset(job.trajectory.axes)
        self._around = around
        self._job = job
        self._offered: Job | None = None
        self._motion: Motion
        # share of speed at the last tick, and whether it was the same at the one before
        self._rate, self._steady = 1.0, True
        self._leave = False
        self._wake = asyncio.Event()
        self._closing = False
        # bodies or zones: its axes are led between the bounds of its first trajectory alone
        self._bounded = False
        # time on the trajectory, and when that was
        self._at = self._then = 0.0
        # until when the newest chunk counts
        self._counts_until = 0.0

    def offer(self, job: Job) -> bool:
        """Take another job over at the next tick; False: the lane is at its end, wait for that."""
        if self._closing or self._leave or self._bounded:
            return False
        if self._offered is not None:
            self._offered.goal.end(PREEMPTED)
        self._offered = job
        return True

    def leave(self) -> None:
        """Stop the axes for a job that needs others too."""
        self._leave = True
        self._wake.set()

    async def run(self) -> Job | None:
        """Carry its job out, and those that take over; returns one that came too late for that."""
        outcome = LEAVING
        try:
            outcome = await self._carry_out()
        except asyncio.CancelledError:
            if self._offered is not None:
                self._offered.goal.end(LEAVING)
            raise
        except MotionError as error:
            outcome = await ended_by(error, self._around.reasons)
            if self._bounded and error.code in CONTACTS:
                outcome = outcome._replace(text=f"{outcome.text}; {IN_BOUNDS}")
        except InvalidGoal as invalid:
            outcome = invalid.outcome
        except Exception as error:
            log.exception("a trajectory failed")
            outcome = Outcome(Status.ABORTED, INVALID_GOAL, f"{type(error).__name__}: {error}")
        finally:
            self._closing = True
            self._job.goal.end(outcome)
        return self._offered

    async def _carry_out(self) -> Outcome:
        servo = await self._open()
        try:
            return await self._lead(servo)
        finally:
            self._closing = True
            await self._release(servo)

    async def _open(self) -> Servo:
        """Open servo mode; beside bodies and zones within the trajectory's bounds, which are judged first."""
        machine, name = self._around.machine, "ROS trajectory"
        try:
            return await machine.servo(sorted(self.axes), name=name, counts_s=COUNTS_S)
        except RequestRefused as refusal:
            if refusal.code != "MC595":
                raise
        self._bounded = True
        if self._offered is not None:
            # it has bounds of its own
            self.leave()
        await self._around.states.until_known()
        trajectory = self._job.trajectory
        units = units_of(trajectory.joints)
        bounds = [(each / units).tolist() for each in motion_from_here(self._around, self._job).bounds()]
        within = dict(zip(trajectory.axes, zip(*bounds, strict=True), strict=True))
        return await machine.servo(sorted(self.axes), name=name, counts_s=COUNTS_S, within=within)

    # ------------------------------------------------------------------ on the way

    async def _lead(self, servo: Servo) -> Outcome:
        try:
            async with asyncio.timeout(ENERGIZE_S):
                await self._around.states.until_known()
                await self._until_energized(servo)
        except TimeoutError:
            return Outcome(
                Status.ABORTED, INVALID_GOAL, f"the drives are not energized after {ENERGIZE_S:g} s"
            )
        self._begin(self._job, None)
        tick = 0
        while True:
            self._wake.clear()
            self._check_there(servo)
            self._advance(servo)
            self._take_over()
            if self._job.goal.cancelled.is_set():
                return CANCELED
            if self._leave:
                return PREEMPTED
            await self._send(servo)
            violated = self._off_path(servo)
            if violated is not None:
                return violated
            if tick % FEEDBACK_TICKS == 0:
                self._feed()
            tick += 1
            if self._at >= self._motion.end_s:
                return await self._arrive(servo)
            await self._pause()

    def _begin(self, job: Job, motion: Motion | None) -> None:
        """Lead along a job's trajectory from now on; from ``motion``, where the axes are on one."""
        if motion is None:
            self._motion = motion_from_here(self._around, job)
        else:
            positions, velocities = motion.at(np.array([self._at]))
            column = {joint.axis: at for at, joint in enumerate(motion.trajectory.joints)}
            order = [column[axis] for axis in job.trajectory.axes]
            position, velocity = positions[0, order], velocities[0, order] * self._rate
            self._motion = Motion(job.trajectory, begin_of(job), position, velocity, looked_at=True)
        self._at, self._then = self._motion.begin_s, time.monotonic()
        self._job = job
        job.goal.execute()

    def _take_over(self) -> None:
        offered, self._offered = self._offered, None
        if offered is None or offered.goal.cancelled.is_set():
            if offered is not None:
                offered.goal.end(CANCELED)
            return
        before = self._job
        try:
            self._begin(offered, self._motion)
        except InvalidGoal as invalid:
            # the one under way goes on
            offered.goal.end(invalid.outcome)
            return
        before.goal.end(CANCELED if before.goal.cancelled.is_set() else PREEMPTED)

    def _advance(self, servo: Servo) -> None:
        now = time.monotonic()
        rate = 0.0 if servo.state == "held" else rate_of(self._around.status(), servo.id)
        self._at += (now - self._then) * rate
        self._then, self._steady, self._rate = now, rate == self._rate, rate
        if rate == 0.0 and self._at > self._motion.begin_s:
            states = self._around.states
            columns = states.columns(self._motion.trajectory.joints)
            self._at = place_of(self._motion, self._at, states.setpoint[columns])

    async def _send(self, servo: Servo) -> None:
        motion, rate = self._motion, self._rate
        ahead = np.arange(STEP_S, REACH_S, STEP_S)
        if rate > 0.0:
            # the end is a point of its own: no curve between others goes beyond it
            end = (motion.end_s - self._at) / rate
            if end <= 0.0:
                # the axes are to stand there: what ends them waits for their last point
                ahead = ahead[:1]
            elif end < REACH_S:
                ahead = np.union1d(ahead[np.abs(ahead - end) > 1e-3], [end])
        positions, velocities = motion.at(self._at + ahead * rate)
        column = {joint.axis: at for at, joint in enumerate(motion.trajectory.joints)}
        order = [column[axis] for axis in servo.axes]
        units = units_of(motion.trajectory.joints)
        try:
            await servo.send(
                (positions / units)[:, order], (velocities * rate / units)[:, order], times=ahead
            )
        except NobodyAnswers:
            # the chunk before leads on; where this process was late, the answers are about to be read
            if time.monotonic() > self._counts_until:
                raise
        else:
            self._counts_until = self._then + float(ahead[-1]) + COUNTS_S

    def _check_there(self, servo: Servo) -> None:
        servo.check()
        if servo.state in ENDED:
            raise MotionError("MC536", f"the targets are followed no more: {servo.state}")
        if not self._around.machine.online:
            raise NobodyAnswers("MC530", "the server is gone", "its axes stop by themselves")

    async def _until_energized(self, servo: Servo) -> None:
        while not (self._job.goal.cancelled.is_set() or self._leave):
            self._check_there(servo)
            status = self._around.status()
            # a state of before says nothing: it does not know the program yet
            if status is not None and any(each.program == servo.id for each in status.programs):
                rows = {axis: row for row, axis in enumerate(status.axes.index)}
                if all(status.axes.state[rows[axis]] in ENERGIZED for axis in self.axes):
                    return
            await asyncio.sleep(TICK_S / 5)

    # ------------------------------------------------------------------ what is measured

    def _measured(self) -> tuple[float, Array, Array, Array, Array]:
        """Return time on the trajectory, desired and actual positions and velocities of the newest cycle."""
        states = self._around.states
        columns = states.columns(self._motion.trajectory.joints)
        at = self._at - (self._then - states.at) * self._rate
        positions, velocities = self._motion.at(np.array([at]))
        return (
            at,
            positions[0],
            velocities[0] * self._rate,
            states.position[columns],
            states.velocity[columns],
        )

    def _off_path(self, servo: Servo) -> Outcome | None:
        if not self._steady or servo.state == "held" or self._rate == 0.0:
            return None
        at, position, velocity, there, speed = self._measured()
        if at < self._motion.begin_s:
            return None
        column = self._job.tolerances.violated_on_path(position - there, velocity - speed)
        if column is None:
            return None
        joint = self._motion.trajectory.joints[column]
        return Outcome(
            Status.ABORTED,
            PATH_TOLERANCE_VIOLATED,
            f"{joint.name} is at {there[column]:.6g}, not at {position[column]:.6g}, after {at:.3f} s",
        )

    def _feed(self) -> None:
        at, position, velocity, there, speed = self._measured()
        make = interfaces().make
        point = "trajectory_msgs/msg/JointTrajectoryPoint"
        since = duration_of(max(at, 0.0))

        def made(positions: Array, velocities: Array) -> Any:
            return make(point, positions=positions, velocities=velocities, time_from_start=since)

        self._around.feed(
            self._job.goal,
            make(
                "control_msgs/action/FollowJointTrajectory_Feedback",
                header=make("std_msgs/msg/Header", stamp=stamp_of(time.time())),
                joint_names=[joint.name for joint in self._motion.trajectory.joints],
                desired=made(position, velocity),
                actual=made(there, speed),
                error=made(position - there, velocity - speed),
            ),
        )

    # ------------------------------------------------------------------ the end

    async def _arrive(self, servo: Servo) -> Outcome:
        """Let the axes come to rest on the last point, and see whether they are there."""
        self._closing = True
        closing = asyncio.ensure_future(servo.close())
        left_s = self._job.tolerances.settle_s
        try:
            while not closing.done():
                if self._job.goal.cancelled.is_set():
                    return CANCELED
                if self._leave:
                    return PREEMPTED
                if left_s <= 0.0:
                    return self._not_there(self._motion.at(np.array([self._motion.end_s]))[0][0])
                await asyncio.wait([closing], timeout=TICK_S)
                left_s -= TICK_S if servo.state != "held" else 0.0
            closing.result()
        finally:
            closing.cancel()
            await asyncio.gather(closing, return_exceptions=True)
        return await self._settle(left_s)

    async def _settle(self, left_s: float) -> Outcome:
        states = self._around.states
        columns = states.columns(self._motion.trajectory.joints)
        wanted = self._motion.at(np.array([self._motion.end_s]))[0][0]
        ended = time.monotonic()
        while True:
            if states.at >= ended:
                error = states.position[columns] - wanted
                if self._job.tolerances.violated_at_goal(error, states.velocity[columns]) is None:
                    return Outcome(Status.SUCCEEDED)
            if left_s <= 0.0:
                return self._not_there(wanted)
            await asyncio.sleep(TICK_S / 5)
            left_s -= TICK_S / 5

    def _not_there(self, wanted: Array) -> Outcome:
        states = self._around.states
        joints = self._motion.trajectory.joints
        there = states.position[states.columns(joints)]
        column = int(np.argmax(np.abs(there - wanted) / np.minimum(self._job.tolerances.goal, 1e3)))
        return Outcome(
            Status.ABORTED,
            GOAL_TOLERANCE_VIOLATED,
            f"{joints[column].name} is at {there[column]:.6g} and should be at {wanted[column]:.6g}, "
            f"{self._job.tolerances.settle_s:g} s behind the end",
        )

    async def _release(self, servo: Servo) -> None:
        """Stop what still moves, and give the axes back; where nobody answers they stop by themselves."""
        try:
            if servo.state not in ENDED and self._around.machine.online:
                await servo.abort()
        except MotionError:
            return

    async def _pause(self) -> None:
        try:
            async with asyncio.timeout(TICK_S):
                await self._wake.wait()
        except TimeoutError:
            return
