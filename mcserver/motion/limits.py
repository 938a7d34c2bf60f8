"""What the axes' limits allow along a path coordinate σ, as a function of speed.

With q(σ) the path, q̇ = q'σ̇, q̈ = q'σ̈ + q''σ̇² and q⃛ = q'σ⃛ + 3q''σ̇σ̈ + q'''σ̇³. At a speed v each axis leaves
|q'|·A ≤ a - |q''|v² for acceleration along the path, and likewise for jerk. A vertex of a polyline is
a step of the tangent by D: at the cycle rate it asks for the acceleration D·v·max(1/dt, v/ℓ), ℓ being
the length of the segments about it (several vertices may fall into one cycle). Limits are judged so by D-36.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.path import Array, LineCurve, PolynomialCurve, SampledCurve
from mcserver.motion.segment import AxisLimits, Segment

# Share of the acceleration that curvature may take at top speed; the rest is left for the way there.
CURVATURE_SHARE = 0.97
# Share of the jerk that curvature alone may take.
JERK_SHARE = 0.9
# A vertex between segments that last many cycles is passed in one cycle: half of the limit is left beside it.
VERTEX_SHARE = 0.5
# Speeds of the rungs below the top one, as shares of the top speed.
RUNGS = (0.45, 0.65, 0.8, 0.9, 0.96)
# Top speeds leave at least this share of the acceleration and jerk that are free at rest.
LEAST_FREE = 0.01
# Short segments that turn by less than this are a polyline in place of a curve [rad].
POLYLINE_TURN = 0.35
# A joint that can be passed at no more than this many times max_acceleration·dt is a stop.
CRAWL = 10.0

_TINY = 1e-300
_HUGE = 1e100


@dataclass(frozen=True)
class Demand:
    """Samples of a path's derivatives with respect to σ, absolute values, shape (m, K) each.

    ``slope``, ``bend``, ``twist`` are |q'|, |q''|, |q'''|; ``step`` is a vertex's |Δq'| and
    ``spacing`` (m,) its ℓ [m]; ``kick`` is a step of the bend, |Δq''|, where a line meets an arc.
    ``ceiling`` (m,) are speeds that are not passed at the sample whatever its segment allows: at a
    vertex that of the joint.
    """

    slope: Array
    bend: Array
    twist: Array
    step: Array
    spacing: Array
    kick: Array
    ceiling: Array

    @staticmethod
    def stack(parts: list[Demand]) -> Demand:
        return Demand(
            slope=np.concatenate([part.slope for part in parts]),
            bend=np.concatenate([part.bend for part in parts]),
            twist=np.concatenate([part.twist for part in parts]),
            step=np.concatenate([part.step for part in parts]),
            spacing=np.concatenate([part.spacing for part in parts]),
            kick=np.concatenate([part.kick for part in parts]),
            ceiling=np.concatenate([part.ceiling for part in parts]),
        )


@dataclass(frozen=True)
class Level:
    """Up to speed ``velocity`` these accelerations and jerks are free along the path (SI along σ)."""

    velocity: float
    acceleration: float
    jerk: float


@dataclass(frozen=True)
class SpeedLimit:
    """Greatest speed along σ and what bounds it: (column, "velocity" | "acceleration" | "jerk")."""

    velocity: float
    column: int
    kind: str


def samples_of(segment: Segment, width: int) -> Demand:
    """Demand of one segment in its coordinate σ = s·scale."""
    simple = all(isinstance(curve, LineCurve) for curve in segment.curves)
    if simple:
        slope = np.abs(segment.first)[None, :] / segment.scale
        zero = np.zeros_like(slope)
        return Demand(slope, zero, zero, zero, np.full(1, math.inf), zero, np.full(1, math.inf))
    count = 2
    for curve in segment.curves:
        if isinstance(curve, SampledCurve):
            count = max(count, 4 * (len(curve.knots) - 1) + 1)
        elif isinstance(curve, PolynomialCurve):
            count = max(count, 33)
        elif not isinstance(curve, LineCurve):
            # derivatives of a circle repeat after one turn: 128 points a turn miss an extreme by 0.03 %
            sweep = abs(getattr(curve, "sweep", 2.0 * math.pi))
            count = max(count, min(129, 3 + int(128 * min(sweep, 2.0 * math.pi) / (2.0 * math.pi))))
    s = np.linspace(0.0, 1.0, count)
    sweeps = [abs(getattr(curve, "sweep", 0.0)) for curve in segment.curves]
    if max(sweeps) > 2.0 * math.pi and not any(
        isinstance(curve, SampledCurve | PolynomialCurve) for curve in segment.curves
    ):
        s = s * (2.0 * math.pi / max(sweeps))
    slope, bend, twist = segment.derivatives(s, width)
    scale = segment.scale
    return Demand(
        slope=np.abs(slope) / scale,
        bend=np.abs(bend) / scale**2,
        twist=np.abs(twist) / scale**3,
        step=np.zeros_like(slope),
        spacing=np.full(len(s), math.inf),
        kick=np.zeros_like(slope),
        ceiling=np.full(len(s), math.inf),
    )


def speed_limit(demand: Demand, limits: AxisLimits) -> SpeedLimit:
    """Greatest constant speed that the axes allow on the samples (vertices not counted)."""
    with np.errstate(divide="ignore", over="ignore"):
        by_velocity = (limits.velocity / np.maximum(demand.slope, _TINY)).min(axis=0)
        choices = [(by_velocity, "velocity")]
        if demand.bend.any():
            by_bend = np.sqrt(CURVATURE_SHARE * limits.acceleration / np.maximum(demand.bend, _TINY)).min(
                axis=0
            )
            by_twist = np.cbrt(JERK_SHARE * limits.jerk / np.maximum(demand.twist, _TINY)).min(axis=0)
            choices += [(by_bend, "acceleration"), (by_twist, "jerk")]
    best = SpeedLimit(math.inf, 0, "velocity")
    for values, kind in choices:
        column = int(np.argmin(values))
        if values[column] < best.velocity:
            best = SpeedLimit(float(values[column]), column, kind)
    return best


def _ripple(apart: Array) -> Array:
    """How much more than on average vertices ``apart`` ≤ 1 cycles from each other weigh at the worst cycle.

    A second difference weighs them with a hat of two cycles. With f the fraction of 1/r, its sum over
    points r apart is at most (1 + r² f (1 - f)) / r; below 2/3 the bound f (1 - f) ≤ 1/4 serves, which
    has no jumps.
    """
    ripple: Array = np.where(apart < 2.0 / 3.0, apart * apart / 4.0, (1.0 - apart) * (2.0 * apart - 1.0))
    return ripple


def _free(demand: Demand, limits: AxisLimits, speed: Array) -> tuple[Array, Array]:
    """Acceleration and jerk along σ that each sample's axes leave free at ``speed`` (m,), shape (m,) each."""
    slope = np.maximum(demand.slope, _TINY)
    v = speed[:, None]
    taken = demand.bend * (v * v)
    if demand.step.any():
        apart = np.minimum(demand.spacing / np.maximum(speed * limits.cycle, _TINY), 1.0)
        crowd = (1.0 + _ripple(apart)) / apart / limits.cycle
        taken = taken + demand.step * (speed * crowd)[:, None]
    acceleration: Array = ((limits.acceleration - taken) / slope).min(axis=1)
    # a step of the acceleration within a cycle looks like this jerk at the cycle rate (peak of the
    # quadratic B-spline that a third difference is)
    left = limits.jerk - demand.twist * v**3 - demand.kick * (0.75 / limits.cycle * v * v)
    coupling = 3.0 * demand.bend * v
    if coupling.any():
        # half of what is left of the jerk is the most that acceleration across the bend may use
        allowed = np.where(coupling > 0.0, 0.5 * left / np.maximum(coupling, _TINY), math.inf).min(axis=1)
        acceleration = np.minimum(acceleration, allowed)
        left = left - coupling * np.maximum(acceleration, 0.0)[:, None]
    jerk: Array = (left / slope).min(axis=1)
    # an axis that does not move limits nothing: its quotient is huge, not infinite
    jerk[jerk > _HUGE] = math.inf
    return acceleration, jerk


