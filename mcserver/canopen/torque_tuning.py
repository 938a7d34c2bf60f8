"""What a motor turns, from torques and places of a motion, and how stable its torque loop is with that.

Nothing is excited: any program that accelerates the axis both ways is the test, within the limits of its
machine file. The loop is that of `mcserver.drives.cia402.loops.TorqueLoop`, a rigid load, and the delays of
the bus; what rings besides is measured by `mcserver.canopen.frequency_response`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial

from mcserver.canopen.cycle_samples import Array
from mcserver.canopen.frequency_response import Complex
from mcserver.drives.cia402.loop_gains import USUAL_CROSSOVER, USUAL_INTEGRAL, USUAL_SHARE, lateness
from mcserver.drives.cia402.loops import DAMPING_CYCLES

# Cycles over which impulses and changes of speed are compared.
WINDOW = 20
LEAST_WINDOWS = 20
# Inertias that are tried, as multiples of the measured one.
TRIED = np.geomspace(0.05, 20.0, 241)
# Frequencies of the loop, as shares of that at which the cycle samples.
FREQUENCIES = np.geomspace(1e-5, 0.5, 4000)


@dataclass(frozen=True)
class MeasuredLoad:
    """What a motor turns, at its shaft.

    Attributes:
        inertia: [kg·m²]; uncertainty: of it, the standard error as a share. friction: against any motion
            [N·m]; viscous: against its speed [N·m·s/rad]. load: torque that holds it [N·m]. explained: share
            of the impulses that these explain [1].
    """

    inertia: float
    uncertainty: float
    friction: float
    viscous: float
    load: float
    explained: float


@dataclass(frozen=True)
class TorqueGains:
    """Gains of a torque loop: as in `[axis.drive]`; integral_time_s 0: no integral."""

    velocity_gain: float
    position_gain: float
    integral_time_s: float


@dataclass(frozen=True)
class Margins:
    """How far a loop is from not being stable.

    Attributes:
        least, greatest: share of the inertia down and up to which it is stable; 0 and 0: it is not.
        phase: that is left where the loop's gain is 1 [rad].
    """

    least: float
    greatest: float
    phase: float


def measure_load(torque: Array, angle: Array, cycle_s: float) -> MeasuredLoad | None:
    """Fit inertia, friction and load to a motion, by least squares over windows in which it never stands.

    With torques that are constant from SYNC to SYNC the change of speed over a window is the sum of the means
    of two torques each, exactly, so no acceleration has to be taken from an encoder's steps.

    Args:
        torque: ordered before the SYNC of each cycle, shape (n,) [N·m]. angle: of the shaft, sampled at it
            [rad]; NaN: nothing came.

    Returns:
        The load; None where there are too few windows, or its motion does not tell its parts apart.
    """
    starts = np.arange(1, len(angle) - WINDOW, WINDOW)
    span = starts[:, None] + np.arange(WINDOW)
    moved = np.diff(angle)
    # dry friction of a cycle goes by where it went; what stands may be held by any
    way = np.sign(moved[span])
    moving = np.isfinite(way).all(axis=1) & way.all(axis=1)
    impulse = 0.5 * cycle_s * (torque[span] + torque[span - 1]).sum(axis=1)
    kept = moving & np.isfinite(impulse) & np.isfinite(moved[starts - 1])
    if kept.sum() < LEAST_WINDOWS:
        return None
    starts, impulse, rubbed = starts[kept], impulse[kept], cycle_s * way[kept].sum(axis=1)
    ends, passed = starts + WINDOW, WINDOW * cycle_s
    faster = (moved[ends - 1] - moved[starts - 1]) / cycle_s
    basis = np.stack(
        [faster, rubbed, angle[ends - 1] - angle[starts - 1], np.full(len(starts), passed)], axis=1
    )
    scale = np.abs(basis).max(axis=0)
    if not (scale > 0.0).all() or np.linalg.cond(basis / scale) > 1e3:
        return None
    found, *_ = np.linalg.lstsq(basis / scale, impulse, rcond=None)
    left = impulse - basis / scale @ found
    variance = float(left @ left) / max(1, len(impulse) - basis.shape[1])
    error = math.sqrt(variance * float(np.linalg.inv((basis / scale).T @ (basis / scale))[0, 0]))
    inertia, friction, viscous, load = (found / scale).tolist()
    whole = float(((impulse - impulse.mean()) ** 2).sum())
    explained = 1.0 - float(left @ left) / whole if whole > 0.0 else 0.0
    return MeasuredLoad(inertia, float(abs(error / found[0])), friction, viscous, load, explained)


def usual_gains(inertia: float, cycle_s: float, delay: int) -> TorqueGains:
    """Return the gains that a machine file gets which gives the inertia alone; ``delay``: as `margins`."""
    crossover = USUAL_CROSSOVER / (lateness(delay) * cycle_s)
    gain = USUAL_SHARE * crossover
    return TorqueGains(inertia * crossover, gain, USUAL_INTEGRAL / gain)


def margins(gains: TorqueGains, inertia: float, cycle_s: float, delay: int) -> Margins:
    """Return the margins of a loop on an inertia [kg·m²].

    With q a delay of one cycle, the torque of a cycle is first seen in the reading ``delay`` cycles later:
    1 + L = 0, L = K·(P + P·dt/Ti·q/(1-q) + (1-q^m)/(m·dt)) · dt²/(2·J) · q^delay·(1+q)/(1-q)².
    """
    opened, closing = _loop(gains, inertia, cycle_s, delay)
    # the greater the inertia, the smaller the gain of the loop
    stable = [
        bool((np.abs(polynomial.polyroots(_sum(opened, closing / each))) > 1.0 + 1e-9).all())
        for each in TRIED
    ]
    middle = int(np.argmin(np.abs(np.log(TRIED))))
    if not stable[middle]:
        return Margins(0.0, 0.0, 0.0)
    low = high = middle
    while low > 0 and stable[low - 1]:
        low -= 1
    while high < len(TRIED) - 1 and stable[high + 1]:
        high += 1
    delayed = np.exp(-2j * math.pi * FREQUENCIES)
    loop = polynomial.polyval(delayed, closing) / polynomial.polyval(delayed, opened)
    crossing = int(np.flatnonzero(np.abs(loop) >= 1.0)[-1])
    return Margins(float(TRIED[low]), float(TRIED[high]), float(np.angle(-loop[crossing])))


def torque_controller(gains: TorqueGains, frequency: Array, cycle_s: float) -> Complex:
    """Return torque by error of a loop at frequencies, shares of the cycle's rate, shape (n,)."""
    q = np.exp(-2j * math.pi * frequency)
    damped = (1.0 - q**DAMPING_CYCLES) / (DAMPING_CYCLES * cycle_s)
    parts = gains.position_gain + damped
    if gains.integral_time_s > 0.0:
        parts = parts + gains.position_gain * cycle_s / gains.integral_time_s * q / (1.0 - q)
    return np.asarray(gains.velocity_gain * parts)


def _loop(gains: TorqueGains, inertia: float, cycle_s: float, delay: int) -> tuple[Array, Array]:
    """Return denominator and numerator of L, as polynomials in q."""
    one_less, gain = np.array([1.0, -1.0]), gains.position_gain
    damping = np.zeros(DAMPING_CYCLES + 1)
    damping[0], damping[-1] = 1.0, -1.0
    parts = polynomial.polymul(one_less, _sum(np.array([gain]), damping / (DAMPING_CYCLES * cycle_s)))
    if gains.integral_time_s > 0.0:
        parts = _sum(parts, np.array([0.0, gain * cycle_s / gains.integral_time_s]))
    plant = np.array([*[0.0] * delay, 1.0, 1.0]) * cycle_s**2 / (2.0 * inertia)
    closing = polynomial.polymul(gains.velocity_gain * parts, plant)
    return np.asarray(polynomial.polypow(one_less, 3)), np.asarray(closing)


def _sum(one: Array, other: Array) -> Array:
    return np.asarray(polynomial.polyadd(one, other))
