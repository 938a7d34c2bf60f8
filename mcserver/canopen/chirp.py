"""A chirp as a program: an axis goes to and fro, ever quicker, at the limits of its machine file."""

from __future__ import annotations

import math
from typing import Protocol

from mcserver.units import MINUTE

# Frequencies, as shares of the cycle's rate: a move lasts five cycles at the least.
LOWEST_SHARE, HIGHEST_SHARE = 0.002, 0.1
# The program begins before it is looked at, and ends behind that [s].
CHIRP_AROUND_S = 4.0


class Limits(Protocol):
    """An axis and its limits, of position, in one unit of length or angle; max_jerk None: none."""

    @property
    def index(self) -> int: ...
    @property
    def max_velocity(self) -> float: ...
    @property
    def max_acceleration(self) -> float: ...
    @property
    def max_jerk(self) -> float | None: ...


def half_period_travel(axis: Limits, duration_s: float) -> float:
    """Return how far an axis gets from rest to rest within a time, at its limits [their unit]."""
    ramp, most = 0.5 * duration_s, axis.max_acceleration
    jerk = axis.max_jerk or math.inf
    # of a ramp that uses the jerk alone, or the acceleration too
    rise = most / jerk
    speed = jerk * ramp**2 / 4.0 if ramp < 2.0 * rise else most * (ramp - rise)
    if speed <= axis.max_velocity:
        return speed * ramp
    speed = axis.max_velocity
    ramp = 2.0 * math.sqrt(speed / jerk) if speed < most * rise else speed / most + rise
    return speed * (duration_s - ramp)


def chirp_lines(
    axis: Limits, word: str, seconds: float, cycle_s: float, unit: float = 1.0, room: float = math.inf
) -> list[str]:
    """Return a program that goes to and fro, slowly first, for as long at each octave of frequency.

    It energizes the axis, goes from where that stands towards greater positions, and comes back.

    Args:
        word: of the axis in a program, such as ``X``. unit: of its limits, for one mm or degree.
        room: no move is longer, so that it begins at a higher frequency [mm or deg].
    """
    longest = 0.5 * cycle_s / LOWEST_SHARE
    while half_period_travel(axis, longest) / unit > room:
        longest *= 0.95
    lowest = 0.5 * cycle_s / longest
    lines = [f"G1010 P{axis.index}", f"G21 G91 G94 G64 P0 F{axis.max_velocity / unit * MINUTE:g}"]
    passed = 0.0
    while passed < seconds:
        duration = 0.5 * cycle_s / (lowest * (HIGHEST_SHARE / lowest) ** (passed / seconds))
        travel = half_period_travel(axis, duration) / unit
        lines += [f"G01 {word}{travel:.6f}", f"G01 {word}-{travel:.6f}"]
        passed += 2.0 * duration
    return lines
