"""The playback rate of a program: overrides and feed hold along the path, within every axis's limits.

With the path Q(u) of the rows, setpoints are Q(u_k) for the cycles k. A change of rate is an s-curve of r,
tried on the very setpoints that it would give (`motion/kernels/rate_search.py`, a bounded number of them a
cycle): only one whose first, second and third differences keep the velocity, acceleration and jerk of every
axis, and whose torques keep those of every joint, is followed. Each plan ends at a steady rate of 100 % or
less, or at rest, from where rows can always be played on. So a plan can be followed to its end whatever
comes; a new order replaces it as soon as a change is found that keeps all limits. Rows of a greater pace than
one a cycle may be played at that: where all rows ahead have one, the least of them is as safe as 100 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mcserver.executor.entries import Array
from mcserver.executor.headroom import RATE_MAX, longest_stop
from mcserver.executor.playback.playback import Playback, RowWindow
from mcserver.executor.playback.rate_plan import RatePlan
from mcserver.executor.shm.rings import ProgramRing
from mcserver.machine.machine_file import Machine
from mcserver.motion.geometry.row_torques import NUMBERS
from mcserver.motion.kernels.rate_changes import MOST_PHASES, SAME_RATE
from mcserver.motion.kernels.rate_search import (
    CRUISE,
    TRIES,
    WORTH,
    headroom_ahead,
    keeps_limits,
    safe_rates,
    search_rate,
)
from mcserver.motion.kernels.rate_trial import SETTLING
from mcserver.motion.kernels.rate_window import SCRATCH

# What differences at the cycle rate may pass the limits by, inside the 100.1 %, 101 % and 105 % that
# velocity, acceleration and jerk are judged at; what rows do themselves is allowed in any case.
VELOCITY_SLACK, ACCELERATION_SLACK, JERK_SLACK = 1.0005, 1.004, 1.04
# Cycles without a change that keeps all limits. Motion that stands goes on a little way after as many without
# new rows either: the gentle change may only lack room. After twice as many the one that passes the limits
# least is made: rows whose vertices pass a jerk limit let no other through, and motion would stand for good.
# The second number is that of an emergency stop, for which such a change is made at once after it.
PATIENCE, URGENT_PATIENCE = 250, 4
# The same while a stop before an edge has to begin: later there is room for worse ones only.
NEAR_PATIENCE = 6
# Cycles in which only whole changes at full pace are tried: they may merely have to wait for a moment.
QUICK_TRIES = 8
# A change that takes longer than this goes slowly: a quicker one is looked for on the way [cycles].
SLOW_CYCLES = 4 * CRUISE
# Share of the rows in which a stop is near, at 100 %, from which on that patience counts.
NEAR_ROOM = 0.6
# Rows ahead without which a stop may be near, beside the distance of the longest stop.
NEAR_ROWS = 8.0
# Rows ahead at most, at a rate of 1, of those from which on a higher rate is safe, for it to be changed to.
SOON = 64.0
# Share of the rows in which a stop is near, that motion goes on by where there is no room for more.
LITTLE_WAY = 0.99
# Shares of its rate at which a motion may begin right behind another: the first one that keeps all limits.
BEGINNING = (1.0, 0.75, 0.5, 0.25)

# Where no rate above 100 % is to be had: the safe rate, and that no higher one follows.
_ALL_PLAIN = (1.0, math.inf, 1.0)


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
        velocity = np.array([axis.max_velocity for axis in machine.axes]) * dt
        acceleration = np.array([axis.max_acceleration for axis in machine.axes]) * dt**2
        jerk = np.array([axis.max_jerk for axis in machine.axes]) * dt**3
        self._limits = np.stack(
            [
                velocity * VELOCITY_SLACK,
                acceleration * ACCELERATION_SLACK,
                jerk * JERK_SLACK,
                acceleration,
                jerk,
                *playback.bounds,
            ]
        )
        self._stop = longest_stop(machine) / dt
        self._torques = ring.torque
        # where nothing is to be looked at
        self._no_torques = np.zeros((ring.rows, NUMBERS, 0))
        self._has_torques = self._torques.shape[2] > 0
        # the search's own memory: nothing is allocated in a cycle
        places = 2 * ring.rows + 2
        self._places, self._at = np.zeros(places), np.zeros(places, np.int64)
        self._scratch = np.zeros((SCRATCH, len(machine.axes)))
        self._phases, self._spare = np.zeros((MOST_PHASES, 4)), np.zeros((MOST_PHASES, 4))
        self.rate = 1.0
        self._slope = 0.0
        self._plan: RatePlan | None = None
        self._wish: _Wish | None = None
        self._passed = 0
        self._origin = 0.0
        self._refused = 0
        self._edge: float | None = None
        self._delayed = False
        self._tries = 0
        self._last_u = math.nan
        self._ahead = _ALL_PLAIN
        # of a motion that stands at its beginning: the edge, and how often and where it was searched for
        self._begun: tuple[float | None, int, int] = (None, 0, 0)

    def jump(self, rate: float) -> None:
        """Set the rate at once: nothing moves by it."""
        self.rate = rate
        self._slope = 0.0
        self._plan = None
        self._refused = self._tries = 0
        self._last_u = math.nan

    @property
    def _far(self) -> float:
        """Rows before an edge from which on a stop there is thought of."""
        # two and a half times the rows that a stop from 100 % takes: where rows brake before the edge with
        # all that an axis has, only who was slow before that can stop on it
        stop = max(self._stop, self._ring.torque_stop) if self._has_torques else self._stop
        return 1.25 * stop + NEAR_ROWS

    @property
    def steady(self) -> bool:
        """Whether rows are played one a cycle, with no change of the rate under way."""
        return self._plan is None and self.rate == 1.0

    def decided_until(self, u: float) -> float:
        """Return up to where rows are passed by the change of the rate that is followed."""
        plan = self._plan
        return u if plan is None else self._origin + plan.at(len(plan))[0]

    def safe_rate(self, u: float) -> float:
        """Return the rate at which all rows ahead may be played [1]."""
        return self._look_ahead(u)[0]

    def _look_ahead(self, u: float) -> tuple[float, float, float]:
        """Return the safe rate, the u from which on a higher one is safe (infinite: none soon), and that."""
        ring, playback = self._ring, self._playback
        playback.seek(u)
        until = u + SOON * max(1.0, self.rate)
        first, written = playback.following, playback.written
        return safe_rates(ring.pace, ring.velocity, ring.row_u, first, written, until)

    def beginning_rate(self, u: float, wanted: float, rate: float, left: float, edge: float | None) -> float:
        """Return the rate at which a motion goes on from its beginning at u, right behind another: the wanted
        one, or the first share of ``rate`` that keeps all limits with the setpoints before; else ``rate``.

        Args:
            left: share of this cycle that is left for it. edge: as of `advance`.
        """
        tried = dict.fromkeys((wanted, *(share * rate for share in BEGINNING)))
        return next((each for each in tried if self._may_begin(u, each, left, edge)), rate)

    def _may_begin(self, u: float, rate: float, left: float, edge: float | None) -> bool:
        """Return whether a motion that begins at u goes well with the setpoints before at a steady rate."""
        window = self._playback.window(u, math.ceil((SETTLING + 2) * RATE_MAX))
        if window is None:
            return False
        # as if it had begun with the cycle, so far before its beginning
        early = u - (1.0 - left) * rate
        state = self._state(early, (rate, 0.0, rate), edge, window.begun, rate, (rate, math.inf, rate))
        return self._keeps_limits(window, state, 0)

    def may_go_on(self, u: float, edge: float | None) -> bool:
        """Return whether the change of the rate under way keeps all limits on the rows as they are now, and
        leaves room for a stop: they may be others than those that it was found for.

        Args:
            u: at the cycle's beginning. edge: as of `advance`.
        """
        plan, passed = self._plan, u - self._last_u
        if plan is None:
            return True
        before = 0.0 if self._passed == 0 else plan.at(self._passed)[0]
        if abs(self._origin + before - u) > 1e-6 or not 0.0 <= passed <= RATE_MAX + SAME_RATE:
            return False
        ahead = self.decided_until(u) - u + (SETTLING + 2) * RATE_MAX
        window = self._playback.window(u, math.ceil(ahead))
        if window is None:
            return False
        rates = (self.rate, self._slope, plan.target)
        # no steady part of it is passed over
        state = self._state(u, rates, edge, window.begun, passed, (0.0, math.inf, 0.0))
        return self._keeps_limits(window, state, plan.write_rest(self._passed, self._phases))

    def _keeps_limits(self, window: RowWindow, state: Array, parts: int) -> bool:
        """Return whether the first phases of the search's memory keep all limits, as `keeps_limits` does."""
        return keeps_limits(
            self._ring.row_u,
            self._ring.position,
            self._ring.velocity,
            self._torques,
            self._ring.pace,
            np.array(window.numbers),
            np.array((window.from_rest, window.ends)),
            window.driven,
            window.displaced,
            window.start,
            self._playback.recent(),
            self._limits,
            state,
            self._places,
            self._at,
            self._scratch,
            self._phases,
            parts,
        )

    def rows_before(self, u: float, edge: float) -> int:
        """Return the rows that u may pass before a stop at an edge has to be thought of."""
        return max(0, int(edge - u - self._far) - 1)

    def advance(
        self, u: float, target: float, edge: float | None, *, urgent: bool, begins: bool = False
    ) -> float:
        """Step one cycle towards ``target``; return the rows that u passes in it.

        Args:
            u: at the cycle's beginning. edge: u before which the motion has to be able to stop; None: it ends
                by itself. urgent: stop without regard to jerk. begins: the motion stands at its beginning,
                and goes on at the present rate if it can stop before the edge.
        """
        self._ahead = self._look_ahead(u) if target > 1.0 or self.rate > 1.0 else _ALL_PLAIN
        if abs(target - self._ahead[0]) <= SAME_RATE:
            target = self._ahead[0]
        wish = _Wish(target, edge, urgent)
        plan = self._plan
        passed, self._last_u = u - self._last_u, u
        if not 0.0 <= passed <= RATE_MAX + SAME_RATE:
            # the motion has begun, or has been kept back
            passed = self.rate
        before = 0.0 if plan is None or self._passed == 0 else plan.at(self._passed)[0]
        if plan is not None and abs(self._origin + before - u) > 1e-6:
            # a barrier or an edge has kept u back
            plan = self._plan = None
        if self.rate == 0.0 and edge != self._edge:
            # new rows are new room
            self._refused = 0
        self._edge = edge
        if self._is_due(u, wish):
            found = self._search(u, wish, passed)
            if found is None and begins and plan is None and self.rate > 0.0 and self._is_near(u, edge):
                found = self._search_from_rest(u, wish)
            if found is not None and self._is_better(found, wish):
                self._plan = plan = found
                self._wish = wish
                self._delayed = found.keeps_above(wish.target)
                self._passed, self._origin, self._refused, self._tries = 0, u, 0, 0
                before = 0.0
            elif not self._is_partial(wish):
                self._refused += 1
        if plan is None:
            self._slope = 0.0
            return self.rate
        self._passed += 1
        after, self.rate, self._slope = plan.at(self._passed)
        if self._passed >= len(plan):
            self.rate, self._slope, self._plan = plan.target, 0.0, None
        return after - before

    def _search_from_rest(self, u: float, wish: _Wish) -> RatePlan | None:
        """Return a plan for a motion that stands at its beginning, and has too few rows ahead to stop from
        100 %.
        """
        self.rate = 0.0
        if wish.edge != self._begun[0]:
            # new rows are new room
            self._begun = (wish.edge, 0, 0)
        _, self._refused, self._tries = self._begun
        found = self._search(u, wish, 0.0)
        self._begun = (wish.edge, self._refused + 1, self._tries)
        return found

    # ------------------------------------------------------------------ when

    def _is_due(self, u: float, wish: _Wish) -> bool:
        """Return whether a new plan is needed, or may be better."""
        plan, had = self._plan, self._wish
        near = self._is_near(u, wish.edge)
        safe = self._ahead[0]
        if (self.rate if plan is None else plan.target) > safe + SAME_RATE:
            # rows ahead are of a lower pace
            return True
        if plan is None:
            if wish.target > safe and abs(self.rate - safe) <= SAME_RATE and not near:
                return self._cap(3) > safe + WORTH
            return abs(wish.target - self.rate) > SAME_RATE or (near and self.rate > 0.0)
        assert had is not None
        if wish.target != had.target or wish.urgent != had.urgent:
            return True
        if self._is_partial(wish) and self._passed % CRUISE == 0:
            return True
        if wish.target > safe:
            # what is left of the plan is the way back to the safe rate, or keeps one that is safe later
            return (len(plan) - self._passed) % CRUISE == 0 or self._passed == CRUISE
        if wish.edge != had.edge and (near or plan.target < wish.target):
            return True
        return self._refused > 0

    def _is_partial(self, wish: _Wish) -> bool:
        """Return whether a plan is followed that goes only a part of what is wished for, or only after a
        while, before an edge, or slowly.
        """
        plan, had = self._plan, self._wish
        if plan is None or had is None or had.target != wish.target or had.urgent != wish.urgent:
            return False
        if self._delayed:
            return True
        if wish.target > self._ahead[0]:
            return False
        if plan.target == wish.target:
            return len(plan) - self._passed > SLOW_CYCLES
        return plan.target != 0.0

    def _is_better(self, found: RatePlan, wish: _Wish) -> bool:
        """Return whether a plan comes closer to what is wished for than the one that is followed, or
        sooner.
        """
        plan = self._plan
        if plan is None or not self._is_partial(wish):
            return True
        if found.target == plan.target == wish.target:
            return len(found) < len(plan) - self._passed
        return abs(found.target - wish.target) <= abs(plan.target - wish.target)

    def _is_near(self, u: float, edge: float | None) -> bool:
        """Return whether a stop before an edge may have to begin soon."""
        return edge is not None and edge - u < self._far * max(1.0, self.rate)

    def _cap(self, rows_ahead: int) -> float:
        """Return the greatest rate that the next rows allow by themselves."""
        ring, playback = self._ring, self._playback
        first = max(playback.following - 1, playback.first)
        count = min(rows_ahead + 1, playback.written - first)
        return headroom_ahead(ring.headroom, first, count) if count > 0 else 1.0

    # ------------------------------------------------------------------ what

    def _state(
        self,
        u: float,
        rates: tuple[float, float, float],
        edge: float | None,
        begun: float,
        passed: float,
        ahead: tuple[float, float, float],
    ) -> Array:
        """Return the state that kernels are asked about, see `rate_window`.

        Args:
            rates: the rate, its slope, and the rate that is wished for. edge: as of `advance`.
            begun: u where the motion began. passed: rows in the last cycle. ahead: as of `_look_ahead`.
        """
        until = math.inf if edge is None else edge
        return np.array((u, *rates, until, self._far, self._cycle, begun, passed, *ahead))

    def _search(self, u: float, wish: _Wish, passed: float) -> RatePlan | None:
        """Return the fastest plan found that keeps all limits."""
        playback, ring = self._playback, self._ring
        target = min(wish.target, RATE_MAX)
        ahead = self._far * 2.0 * max(1.0, self.rate, target) + 4 * CRUISE
        window = playback.window(u, math.ceil(ahead))
        if window is None:
            return None
        must_stop = wish.edge is not None and wish.edge - u < 2.0 * self.rate
        patience = URGENT_PATIENCE if wish.urgent else PATIENCE
        # a plan that is followed ends at a rate that can be kept: a faster one may be waited for
        waits = self._plan is None or target < self.rate
        near = self._plan is None and self.rate > 0.0 and self._is_near(u, wish.edge)
        stands = self._plan is None and self.rate == 0.0
        edge = math.inf if wish.edge is None else wish.edge
        if near and edge - u < NEAR_ROOM * self._far * self.rate:
            patience = NEAR_PATIENCE
        elif stands and edge < math.inf:
            # in turns: within all limits a little way, then by any change, by any a little way
            stage = min(self._refused // PATIENCE, 3)
            patience = 2 * PATIENCE
            if stage in (1, 3):
                edge = min(edge, u + LITTLE_WAY * self._far)
        by_any = must_stop or (waits and self._refused >= patience)
        safe = self._ahead[0]
        if by_any and target > safe and not near:
            # nothing is passed to be faster than the rows
            by_any, target = self.rate < safe, safe if self.rate < safe else target
        if self.rate < safe < target and not near and self._refused // QUICK_TRIES % 2 == 1:
            # rows that leave nothing to a rise above the safe rate may leave something to a part of one to it
            target = safe
        slowly = (stands or (near and self.rate <= safe)) and self._refused // QUICK_TRIES % 2 == 1
        in_parts = self._has_torques or self._refused >= QUICK_TRIES or self._is_partial(wish)
        flags = (window.from_rest, window.ends, wish.urgent, self._plan is not None, by_any, slowly, in_parts)
        rates = (self.rate, self._slope, target)
        state = self._state(u, rates, edge, window.begun, passed, self._ahead)
        parts, end, spare_parts, spare_end, tries = search_rate(
            ring.row_u,
            ring.position,
            ring.velocity,
            self._no_torques if wish.urgent else self._torques,
            ring.headroom,
            ring.pace,
            np.array(window.numbers),
            np.array(flags),
            window.driven,
            window.displaced,
            window.start,
            playback.recent(),
            self._limits,
            state,
            self._tries,
            self._places,
            self._at,
            self._scratch,
            self._phases,
            self._spare,
        )
        self._tries = 0 if parts >= 0 else (self._tries + tries) % TRIES
        if parts >= 0:
            return RatePlan.of(self._phases[:parts], end, SETTLING)
        if spare_parts >= 0:
            return RatePlan.of(self._spare[:spare_parts], spare_end, SETTLING)
        return None
