"""Torques of the joints while the playback rate changes.

With the rows' velocity v and acceleration a by time, a playback rate r and its change ṙ, a joint moves at r v
and accelerates by r² a + ṙ v, so τ = g + r² (M a + C(q, v) v) + ṙ M v: three numbers for each joint, here in
shares of its limit, give a row's torques at any r and ṙ. At constant rates from 0 to 1, τ lies between g and
the row's torque at rate 1.
"""

from __future__ import annotations

import numpy as np

from mcserver.motion.geometry.curves import Array

# Numbers of each limited joint: torque at rest; torque that the motion between the row before and the row
# adds at rate 1; torque that a change of the rate by 1 per cycle adds.
HOLDING, MOTION, CHANGE = range(3)
NUMBERS = 3
# Share of a limit that a stop counts on at least, also where holding still leaves less [1].
LEAST_ROOM = 0.02
# Longest stop [cycles].
LONGEST_STOP = 1500


def stop_cycles(torque: Array) -> int:
    """Return the longest stop from rate 1 that the rows' torque limits need [cycles].

    Args:
        torque: of the rows, shape (n, 3, J).
    """
    if torque.size == 0:
        return 0
    room = np.maximum(1.0 - np.abs(torque[:, HOLDING]), LEAST_ROOM)
    return int(min(np.ceil((np.abs(torque[:, CHANGE]) / room).max()), LONGEST_STOP))
