"""Torques of the joints between rows at a changing rate, relative to their limits there.

See `mcserver.motion.geometry.row_torques`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.row_torques import CHANGE, HOLDING, LEAST_ROOM, MOTION
from mcserver.motion.kernels.compiled import compiled

# Share of their limits that torques may take while the rate changes, within the 102 % that they are tested
# for; the torques of the rows themselves are allowed in any case.
TORQUE_SLACK = 1.01
# Rows around u whose own torques are allowed there.
NEAR_ROWS = 3


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
    """Return the greatest ratio of a joint's torque to its limit at u, between places row - 1 and row.

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
    """Return the greatest change of the rate that torques allow at a row that hardly moves [1/cycle]."""
    least = np.inf
    for j in range(torque.shape[2]):
        room = max(1.0 - abs(torque[at, HOLDING, j]), LEAST_ROOM)
        least = min(least, room / (abs(torque[at, CHANGE, j]) + 1e-12))
    return float(least)
