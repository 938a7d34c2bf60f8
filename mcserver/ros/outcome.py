"""How a goal of FollowJointTrajectory ends: the codes of its result, and the states of goals of actions."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

from mcclient import MotionError, ProgramAborted

SUCCESSFUL = 0
INVALID_GOAL = -1
INVALID_JOINTS = -2
OLD_HEADER_TIMESTAMP = -3
PATH_TOLERANCE_VIOLATED = -4
GOAL_TOLERANCE_VIOLATED = -5

# of what is said, which may have names of a goal in it
LONGEST = 500

# for the reason of an abort, which comes a moment later than the abort itself
LOOKS_FOR_REASON, LOOK_S = 20, 0.025


class Status(IntEnum):
    """Of a goal, as of action_msgs/msg/GoalStatus."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


class Outcome(NamedTuple):
    """The end of a goal."""

    status: Status
    code: int = SUCCESSFUL
    text: str = ""


class InvalidGoal(Exception):
    """A goal that nothing moves for."""

    def __init__(self, code: int, text: str) -> None:
        super().__init__(text[:LONGEST])
        self.outcome = Outcome(Status.ABORTED, code, text[:LONGEST])


CANCELED = Outcome(Status.CANCELED, SUCCESSFUL, "cancelled; the joints were stopped within their limits")
# as joint_trajectory_controller says it
PREEMPTED = Outcome(Status.CANCELED, INVALID_GOAL, "Current goal cancelled due to new incoming action.")
LEAVING = Outcome(Status.ABORTED, INVALID_GOAL, "MC530: the server or the bridge is gone")


def refused(error: MotionError) -> Outcome:
    """Return the end of a goal that the machine refuses or has ended; the action has no code for that."""
    return Outcome(Status.ABORTED, INVALID_GOAL, f"{error.code}: {with_hint(error)}")


async def ended_by(error: MotionError, reasons: Mapping[str, str]) -> Outcome:
    """Return the end of a goal whose program has ended; ``reasons``: of programs that were aborted, by id."""
    if isinstance(error, ProgramAborted):
        for _ in range(LOOKS_FOR_REASON):
            reason = reasons.get(error.program)
            if reason is not None:
                code = "" if reason.startswith("MC") else f"{error.code}: "
                return Outcome(Status.ABORTED, INVALID_GOAL, f"{code}{reason}")
            await asyncio.sleep(LOOK_S)
    return refused(error)


def with_hint(error: MotionError) -> str:
    """Return what an error says, and its remedy."""
    return error.message + (f" ({error.hint})" if error.hint else "")
