"""The planned run: a velocity profile over segments, with time-domain blends in place of stops."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.motion.bound import Bound
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.lookahead.time_domain_corner import TimeDomainBlend, is_time_domain
from mcserver.motion.profile.velocity_profile import Phases, join_phases

# Times that differ by no more than this are the same, but for rounding [s].
NO_TIME = 1e-12
# Relative error with which a segment keeps its T, where the profile was found by bisection.
KEPT_TIME = 2e-6


@dataclass(frozen=True)
class PlannedRun:
    """A velocity profile over n segments.

    Attributes:
        segments: in order; a time-domain blend adds two, one for each line. window_index: the segment of the
            window that each belongs to, shape (n,).
        bounds: σ at their starts and at the end, shape (n+1,).
        phases: σ over time. timed: which phases are time-domain blends, which cannot be cut inside.
        times: at ``bounds``, shape (n+1,) [s].
        bound_by: for each segment the limit that stretched it, or None.
        held: which segments take their T between knots of their own, shape (n,).
        ends_early: whether a segment ends before its T because no slower profile exists.
    """

    segments: SegmentList
    window_index: NDArray[np.intp]
    bounds: Array
    phases: Phases
    timed: NDArray[np.bool_]
    times: Array
    bound_by: list[Bound | None]
    held: NDArray[np.bool_]
    ends_early: bool = False

    @property
    def window(self) -> int:
        """Number of segments of the window that it covers."""
        return int(self.window_index[-1]) + 1

    def at_end(self, moment: float) -> float:
        """Snap a time to a segment boundary within rounding [s]."""
        near = float(self.times[int(np.argmin(np.abs(self.times - moment)))])
        return near if abs(near - moment) <= NO_TIME else moment

    def segment_at(self, moment: float) -> int:
        """Return the segment under way at a time [s] that is not inside a time-domain blend."""
        index = int(np.searchsorted(self.times, moment, side="right")) - 1
        index = min(max(index, 0), len(self.segments) - 1)
        # the start of a blend counts as the end of the line before it
        while is_time_domain(self.segments[index]):
            index -= 1
        return index

    def window_at(self, moment: float) -> int:
        """Return the segment of the window under way at a time [s], as `segment_at` does."""
        return int(self.window_index[self.segment_at(moment)])

    def keeps_time(self, index: int) -> bool:
        """Return whether a segment with a T of its own takes that time."""
        duration = self.segments[index].duration
        if duration is None:
            return False
        took = float(self.times[index + 1] - self.times[index])
        return abs(took - duration) <= KEPT_TIME * max(1.0, duration)

    def spent(self, moment: float) -> float:
        """Return how much of its T the segment under way has used at a time [s]; 0 without a T."""
        index = self.segment_at(moment)
        if self.segments[index].duration is None:
            return 0.0
        spent = moment - float(self.times[index])
        return spent if spent > NO_TIME else 0.0

    def after(self, moment: float) -> PlannedRun:
        """Return the part after a time [s] that is not inside a time-domain blend, counted from there."""
        index = self.segment_at(moment)
        sigma = float(self.phases.at(np.array([moment]))[0][0])
        segments = self.segments[index:]
        if moment - float(self.times[index]) > NO_TIME:
            # the rest of a segment under way
            first = segments[0].lasting_less(self.spent(moment), segments[0].feed_scale)
            begin = first.begin + (sigma - float(self.bounds[index])) / first.scale
            segments[0] = msgspec.structs.replace(first, begin=begin, opens=False)
        phases = self.phases.after(moment)
        return PlannedRun(
            segments=segments,
            window_index=self.window_index[index:] - self.window_index[index],
            bounds=np.maximum(self.bounds[index:] - sigma, 0.0),
            phases=phases,
            timed=self.timed[len(self.timed) - len(phases.start) :],
            times=np.maximum(self.times[index:] - moment, 0.0),
            bound_by=self.bound_by[index:],
            held=self.held[index:],
        )

    def _uncut(self, low: float, high: float) -> NDArray[np.bool_]:
        """Return which phases between two times [s] are not to be cut."""
        first, last = self.phases.span(low, high)
        return self.phases.uncut[first:last]

    def with_corners(self, stops: list[int], corners: list[TimeDomainBlend]) -> PlannedRun:
        """Return the run with blends in place of stops.

        Args:
            stops: index of the segment after each stop, increasing, above 0. corners: the blends.
        """
        if not stops:
            return self
        at = np.array(stops)
        leave, join, lasts, turn = np.array(
            [(each.leave, each.join, each.duration, each.turn) for each in corners]
        ).T
        saved = np.cumsum(join - leave - lasts)
        leave_at = leave - np.concatenate(([0.0], saved[:-1]))
        times = self.times.copy()
        times[1:] -= np.concatenate(([0.0], saved))[np.searchsorted(at, np.arange(1, len(times)))]
        times[at] = leave_at + turn * lasts
        # σ passes a blend at constant speed, over the length that the blend replaces
        from_, to = np.array([(each.sigma_leave, each.sigma_join) for each in corners]).T
        bounds = self.bounds.copy()
        bounds[at] = from_ + turn * (to - from_)
        places = np.column_stack((at, at + 1)).ravel()
        segments = SegmentList()
        bound_by: list[Bound | None] = []
        parts: list[Array] = []
        uncut: list[NDArray[np.bool_]] = []
        low, since = 0, 0.0
        for stop, corner in zip(stops, corners, strict=True):
            segments.extend(self.segments[low:stop])
            segments.extend(corner.parts)
            bound_by += [*self.bound_by[low:stop], None, None]
            parts += [self.phases.between(since, corner.leave), corner.phase]
            uncut += [self._uncut(since, corner.leave), np.zeros(len(corner.phase), np.bool_)]
            low, since = stop, corner.join
        segments.extend(self.segments[low:])
        for stop, corner in zip((at + 2 * np.arange(len(at))).tolist(), corners, strict=True):
            segments[stop - 1] = msgspec.structs.replace(
                segments[stop - 1], finish=corner.leave_s, closes=False
            )
            segments[stop + 2] = msgspec.structs.replace(segments[stop + 2], begin=corner.join_s, opens=False)
        parts.append(self.phases.between(since, self.phases.duration))
        uncut.append(self._uncut(since, self.phases.duration))
        phases = join_phases(np.concatenate(parts), self.phases.end, np.concatenate(uncut))
        timed = np.concatenate([np.full(len(part), bool(i % 2)) for i, part in enumerate(parts)])
        # the same sums as in the velocity profile, so that the end of a blend is exactly the next phase's
        # start
        leave_at = phases.start[timed]
        join_at = np.append(phases.start, phases.duration)[np.nonzero(timed)[0] + 1]
        return PlannedRun(
            segments=segments,
            window_index=np.insert(
                self.window_index, np.repeat(at, 2), np.column_stack((at - 1, at)).ravel()
            ),
            bounds=np.insert(bounds, places, np.column_stack((from_, to)).ravel()),
            phases=phases,
            timed=timed,
            times=np.insert(times, places, np.column_stack((leave_at, join_at)).ravel()),
            bound_by=bound_by + self.bound_by[low:],
            held=np.insert(self.held, np.repeat(at, 2), False),
            ends_early=self.ends_early,
        )
