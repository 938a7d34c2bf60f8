"""How an axis answers to a short motion: following error, overshoot and settling, from samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# What counts as the end of the record, for noise at rest [s].
REST_S = 0.2


@dataclass(frozen=True)
class StepResponse:
    """One motion from rest to rest; lengths in the axis's unit (mm, deg).

    Attributes:
        distance: of the setpoints. duration_s: from their first change to their last.
        greatest_error: between setpoint and encoder in the same cycle, the bus's delay included.
        delay_s: by which the encoder is behind, as the shift that fits best.
        error_without_delay: the greatest error with the setpoints shifted by it.
        overshoot: how far the encoder goes beyond the target, 0: it does not.
        settling_s: after the last setpoint, until the encoder stays within the tolerance; None: it does not.
        noise: standard deviation of the encoder at the end of the record.
    """

    distance: float
    duration_s: float
    greatest_error: float
    delay_s: float
    error_without_delay: float
    overshoot: float
    settling_s: float | None
    noise: float


def step_response(time_s: Array, setpoint: Array, actual: Array, tolerance: float) -> StepResponse | None:
    """Measure one motion from rest to rest; shapes (n,), n cycles without gaps.

    Args:
        tolerance: within which the axis counts as arrived, in its unit.

    Returns:
        None where the setpoints do not move.
    """
    moved = np.flatnonzero(np.diff(setpoint))
    if not len(moved):
        return None
    first, last = int(moved[0]), int(moved[-1]) + 1
    target = float(setpoint[last])
    distance = target - float(setpoint[first])
    shift = _delay(setpoint, actual, len(setpoint) // 2)
    shifted = np.concatenate((np.full(shift, setpoint[0]), setpoint[: len(setpoint) - shift]))
    beyond = (actual[first:] - target) * np.sign(distance)
    outside = np.flatnonzero(np.abs(actual[last:] - target) > tolerance)
    settled = int(outside[-1]) + 1 if len(outside) else 0
    rest = actual[time_s >= time_s[-1] - REST_S]
    return StepResponse(
        distance=distance,
        duration_s=float(time_s[last] - time_s[first]),
        greatest_error=float(np.max(np.abs(setpoint - actual))),
        delay_s=float(time_s[shift] - time_s[0]),
        error_without_delay=float(np.max(np.abs(shifted - actual))),
        overshoot=max(0.0, float(beyond.max())),
        settling_s=float(time_s[last + settled] - time_s[last]) if last + settled < len(time_s) else None,
        noise=float(np.std(rest)),
    )


def _delay(setpoint: Array, actual: Array, most: int) -> int:
    """Return by how many cycles the setpoints have to be later to fit the encoder best (least squares)."""
    length = len(setpoint)
    best, least = 0, np.inf
    for shift in range(min(most, 200)):
        error = setpoint[: length - shift] - actual[shift:]
        mean = float(np.mean(error * error))
        if mean < least:
            best, least = shift, mean
    return best
