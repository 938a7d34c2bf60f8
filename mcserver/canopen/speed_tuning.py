"""How late a drive follows the speeds that it is told, by a motion, and how stable its position loop is then.

The loop is that of `mcserver.drives.cia402.loops.SpeedLoop`. A drive's own speed loop is taken as a
delay, which costs more phase than a lag of the same mean: margins are on the safe side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mcserver.canopen.cycle_samples import Array
from mcserver.canopen.frequency_response import Complex
from mcserver.canopen.torque_tuning import FREQUENCIES, LEAST_WINDOWS, WINDOW
from mcserver.drives.cia402.loop_gains import USUAL_GAIN, lateness

# Share of its way by which a window may differ from the rest, to count.
MOST_OFF = 0.25
# Phase that a proposed gain leaves [rad].
PHASE = math.radians(60.0)


@dataclass(frozen=True)
class MeasuredSpeed:
    """How a drive follows speeds.

    Attributes:
        scale: its speed as a share of what it is told [1]. lag: by which it is late, besides the bus;
            uncertainty: of it, the standard error [s].
    """

    scale: float
    lag: float
    uncertainty: float


@dataclass(frozen=True)
class SpeedGains:
    """Gains of a speed loop: as in `[axis.drive]`; integral_time_s 0: no integral."""

    position_gain: float
    integral_time_s: float


@dataclass(frozen=True)
class SpeedMargins:
    """How far a loop is from not being stable.

    Attributes:
        greatest: multiple of its gain up to which it is stable. phase: left where its gain is 1 [rad].
    """

    greatest: float
    phase: float


def measure_speed(speed: Array, place: Array, cycle_s: float) -> MeasuredSpeed | None:
    """Fit how far and how late an axis follows speeds, by least squares over windows.

    Over a window an axis that is late by T goes scale · (sum of speeds · dt - T · change of the speed). A
    drive goes by its own clock, so where a SYNC comes late it goes further: such windows do not count.

    Args:
        speed: ordered before the SYNC of each cycle, shape (n,) [mm/s or deg/s].
        place: sampled at it [mm or deg]; NaN: nothing came.

    Returns:
        What was fitted; None where there are too few windows, or the speed did not change.
    """
    starts = np.arange(1, len(place) - WINDOW, WINDOW)
    span = starts[:, None] + np.arange(WINDOW)
    went = place[starts + WINDOW] - place[starts]
    basis = np.stack(
        [speed[span].sum(axis=1) * cycle_s, speed[starts - 1] - speed[starts + WINDOW - 1]], axis=1
    )
    kept = np.isfinite(went) & np.isfinite(basis).all(axis=1)
    basis, went = basis[kept], went[kept]
    way = np.abs(speed[span[kept]]).sum(axis=1) * cycle_s
    if not len(went):
        return None
    found, *_ = np.linalg.lstsq(basis, went, rcond=None)
    usual = np.abs(went - basis @ found) <= MOST_OFF * abs(found[0]) * way
    basis, went = basis[usual], went[usual]
    if len(went) < LEAST_WINDOWS or np.linalg.matrix_rank(basis) < 2:
        return None
    found, *_ = np.linalg.lstsq(basis, went, rcond=None)
    left = went - basis @ found
    scale, late = found.tolist()
    error = math.sqrt(float(left @ left) / (len(went) - 2) * float(np.linalg.inv(basis.T @ basis)[1, 1]))
    return MeasuredSpeed(scale, late / scale, abs(error / scale)) if scale else None


def proposed_gains(measured: MeasuredSpeed, now: SpeedGains, cycle_s: float, delay: int) -> SpeedGains:
    """Return the usual share of the greatest gain, less where it would leave less than `PHASE`."""
    late = (delay - 0.5) * cycle_s + max(0.0, measured.lag)
    gain = min(USUAL_GAIN / (lateness(delay) * cycle_s), (math.pi / 2.0 - PHASE) / late)
    return SpeedGains(gain, now.integral_time_s)


def speed_margins(gains: SpeedGains, measured: MeasuredSpeed, cycle_s: float, delay: int) -> SpeedMargins:
    """Return the margins of a loop on a drive.

    With q a delay of one cycle: L = P·(1 + dt/Ti·q/(1-q)) · scale·dt·q^delay·e^(-lag)/(1-q).
    """
    turned = 2.0 * math.pi * FREQUENCIES
    q = np.exp(-1j * turned)
    loop = speed_controller(gains, FREQUENCIES, cycle_s) * measured.scale * cycle_s / (1.0 - q)
    size = np.abs(loop)
    phase = np.unwrap(np.angle(loop)) - turned * (delay + max(0.0, measured.lag) / cycle_s)
    beyond = phase <= -math.pi
    greatest = 1.0 / float(size[beyond].max()) if beyond.any() else math.inf
    crossing = max(0, int((size >= 1.0).sum()) - 1)
    return SpeedMargins(greatest, float(phase[crossing]) + math.pi)


def speed_controller(gains: SpeedGains, frequency: Array, cycle_s: float) -> Complex:
    """Return speed by error of a loop at frequencies, shares of the cycle's rate, shape (n,)."""
    q = np.exp(-2j * math.pi * frequency)
    integral = cycle_s / gains.integral_time_s * q / (1.0 - q) if gains.integral_time_s > 0.0 else 0.0 * q
    return np.asarray(gains.position_gain * (1.0 + integral))
