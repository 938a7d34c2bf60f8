"""The planner of one program: feed groups in, setpoint rows out, with a window that always ends at rest.

The window holds segments without a stop between them; its velocity profile comes to rest at its end. A part
is committed from the window's beginning up to a moment without acceleration that lies before that stop; the
rest starts there at the speed reached, and is planned anew as more lines arrive. So the motion can always
stop on the path, and stops only where the next lines come too late.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from mckinematics.dynamics import JointDynamics

from mcserver.machine.machine_file import Machine
from mcserver.motion.bound import PlanningError
from mcserver.motion.canonical import FeedGroup, PathBatch
from mcserver.motion.geometry.batch_segments import segments_of_batch
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits, Segment, anchor, segment_of
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.lookahead.commit_moments import commit_moment, hand_over_moment, last_steady
from mcserver.motion.lookahead.companion_motions import CompanionMotions
from mcserver.motion.lookahead.feed_scale import plan_at_feed_scale
from mcserver.motion.lookahead.leading_group import CommaLine, Companions, MachineAxes, comma_line
from mcserver.motion.lookahead.parallel_groups import plan_parallel, sample_parallel
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.lookahead.setpoint_sampling import CYCLE_ROUNDING, whole_cycle
from mcserver.motion.lookahead.torque_of_rows import TorqueOfRows
from mcserver.motion.pieces import Deactivation, Piece
from mcserver.motion.planned_window import PlannedWindow
from mcserver.motion.run_output import RunOutput
from mcserver.units import AxisType

# Segments that the window is first filled with before it is planned.
WINDOW = 512
# Most segments that the window is filled with: enough for any stopping distance made of short lines.
LARGEST_WINDOW = 8192


class MotionPlanner:
    """Plan the feed groups of one program and return setpoint rows, piece by piece.

    Attributes:
        u: end of the committed motion, on the program's time axis [cycles].
        position: where the last appended segment ends, shape (K,) [m or rad].
        feed_scale: for motion that is not committed yet: the override where above 100 %, else 1.
    """

    def __init__(self, machine: Machine, position: Array, dynamics: JointDynamics | None = None) -> None:
        self._limits = AxisLimits.of(machine, dynamics)
        self._slots = {axis.index: column for column, axis in enumerate(machine.axes)}
        self._linear = np.array([axis.type is AxisType.LINEAR for axis in machine.axes])
        self.position: Array = position.copy()
        self.u = 0.0
        self.feed_scale = 1.0
        self._cycle = machine.cycle_s
        self._window = PlannedWindow(self._limits)
        self._size = WINDOW
        self._active = 0
        torque = self._limits.torque
        self._torques = None if torque is None else TorqueOfRows(torque, machine.cycle_s)
        self._companions = CompanionMotions(machine.cycle_s)
        self._output = RunOutput(machine.cycle_s, self._companions, self._torques)

    @property
    def torque_stop(self) -> int:
        """Longest stop that the torques of the committed rows need [cycles]."""
        return 0 if self._torques is None else self._torques.longest_stop

    @property
    def pending(self) -> int:
        """Number of segments in the window and of chords that wait to be appended to it."""
        return len(self._window)

    @property
    def full(self) -> bool:
        """Whether the window is long enough to be planned: its stop is well after the next part to commit."""
        return self.pending >= self._size

    @property
    def moving(self) -> bool:
        """Whether the committed motion ends at a speed above 0."""
        return self._window.moving

    @property
    def end_u(self) -> float:
        """Where the motion in the window ends [cycles]."""
        self._window.take_chords()
        if not self._window.lookahead.table:
            return self.u
        try:
            return self.u + self._solved().phases.duration / self._cycle
        except PlanningError:
            return self.u

    def segment(self, group: FeedGroup, line: int) -> Segment:
        """Return the segment of a group; `position` advances to its end."""
        segment = segment_of(group, line, self._slots, self._linear, self.feed_scale)
        anchor(segment, self.position)
        return segment

    def comma_line(self, groups: list[FeedGroup], line: int, tolerance: float) -> CommaLine | None:
        """Return a line of several groups for `append`; None: it has to start from rest (`comma_line`).

        `position` advances to its end.
        """
        axes = MachineAxes(self._limits, self._slots, self._linear, self.feed_scale)
        found = comma_line(groups, line, tolerance, self.position, axes)
        if found is not None:
            self.position[:] = found.end
        return found

    def append(
        self,
        segment: Segment,
        *,
        from_rest: bool = False,
        tolerance: float = 0.0,
        companions: Companions | None = None,
    ) -> None:
        """Append a segment that travels to the window.

        Args:
            from_rest: the motion stops before it.
            tolerance: how far the corner before it may be rounded [m].
            companions: motions of the line's other groups, parallel to it.
        """
        from_rest = self._companions.begins_at_rest(segment, companions, from_rest=from_rest)
        self._active |= segment.mask if companions is None else segment.mask | companions.mask
        segment.active = self._active
        segment.tolerance = 0.0 if from_rest else tolerance
        self._window.append(segment, from_rest=from_rest)

    def append_run(self, run: PathBatch, *, from_rest: bool = False, tolerance: float = 0.0) -> bool:
        """Append a batch of lines; `position` advances to its end.

        Args:
            from_rest: the motion stops before it. tolerance: how far the corner before it may be rounded [m].

        Returns:
            False, with nothing done, where a line does not travel or torques are limited.
        """
        if self._limits.torque is not None:
            return False
        lines = segments_of_batch(
            run, self._slots, self._linear, self.position, self.feed_scale, self._active
        )
        if lines is None:
            return False
        from_rest = self._companions.run_begins_at_rest(lines, from_rest=from_rest)
        if run.tolerances[0] > 0.0:
            arcs = np.flatnonzero(run.sweeps).tolist()
            self._window.append_lines(SegmentList.of(lines), arcs, from_rest=from_rest, tolerance=tolerance)
        else:
            self._window.append_exact(lines, from_rest=from_rest)
        self._active |= lines.mask
        self.position[:] = lines.path.ends[-1]
        return True

    def _solved(self) -> PlannedRun:
        """Return the window's velocity profile (`PlannedWindow.solved`), which lasts until companions end."""
        window = self._window
        window.plan = self._companions.last_to_end(window.lookahead, window.solved(), self.u)
        return window.plan

    # ------------------------------------------------------------------ committing

    def follow_feed_scale(self) -> None:
        """Plan the window again if its feed scale has changed."""
        window = self._window
        window.take_chords()
        if self._companions.present or not window.lookahead.table:
            # the companions' velocity profiles are fixed already
            return
        found = plan_at_feed_scale(window.lookahead, self.feed_scale)
        if found is not None:
            window.plan = found

    def commit(self, want: float = math.inf, *, closing: bool = False) -> Iterator[Piece] | None:
        """Commit motion up to ``want`` [cycles] or a little more, but not the stop at the window's end.

        The rest begins at the speed reached, and keeps its plan until lines come or the feed scale changes.

        Args:
            want: infinite: as much as possible. closing: no more lines come into the window.

        Returns:
            The output, to be consumed in full before the next call; None where only the stop is left.
        """
        self.follow_feed_scale()
        if not self._window.lookahead.table:
            return None
        if closing:
            self._window.end_here()
        try:
            plan = self._solved()
        except PlanningError:
            return self._fall_back()
        wanted = (want - self.u) * self._cycle
        moment = (
            commit_moment(plan, wanted)
            if math.isinf(want)
            else hand_over_moment(plan, wanted, closing=closing)
        )
        settled = math.inf if closing else self._window.settled_until(plan)
        if moment > settled and (math.isinf(want) or wanted <= settled):
            # commit a part of the curve that may still change only if the executor needs it
            moment = last_steady(plan, settled)
        if moment < wanted:
            # each plan repeats the work on the rest: the longer that is, the more segments to wait for
            left = self.pending if moment < self._cycle else self.pending - plan.window_at(moment)
            left = max(left, WINDOW // 2)
            self._size = min(left + max(WINDOW, left) // 2, LARGEST_WINDOW)
        if moment < self._cycle:
            # less than a cycle is not worth a plan, and a rounding error would be committed for ever: let
            # the window grow first
            return None
        moment = plan.at_end(moment)
        origin, self.u = self.u, self.u + moment / self._cycle
        self._window.drop_until(plan, moment)
        return self._output.pieces(plan, origin, math.floor(self.u + CYCLE_ROUNDING), moment)

    def _fall_back(self) -> Iterator[Piece]:
        """Commit the window's reserve, a stop before the latest segments, which then begin at rest.

        Raises:
            PlanningError: the motion is at rest already: the first segment has no velocity profile.
        """
        plan = self._window.drop_reserve()
        origin, self.u = self.u, self.u + plan.phases.duration / self._cycle
        return self._output.pieces(plan, origin, math.floor(self.u + CYCLE_ROUNDING), math.inf)

    def close(self) -> Iterator[Piece]:
        """Commit the whole window, its stop included."""
        self.follow_feed_scale()
        if not self._window.lookahead.table:
            return iter(())
        self._window.end_here()
        try:
            plan = self._solved()
        except PlanningError:
            return itertools.chain(self._fall_back(), self._close_rest())
        origin, end = self.u, self.u + plan.phases.duration / self._cycle
        # the row at the first whole cycle holds the target; the next motion starts there
        self.u = float(whole_cycle(end))
        self._size = WINDOW
        self._window.clear()
        self._companions.closed()
        mask = self._active
        self._active = 0
        return self._closing(plan, origin, end, mask)

    def _close_rest(self) -> Iterator[Piece]:
        yield from self.close()

    def _closing(self, plan: PlannedRun, origin: float, end: float, mask: int) -> Iterator[Piece]:
        yield from self._output.pieces(plan, origin, whole_cycle(end), math.inf)
        self._output.announced = 0
        last = plan.segments[-1]
        position = last.sample(np.array([last.finish]))[0][0]
        self._companions.put_ends_on(position, last.line)
        yield Deactivation(float(whole_cycle(end)), last.line, mask, tuple(position.tolist()))

    # ------------------------------------------------------------------ with an empty window

    def rest(self, cycles: float) -> None:
        """Let time pass without motion."""
        self.u += cycles

    def to_whole_cycle(self) -> None:
        """Advance to a whole cycle: waits begin at one."""
        self.u = float(whole_cycle(self.u))

    def together(
        self, groups: list[FeedGroup], line: int
    ) -> tuple[Iterator[Piece], list[PlannedRun | None], float]:
        """Plan groups that start together, each with its own velocity profile from rest to rest (D-32).

        Returns:
            The output, which ends with the longest group; the groups' velocity profiles (None: no travel);
            where the longest one ends on the program's time axis [cycles].

        Raises:
            PlanningError: a group has no velocity profile, or their sum exceeds a torque limit.
        """
        base = self.position.copy()
        segments = [self.segment(group, line) for group in groups]
        for segment in segments:
            segment.active = segment.mask
        mask = sum(segment.mask for segment in segments)
        runs = plan_parallel(segments, base, self._limits)
        origin, durations = self.u, [run.phases.duration for run in runs if run is not None]
        end = origin + max(durations, default=0.0) / self._cycle
        self.u = float(whole_cycle(end)) if durations else origin
        pieces = sample_parallel(runs, base, origin, whole_cycle(end), line, mask, self._cycle)
        if self._torques is not None:
            pieces = self._torques.on_pieces(pieces, segments[0].carried)
        return pieces, runs, end
