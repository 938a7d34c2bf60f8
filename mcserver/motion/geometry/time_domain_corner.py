"""Corners at which a path would stop, passed within the tolerance in a time of their own.

About a stop the motion along the path loses all of its speed and gains it again. Between a moment x before
the stop and one x behind it the axes may leave the path: each goes the quickest way from its state at the one
to its state at the other, and all take the same time. Where the lines move different axes the end of one ramp
and the beginning of the next pass at once, and acceleration need not vanish between them. Position, velocity
and acceleration go on as they were, within each axis's own limits, so mostly the tolerance bounds x (D-35,
D-36).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.blend import bow_of, can_be_rounded, programmed_points
from mcserver.motion.geometry.curves import Array, span_of
from mcserver.motion.geometry.segment import AxisLimits, KnownCorner, Segment, columns_of
from mcserver.motion.kernels.corner_trajectory import PLACES, miss_of, ways_at
from mcserver.motion.kernels.junctions import length_of
from mcserver.motion.kernels.min_time_trajectories import PHASES, quickest_ways
from mcserver.motion.profile.velocity_profile import Phases

# A corner is worth its pieces if it saves this share of a cycle.
WORTH = 0.1
# Corners that are tried for one at most; the share of the tolerance to aim at, and one near enough to stop
# there; how the reach follows from that share, which grows with its second or third power, how far in one
# step, and how far from what is known to be too short or too long; what of the lines is left out at first, in
# tolerances.
TRIALS = 10
AIM, NEAR = 0.97, 0.92
POWER, LEAST, MOST, ASIDE = 0.4, 0.4, 2.5, 0.3
FAR = 4.0
# Chords of an arc are short enough if they have this share of its length.
CHORDS = 0.99
# Share of the limits that rounding may pass.
ROUNDING = 1e-9


@dataclass(frozen=True)
class TimedCurve:
    """Where K axes are in a time of their own; s is the share of that time that has passed.

    Attributes:
        axes: machine columns. duration: [s]. phases: of each axis, with constant jerk: when they begin,
            position, velocity, acceleration and jerk then, shape (K, n, 5). length: not measured.
    """

    axes: tuple[int, ...]
    duration: float
    phases: Array
    length: float = 0.0

    def position(self, s: Array) -> Array:
        return self._at(s)[0]

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        _, first, second, third = self._at(s)
        return first * self.duration, second * self.duration**2, third * self.duration**3

    def bounds(self) -> tuple[Array, Array]:
        return span_of(self.position(np.linspace(0.0, 1.0, PLACES)))

    def _at(self, s: Array) -> tuple[Array, Array, Array, Array]:
        """Position and its derivatives by time, shape (len(s), K)."""
        found = np.empty((4, len(s), len(self.axes)))
        ways_at(self.phases, np.asarray(s, dtype=float) * self.duration, found)
        return found[0], found[1], found[2], found[3]


@dataclass(frozen=True)
class TimedCorner:
    """What stands in the place of a stop.

    Attributes:
        leave, join: moments of the time law between which it stands [s], and σ and the shares of the two
            segments there. duration: what it takes itself [s]. turn: the share of that at which it is nearest
            to the vertex. parts: before that the first line's, then the second one's.
    """

    leave: float
    join: float
    sigma_leave: float
    sigma_join: float
    leave_s: float
    join_s: float
    duration: float
    turn: float
    parts: tuple[Segment, Segment]

    @property
    def saved(self) -> float:
        """[s]"""
        return self.join - self.leave - self.duration

    @property
    def phase(self) -> Array:
        """Its row of `mcserver.motion.kernels.phases`."""
        speed = (self.sigma_join - self.sigma_leave) / self.duration
        return np.array([[self.duration, self.sigma_leave, speed, 0.0, 0.0]])


@dataclass(frozen=True)
class Stop:
    """A stop between two segments of a time law.

    Attributes:
        before, after: the segments. phases: the time law. moment: when it stands still [s]. begin, sigma: σ
            where ``before`` begins, and at the stop. longest: how far a corner may reach to either side [s].
    """

    before: Segment
    after: Segment
    phases: Phases
    moment: float
    begin: float
    sigma: float
    longest: float


@dataclass(frozen=True)
class _State:
    """One end of a corner: share of the segment, σ, and place, velocity and acceleration of all columns."""

    s: float
    sigma: float
    position: Array
    velocity: Array
    acceleration: Array


def is_timed(segment: Segment) -> bool:
    """Whether it is part of a timed corner."""
    return any(isinstance(curve, TimedCurve) for curve in segment.curves)


class TimedCorners:
    """Finds them under the limits of a machine."""

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits

    def find(self, stop: Stop) -> TimedCorner | None:
        """The corner that saves most time within ``stop.after.tolerance``; None where none saves any.

        What was found is noted in that segment: the next plan mostly has the same stop.
        """
        before, after = stop.before, stop.after
        if not (can_be_rounded(before) and can_be_rounded(after)) or not stop.longest > 0.0:
            return None
        ramps = _ramps(stop)
        known = after.corner
        if (
            known is not None
            and math.isclose(known.longest, stop.longest)
            and math.isclose(known.ramps, ramps)
        ):
            if known.reach <= 0.0:
                return None
            found, miss = self._try(stop, min(known.reach, stop.longest))
            if found is not None and miss <= after.tolerance:
                return found
        best = self._search(stop, ramps)
        if best is not None and best.saved < WORTH * self._limits.cycle:
            best = None
        after.corner = KnownCorner(0.0 if best is None else stop.moment - best.leave, stop.longest, ramps)
        return best

    def _search(self, stop: Stop, ramps: float) -> TimedCorner | None:
        """The longest corner within the tolerance: what is saved and what is missed grow with its reach."""
        best: TimedCorner | None = None
        good, bad = 0.0, math.inf
        reach = min(self._guess(stop, ramps), stop.longest)
        if not reach > 0.0:
            return None
        for _ in range(TRIALS):
            corner, miss = self._try(stop, reach)
            share = miss / stop.after.tolerance
            if share <= 1.0:
                good, best = reach, corner or best
                if share >= NEAR or reach >= stop.longest:
                    break
            else:
                bad = reach
            reach *= min(max((AIM / max(share, 1e-6)) ** POWER, LEAST), MOST)
            if math.isfinite(bad):
                aside = ASIDE * (bad - good)
                reach = min(max(reach, good + aside), bad - aside)
            reach = min(reach, stop.longest)
        return best

    def _guess(self, stop: Stop, ramps: float) -> float:
        """A reach that is some tenths to some times the right one."""
        weights = self._limits.weights
        leave = _state(stop.phases, stop.moment - ramps, stop.before, stop.begin)
        join = _state(stop.phases, stop.moment + ramps, stop.after, stop.sigma)
        vertex = stop.after.base
        far = min(float(np.linalg.norm((each.position - vertex) * weights)) for each in (leave, join))
        wanted = FAR * stop.after.tolerance
        if wanted < far:
            return ramps * math.sqrt(wanted / far)
        speed = max(float(np.linalg.norm(each.velocity * weights)) for each in (leave, join))
        return ramps + (wanted - far) / max(speed, 1e-9)

    def _try(self, stop: Stop, reach: float) -> tuple[TimedCorner | None, float]:
        """The corner between two moments ``reach`` [s] about a stop, and its largest distance from the
        programmed path [m]; None: it saves nothing. The distance is infinite where none may be driven.
        """
        before, after = stop.before, stop.after
        leave = _state(stop.phases, stop.moment - reach, before, stop.begin)
        join = _state(stop.phases, stop.moment + reach, after, stop.sigma)
        columns = columns_of(before.mask | after.mask)
        best, miss = None, 0.0
        for cruising in (False, True):
            curve = self._curve(leave, join, columns, reach, cruising=cruising)
            if curve is None:
                # nothing is saved, but a longer corner might
                continue
            miss, turn = self._miss(stop, leave, join, curve)
            if math.isfinite(miss):
                best = _corner(stop, reach, leave, join, curve, turn)
                break
        return best, miss

    def _curve(
        self, leave: _State, join: _State, columns: NDArray[np.intp], reach: float, *, cruising: bool
    ) -> TimedCurve | None:
        """The quickest way from one state to the other; None: there is none that is quicker than the stop."""
        limits = self._limits
        here = leave.position[columns]
        states = np.column_stack(
            (
                join.position[columns] - here,
                leave.velocity[columns],
                join.velocity[columns],
                leave.acceleration[columns],
                join.acceleration[columns],
            )
        )
        most = np.maximum(limits.acceleration[columns], np.abs(states[:, 3:]).max(axis=1))
        ways = np.empty((len(columns), PHASES, 5))
        bounds = np.stack((most, limits.jerk[columns]))
        duration = quickest_ways(states, bounds, 2.0 * reach, cruising, ways)
        if not duration < 2.0 * reach:
            return None
        ways[:, :, 1] += here[:, None]
        return TimedCurve(tuple(columns.tolist()), duration, ways)

    def _miss(self, stop: Stop, leave: _State, join: _State, curve: TimedCurve) -> tuple[float, float]:
        """Largest distance from the programmed path [m], infinite where it may not be driven, and the share
        of the time at which it is nearest to the vertex.
        """
        before, after = stop.before, stop.after
        columns = np.array(curve.axes, dtype=np.intp)
        if before.straight and after.straight:
            bow = 0.0
            programmed = np.stack((leave.position, after.base, join.position))[:, columns]
        else:
            programmed = programmed_points(before, after, leave.s, join.s)[:, columns]
            bow = bow_of(programmed)
            if _length_of_points(programmed) < CHORDS * (join.sigma - leave.sigma):
                return math.inf, 0.5
        speeds = np.stack((leave.velocity, join.velocity))
        slower = math.sqrt(float((speeds * speeds).sum(axis=1).max()))
        lines = ((before, before.last), (after, after.first))
        caps = [(min(line.feed * length_of(tangent), slower), line.pace) for line, tangent in lines]
        paced = [np.isin(columns, line.paced) for line, _ in lines]
        found: tuple[float, float] = miss_of(
            curve.phases,
            curve.duration,
            np.ascontiguousarray(programmed),
            bow,
            self._limits.weights[columns],
            np.abs(speeds[:, columns]).max(axis=0),
            np.array(caps),
            np.array(paced, dtype=float),
            self._limits.cycle,
        )
        return found


def _ramps(stop: Stop) -> float:
    """How long the shorter of the ramps to the stop and from it lasts [s]."""
    phases = stop.phases
    at = int(np.searchsorted(phases.start, stop.moment - ROUNDING))
    low = high = at
    while low > 0 and _rise(phases, low - 1) < 0.0:
        low -= 1
    while high < len(phases.start) and _rise(phases, high) > 0.0:
        high += 1
    end = float(phases.start[high]) if high < len(phases.start) else phases.duration
    return min(stop.moment - float(phases.start[low]), end - stop.moment)


def _rise(phases: Phases, index: int) -> float:
    """Mean acceleration of a phase."""
    last, _, _, acceleration, jerk = phases.rows[index].tolist()
    return float(acceleration + 0.5 * jerk * last)


def _length_of_points(points: Array) -> float:
    """Length of a polyline, shape (n, K)."""
    steps = np.diff(points, axis=0)
    return float(np.sqrt((steps * steps).sum(axis=1)).sum())


def _state(phases: Phases, moment: float, segment: Segment, begin: float) -> _State:
    """Where a time law is on a segment that begins at σ = ``begin``."""
    sigma, speed, acceleration = phases.state(moment)
    s = segment.begin + (sigma - begin) / segment.scale
    rate, change = speed / segment.scale, acceleration / segment.scale
    if segment.straight:
        travel = segment.first
        return _State(s, sigma, segment.base + s * travel, travel * rate, travel * change)
    at = np.array([s])
    first, second, _ = segment.derivatives(at, len(segment.base))
    return _State(
        s=s,
        sigma=sigma,
        position=segment.sample(at)[0][0],
        velocity=first[0] * rate,
        acceleration=second[0] * rate**2 + first[0] * change,
    )


def _corner(
    stop: Stop, reach: float, leave: _State, join: _State, curve: TimedCurve, turn: float
) -> TimedCorner:
    columns = np.array(curve.axes, dtype=np.intp)
    mask = stop.before.mask | stop.after.mask
    base = stop.after.base

    def part(segment: Segment, low: float, high: float, *, opens: bool) -> Segment:
        return dataclasses.replace(
            segment,
            curves=(curve,),
            columns=(columns,),
            mask=mask,
            requested=0.0,
            scale=join.sigma - leave.sigma,
            begin=low,
            finish=high,
            base=base,
            active=stop.after.active,
            opens=opens,
            closes=not opens,
            straight=False,
            tolerance=0.0,
        )

    return TimedCorner(
        leave=stop.moment - reach,
        join=stop.moment + reach,
        sigma_leave=leave.sigma,
        sigma_join=join.sigma,
        leave_s=leave.s,
        join_s=join.s,
        duration=curve.duration,
        turn=turn,
        parts=(part(stop.before, 0.0, turn, opens=False), part(stop.after, turn, 1.0, opens=True)),
    )
