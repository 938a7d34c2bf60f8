"""Plan velocity profiles over many segments, within all limits and without needless stops (D-33, D-35, D-36).

A *run* is a chain of segments on one coordinate σ, scaled so that speed along it is continuous where
the tangent is. Each junction has a greatest speed.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import Bound, PlanningError
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import AxisLimits, Segment
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.geometry.segment_rows import SegmentRows
from mcserver.motion.kernels.arc_segments import append_path_junctions
from mcserver.motion.kernels.groups import Groups, Segments, group_segments
from mcserver.motion.kernels.junctions import PrecedingEnd, length_of
from mcserver.motion.kernels.polynomials import KINDS
from mcserver.motion.kernels.ramp_kernels import reachable_speed
from mcserver.motion.kernels.rest_vertices import slow_vertices
from mcserver.motion.kernels.sample_limits import limit_junctions, run_of
from mcserver.motion.kernels.spline_samples import PartSamples, scale_samples
from mcserver.motion.limits.path_limits import (
    Junction,
    SpeedLimit,
    junction,
    samples_of,
)
from mcserver.motion.limits.segment_table import SegmentTable, empty_columns
from mcserver.motion.limits.torque_samples import spline_with_torques
from mcserver.motion.lookahead.missed_times import late_groups, release_all, release_late, slow_early
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.lookahead.time_domain_corner import Stop, TimeDomainBlend, TimeDomainBlends
from mcserver.motion.profile.faster_stretches import KnotProfile, quicker_stretches, sample_spans
from mcserver.motion.profile.profile_solver import KnotSolver, Solution
from mcserver.motion.profile.velocity_profile import Phases, join_phases

# Times within a segment at which its speed is compared with its limit.
SPEED_PROBES = 17


@dataclass(frozen=True)
class _Samples:
    """Samples of all segments.

    Attributes:
        rows: see `mcserver.motion.kernels.sample_limits`.
        vertices, ends: rows of vertices at the ends of segments with a T, and the index of the group end of
            each.
    """

    rows: Array
    vertices: NDArray[np.intp]
    ends: NDArray[np.intp]

    @classmethod
    def of(cls, table: SegmentTable, groups: Groups) -> _Samples:
        (timed,) = np.nonzero(table.timed[groups.starts])
        last = groups.offset[timed + 1] - 1
        first = groups.starts[timed]
        before, after = table.columns.vertex_before[first] != 0, table.columns.vertex_after[first] != 0
        vertices = np.concatenate((last[after], (last - after)[before]))
        return cls(groups.rows, vertices, np.concatenate((timed[after] + 1, timed[before])))

    def under(self, junction_vmax: Array) -> Array:
        """Return the rows with the vertices at the ends of segments with a T limited to junction speeds."""
        if not len(self.vertices):
            return self.rows
        rows = self.rows.copy()
        rows[self.vertices, -1] = np.minimum(rows[self.vertices, -1], junction_vmax[self.ends])
        return rows


@dataclass(frozen=True)
class _Law:
    """A velocity profile over groups.

    Attributes:
        times: at the segments' starts and at the end, shape (n+1,) [s]. held: which segments are planned
            between knots of their own, to take their T, shape (n,). late: groups that take longer than their
            T.
    """

    groups: Groups
    solution: Solution
    phases: Phases
    times: Array
    held: NDArray[np.bool_]
    late: list[int]


class Lookahead:
    """Collects segments into a run and plans its velocity profile.

    Attributes:
        table: its segments. entry: speed at its beginning [m/s or rad/s along σ]. stop_is_last: no more
            segments come.
    """

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits
        self._corners = TimeDomainBlends(limits)
        self.table = SegmentTable(limits.of_samples.shape[1])
        self.entry = 0.0
        self.stop_is_last = False

    def append(self, segment: Segment, *, from_rest: bool = False) -> None:
        """Append a segment that travels; where the greatest junction speed is 0, the motion stops."""
        met = None if from_rest else self._joined(segment)
        samples, limit = samples_of(segment, self._limits)
        self._add(segment, met, limit, samples)

    def _joined(self, segment: Segment) -> Junction | None:
        """Return the junction with a segment to append, and set its scale; None at the run's beginning."""
        if not self.table:
            return None
        met = junction(self.table.segments[-1], segment, self._limits)
        segment.scale = met.scale
        return met

    def _add(self, segment: Segment, met: Junction | None, limit: SpeedLimit, samples: Array) -> None:
        if met is None:
            self.table.append(segment, 0.0, limit, samples, None)
        else:
            self.table.append(segment, met.speed, limit, samples, met.samples)

    def append_parts(self, parts: SegmentList, samples: PartSamples, *, joined: bool) -> None:
        """Append the parts of a spline.

        Args:
            samples: of all of them. joined: whether the first part continues the last segment with all
                derivatives.
        """
        first = parts[0]
        met: Junction | None = None
        if joined:
            last = self.table.segments[-1]
            first.scale = last.scale * length_of(first.first) / length_of(last.last)
        else:
            met = self._joined(first)
        unit = first.scale / float(samples.spans[0])
        rows, offset = samples.rows.copy(), samples.offset
        vmax, by = np.empty(len(parts)), np.empty((len(parts), 2), np.intp)
        scale_samples(rows, unit, offset, self._limits.rows, vmax, by)
        parts.set_scales(unit * samples.spans)
        if self._limits.torque is not None:
            rows = spline_with_torques(list(parts), rows, offset, self._limits, vmax, by)
        low = 0
        if not joined:
            limit = SpeedLimit(float(vmax[0]), int(by[0, 0]), KINDS[by[0, 1]])
            self._add(first, met, limit, rows[: offset[1]])
            low = 1
        if low < len(parts):
            begin = int(offset[low])
            self.table.append_parts(parts[low:], vmax[low:], by[low:], rows[begin:], offset[low:] - begin)

    def lengthen(self, line: int, seconds: float) -> None:
        """Lengthen the T of a line by lengthening that of its longest segment [s].

        Raises:
            PlanningError: none of its segments has a T.
        """
        timed = [
            (each.duration, index)
            for index, each in enumerate(self.table.segments)
            if each.line == line and each.duration is not None
        ]
        if not timed:
            raise PlanningError(line)
        duration, index = max(timed)
        segment = msgspec.structs.replace(self.table.segments[index], duration=duration + seconds)
        self.table.replace(index, segment)

    def append_path(self, lines: SegmentRows, *, from_rest: bool = False) -> None:
        """Append consecutive lines and arcs, as `append` does one by one."""
        path, arcs, still = lines.path, lines.path.arcs, lines.ends[0, 2]
        assert arcs is not None
        before = PrecedingEnd(still, still, 0.0, False)
        if self.table and not from_rest:
            last = self.table.segments[-1]
            before = PrecedingEnd(last.last, last.d2q_end, last.scale, last.may_be_split)
        columns = empty_columns(len(lines))
        rows = np.zeros((int(arcs[:, -1].sum()) + 2 * len(lines), 5 * len(still) + 2))
        samples, leads = append_path_junctions(
            before,
            lines.ends,
            arcs,
            path.spans[:, 0].copy(),
            np.column_stack((path.feed, path.requested, path.duration)),
            self._limits.rows,
            self._limits.cycle,
            columns,
            rows,
        )
        self.table.append_path(lines, columns, rows[:samples], leads=leads)

    def joint_speed(self, segment: Segment) -> float:
        """Return the greatest speed over the junction with a segment to append [m/s or rad/s along σ]."""
        return junction(self.table.segments[-1], segment, self._limits).speed if self.table else 0.0

    def enter_fast(self) -> None:
        """Set the entry speed to half of what the first segment could reach from rest over its length."""
        rows = self.table.samples_of(0)
        segment_vmax = self.table.columns.segment_vmax[:1].copy()
        limits = self._limits
        run = run_of(rows, np.array([0, len(rows)]), segment_vmax, limits.of_samples, limits.cycle)
        acceleration, jerk = run.free_at_vmax[0].tolist()
        whole = self.table.segments[0].scale
        self.entry = 0.5 * reachable_speed(0.0, whole, acceleration, jerk, float(run.segment_vmax[0]))

    # ------------------------------------------------------------------ planning

    def plan(self) -> PlannedRun:
        """Plan the whole run from the `entry` speed to rest."""
        table = self.table
        run = self._quickest(table.kernel_view)
        if table.columns.vertex_before.any() and not table.timed.any():
            # vertices leave less acceleration at higher speed: where they bind, a greater F may take longer
            programmed = table.programmed_view
            if programmed is not None and self.entry <= programmed.columns.segment_vmax[0]:
                with contextlib.suppress(PlanningError):
                    slower = self._quickest(programmed)
                    if slower.phases.duration < run.phases.duration:
                        run = slower
        return run

    def _quickest(self, segments: Segments) -> PlannedRun:
        """Plan the run through its vertices, and with stops where that might be faster; return the faster."""
        law = self._law(segments)
        run = self._run_of(law)
        if self._limits.torque is None:
            slow = slow_vertices(segments, law.times, self._limits.rows)
        else:
            # a vertex's torque samples limit all of its segment, not only its surroundings
            slow = segments.columns.vertex_before != 0
        if slow.any():
            with contextlib.suppress(PlanningError):
                stopping = self._run_of(self._law(self.table.with_stops(segments, slow)))
                if stopping.phases.duration < run.phases.duration:
                    return stopping
        return run

    def _run_of(self, law: _Law) -> PlannedRun:
        bound_by: list[Bound | None] = [None] * len(self.table)
        if law.late:
            self._late_bounds(law, bound_by)
        self._feed_bounds(law.times, bound_by)
        if self._limits.torque is not None:
            self._torque_bounds(law, bound_by)
        required_only = PlannedRun(
            segments=self.table.segments.copy(),
            window_index=np.arange(len(self.table)),
            bounds=law.groups.bounds,
            phases=law.phases,
            timed=np.zeros(len(law.phases.start), np.bool_),
            times=law.times,
            bound_by=bound_by,
            held=law.held,
            ends_early=bool(law.solution.early),
        )
        stops, corners = self._corners_of(required_only)
        return required_only.with_corners(stops, corners)

    def _corners_of(self, run: PlannedRun) -> tuple[list[int], list[TimeDomainBlend]]:
        """Return the blends that may replace stops, each with the segment that starts at its stop."""
        found: tuple[list[int], list[TimeDomainBlend]] = ([], [])
        untimed = ~self.table.timed
        (tolerant,) = np.nonzero((self.table.columns.tolerance[1:] > 0.0) & untimed[1:] & untimed[:-1])
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
                max_blend_time=0.5 * min(moment - start, end - moment),
            )
            corner = self._corners.find(stop)
            if corner is not None:
                found[0].append(index)
                found[1].append(corner)
        return found

    def _law(self, segments: Segments) -> _Law:
        groups = group_segments(segments, self.entry, self._limits.of_samples, self._limits.cycle)
        solver, limits = KnotSolver(self.table, groups, self.entry), self._limits
        samples = _Samples.of(self.table, groups)

        def attempt(junction_vmax: Array) -> Solution:
            vmax = np.minimum(groups.segment_vmax, solver.flow_vmax)
            rows = samples.under(junction_vmax)
            solver.run = run_of(rows, groups.offset, vmax, limits.of_samples, limits.cycle)
            bound = junction_vmax.copy()
            limit_junctions(bound, solver.run.segment_vmax)
            return solver.solve(bound)

        junction_vmax = solver.nominal_speeds()
        try:
            solution = attempt(junction_vmax)
        except PlanningError:
            if not solver.held.any():
                raise
            solution = release_all(solver, junction_vmax, groups.edges, attempt)
        if solution.late and solver.raise_speeds(solution.late, solution.speeds, junction_vmax):
            solution = attempt(junction_vmax)
        if solution.late:
            solution = release_late(solver, solution, junction_vmax, groups.edges, attempt)
        if solution.early:
            solution = slow_early(solver, solution, junction_vmax, groups.edges, attempt)
        profile = self._quickened(segments, groups, solver, solution)
        phases = join_phases(profile.phases, float(groups.edges[-1]), profile.uncut)
        times = phases.time_at(groups.bounds)
        # times at knots come from the phases, which are exact: near rest a position determines time poorly
        at_knots = np.append(phases.start, phases.duration)[profile.first]
        starts = np.append(groups.starts, len(self.table))
        # not where zones of a long segment meet
        opens = np.diff(starts, prepend=-1)[profile.knots] > 0
        times[starts[profile.knots][opens]] = at_knots[opens]
        held = np.zeros(len(self.table), np.bool_)
        held[groups.starts] = solver.held
        at_edges = np.append(times[groups.starts], times[-1])
        return _Law(groups, solution, phases, times, held, late_groups(solver, at_edges))

    def _quickened(
        self, segments: Segments, groups: Groups, solver: KnotSolver, solution: Solution
    ) -> KnotProfile:
        """Solve stretches without a group that keeps its T again, with acceleration at their knots."""
        columns = segments.columns
        timed, late = ~np.isnan(solver.durations), np.zeros(len(groups.starts), np.bool_)
        if timed.any():
            late[late_groups(solver, solution.times(groups.edges))] = True
        return quicker_stretches(
            solution.run,
            groups,
            # a late group is limited to its mean speed, or it would end before its T
            np.fmin(np.minimum.reduceat(columns.feed, groups.starts), solver.means),
            self._limits,
            KnotProfile(solution.phases, solution.knots, solution.first),
            sample_spans(groups, columns),
            in_time=timed & ~late,
            stops=self.stop_is_last,
        )

    def _late_bounds(self, law: _Law, bound_by: list[Bound | None]) -> None:
        """Set the limit that stretches each late group beyond its T.

        It is the speed or the acceleration if the group reaches that limit, else jerk.
        """
        late, phases = np.array(law.late), law.phases
        first = law.groups.starts[late]
        times = phases.time_at(law.groups.edges)
        low = np.clip(np.searchsorted(phases.start, times[late], side="right") - 1, 0, None)
        high = np.maximum(np.searchsorted(phases.start, times[late + 1], side="left"), low + 1)
        ends = np.column_stack((low, high)).ravel()

        def greatest(values: Array) -> Array:
            """Return the greatest value over the phases of each group."""
            found: Array = np.maximum.reduceat(np.append(values, 0.0), ends)[::2]
            return found

        last = phases.velocity + phases.rows[:, 0] * phases.acceleration
        peak = np.maximum(greatest(phases.velocity), last[high - 1])
        _, most_acceleration, most_jerk = self._limits.of_samples
        run = law.solution.run
        slope = np.maximum.reduceat(run.rows[:, : len(most_jerk)], run.offset[:-1])[late].clip(1e-300)
        accelerated = greatest(np.abs(phases.acceleration)) >= 0.999 * run.free_at_vmax[late, 0]
        columns = np.where(
            accelerated, np.argmin(most_acceleration / slope, axis=1), np.argmin(most_jerk / slope, axis=1)
        )
        for index, speed, column, by_acceleration in zip(
            first.tolist(), peak.tolist(), columns.tolist(), accelerated.tolist(), strict=True
        ):
            limit = self.table.limit_of(index)
            bound_by[index] = (
                self._limits.bound(limit.column, limit.kind)
                if speed >= 0.999 * limit.velocity
                else self._limits.bound(column, "acceleration" if by_acceleration else "jerk")
            )

    def _feed_bounds(self, times: Array, bound_by: list[Bound | None]) -> None:
        columns = self.table.columns
        slower = columns.axis_vmax < columns.feed * (1.0 - 1e-9)
        longer = np.diff(times) > columns.requested * (1.0 + 1e-9)
        for index in np.nonzero(slower & longer & ~self.table.timed)[0].tolist():
            limit = self.table.limit_of(index)
            bound_by[index] = self._limits.bound(limit.column, limit.kind)

    def _torque_bounds(self, law: _Law, bound_by: list[Bound | None]) -> None:
        """Set a torque as the bound of segments whose ramps it makes longer than the axes' limits do.

        Only where the greatest speed that the axes allow is not reached.
        """
        columns, most = self.table.columns, self._limits.of_samples[1]
        longer = np.diff(law.times) > columns.requested * (1.0 + 1e-9)
        for index in np.nonzero(longer & ~self.table.timed)[0].tolist():
            slope = self.table.samples_of(index)[:, : len(most)].max(axis=0)
            column = int(np.argmax(slope / most))
            if column < len(self._limits.velocity):
                continue
            moments = np.linspace(law.times[index], law.times[index + 1], SPEED_PROBES)
            if law.phases.at(moments)[1].max() < 0.99 * columns.axis_vmax[index]:
                bound_by[index] = self._limits.bound(column, "acceleration")
