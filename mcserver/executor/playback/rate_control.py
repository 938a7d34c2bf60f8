"""The playback rate of a program: overrides up to 100 % and feed hold on the path, within all axes' limits.

With the path Q(u) of the rows, setpoints are Q(u_k) for the cycles k. A change of rate is an s-curve of r,
tried on the setpoints that it would give (`motion/kernels/rate_search.py`, a bounded number of them per
cycle). It is followed only if their first, second and third differences keep the velocity, acceleration and
jerk limits of every axis, and their torques those of every joint. Each change ends at a steady rate of at
most 100 %, or at rest, from where rows can always be played on: so it can be followed to its end in any case.
A new order replaces it as soon as a change for that is found that keeps all limits.
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

# Factors by which differences at the cycle rate may exceed the limits, within the 100.1 %, 101 % and 105 %
# that velocity, acceleration and jerk are tested for; the differences of the rows themselves are always
# allowed.
VELOCITY_SLACK, ACCELERATION_SLACK, JERK_SLACK = 1.0005, 1.004, 1.04
# Cycles without a change within all limits after which the change that exceeds them least is made: where
# vertices of the rows exceed a jerk limit there is no other, and motion would stand for ever. Motion at rest
# before an edge first goes on a little way, since a gentle change may just lack room, and makes any change
# after twice as many.
PATIENCE = 250
# The same while a stop before an edge has to begin: later there is only room for worse ones.
NEAR_PATIENCE = 6
# Cycles in which only whole changes at full speed are tried: these may become possible shortly.
QUICK_TRIES = 8
# Period of searching for a change that goes further, or is faster, than the one that is followed [cycles].
AGAIN = 12
# It is searched for if the present change lasts longer than this [cycles]; in an emergency stop in every
# cycle, for any change, and with this period for one within the jerk limit too.
SLOW_CYCLES, GENTLY_AGAIN = 48, 3
# `NEAR_PATIENCE` applies within this share of the rows before an edge in which a stop is near.
NEAR_ROOM = 0.6
# A stop is near within so many stops of the rows' speed before an edge, plus some rows. Where rows brake
# before the edge at an axis's limits, only a motion that was slow before can stop on it: that takes two and a
# half times the rows of a stop from 100 %.
NEAR_STOPS, NEAR_ROWS = 1.25, 8.0
# Share of the rows in which a stop is near by which motion goes on where there is no room for more.
LITTLE_WAY = 0.99


@dataclass(frozen=True)
class _Order:
    """The ordered rate, the u before which the motion has to be able to stop (None: it ends by itself), and
    whether to stop without regard to jerk.
    """

    target: float
    edge: float | None
    urgent: bool


def _sooner(plan: RatePlan, other: RatePlan | None) -> bool:
    """Return whether a plan stops, and the other one does not, or later."""
    return plan.target == 0.0 and (other is None or other.target > 0.0 or len(plan) < len(other))


def _slows_more(plan: RatePlan, passed: int, other: RatePlan, since: int) -> bool:
    """Return whether a plan is at a lower rate than another one some cycles from now.

    Args:
        passed, since: cycles of the two that have passed.
    """
    cycles = min(AGAIN, len(plan) - passed, len(other) - since)
    return cycles > 0 and plan.at(passed + cycles)[1] < other.at(since + cycles)[1]


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
        # for a motion at its beginning: the edge, and how often and from which try a plan was searched for
        self._begun: tuple[float | None, int, int] = (None, 0, 0)

    def jump(self, rate: float) -> None:
        """Set the rate at once, while nothing moves by it."""
        self.rate = rate
        self._slope = 0.0
        self._plan = None
        self._refused = self._tries = 0
        self._last_u = math.nan

    @property
    def steady(self) -> bool:
        """Whether rows are played one per cycle, without a change of the rate under way."""
        return self._plan is None and self.rate == 1.0

    def rows_before(self, u: float, edge: float) -> int:
        """Return the rows that u may pass before a stop at an edge has to be planned."""
        return max(0, int(edge - u - self._far(u, edge)) - 1)

    def _far_from(self, stop: float) -> float:
        """Return the number of rows before an edge within which a stop of some cycles is near."""
        return NEAR_STOPS * (max(stop, self._ring.torque_stop) if self._has_torques else stop) + NEAR_ROWS

    def _far(self, u: float, edge: float | None) -> float:
        """Return the number of rows before an edge within which a stop is near, by the rows' speeds."""
        far = self._far_from(self._stop)
        if edge is None or edge - u >= far:
            return far
        return self._far_from(self._playback.stop_until_last(u))

    def advance(
        self, u: float, target: float, edge: float | None, *, urgent: bool, begins: bool = False
    ) -> float:
        """Step one cycle towards ``target``; return the rows that u passes in it.

        Args:
            u: at the cycle's beginning. target: ordered rate, 0 to 1. edge: u before which the motion has to
                be able to stop; None: it ends by itself. urgent: stop without regard to jerk. begins: the
                motion is at its beginning, and goes on at the present rate if it can stop before the edge.
        """
        order = _Order(target, edge, urgent)
        plan = self._plan
        passed, self._last_u = u - self._last_u, u
        if not 0.0 <= passed <= 1.0 + 1e-9:
            # the motion has begun, or has been held back
            passed = self.rate
        before = 0.0 if plan is None or self._passed == 0 else plan.at(self._passed)[0]
        if plan is not None and abs(self._origin + before - u) > 1e-6:
            # a barrier or an edge has held u back
            plan = self._plan = None
        if self.rate == 0.0 and edge != self._edge:
            # new rows are new room
            self._refused = 0
        self._edge = edge
        far = self._far(u, edge)
        if self._is_due(u, order, far):
            found = self._search(u, order, passed, far)
            near = edge is not None and edge - u < far
            begun = plan is not None and self._order is not None and self._order.urgent
            if urgent and (not begun or self._passed % GENTLY_AGAIN == 0):
                # where rows leave little room for a step of acceleration, a stop within the jerk limit, or a
                # part of one, may be sooner
                gentle = self._search(u, _Order(target, edge, False), passed, far, in_parts=True)
                if gentle is not None and (
                    _sooner(gentle, found)
                    or (found is not None and gentle.target > 0.0 and _slows_more(gentle, 0, found, 0))
                ):
                    found = gentle
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
        """Return a plan for a motion at its beginning that has too few rows ahead to stop from 100 %."""
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
        """Return whether to search for a plan: one is needed, or may be better than the present one."""
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
        """Return whether the present plan goes only a part of the way, or is slow."""
        plan, had = self._plan, self._order
        if plan is None or had is None or had.target != order.target or had.urgent != order.urgent:
            return False
        if plan.target == order.target:
            return order.urgent or len(plan) - self._passed > SLOW_CYCLES
        return plan.target != 0.0

    def _is_better(self, found: RatePlan, order: _Order) -> bool:
        """Return whether a plan comes closer to the ordered rate than the present one, or sooner."""
        plan, had = self._plan, self._order
        if order.urgent and plan is not None and had is not None:
            slows = plan.at(min(self._passed + AGAIN, len(plan)))[1] < self.rate
            if had.edge == order.edge and slows and _slows_more(plan, self._passed, found, 0):
                return False
            if found.target > 0.0 and _slows_more(found, 0, plan, self._passed):
                return True
        if plan is None or not self._may_be_better(order):
            return True
        if found.target == plan.target == order.target:
            return len(found) < len(plan) - self._passed
        return abs(found.target - order.target) <= abs(plan.target - order.target)

    # ------------------------------------------------------------------ what

    def _search(
        self, u: float, order: _Order, passed: float, far: float, *, in_parts: bool = False
    ) -> RatePlan | None:
        """Return the fastest plan found that keeps all limits, or else one that `PATIENCE` allows.

        Args:
            in_parts: changes that go only a part of the way will do at once.
        """
        ahead = 2.0 * self._far_from(self._stop) + 4 * AGAIN
        window = self._playback.window(u, math.ceil(ahead))
        if window is None:
            return None
        edge = math.inf if order.edge is None else order.edge
        must_stop = edge - u < 2.0 * self.rate
        patience = PATIENCE
        # the present plan ends at a rate that can be kept: a better one may be waited for
        waits = self._plan is None or order.target < self.rate
        # rows that brake at an axis's limits leave no room for a lower rate: also search for a stop on the
        # edge, where the rows are slow, and from further away
        delays = order.target == 0.0 or (order.target < self.rate and self._refused >= QUICK_TRIES)
        reach = self._far_from(self._stop) if delays else far
        near = self._plan is None and self.rate > 0.0 and edge - u < reach
        stands = self._plan is None and self.rate == 0.0
        if near and edge - u < NEAR_ROOM * far * self.rate:
            patience = NEAR_PATIENCE
        elif stands and edge < math.inf:
            # in turn: a little way within all limits; any change; a little way by any change
            stage = min(self._refused // PATIENCE, 3)
            patience = 2 * PATIENCE
            if stage in (1, 3):
                edge = min(edge, u + LITTLE_WAY * far)
        in_parts = in_parts or order.urgent or self._has_torques or self._may_be_better(order)
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
