"""Servo mode of a trajectory on a machine with bodies: its bounds, and what takes over there."""

from __future__ import annotations

import math
import time
from typing import Any, cast

import numpy as np
import pytest
from mcclient import MotionError, NobodyAnswers, RequestRefused

from mcserver.ros.goals import Goal
from mcserver.ros.joints import Joint
from mcserver.ros.lane import IN_BOUNDS, Job, Lane, Surroundings
from mcserver.ros.tolerances import Tolerances
from mcserver.ros.trajectory import Motion, read_trajectory
from tests.ros.wire import trajectory

KNOWN = {
    "turn": Joint("turn", 4, True, math.radians(1.0), -3.0, 3.0, 3.0, 1e-4),
    "lift": Joint("lift", 1, False, 1e-3, -1.0, 1.0, 1.0, 1e-5),
}


class States:
    """Joints that stand at 0.2 rad and 0.1 m."""

    setpoint = np.array([0.2, 0.1])

    async def until_known(self) -> None:
        return

    def columns(self, joints: Any) -> Any:
        return [0, 1][: len(joints)]


class Guarded:
    """A machine with bodies, which refuses servo mode without bounds, and with them by ``judge``."""

    online = False

    def __init__(self, judge: MotionError) -> None:
        self.asked: list[dict[str, Any]] = []
        self._judge = judge

    async def servo(self, axes: list[int], **options: Any) -> Any:
        self.asked.append({"axes": axes, **options})
        raise self._judge if "within" in options else RequestRefused("MC595", "it has [clearance]")


def job() -> Job:
    read = read_trajectory(trajectory(["turn", "lift"], (1.0, [-0.5, 0.1]), (2.0, [0.4, 0.3])), KNOWN)
    return Job(Goal(b"", None, 0.0, lambda: None), read, cast("Tolerances", None), 0.0)


def lane(machine: Guarded) -> Lane:
    around = Surroundings(cast("Any", machine), cast("Any", States()), lambda: None, lambda *_: None, {})
    return Lane(around, job())


async def test_bounds_are_those_of_the_way_from_where_the_joints_stand_and_a_contact_says_so() -> None:
    machine = Guarded(MotionError("MC320", "'flange' would come too near to 'post'"))
    made = lane(machine)
    goal = made._job.goal
    await made.run()
    _, bounded = machine.asked
    low, high = bounded["within"][4]
    assert (low, high) == pytest.approx((math.degrees(-0.5), math.degrees(0.4)))
    assert bounded["within"][1] == pytest.approx((100.0, 300.0))
    assert bounded["axes"] == [1, 4]
    assert goal.ended.result().text == f"MC320: 'flange' would come too near to 'post'; {IN_BOUNDS}"


async def test_what_would_take_over_within_bounds_of_another_way_waits_for_its_end() -> None:
    made = lane(Guarded(MotionError("MC512", "leased")))
    early = job()
    assert made.offer(early)
    # it came before the bounds were known: it begins anew behind them
    assert await made.run() is early
    assert not made.offer(job())


class Silent:
    """Servo mode that takes chunks until the server answers no more."""

    axes = (1, 4)

    def __init__(self) -> None:
        self.answers = True
        self.times: list[float] = []

    async def send(self, positions: Any, velocities: Any, *, times: Any) -> None:  # noqa: ARG002
        if not self.answers:
            raise NobodyAnswers("MC530", "the server has not answered for 0.7 s", "")
        self.times = times.tolist()


def under_way() -> Lane:
    made = lane(Guarded(MotionError("MC512", "leased")))
    read = made._job.trajectory
    made._motion = Motion(read, 0.0, np.array([0.2, 0.1]), np.zeros(2), looked_at=True)
    made._then = time.monotonic()
    return made


async def test_a_chunk_reaches_a_second_ahead_and_leads_on_while_no_answer_is_heard() -> None:
    made, servo = under_way(), Silent()
    await made._send(cast("Any", servo))
    assert servo.times[-1] == pytest.approx(1.0, abs=0.03)
    servo.answers = False
    await made._send(cast("Any", servo))
    made._counts_until = time.monotonic() - 1e-3
    with pytest.raises(NobodyAnswers):
        await made._send(cast("Any", servo))


async def test_behind_the_end_the_axes_are_led_to_their_last_point_at_once() -> None:
    made, servo = under_way(), Silent()
    made._at = made._motion.end_s
    await made._send(cast("Any", servo))
    assert len(servo.times) == 1
