"""The playback rate of a program: overrides up to 100 % and feed hold on the path, within all axes' limits.

With the path Q(u) of the rows, setpoints are Q(u_k) for the cycles k. A change of rate is an s-curve of r,
tried on the very setpoints that it would give (`motion/kernels/rate_search.py`, a bounded number of them a
cycle): only one whose first, second and third differences keep the velocity, acceleration and jerk of every
axis, and whose torques keep those of every joint, is followed. Each change ends at a steady rate of 100 % or
less, or at rest, from where rows can always be played on. So it can be followed to its end whatever comes; a
new order replaces it as soon as a change is found that keeps all limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mcserver.executor.playback.playback import Playback
from mcserver.executor.playback.rate_plan import RatePlan
from mcserver.executor.shm.rings import ProgramRing
from mcserver.executor.stopping import longest_stop
from mcserver.machine.machine_file import Machine
from mcserver.motion.geometry.row_torques import NUMBERS
from mcserver.motion.kernels.rate_changes import SAME_RATE
from mcserver.motion.kernels.rate_search import TRIES, Manner, SearchMemory, search_rate
from mcserver.motion.kernels.rate_trial import SETTLING
from mcserver.motion.kernels.rate_window import RateState, RingRows

# What differences at the cycle rate may pass the limits by, inside the 100.1 %, 101 % and 105 % that
# velocity, acceleration and jerk are judged at; what rows do themselves is allowed in any case.
VELOCITY_SLACK, ACCELERATION_SLACK, JERK_SLACK = 1.0005, 1.004, 1.04
# Cycles without a change that keeps all limits. Motion that stands goes on a little way after as many without
# new rows either: the gentle change may only lack room. After twice as many the one that passes the limits
# least is made: rows whose vertices pass a jerk limit let no other through, and motion would stand for good.
PATIENCE = 250
# The same while a stop before an edge has to begin: later there is room for worse ones only.
NEAR_PATIENCE = 6
# Cycles in which only whole changes at full speed are tried: they may merely have to wait for a moment.
QUICK_TRIES = 8
# Cycles between two searches for a change that goes further, or sooner, than the one that is followed; and
# from how long a change on it is looked for. In an emergency stop that is every cycle, and any change.
AGAIN, SLOW_CYCLES = 12, 48
# Share of the rows in which a stop is near from which on that patience counts.
NEAR_ROOM = 0.6
# Rows ahead without which a stop may be near: so many stops of the rows' speed, and some more. Where rows
# brake before the edge with all that an axis has, only who was slow before that can stop on it: two and a
# half times the rows that a stop from 100 % takes.
NEAR_STOPS, NEAR_ROWS = 1.25, 8.0
# Share of the rows in which a stop is near, that motion goes on by where there is no room for more.
LITTLE_WAY = 0.99


@dataclass(frozen=True)
class _Order:
    """What the rate is to become, the u before which the motion has to be able to stop (None: it ends by
    itself), and whether jerk does not count.
    """

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
        self._stop = longest_stop(machine)
        self._has_torques = ring.torque.shape[2] > 0
        self._rows = RingRows(ring.row_u, ring.position, ring.velocity, ring.torque)
        self._rows_without_torques = self._rows._replace(torque=np.zeros((ring.rows, NUMBERS, 0)))
        # nothing is allocated in a cycle
        self._memory = SearchMemory.of(ring.rows, len(machine.axes))
        self.rate = 1.0
        self._slope = 0.0
        self._plan: RatePlan | None = None
        self._order: _Order | None = None
        self._passed = 0
        self._origin = 0.0
        self._refused = 0
        self._edge: float | None = None
        self._tries = 0
        self._last_u = math.nan
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
    def steady(self) -> bool:
        """Whether rows are played one a cycle, with no change of the rate under way."""
        return self._plan is None and self.rate == 1.0

    def rows_before(self, u: float, edge: float) -> int:
        """Return the rows that u may pass before a stop at an edge has to be thought of."""
        return max(0, int(edge - u - self._far(u, edge)) - 1)

    def _far_from(self, stop: float) -> float:
        """Return the rows before an edge from which on a stop of some cycles there is thought of."""
        return NEAR_STOPS * (max(stop, self._ring.torque_stop) if self._has_torques else stop) + NEAR_ROWS

    def _far(self, u: float, edge: float | None) -> float:
        """Return the rows before an edge from which on a stop there is thought of: by the speeds of the rows
        up to it.
        """
        far = self._far_from(self._stop)
        if edge is None or edge - u >= far:
            return far
        return self._far_from(self._playback.stop_until_last(u))

    def advance(
        self, u: float, target: float, edge: float | None, *, urgent: bool, begins: bool = False
    ) -> float:
        """Step one cycle towards ``target``; return the rows that u passes in it.

        Args:
            u: at the cycle's beginning. target: 0 to 1. edge: u before which the motion has to be able to
                stop; None: it ends by itself. urgent: stop without regard to jerk. begins: the motion stands
                at its beginning, and goes on at the present rate if it can stop before the edge.
        """
        order = _Order(target, edge, urgent)
        plan = self._plan
        passed, self._last_u = u - self._last_u, u
        if not 0.0 <= passed <= 1.0 + 1e-9:
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
        far = self._far(u, edge)
        if self._is_due(u, order, far):
            found = self._search(u, order, passed, far)
            near = edge is not None and edge - u < far
            if found is None and begins and plan is None and self.rate > 0.0 and near:
                found = self._search_from_rest(u, order, far)
            if found is not None and self._is_better(found, order):
                self._plan = plan = found
                self._order = order
                self._passed, self._origin, self._refused, self._tries = 0, u, 0, 0
                before = 0.0
            elif not self._may_be_better(order):
                self._refused += 1
        if plan is None:
            self._slope = 0.0
            return self.rate
        self._passed += 1
        after, self.rate, self._slope = plan.at(self._passed)
        if self._passed >= len(plan):
            self.rate, self._slope, self._plan = plan.target, 0.0, None
        return after - before

    def _search_from_rest(self, u: float, order: _Order, far: float) -> RatePlan | None:
        """Return a plan for a motion that stands at its beginning, and has too few rows ahead to stop from
        100 %.
        """
        self.rate = 0.0
        if order.edge != self._begun[0]:
            # new rows are new room
            self._begun = (order.edge, 0, 0)
        _, self._refused, self._tries = self._begun
        found = self._search(u, order, 0.0, far)
        self._begun = (order.edge, self._refused + 1, self._tries)
        return found

    # ------------------------------------------------------------------ when

    def _is_due(self, u: float, order: _Order, far: float) -> bool:
        """Return whether a new plan is needed, or may be better."""
        plan, had = self._plan, self._order
        near = order.edge is not None and order.edge - u < far
        if plan is None:
            return abs(order.target - self.rate) > SAME_RATE or (near and self.rate > 0.0)
        assert had is not None
        if order.target != had.target or order.urgent != had.urgent:
            return True
        if self._may_be_better(order) and (order.urgent or self._passed % AGAIN == 0):
            return True
        if order.edge != had.edge and (near or plan.target < order.target):
            return True
        return self._refused > 0

    def _may_be_better(self, order: _Order) -> bool:
        """Return whether a plan is followed that goes only a part of the way, or slowly."""
        plan, had = self._plan, self._order
        if plan is None or had is None or had.target != order.target or had.urgent != order.urgent:
            return False
        if plan.target == order.target:
            return order.urgent or len(plan) - self._passed > SLOW_CYCLES
        return plan.target != 0.0

    def _is_better(self, found: RatePlan, order: _Order) -> bool:
        """Return whether a plan comes closer to what is ordered than the one that is followed, or sooner."""
        plan = self._plan
        if plan is None or not self._may_be_better(order):
            return True
        if found.target == plan.target == order.target:
            return len(found) < len(plan) - self._passed
        return abs(found.target - order.target) <= abs(plan.target - order.target)

    # ------------------------------------------------------------------ what

    def _search(self, u: float, order: _Order, passed: float, far: float) -> RatePlan | None:
        """Return the fastest plan found that keeps all limits."""
        ahead = 2.0 * self._far_from(self._stop) + 4 * AGAIN
        window = self._playback.window(u, math.ceil(ahead))
        if window is None:
            return None
        edge = math.inf if order.edge is None else order.edge
        must_stop = edge - u < 2.0 * self.rate
        patience = PATIENCE
        # a plan that is followed ends at a rate that can be kept: a faster one may be waited for
        waits = self._plan is None or order.target < self.rate
        # rows that brake with all that an axis has leave no room to be slower: a stop on the edge, at which
        # they are slow, is looked for too, and from further away
        delays = order.target == 0.0 or (order.target < self.rate and self._refused >= QUICK_TRIES)
        reach = self._far_from(self._stop) if delays else far
        near = self._plan is None and self.rate > 0.0 and edge - u < reach
        stands = self._plan is None and self.rate == 0.0
        if near and edge - u < NEAR_ROOM * far * self.rate:
            patience = NEAR_PATIENCE
        elif stands and edge < math.inf:
            # in turns: within all limits a little way, then by any change, by any a little way
            stage = min(self._refused // PATIENCE, 3)
            patience = 2 * PATIENCE
            if stage in (1, 3):
                edge = min(edge, u + LITTLE_WAY * far)
        in_parts = order.urgent or self._has_torques or self._may_be_better(order)
        manner = Manner(
            urgent=order.urgent,
            by_any=must_stop or (waits and self._refused >= patience),
            slowly=(stands or near) and self._refused // QUICK_TRIES % 2 == 1,
            in_parts=in_parts or self._refused >= QUICK_TRIES,
            from_try=self._tries,
        )
        state = RateState(u, self.rate, self._slope, order.target, edge, reach, self._cycle, passed)
        rows = self._rows_without_torques if order.urgent else self._rows
        parts, end, spare_parts, spare_end, tries = search_rate(
            rows, window, self._limits, state, manner, self._memory
        )
        self._tries = 0 if parts >= 0 else (self._tries + tries) % TRIES
        if parts >= 0:
            return RatePlan.of(self._memory.phases[:parts], end, SETTLING)
        if spare_parts >= 0:
            return RatePlan.of(self._memory.spare[:spare_parts], spare_end, SETTLING)
        return None
