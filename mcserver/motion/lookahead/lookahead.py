"""Time laws over many segments: no stop where none is needed, no limit broken anywhere (D-33, D-35, D-36).

A *run* is a chain of segments on one coordinate σ, scaled so that speed along it is continuous where
the tangent is. Its nodes are the joints, each with the greatest speed at which it can be passed.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import Bound, PlanningError
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits, Segment, StraightRun
from mcserver.motion.geometry.time_domain_corner import Stop, TimedCorner, TimedCorners
from mcserver.motion.kernels.groups import (
    AFTER,
    BEFORE,
    FEED,
    MARKS,
    NUMBERS,
    REQUESTED,
    SPEED,
    START,
    TOLERANCE,
    TOP,
    Columns,
    Groups,
    groups_of,
)
from mcserver.motion.kernels.junctions import Before, meet_lines
from mcserver.motion.kernels.ramp_kernels import reachable_speed
from mcserver.motion.kernels.rest_vertices import slow_vertices
from mcserver.motion.kernels.sample_limits import bind_joints
from mcserver.motion.lookahead.path_limits import RunLimits, junction, samples_of
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.lookahead.segment_table import Nodes
from mcserver.motion.profile.profile_solver import KeySolver, Solution
from mcserver.motion.profile.velocity_profile import Phases, ProfileSolver, time_law

# Late segments of one window that stops are tried for.
MOST_STOPS = 8


@dataclass(frozen=True)
class _Samples:
    """Samples of all nodes.

    Attributes:
        rows: see `mcserver.motion.kernels.sample_limits`.
        vertices: rows at the ends of timed segments, and the groups' ends that they stand at.
    """

    rows: Array
    vertices: NDArray[np.intp]
    ends: NDArray[np.intp]

    @classmethod
    def of(cls, nodes: Nodes, groups: Groups) -> _Samples:
        marks = nodes.marks[groups.starts]
        (timed,) = np.nonzero(nodes.timed[groups.starts])
        last = groups.offset[timed + 1] - 1
        before, after = marks[timed, BEFORE] != 0, marks[timed, AFTER] != 0
        vertices = np.concatenate((last[after], (last - after)[before]))
        return cls(groups.rows, vertices, np.concatenate((timed[after] + 1, timed[before])))

    def under(self, caps: Array) -> Array:
        """The rows where a vertex at the end of a timed segment asks for no more than its cap does."""
        if not len(self.vertices):
            return self.rows
        rows = self.rows.copy()
        rows[self.vertices, -1] = np.minimum(rows[self.vertices, -1], caps[self.ends])
        return rows


@dataclass(frozen=True)
class _Law:
    """A time law over groups.

    Attributes:
        times: at the segments' starts and at the end, shape (n+1,) [s].
    """

    groups: Groups
    solution: Solution
    phases: Phases
    times: Array


class Lookahead:
    """Collects segments into a run and gives its time law.

    Attributes:
        nodes: its segments. entry: speed at its beginning [m/s or rad/s along σ].
    """

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits
        self._solver = ProfileSolver()
        self._corners = TimedCorners(limits)
        self.nodes = Nodes(len(limits.velocity))
        self.entry = 0.0

    def append(self, segment: Segment, *, from_rest: bool = False) -> None:
        """Joins a segment that travels to the run; the joint's cap says whether it can flow."""
        cap = 0.0
        vertex: Array | None = None
        if not from_rest and self.nodes:
            met = junction(self.nodes.segments[-1], segment, self._limits)
            cap, segment.scale, vertex = met.speed, met.scale, met.samples
        samples, limit = samples_of(segment, self._limits)
        self.nodes.append(segment, cap, limit, samples, vertex)

    def append_run(self, run: StraightRun, active: int, *, from_rest: bool = False) -> None:
        """Joins segments on end, as `append` does one by one."""
        count, width = run.travels.shape
        before = Before(run.travels[0], run.travels[0], 0.0, False)
        if self.nodes and not from_rest:
            last = self.nodes.segments[-1]
            before = Before(last.last, last.bend_last, last.scale, last.in_parts)
        numbers, marks = np.empty((count, NUMBERS)), np.empty((count, MARKS), np.intp)
        rows = np.zeros((3 * count, 5 * width + 2))
        samples, leads = meet_lines(
            before,
            run.travels,
            run.scales,
            run.asked,
            self._limits.rows,
            self._limits.cycle,
            numbers,
            marks,
            rows,
        )
        self.nodes.append_run(run, active, numbers, marks, rows[:samples], leads=leads)

    def joint_speed(self, segment: Segment) -> float:
        """Greatest speed over the joint with a segment that is not in the run yet [m/s or rad/s along σ]."""
        return junction(self.nodes.segments[-1], segment, self._limits).speed if self.nodes else 0.0

    def enter_fast(self) -> None:
        """Sets the entry to the speed that the first segment could have reached from rest in its own
        length."""
        rows = self.nodes.rows_of(0)
        tops = self.nodes.numbers[:1, TOP]
        run = RunLimits(rows, np.array([0, len(rows)]), tops, self._limits)
        acceleration, jerk = run.weakest(0, 1)
        whole = self.nodes.segments[0].scale
        self.entry = 0.5 * reachable_speed(0.0, whole, acceleration, jerk, float(run.tops[0]))

    # ------------------------------------------------------------------ planning

    def plan(self) -> PlannedRun:
        """The time law of the whole run from `entry` speed to rest."""
        nodes = self.nodes
        law = self._law(nodes.columns)
        run = self._run_of(law)
        if not nodes.timed.any():
            slow = slow_vertices(nodes.columns, law.times, self._limits.rows)
            if slow.any():
                with contextlib.suppress(PlanningError):
                    other = self._law(nodes.columns_with_stops(slow))
                    stopping = self._run_of(other)
                    if stopping.phases.duration < run.phases.duration:
                        law, run = other, stopping
        groups, keys = law.groups, law.solution.keys
        inner = keys[(keys > 0) & (keys < len(groups.starts))]
        nodes.bind(groups.starts[inner], groups.bits[inner])
        return run

    def _run_of(self, law: _Law) -> PlannedRun:
        bound_by: list[Bound | None] = [None] * len(self.nodes)
        for group, bound in law.solution.late.items():
            bound_by[law.groups.starts[group]] = bound
        self._feed_bounds(law.times, bound_by)
        plain = PlannedRun(
            segments=list(self.nodes.segments),
            nodes=np.arange(len(self.nodes)),
            bounds=law.groups.bounds,
            phases=law.phases,
            timed=np.zeros(len(law.phases.start), np.bool_),
            times=law.times,
            bound_by=bound_by,
        )
        stops, corners = self._corners_of(plain)
        return plain.with_corners(stops, corners)

    def _corners_of(self, run: PlannedRun) -> tuple[list[int], list[TimedCorner]]:
        """Corners that may stand in the place of stops, each with the segment that starts at its stop."""
        found: tuple[list[int], list[TimedCorner]] = ([], [])
        untimed = ~self.nodes.timed
        (tolerant,) = np.nonzero((self.nodes.numbers[1:, TOLERANCE] > 0.0) & untimed[1:] & untimed[:-1])
        if not len(tolerant):
            return found
        at = tolerant + 1
        for index in at[run.phases.at(run.times[at])[1] <= 0.0].tolist():
            start, moment, end = run.times[index - 1 : index + 2].tolist()
            stop = Stop(
                before=run.segments[index - 1],
                after=run.segments[index],
                phases=run.phases,
                moment=moment,
                begin=float(run.bounds[index - 1]),
                sigma=float(run.bounds[index]),
                longest=0.5 * min(moment - start, end - moment),
            )
            corner = self._corners.find(stop)
            if corner is not None:
                found[0].append(index)
                found[1].append(corner)
        return found

    def _law(self, columns: Columns) -> _Law:
        groups = groups_of(columns, self.entry, self._limits.rows, self._limits.cycle)
        caps = groups.caps
        solver = KeySolver(self._solver, self._limits, self.nodes, groups, self.entry)
        samples = _Samples.of(self.nodes, groups)

        def attempt(caps: Array) -> Solution:
            solver.run = RunLimits(samples.under(caps), groups.offset, groups.tops, self._limits)
            bound = caps.copy()
            bind_joints(bound, solver.run.tops)
            return solver.solve(bound)

        solution = attempt(caps)
        if solution.late and solver.raise_speeds(solution.late, solution.speeds, caps):
            solution = attempt(caps)
        if solution.late:
            solution = self._with_stops(solution, caps, attempt)
        phases = time_law(solution.phases, float(groups.edges[-1]))
        times = phases.time_at(groups.bounds)
        # at keys the time law's own times are exact; where the motion rests, positions tell time poorly
        at_keys = np.append(phases.start, phases.duration)[solution.first]
        at_starts = np.append(groups.bits, START)[solution.keys] == START
        starts = np.append(groups.starts, len(self.nodes))[solution.keys]
        times[starts[at_starts]] = at_keys[at_starts]
        return _Law(groups, solution, phases, times)

    def _with_stops(self, solution: Solution, caps: Array, attempt: Callable[[Array], Solution]) -> Solution:
        """Stops at vertices beside timed segments that are late, where that lets more of them keep their T.

        A vertex that is passed with speed takes its part of the acceleration of the whole segment.
        """
        for group in list(solution.late)[:MOST_STOPS]:
            for ends in ((group,), (group + 1,), (group, group + 1)):
                inner = [end for end in ends if 0 < end < len(caps) - 1 and caps[end] > 0.0]
                if len(inner) < len(ends):
                    continue
                trial = caps.copy()
                trial[inner] = 0.0
                try:
                    other = attempt(trial)
                except PlanningError:
                    continue
                if len(other.late) < len(solution.late):
                    solution = other
                    caps[inner] = 0.0
                    break
        return solution

    def _feed_bounds(self, times: Array, bound_by: list[Bound | None]) -> None:
        numbers = self.nodes.numbers
        slower = numbers[:, SPEED] < numbers[:, FEED] * (1.0 - 1e-9)
        longer = np.diff(times) > numbers[:, REQUESTED] * (1.0 + 1e-9)
        for index in np.nonzero(slower & longer & ~self.nodes.timed)[0].tolist():
            limit = self.nodes.limit_of(index)
            bound_by[index] = Bound(limit.column, limit.kind)
