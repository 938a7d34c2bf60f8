"""How an axis rings after its moves, from a recording, and the shapers that take that away."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import get_args

import msgspec
import numpy as np

from mcserver.executor.entries import Array
from mcserver.machine.axis import Axis
from mcserver.machine.shaper_section import RESIDUAL, Shaper, ShaperType, Shaping
from mcserver.units import TURN

# A ring is looked at for so long, and is of use from so long on [s].
LONGEST_S, SHORTEST_S = 1.0, 0.08
# A measured stop rings from the end of its braking on, which is so long behind the greatest value [s]; what
# dies away soon is looked at for less long, for then noise is left.
STARTS_S = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2)
SPANS_S = (0.3, LONGEST_S, 0.1)
# Values a second that are enough for it; values at the least, for fewer are soon like a vibration.
ENOUGH_HZ, LEAST_VALUES = 1600.0, 128
# What is damped more is the stop itself, which is gone within a swing.
MOST_DAMPING = 0.3
# A record that is longer than this is no stop, but a sweep [s]; its spectrum has values so far apart [Hz].
SWEEP_S, SPECTRUM_HZ = 10.0, 0.25
# Frequencies that are looked for [Hz], and the damping ratios that the search begins with.
LOWEST_HZ, HIGHEST_HZ = 2.0, 400.0
DAMPINGS = (0.003, 0.01, 0.03, 0.1, 0.2)
FREQUENCIES = 200
REFINEMENTS = 8
# A shaper is to leave `RESIDUAL` at frequencies beside the measured one by this share, too.
BESIDE = 0.1


@dataclass(frozen=True)
class Resonance:
    """A vibration that dies away.

    Attributes:
        damping: as a ratio. explained: share of the rings, or of the spectrum of a sweep [1].
        rings: how many these are; 0: it was a sweep.
    """

    frequency_hz: float
    damping: float
    explained: float
    rings: int


class ShaperCost(msgspec.Struct, frozen=True):
    """What a shaper leaves and costs.

    Attributes:
        residual: of a vibration at its frequency, worst: within a tenth beside it [1]. delay_s: of the path.
        length_s: by which an exact stop takes longer. deviation: of the axis from the delayed path at its
            acceleration limit [m or rad].
    """

    shaper: Shaper
    residual: float
    worst: float
    delay_s: float
    length_s: float
    deviation: float


def rings_of(setpoint: Array, actual: Array, cycle_s: float) -> list[Array]:
    """Return how the axis swings about its setpoint in each rest behind a move, shapes (n,)."""
    (moves,) = np.nonzero(np.diff(setpoint))
    if not len(moves):
        return []
    ends = np.append(moves[1:], len(setpoint) - 1)
    swing = actual - setpoint
    shortest, longest = round(SHORTEST_S / cycle_s), round(LONGEST_S / cycle_s)
    return [
        swing[move + 1 : min(end + 1, move + 1 + longest)]
        for move, end in zip(moves.tolist(), ends.tolist(), strict=True)
        if end - move >= shortest
    ]


def fit_stop(signal: Array, step_s: float) -> tuple[Resonance, Array, float] | None:
    """Return the vibration behind a stop that an accelerometer has measured.

    Returns:
        It, the ring that it explains, shape (n,), and the seconds between two values of that; None: none.
    """
    together = max(1, int(1.0 / (ENOUGH_HZ * step_s)))
    signal = signal[: len(signal) // together * together].reshape(-1, together).mean(axis=1)
    step_s *= together
    peak = int(np.argmax(np.abs(signal - np.median(signal))))

    def ring(start: float, span: float) -> tuple[Resonance, Array, float] | None:
        first = peak + round(start / step_s)
        ring = signal[first : first + round(span / step_s)]
        found = fit([ring], step_s) if len(ring) >= LEAST_VALUES else None
        if found is None or found.frequency_hz > HIGHEST_HZ or found.damping > MOST_DAMPING:
            return None
        return found, ring, step_s

    usual = SPANS_S[0] if SPANS_S[0] / step_s >= LEAST_VALUES else LONGEST_S
    starts = {start: each for start in STARTS_S if (each := ring(start, usual)) is not None}
    if not starts:
        return None
    best = max(starts, key=lambda start: starts[start][0].explained)
    found = [starts[best], *(each for span in SPANS_S[1:] if (each := ring(best, span)) is not None)]
    return max(found, key=lambda each: each[0].explained)


def fit_sweep(signal: Array, step_s: float) -> Resonance | None:
    """Return the vibration that shapes the spectrum of a sweep: a slow change of the frequency that shakes.

    The spectrum of the load's acceleration is that of its base times the transmissibility (Thomson, Theory of
    Vibration, 1993, ch. 3.6); that of the base is taken as a constant and a part that rises as f².
    """
    at = np.fft.rfftfreq(len(signal), step_s)
    power = np.abs(np.fft.rfft(signal - signal.mean())) ** 2
    highest = min(HIGHEST_HZ, 0.4 / step_s)
    edges = np.arange(LOWEST_HZ, highest, SPECTRUM_HZ)
    counts, _ = np.histogram(at, edges)
    sums, _ = np.histogram(at, edges, weights=power)
    if not counts.all() or not sums.any():
        return None
    spectrum, frequencies = sums / counts, 0.5 * (edges[1:] + edges[:-1])

    def left(frequency: float, damping: float) -> float:
        ratio = (frequencies / frequency) ** 2
        damped = 4.0 * damping**2 * ratio
        passed = (1.0 + damped) / ((1.0 - ratio) ** 2 + damped)
        return _beside(np.stack([passed, passed * frequencies**2], axis=1), spectrum)

    frequency, damping = _least(left, highest)
    whole = float(((spectrum - spectrum.mean()) ** 2).sum())
    return Resonance(frequency, damping, 1.0 - left(frequency, damping) / whole, 0)


def fit(rings: Sequence[Array], step_s: float) -> Resonance | None:
    """Return the vibration that explains rings best, each with its own size and phase; None without any.

    Least squares over frequency and damping; size, phase and rest position follow linearly.
    """
    rings = [ring for ring in rings if len(ring) * step_s >= SHORTEST_S / 2 and np.ptp(ring) > 0.0]
    if not rings:
        return None
    whole = math.fsum(float(((ring - ring.mean()) ** 2).sum()) for ring in rings)

    def left(frequency: float, damping: float) -> float:
        return math.fsum(_unexplained(ring, step_s, frequency, damping) for ring in rings)

    frequency, damping = _least(left, min(HIGHEST_HZ, 0.4 / step_s))
    return Resonance(frequency, damping, 1.0 - left(frequency, damping) / whole, len(rings))


def _least(left: Callable[[float, float], float], highest: float) -> tuple[float, float]:
    """Return frequency [Hz] and damping of which the least is left."""
    tried = [(f, d) for f in np.geomspace(LOWEST_HZ, highest, FREQUENCIES).tolist() for d in DAMPINGS]
    frequency, damping = min(tried, key=lambda each: left(*each))
    wide, deep = (highest / LOWEST_HZ) ** (1.0 / FREQUENCIES), 2.0
    for _ in range(REFINEMENTS):
        tried = [
            (frequency * wide**across, min(damping * deep**down, 0.5))
            for across in (-1.0, -0.5, 0.0, 0.5, 1.0)
            for down in (-1.0, -0.5, 0.0, 0.5, 1.0)
        ]
        frequency, damping = min(tried, key=lambda each: left(*each))
        wide, deep = wide**0.5, deep**0.6
    return frequency, damping


def _unexplained(ring: Array, step_s: float, frequency_hz: float, damping: float) -> float:
    """Return the sum of squares of what a vibration leaves of a ring."""
    at = np.arange(len(ring)) * step_s * frequency_hz * TURN
    damped, decay = at * np.sqrt(1.0 - damping**2), np.exp(-damping * at)
    basis = np.stack([decay * np.cos(damped), decay * np.sin(damped), np.ones(len(ring))], axis=1)
    return _beside(basis, ring)


def _beside(basis: Array, values: Array) -> float:
    """Return the sum of squares of what the columns of a basis leave of values."""
    found, *_ = np.linalg.lstsq(basis, values, rcond=None)
    return float(((values - basis @ found) ** 2).sum())


def compare_shapers(found: Resonance, axis: Axis, cycle_s: float) -> list[ShaperCost]:
    """Return what each shaper leaves and costs on an axis, the shortest first."""
    costs = []
    for kind in get_args(ShaperType):
        # no more digits than a measurement has
        shaper = Shaper(kind, round(found.frequency_hz, 2), round(min(found.damping, 0.5), 4))
        shaping = Shaping.of([msgspec.structs.replace(axis, shaper=shaper, tool_shapers={})], cycle_s)
        assert shaping is not None
        beside = np.linspace(1.0 - BESIDE, 1.0 + BESIDE, 21) * found.frequency_hz
        costs.append(
            ShaperCost(
                shaper=shaper,
                residual=shaper.residual(found.frequency_hz, found.damping),
                worst=max(shaper.residual(each, found.damping) for each in beside.tolist()),
                delay_s=shaping.delay * cycle_s,
                length_s=shaping.length * cycle_s,
                deviation=shaping.deviations[0],
            )
        )
    return costs


def proposed(costs: Sequence[ShaperCost]) -> ShaperCost:
    """Return the shortest shaper that leaves little enough beside its frequency, else that with the least."""
    good = [cost for cost in costs if cost.worst <= 1.02 * RESIDUAL]
    return good[0] if good else min(costs, key=lambda cost: cost.worst)
