"""How fast a trajectory's time passes: as the machine's override says, not at all in a hold."""

from __future__ import annotations

import numpy as np
from mcclient.types import MachineStatus
from numpy.typing import NDArray

from mcserver.ros.trajectory import Motion

Array = NDArray[np.float64]

# Where on the way axes may have come to a stand in a hold, around where their targets were [s].
BEFORE_S, AFTER_S = 0.3, 0.7
LOOKS = 201
# What a second away from where the targets were costs, in seconds of distance at top speed.
NEARNESS = 0.05


def rate_of(status: MachineStatus | None, program: str) -> float:
    """Return the share of its speed at which a program's targets may move, 0 to 1."""
    if status is None:
        return 1.0
    rate = status.override / 100.0
    for each in status.programs:
        if each.program == program:
            rate *= 0.0 if each.state == "held" else each.override / 100.0
    return min(rate, 1.0)


def place_of(motion: Motion, around_s: float, position: Array) -> float:
    """Return the time on a trajectory at which joints are nearest to where they are now [s].

    Joints that a hold has stopped have gone on for a moment: from there they go on, not back. Of several
    times at which they are there the nearest one is taken: nothing of the way is left out.
    """
    times = np.linspace(around_s - BEFORE_S, around_s + AFTER_S, LOOKS)
    times = np.clip(times, motion.begin_s, motion.end_s)
    speeds = np.array([joint.max_velocity for joint in motion.trajectory.joints])
    positions, _ = motion.at(times)
    off = np.linalg.norm((positions - position) / speeds, axis=1)
    return float(times[int(np.argmin(off + NEARNESS * np.abs(times - around_s)))])
