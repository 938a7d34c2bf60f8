"""Motion that is handed over is taken back, and planned anew, where an override above 100 % is raised.

The executor is asked to take new rows in the place of old ones that it has not come to. It answers in its
next cycle: either all of the new ones count from then on, or nothing has changed. Meanwhile nothing else is
planned.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mcserver.executor.entries import Array, ReplaceableSink
from mcserver.machine.machine_file import Machine
from mcserver.motion.pieces import LineBound, LineEdges, Rows
from mcserver.motion.planner import PlannedAnew
from mcserver.motion.profile.setpoint_sampling import CYCLE_ROUNDING
from mcserver.planning.line_planner import LinePlanner
from mcserver.planning.planner_messages import Report, ReportKind

# What the executor comes to until it answers [cycles]: looks of the planner and its own turn; beside that a
# plan, for each segment at first, and at most.
ANSWER, A_SEGMENT, MOST_A_SEGMENT = 24.0, 0.05, 5.0
# What is left for a plan, as a multiple of what the last one took.
SPARE = 1.3
# The time until the answer after refusals, at most, as a multiple: the executor may be in a change of the
# rate that goes further.
LONGEST_ANSWER = 8
# Tries for an order, and refusals after which the next one follows at once.
TRIES, AT_ONCE = 8, 2
# Fewer rows are not worth a plan.
LEAST = 64
# Time that it may cost to begin sooner [s].
WORTH_S = 0.002
# Rows after which it is tried again where there was no way.
AGAIN = 32.0
# Rows before the cut that are looked at for the rate they allow.
LOOKED_AT = 400


class TakeBack:
    """Takes motion of one program back.

    Args:
        plan: the program's. sink: where what it plans goes.
    """

    def __init__(self, machine: Machine, plan: LinePlanner, sink: ReplaceableSink) -> None:
        self._plan = plan
        self._sink = sink
        self._cycle = machine.cycle_s
        # by how much rows of the same motion, from the same state but for rounding, may differ within a cycle
        reach = [
            axis.max_jerk * machine.cycle_s**3
            if math.isfinite(axis.max_jerk)
            else axis.max_acceleration * machine.cycle_s**2
            for axis in machine.axes
        ]
        self._reach = 4.0 * np.array(reach)
        self._asked: PlannedAnew | None = None
        self._scale = 1.0
        # how often it was refused, and tried, for an order, and from where on it is tried again
        self._refused, self._tries, self._next_u = 0, 0, -math.inf
        # cycles that a plan takes for each segment, where the last one was begun, and for how many
        self._a_segment = A_SEGMENT
        self._begun: tuple[float, int] | None = None

    def waits(self) -> bool:
        """Return whether an answer is waited for; what it allows is done with it."""
        if self._asked is None:
            return False
        answer = self._sink.replacement_answer()
        if answer is None:
            return True
        asked, self._asked = self._asked, None
        if answer:
            self._go_on(asked)
        else:
            if self._refused < AT_ONCE:
                # where it is on its way to another rate is known now, and how far that may go
                self._next_u = -math.inf
            self._refused += 1
        return False

    def ask(self, u: float, rate: float, stop: float, ahead: float) -> bool:
        """Ask for new rows in the place of those planned for a lower override; return whether it did.

        Args:
            u, rate: of the executor. stop: rows that it needs ahead to stop. ahead: more that it is to have
                then, at a pace of 1.
        """
        motion = self._plan.motion
        self._note_time(u, rate)
        if motion.feed_scale != self._scale:
            self._scale, self._refused, self._tries, self._next_u = motion.feed_scale, 0, 0, -math.inf
        if motion.feed_scale <= 1.0 or u < self._next_u or self._tries >= TRIES:
            return False
        longer = min(2 ** max(self._refused - 1, 0), LONGEST_ANSWER)
        late = ANSWER * longer + SPARE * self._a_segment * motion.pending
        from_u = u + max(late * max(1.0, rate), self._rising_rows(u, rate))
        if motion.u - from_u < stop * motion.pace.now:
            # what is there has to last until the plan is made, should it be in vain
            return False
        if not motion.committed.slower_behind(from_u + LEAST, motion.feed_scale):
            return False
        # who has refused is playing faster already, which is worth more than a quick plan
        cuts = motion.committed.cuts_at(from_u, at_turns=self._refused == 0)
        cuts = [each for each in cuts if each.slower_behind(motion.feed_scale) >= LEAST]
        if not cuts:
            return False
        self._next_u = u + AGAIN + 2.0 * (from_u - u)
        self._tries += 1
        most = motion.pace.at(motion.feed_scale)
        room = self._sink.replacement_room(math.ceil(from_u))
        want = min(stop + ahead, (room - LEAST) / most)
        if want < stop:
            return False
        plans: list[PlannedAnew] = []
        for count, cut in enumerate(cuts, start=1):
            if cut.instead and plans:
                continue
            self._begun = (u, motion.pending * count)
            plan = motion.planned_anew(
                cut, rate, self._last_rows, u + want * most, from_u + room - 1.0, closing=self._plan.flush
            )
            if plan is not None:
                plans.append(plan)
        found = self._soonest(plans, u)
        if found is None or not self._is_asked(found, u + stop * found.planner.pace.now):
            return False
        self._asked = found
        return True

    def _rising_rows(self, u: float, rate: float) -> int:
        """Return the rows that playback needs to come to the new pace: where it has refused it is on its way
        there, and what is planned for less behind would be faster by both. Else 0.
        """
        if self._refused == 0:
            return 0
        motion = self._plan.motion
        latest = self._last_rows(math.ceil(u) + LEAST)
        cuts = motion.committed.cuts_at(u, at_turns=False)
        if latest is None or not cuts:
            return 0
        # what is committed last may be planned for this scale already
        stretch = cuts[0].stretch
        pace = dataclasses.replace(motion.pace, now=stretch.pace, plain=stretch.plain)
        if self._refused == 1:
            return pace.rows_until(motion.feed_scale, latest[-1], rate)
        # behind all that is decided nothing of it has to hold on the new rows
        return pace.rows_and_back(motion.feed_scale, latest[-1], rate)

    def _note_time(self, u: float, rate: float) -> None:
        """Note how long the last plan took."""
        begun, self._begun = self._begun, None
        if begun is None or rate < 0.5:
            return
        took = max(u - begun[0] - ANSWER, 0.0) / rate
        self._a_segment = min(max(took / max(begun[1], 1), A_SEGMENT), MOST_A_SEGMENT)

    def _soonest(self, plans: list[PlannedAnew], u: float) -> PlannedAnew | None:
        """Return the plan that begins first of those with which the motion ends soonest: a stretch that is
        cut inside is no longer the quickest one, which may cost more than it saves.
        """
        ends = [(each.u - u) * self._cycle / each.cut.stretch.pace + each.lasts for each in plans]
        soon = [each for each, end in zip(plans, ends, strict=True) if end <= min(ends) + WORTH_S]
        return min(soon, key=lambda each: each.u, default=None)

    def _last_rows(self, u: int) -> Array | None:
        return self._sink.last_rows(u, LOOKED_AT)

    def _is_asked(self, found: PlannedAnew, least_u: float) -> bool:
        """Ask for what is planned anew; return False where that cannot be.

        Args:
            least_u: up to where the rows have to go.
        """
        first = math.floor(found.u + CYCLE_ROUNDING) + 1
        rows = [piece for piece in found.pieces if isinstance(piece, Rows)]
        edges = _joined_edges([piece for piece in found.pieces if isinstance(piece, LineEdges)])
        others = [piece for piece in found.pieces if not isinstance(piece, Rows | LineEdges | LineBound)]
        if others or not rows or rows[0].first != first or found.planner.u < least_u:
            return False
        if not self._plan.only_edges(edges):
            return False
        old = self._sink.row_at(first)
        if old is None or not self._continues(rows[0], old):
            return False
        return self._sink.ask_replacement(_joined(rows), edges, found.cut.edges_behind)

    def _continues(self, rows: Rows, old: tuple[Array, Array]) -> bool:
        """Return whether the first row is where the old one was, but for what limits allow within a cycle."""
        driven = np.array([bool(int(rows.axes[0]) >> column & 1) for column in range(len(old[0]))])
        gap = np.abs(rows.position[0] - old[0])
        return bool((gap[driven] <= self._reach[driven] + 1e-9).all())

    def _go_on(self, asked: PlannedAnew) -> None:
        """Go on with what was planned anew."""
        plan = self._plan
        plan.motion = asked.planner
        plan.output.last_u = float(math.floor(asked.planner.u + CYCLE_ROUNDING))
        for line in sorted(asked.cut.bound_behind):
            plan.reports.append(Report(ReportKind.BOUND, line))
        for piece in asked.pieces:
            if isinstance(piece, LineBound):
                plan.put(piece)


def _joined(rows: list[Rows]) -> Rows:
    """Return rows on end as one."""
    if len(rows) == 1:
        return rows[0]
    first = rows[0]
    scales = [each.feed_scale for each in rows]
    return dataclasses.replace(
        first,
        position=np.concatenate([each.position for each in rows]),
        velocity=np.concatenate([each.velocity for each in rows]),
        axes=np.concatenate([each.axes for each in rows]),
        line=np.concatenate([each.line for each in rows]),
        feed_scale=np.concatenate(
            [np.ones(len(each.line)) if s is None else s for each, s in zip(rows, scales, strict=True)]
        ),
    )


def _joined_edges(edges: list[LineEdges]) -> LineEdges:
    """Return edges on end as one."""
    if not edges:
        return LineEdges(np.empty(0), np.empty(0, np.int64), np.empty(0, np.bool_))
    return LineEdges(
        np.concatenate([each.u for each in edges]),
        np.concatenate([each.line for each in edges]),
        np.concatenate([each.ends for each in edges]),
    )
