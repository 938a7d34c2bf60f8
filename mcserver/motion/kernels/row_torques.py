"""Torques of the joints at a rate of the rows that changes.

With the rows' velocity v and acceleration a by time, a playback rate r and its change ṙ, a joint moves at r v
and accelerates by r² a + ṙ v, so τ = g + r² (M a + C(q, v) v) + ṙ M v: a row's torques are known by three
numbers for each joint, here in shares of its limit. At steady rates from 0 to 1, τ lies between g and what
the row itself asks for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled

# Numbers of each limited joint: the torque at rest, what the motion adds to it at a rate of 1, and what a
# change of the rate by 1 a cycle adds. The motion's is that between the row before and the row.
HOLDING, MOTION, CHANGE = range(3)
NUMBERS = 3
# What torques may pass their limits by while the rate changes, within the 102 % that they are judged at; what
# rows do themselves is allowed in any case.
TORQUE_SLACK = 1.01
# Rows about a place whose own torques are allowed there.
NEAR_ROWS = 3
# What a stop is reckoned with where holding still leaves less of a limit [1], and the longest one [cycles].
LEAST_ROOM, LONGEST_STOP = 0.02, 1500


@compiled
def torque_share(
    torque: Array,
    places: Array,
    at: NDArray[np.int64],
    count: int,
    row: int,
    u: float,
    rate: float,
    change: float,
) -> float:
    """Return the greatest share of what a joint's torque may be, at u between the places row - 1 and row.

    Args:
        torque: of the ring's rows, shape (n, 3, J). places, at: of the window, as `find_window` writes them.
            rate, change: at u [1, 1/cycle].
    """
    low = min(max(row - 1, 0), max(count - 2, 0))
    high = min(low + 1, count - 1)
    after = at[high]
    if after < 0:
        # at rest until the row after it
        return 0.0
    before = at[low]
    share = 1.0
    if high > low:
        share = min(max((u - places[low]) / (places[high] - places[low]), 0.0), 1.0)
    worst = 0.0
    for j in range(torque.shape[2]):
        rising = share * torque[after, CHANGE, j]
        if before >= 0:
            rising += (1.0 - share) * torque[before, CHANGE, j]
        here = abs(torque[after, HOLDING, j] + rate * rate * torque[after, MOTION, j] + change * rising)
        if here > TORQUE_SLACK:
            allowed = TORQUE_SLACK
            for near in range(max(low - NEAR_ROWS, 0), min(high + NEAR_ROWS, count - 1) + 1):
                if at[near] >= 0:
                    own = abs(torque[at[near], HOLDING, j] + torque[at[near], MOTION, j])
                    allowed = own if own > allowed else allowed
            here /= allowed
            worst = here if here > worst else worst
    return worst


@compiled
def change_limit(torque: Array, at: int) -> float:
    """Return the greatest change of the rate that torques leave to a row that hardly moves [1/cycle]."""
    least = np.inf
    for j in range(torque.shape[2]):
        room = max(1.0 - abs(torque[at, HOLDING, j]), LEAST_ROOM)
        least = min(least, room / (abs(torque[at, CHANGE, j]) + 1e-12))
    return float(least)


def stop_cycles(torque: Array) -> int:
    """Return the longest stop from a rate of 1 that rows' torques ask for [cycles].

    Args:
        torque: of the rows, shape (n, 3, J).
    """
    if torque.size == 0:
        return 0
    room = np.maximum(1.0 - np.abs(torque[:, HOLDING]), LEAST_ROOM)
    return int(min(np.ceil((np.abs(torque[:, CHANGE]) / room).max()), LONGEST_STOP))


def steady_rates(torque: Array) -> Array:
    """Return the greatest steady rates of rows by their torques, 1 at least, shape (n,)."""
    holding, motion = torque[:, HOLDING], torque[:, MOTION]
    room = np.maximum(1.0 - np.where(motion >= 0.0, holding, -holding), 0.0)
    rates: Array = np.sqrt(room / (np.abs(motion) + 1e-30)).min(axis=1, initial=np.inf)
    return np.maximum(rates, 1.0)
