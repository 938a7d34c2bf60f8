"""Torques of the joints at a rate of the rows that changes.

With the rows' velocity v and acceleration a by time, a playback rate r and its change ṙ, a joint moves at r v
and accelerates by r² a + ṙ v, so τ = g + r² (M a + C(q, v) v) + ṙ M v: a row's torques are known by three
numbers for each joint, here in shares of its limit. At steady rates from 0 to 1, τ lies between g and what
the row itself asks for.
"""

from __future__ import annotations

import numpy as np

from mcserver.motion.geometry.curves import Array

# Numbers of each limited joint: the torque at rest, what the motion adds to it at a rate of 1, and what a
# change of the rate by 1 a cycle adds. The motion's is that between the row before and the row.
HOLDING, MOTION, CHANGE = range(3)
NUMBERS = 3
# What a stop is reckoned with where holding still leaves less of a limit [1], and the longest one [cycles].
LEAST_ROOM, LONGEST_STOP = 0.02, 1500


def stop_cycles(torque: Array) -> int:
    """Return the longest stop from a rate of 1 that rows' torques ask for [cycles].

    Args:
        torque: of the rows, shape (n, 3, J).
    """
    if torque.size == 0:
        return 0
    room = np.maximum(1.0 - np.abs(torque[:, HOLDING]), LEAST_ROOM)
    return int(min(np.ceil((np.abs(torque[:, CHANGE]) / room).max()), LONGEST_STOP))
