"""How an axis answers its commands at each frequency, and the margins of a loop on what was measured.

The response is that of least squares over overlapping spectra (Welch; Bendat and Piersol, Random Data, 2010,
ch. 6.1). Positions are differenced first, so that what is slow does not leak into what is quick. A load that
rings is in it, as it is not in the rigid load of `mcserver.canopen.torque_tuning`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.canopen.cycle_samples import Array

Complex = NDArray[np.complex128]

# Cycles of a spectrum, which overlap by half, and spectra at the least.
LENGTH, LEAST_SPECTRA = 512, 8
# Share of what comes that the command has to explain at a frequency, for that to be known.
LEAST_COHERENCE = 0.8
# Cycles without a reading that are interpolated, as a share.
MOST_MISSING = 0.02


@dataclass(frozen=True)
class Response:
    """An axis's position by its command.

    Attributes:
        frequency: where it is known, rising, shape (n,) [share of the cycle's rate]. answer: there, shape
            (n,); one cycle and the delays of the drive are in it.
    """

    frequency: Array
    answer: Complex


@dataclass(frozen=True)
class MeasuredMargins:
    """Margins on a measured response.

    Attributes:
        crossover_hz: the first frequency at which the loop's gain falls below 1. phase: left there, or where
            it is 1 again [rad]. gain: multiple up to which the loop is stable, below 1: it is not; None: its
            phase crosses where nothing is known.
    """

    crossover_hz: float
    phase: float
    gain: float | None


def measure_response(command: Array, place: Array, order: int) -> Response | None:
    """Measure how a position answers.

    Args:
        command: ordered before the SYNC of each cycle, shape (n,). place: sampled at it; NaN: nothing came.
        order: 1: commands are speeds, 2: torques.

    Returns:
        The response where it is known; None: nowhere.
    """
    from scipy.signal import csd, welch

    known = np.isfinite(place) & np.isfinite(command)
    shortest = LENGTH * (LEAST_SPECTRA + 1) // 2
    if len(place) < shortest or np.count_nonzero(~known) > MOST_MISSING * len(place):
        return None
    rows = np.arange(len(place))
    command, place = (np.interp(rows, rows[known], each[known]) for each in (command, place))
    # central for torques, forward for speeds: one cycle ahead of place either way
    moved = np.diff(place, order)
    command = command[order - 1 : order - 1 + len(moved)]
    at, own = welch(command, nperseg=LENGTH)
    _, between = csd(command, moved, nperseg=LENGTH)
    _, whole = welch(moved, nperseg=LENGTH)
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = np.abs(between) ** 2 / (own * whole)
        answer = between / own
    kept = (at > 0.0) & (np.nan_to_num(coherence) >= LEAST_COHERENCE)
    if not kept.any():
        return None
    at, delayed = at[kept], np.exp(-2j * np.pi * at[kept])
    return Response(at, answer[kept] * delayed / (1.0 - delayed) ** order)


def opened_loop(response: Response, controller: Complex, delay: int) -> Complex:
    """Return the loop of a controller on a response, opened, shape (n,); arguments: `measured_margins`."""
    # one cycle is in the response
    late = np.exp(-2j * np.pi * response.frequency * (delay - 1))
    return np.asarray(controller * response.answer * late)


def measured_margins(
    response: Response, controller: Complex, cycle_s: float, delay: int
) -> MeasuredMargins | None:
    """Return the margins of a loop on a response; None: its gain crosses 1 where nothing is known.

    Args:
        controller: command by error at each of the response's frequencies, shape (n,). delay: of a reading
            behind its command [cycles].
    """
    loop = opened_loop(response, controller, delay)
    size, left = np.log(np.abs(loop)), np.angle(-loop)
    beside = np.diff(response.frequency) < 1.5 / LENGTH
    crossed = np.flatnonzero(beside & (size[:-1] * size[1:] <= 0.0))
    falls = crossed[size[crossed] >= 0.0]
    if not len(falls):
        return None
    first = int(falls[0])

    def between(values: Array, at: int, zero: Array) -> float:
        """Return a value where another one is 0, between two frequencies."""
        share = zero[at] / (zero[at] - zero[at + 1]) if zero[at] != zero[at + 1] else 0.0
        return float(values[at] + share * (values[at + 1] - values[at]))

    # a load that rings may bring the gain above 1 again: each time counts, from either side
    phases = [between(left, at, size) for at in crossed.tolist() if at >= first]
    turns = beside & (left[:-1] * left[1:] <= 0.0) & (np.abs(np.diff(left)) < np.pi)
    gains = [between(size, at, left) for at in np.flatnonzero(turns).tolist() if at >= first]
    return MeasuredMargins(
        between(response.frequency, first, size) / cycle_s,
        min(phases[0], *map(abs, phases)),
        math.exp(-max(gains)) if gains else None,
    )
