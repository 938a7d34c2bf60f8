"""The playback rate of a program: overrides and feed hold along the path, within every axis's limits.

With the path Q(u) of the rows, setpoints are Q(u_k) for the cycles k. A change of rate is an s-curve of r,
tried on the very setpoints that it would give: only one whose first, second and third differences keep the
velocity, acceleration and jerk of every axis is followed. Each plan ends at a steady rate of 100 % or less,
or at rest, from where rows can always be played on. So a plan can be followed to its end whatever comes; a
new order replaces it as soon as a change is found that keeps all limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mcserver.executor.headroom import RATE_MAX, Array
from mcserver.executor.playback.path_window import PathWindow
from mcserver.executor.playback.playback import NEAR_U, Playback
from mcserver.executor.playback.rate_plan import (
    SAME_RATE,
    RateLimits,
    RatePhase,
    RatePlan,
    ramp,
    total_advance,
    total_time,
)
from mcserver.executor.shm.rings import ProgramRing
from mcserver.machine.machine_file import Machine

# Shares of the limits that a change of rate is tried with, the fastest first: more of them find a faster
# change where rows leave little, and each try costs some 0.2 ms of one cycle.
SHARES = (1.0, 0.85, 0.65, 0.4, 0.2, 0.08)
# Changes that are tried in one cycle; the other shares follow in the next ones.
TRIES = 3
# What differences at the cycle rate may pass the limits by, inside the 100.1 %, 101 % and 105 % that
# velocity, acceleration and jerk are judged at; what rows do themselves is allowed in any case.
VELOCITY_SLACK, ACCELERATION_SLACK, JERK_SLACK = 1.0005, 1.004, 1.04
# Cycles of steady rate at a plan's end, in which the third difference settles.
SETTLING = 3
# Cycles that a rate above 100 % is kept before it is looked at again: fewer follow the rows' limits more
# closely, and cost more.
CRUISE = 12
# Largest slope of the rate, where axes hardly move [1/cycle].
MAX_SLOPE = 0.5
# What an axis may move in a cycle on an edge on which its rows are at rest [m, rad].
AT_REST = 1e-12
# A rate above 100 % is not tried for less than this [1].
WORTH = 0.01
# Cycles without a change that keeps all limits, after which a stop is made with the one that passes them
# least.
PATIENCE = 250
# Longest wait for a change to 100 % to begin so that u meets the rows [cycles].
LONGEST_LAG = 100.0
# Rows ahead without which a stop may be near, beside the distance of the longest stop.
NEAR_ROWS = 8.0


@dataclass(frozen=True)
class _Wish:
    """What is to be had: the rate, where u has to stop before, and whether jerk does not count."""

    target: float
    edge: float | None
    urgent: bool


class RateControl:
    """The rate of one slot.

    Attributes:
        rate: at the end of this cycle [1].
    """

    def __init__(self, ring: ProgramRing, playback: Playback, machine: Machine) -> None:
        self._ring = ring
        self._playback = playback
        dt = machine.cycle_s
        self._cycle = dt
        self._velocity = np.array([axis.max_velocity for axis in machine.axes]) * dt
        self._acceleration = np.array([axis.max_acceleration for axis in machine.axes]) * dt**2
        self._jerk = np.array([axis.max_jerk for axis in machine.axes]) * dt**3
        stop = max(
            axis.max_velocity / axis.max_acceleration
            + (axis.max_acceleration / axis.max_jerk if math.isfinite(axis.max_jerk) else 0.0)
            for axis in machine.axes
        )
        # rows that a stop from 100 % takes at the most, with the least share but one that it is tried with
        self._far = 0.75 * stop / dt + NEAR_ROWS
        self.rate = 1.0
        self._slope = 0.0
        self._plan: RatePlan | None = None
        self._wish: _Wish | None = None
        self._passed = 0
        self._origin = 0.0
        self._refused = 0

    def jump(self, rate: float) -> None:
        """Set the rate at once: nothing moves by it."""
        self.rate = rate
        self._slope = 0.0
        self._plan = None
        self._refused = 0

    @property
    def steady(self) -> bool:
        """Whether rows are played one a cycle, with no change of the rate under way."""
        return self._plan is None and self.rate == 1.0

    def rows_before(self, u: float, edge: float) -> int:
        """Return the rows that u may pass before a stop at an edge has to be thought of."""
        return max(0, int(edge - u - self._far) - 1)

    def advance(self, u: float, target: float, edge: float | None, *, urgent: bool) -> float:
        """Step one cycle towards ``target``; return the rows that u passes in it.

        Args:
            u: at the cycle's beginning. edge: u before which the motion has to be able to stop; None: it ends
                by itself. urgent: stop without regard to jerk.
        """
        wish = _Wish(target, edge, urgent)
        plan = self._plan
        if plan is not None and abs(self._origin + self._at(self._passed) - u) > 1e-6:
            # a barrier or an edge has kept u back
            plan = self._plan = None
        if self._is_due(u, wish):
            found = self._search(u, wish)
            if found is not None:
                self._plan = plan = found
                self._wish = wish
                self._passed, self._origin, self._refused = 0, u, 0
            else:
                self._refused += 1
        if plan is None:
            self._slope = 0.0
            return self.rate
        before = self._at(self._passed)
        self.rate, self._slope = float(plan.rate[self._passed]), float(plan.slope[self._passed])
        self._passed += 1
        after = self._at(self._passed)
        if self._passed >= len(plan):
            self.rate, self._slope, self._plan = plan.target, 0.0, None
        return after - before

    def _at(self, cycles: int) -> float:
        """Return what u has passed after some cycles of the plan."""
        return float(self._plan.advance[cycles - 1]) if self._plan is not None and cycles > 0 else 0.0

    # ------------------------------------------------------------------ when

    def _is_due(self, u: float, wish: _Wish) -> bool:
        """Return whether a new plan is needed, or may be better."""
        plan, had = self._plan, self._wish
        near = self._is_near(u, wish.edge)
        if plan is None:
            if wish.target > 1.0 and self.rate == 1.0 and not near:
                return self._cap(3) > 1.0 + WORTH
            return abs(wish.target - self.rate) > SAME_RATE or (near and self.rate > 0.0)
        assert had is not None
        if wish.target != had.target or wish.urgent != had.urgent:
            return True
        if wish.target > 1.0:
            # what is left of the plan is the way back to 100 %
            return (len(plan) - self._passed) % CRUISE == 0 or self._passed == CRUISE
        if wish.edge != had.edge and (near or plan.target < wish.target):
            return True
        return self._refused > 0

    def _is_near(self, u: float, edge: float | None) -> bool:
        """Return whether a stop before an edge may have to begin soon."""
        return edge is not None and edge - u < self._far * max(1.0, self.rate)

    # ------------------------------------------------------------------ what

    def _search(self, u: float, wish: _Wish) -> RatePlan | None:
        """Return the fastest plan found that keeps all limits."""
        target = min(wish.target, RATE_MAX)
        ahead = self._far * 2.0 * max(1.0, self.rate, target) + 4 * CRUISE
        window = self._playback.window(u, math.ceil(ahead))
        if window is None:
            return None
        recent = self._playback.recent(window.columns)
        change = max(abs(target - self.rate), 0.1)
        if self._is_near(u, wish.edge):
            change = max(self.rate, min(target, 1.0))
        base = self._limits(window, u, change, max(self.rate, target))
        if wish.urgent:
            base = RateLimits(base.slope, math.inf)
        whole = self._to_rest(window, u, wish)
        if whole is not None and self._excess(window, recent, u, whole, wish) <= 1.0:
            return whole
        least, spare, tries = math.inf, None, 0
        at = TRIES * self._refused % len(SHARES)
        for share in (*SHARES[at:], *SHARES[:at]):
            limits = base.scaled(share)
            for phases, end in self._candidates(u, target, wish.edge, limits):
                plan = RatePlan.of(phases, end, SETTLING)
                over = self._excess(window, recent, u, plan, wish)
                if over <= 1.0:
                    return plan
                if over < least:
                    least, spare = over, plan
                tries += 1
            if tries >= TRIES:
                break
        must_stop = wish.edge is not None and wish.edge - u < 2.0 * self.rate
        if must_stop or (target < self.rate and self._refused >= (4 if wish.urgent else PATIENCE)):
            return spare
        return None

    def _to_rest(self, window: PathWindow, u: float, wish: _Wish) -> RatePlan | None:
        """Return the plan that keeps this rate to an edge on which the rows come to rest by themselves."""
        edge = wish.edge
        if (
            edge is None
            or not self._is_near(u, edge)
            or self._slope != 0.0
            or not 0.0 < self.rate <= wish.target
        ):
            return None
        on_edge = np.abs(window.u - edge) < NEAR_U
        if not on_edge.any() or float(np.abs(window.velocity[on_edge]).max()) * self._cycle > AT_REST:
            return None
        return RatePlan.of([RatePhase((edge - u) / self.rate, self.rate, 0.0, 0.0)], 0.0, SETTLING)

    def _limits(self, window: PathWindow, u: float, change: float, fastest: float) -> RateLimits:
        """Return the rate's limits over the rows that a change by ``change`` passes, were they straight."""
        reach = 16.0
        for _ in range(2):
            rows = (window.u >= u - 1.0) & (window.u <= u + reach)
            speed = np.abs(window.velocity[rows]).max(axis=0, initial=0.0) * self._cycle + 1e-30
            columns = window.columns
            slope = float((self._acceleration[columns] / speed).min(initial=MAX_SLOPE))
            curvature = float((self._jerk[columns] / speed).min(initial=math.inf))
            if math.isfinite(curvature):
                curvature = min(curvature, MAX_SLOPE)
            reach = (change / slope + slope / curvature) * fastest + 4.0
        return RateLimits(slope, curvature)

    def _candidates(
        self, u: float, target: float, edge: float | None, limits: RateLimits
    ) -> list[tuple[list[RatePhase], float]]:
        """Return phases and the steady rates that they end with."""
        rate, slope = self.rate, self._slope
        if edge is not None and self._is_near(u, edge):
            return self._before_edge(edge - u, min(target, 1.0), limits)
        if target <= 1.0:
            phases = ramp(rate, slope, target, limits)
            return [(_met(u, rate, slope, target, limits) if target == 1.0 else phases, target)]
        found: list[tuple[float, list[RatePhase]]] = []
        cap = self._cap(2 * CRUISE + 8)
        for goal in (target, min(target, cap), rate):
            if goal > 1.0 + WORTH and all(abs(goal - other) > WORTH for other, _ in found):
                phases = ramp(rate, slope, goal, limits)
                steady = RatePhase(float(CRUISE), goal, 0.0, 0.0)
                found.append((goal, [*phases, steady, *ramp(goal, 0.0, 1.0, limits)]))
        candidates = [(phases, 1.0) for _, phases in found]
        if self._plan is None and abs(rate - 1.0) > SAME_RATE:
            candidates.append((_met(u, rate, slope, 1.0, limits), 1.0))
        return candidates

    def _before_edge(
        self, room: float, target: float, limits: RateLimits
    ) -> list[tuple[list[RatePhase], float]]:
        """Return a plan that ends at rest on an edge, ``room`` rows ahead, as fast as that allows."""
        rate, slope = self.rate, self._slope

        def by(goal: float) -> tuple[list[RatePhase], list[RatePhase], float]:
            there, stop = ramp(rate, slope, goal, limits), ramp(goal, 0.0, 0.0, limits)
            return there, stop, room - total_advance(there) - total_advance(stop)

        there, stop, left = by(target)
        low, goal = 0.0, target
        if left < 0.0:
            high = target
            for _ in range(30):
                middle = 0.5 * (low + high)
                if by(middle)[2] >= 0.0:
                    low = middle
                else:
                    high = middle
            goal = low
            there, stop, left = by(goal)
        if left < 0.0:
            return []
        if goal <= 1e-3:
            return [(there, 0.0)]
        return [([*there, RatePhase(left / goal, goal, 0.0, 0.0), *stop], 0.0)]

    def _cap(self, rows_ahead: int) -> float:
        """Return the greatest rate that the next rows allow by themselves."""
        ring, playback = self._ring, self._playback
        first = max(playback.following - 1, playback.first)
        last = min(first + rows_ahead, ring.rows_written - 1)
        if last < first:
            return 1.0
        rows = np.arange(first, last + 1) % ring.rows
        return float(ring.headroom[rows].min())

    # ------------------------------------------------------------------ whether

    def _excess(self, window: PathWindow, recent: Array, u: float, plan: RatePlan, wish: _Wish) -> float:
        """Return by what a plan's setpoints pass the limits at the worst, 1 within them; infinite: never to
        be driven.

        Args:
            recent: setpoints of the last cycles, the newest last, shape (4, K).
        """
        if len(plan) == 0:
            return 1.0
        if float(plan.rate.min()) < -1e-9 or float(plan.advance[0]) < -1e-9:
            return math.inf
        at = u + plan.advance
        end = float(at[-1])
        if wish.edge is not None and end > wish.edge + 1e-6:
            return math.inf
        if wish.edge is not None and plan.target > 0.0 and wish.edge - end < self._far:
            # nothing is looked for while a plan is followed: behind it there has to be room for a stop
            return math.inf
        if end > float(window.u[-1]) + 1e-6 and not window.ends:
            return math.inf
        setpoints = np.concatenate((recent[-3:], window.at(at)))
        columns = window.columns
        limits = (
            self._velocity[columns] * VELOCITY_SLACK,
            self._acceleration[columns] * ACCELERATION_SLACK,
            self._jerk[columns] * JERK_SLACK,
        )
        row = np.clip(np.searchsorted(window.u, at, side="right"), 0, len(window.u) - 1)
        worst = 0.0
        differences = setpoints
        for order, (limit, own) in enumerate(zip(limits, window.row_differences(), strict=True), start=1):
            differences = np.diff(differences, axis=0)
            if order == 3 and (wish.urgent or not np.isfinite(limit).any()):
                break
            here = np.abs(differences[3 - order :])
            allowed = np.maximum(limit, _around(own)[row])
            worst = max(worst, float((here / allowed).max(initial=0.0)))
        return worst if worst > 1.0 else 1.0


def _around(own: Array) -> Array:
    """Return the greatest value of each row and the rows that setpoints about it span, shape (m, K)."""
    found = own.copy()
    for shift in range(1, 7):
        np.maximum(found[shift:], own[:-shift], out=found[shift:])
    np.maximum(found[:-1], own[1:], out=found[:-1])
    return found


def _met(u: float, rate: float, slope: float, target: float, limits: RateLimits) -> list[RatePhase]:
    """Return the change to 100 % that ends with u on whole rows, which are then played as they are.

    The change begins a little later, at most as long as u takes to fall back by a row or to gain one.
    """
    phases = ramp(rate, slope, target, limits)
    if abs(rate - 1.0) <= SAME_RATE or slope != 0.0:
        return phases
    # on whole cycles u is off the rows by this share
    off = (u + total_advance(phases) - total_time(phases)) % 1.0
    if min(off, 1.0 - off) < NEAR_U:
        return phases
    lag = off / (1.0 - rate) if rate < 1.0 else (1.0 - off) / (rate - 1.0)
    if lag > LONGEST_LAG:
        return phases
    return [RatePhase(lag, rate, 0.0, 0.0), *phases]