class RunLimits:
    """Limits of all segments of a run, prepared once for many questions about stretches of it.

    Args:
        demands: one for each segment. starts: first segments of the groups that questions are about, (n,).
        tops: greatest speeds of the groups (n,); lowered where a speed would leave hardly any acceleration
            or jerk to get to it.
    """

    def __init__(
        self, demands: list[Demand], starts: NDArray[np.intp], tops: Array, limits: AxisLimits
    ) -> None:
        self._limits = limits
        self._ladders: dict[tuple[int, int], list[Level]] = {}
        self._demand = Demand.stack(demands) if len(demands) > 1 else demands[0]
        ends = np.concatenate([[0], np.cumsum([len(demand.spacing) for demand in demands])])
        self._offset = ends[np.append(starts, len(demands))]
        counts = np.diff(self._offset)
        first = self._offset[:-1]
        rest, rest_jerk = _free(self._demand, limits, np.zeros(int(self._offset[-1])))
        full = np.minimum.reduceat(rest, first)
        full_jerk = np.minimum.reduceat(rest_jerk, first)
        self.tops = tops.copy()
        for _ in range(200):
            self._ceiling = np.minimum(np.repeat(self.tops, counts), self._demand.ceiling)
            acceleration, jerk = _free(self._demand, limits, self._ceiling)
            self._weak = np.minimum.reduceat(acceleration, first)
            self._weak_jerk = np.minimum.reduceat(jerk, first)
            short = self._weak < LEAST_FREE * full
            short |= np.isfinite(full_jerk) & (self._weak_jerk < LEAST_FREE * full_jerk)
            if not short.any():
                break
            self.tops[short] *= 0.98

    def weakest(self, left: int, right: int) -> tuple[float, float]:
        """Acceleration and jerk that are free at every speed on segments ``left`` … ``right`` - 1."""
        return float(self._weak[left:right].min()), float(self._weak_jerk[left:right].min())

    def ladder(self, left: int, right: int) -> list[Level]:
        """A ladder of speeds up to the stretch's top with what is free up to each; one where bends
        hardly count.

        Low speeds leave nearly all of the acceleration to the way along the path, the top speed little: the
        ladder lets a start from rest use what is there.
        """
        known = self._ladders.get((left, right))
        if known is None:
            known = self._ladders[left, right] = self._make_ladder(left, right)
        return known

    def _make_ladder(self, left: int, right: int) -> list[Level]:
        samples = slice(int(self._offset[left]), int(self._offset[right]))
        part = Demand(*(getattr(self._demand, name)[samples] for name in _DEMAND_FIELDS))
        ceiling = self._ceiling[samples]
        top = float(self.tops[left:right].max())
        at_top, jerk_at_top = self.weakest(left, right)
        full, full_jerk = (float(x.min()) for x in _free(part, self._limits, np.zeros(len(ceiling))))
        if at_top >= 0.9 * full and not (math.isfinite(full_jerk) and jerk_at_top < 0.9 * full_jerk):
            return [Level(top, at_top, jerk_at_top)]
        result: list[Level] = []
        low = float(self.tops[left:right].min())
        shares = RUNGS if top <= low * 1.001 else (*RUNGS, 1.0)
        for share in shares:
            free, jerk = _free(part, self._limits, np.minimum(ceiling, share * low))
            result.append(Level(share * low, float(free.min()), float(jerk.min())))
        return [*result, Level(top, at_top, jerk_at_top)]


_DEMAND_FIELDS = ("slope", "bend", "twist", "step", "spacing", "kick", "ceiling")


@dataclass(frozen=True)
class Junction:
    """How two segments meet: greatest speed over the joint, and what it asks of the one before and after."""

    speed: float
    before: Demand | None
    after: Demand | None


def junction(before: Segment, after: Segment, limits: AxisLimits) -> Junction:
    """Speed over the joint of two segments whose coordinates are scaled alike (D-35, D-36).

    The velocity of an axis may step by max_acceleration·dt, its acceleration by max_jerk·dt. Where that
    leaves less than a crawl, the motion stops there: a stop costs hardly more and keeps the jerk limit too.
    """
    t1 = before.last / before.scale
    t2 = after.first / after.scale
    step: Array = np.abs(t2 - t1)
    cycle = limits.cycle
    along: Array = np.maximum(np.abs(t1), np.abs(t2))
    worst = float((step / limits.acceleration).max())
    speed = math.inf
    spacing = min(before.scale, after.scale)
    if worst > 1e-12:
        speed = VERTEX_SHARE * cycle / worst
        isolated = True
        dense = math.sqrt(CURVATURE_SHARE * spacing / worst)
        crowd = 1.0 + float(_ripple(np.array(min(1.0, spacing / (dense * cycle)))))
        dense /= math.sqrt(crowd)
        turn = math.sqrt(float(step @ step) / float(t1 @ t1))
        if turn < POLYLINE_TURN and spacing < 10.0 * cycle * dense:
            # many short segments: a polyline stands for a curve, and the speed is that of the curve
            speed = min(CURVATURE_SHARE * cycle / worst, dense)
            isolated = False
        with np.errstate(divide="ignore"):
            crawl = CRAWL * cycle * float((limits.acceleration / np.maximum(along, _TINY)).min())
        if isolated and speed < crawl:
            return Junction(0.0, None, None)
    # beside a vertex the bend of an arc takes its part of the same axis's acceleration
    bend: Array = np.maximum(
        np.abs(before.bend_last) / before.scale**2, np.abs(after.bend_first) / after.scale**2
    )
    if worst > 1e-12 and bend.any():
        speed = min(speed, _speed_at_bent_vertex(step / (cycle * VERTEX_SHARE), bend, limits.acceleration))
    kick: Array = np.abs(after.bend_first / after.scale**2 - before.bend_last / before.scale**2)
    sharpest = float((kick / limits.jerk).max())
    if sharpest > 0.0:
        speed = min(speed, math.sqrt(VERTEX_SHARE * cycle / sharpest))
    if math.isinf(speed):
        return Junction(speed, None, None)
    zero = np.zeros((1, len(step)))
    asked, other = (
        Demand(
            slope=np.abs(tangent)[None, :],
            bend=bend[None, :],
            twist=zero,
            step=step[None, :],
            spacing=np.full(1, spacing),
            kick=kick[None, :],
            ceiling=np.full(1, speed),
        )
        for tangent in (t1, t2)
    )
    return Junction(speed, asked, other)


def _speed_at_bent_vertex(step: Array, bend: Array, acceleration: Array) -> float:
    """Greatest v with step·v + bend·v² ≤ acceleration in every axis."""
    share = CURVATURE_SHARE * acceleration
    root = np.sqrt(step * step + 4.0 * bend * share)
    return float((2.0 * share / np.maximum(step + root, _TINY)).min())
