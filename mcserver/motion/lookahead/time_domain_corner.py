"""Time-domain corner blends: replace a stop at a corner by synchronized trajectories within the tolerance.

A motion along the path would stop at the corner. From a time x before that stop to a time x after it the axes
leave the path: each takes a minimum-time trajectory from its state before to its state after, all of the same
duration. Where the lines move different axes, the end of one ramp overlaps with the beginning of the next,
and acceleration need not vanish between them. Position, velocity and acceleration are continuous and within
each axis's limits, so mostly the tolerance limits x (D-35, D-36).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.blend import chord_error_of, may_be_passed_in_time, sample_programmed_path
from mcserver.motion.geometry.curves import Array, Curve
from mcserver.motion.geometry.segment import AxisLimits, KnownBlend, Segment, columns_of
from mcserver.motion.kernels.corner_trajectory import SAMPLES, evaluate_trajectories, path_deviation_of
from mcserver.motion.kernels.junctions import length_of
from mcserver.motion.kernels.min_time_trajectories import PHASES, min_time_trajectories
from mcserver.motion.profile.velocity_profile import Phases

# Least time that a blend has to save [cycles].
MIN_SAVING = 0.1
# Most blend times that are tried at one corner.
MAX_TRIALS = 10
# Share of the tolerance to aim at, and the share from which on the search ends.
AIM, NEAR = 0.97, 0.92
# Deviation grows with the second or third power of the blend time: a trial corrects it by this power,
POWER = 0.4
# by factors between these,
LEAST, MOST = 0.4, 2.5
# and stays this share of the bracket away from blend times known to be too short or too long.
ASIDE = 0.3
# The first trial leaves the lines where they are this far from the vertex [tolerances].
FAR = 4.0
# Programmed points resolve an arc if their polyline has this share of its length.
CHORDS = 0.99
# Tolerance for rounding when a phase is looked up by time [s].
ROUNDING = 1e-9


class TimeDomainCurve(Curve, frozen=True, eq=False):
    """Trajectories of K axes over time; s is time / duration.

    Attributes:
        axes: machine columns. duration: [s]. phases: of constant jerk, for each axis: start time, and
            position, velocity, acceleration and jerk then, shape (K, n, 5).
    """

    duration: float
    phases: Array

    def position(self, s: Array) -> Array:
        return self._at(s)[0]

    def derivatives(self, s: Array) -> tuple[Array, Array, Array]:
        _, first, second, third = self._at(s)
        return first * self.duration, second * self.duration**2, third * self.duration**3

    def _at(self, s: Array) -> tuple[Array, Array, Array, Array]:
        """Return position and its derivatives by time, shape (len(s), K)."""
        found = np.empty((4, len(s), len(self.axes)))
        evaluate_trajectories(self.phases, np.asarray(s, dtype=float) * self.duration, found)
        return found[0], found[1], found[2], found[3]


@dataclass(frozen=True)
class TimeDomainBlend:
    """The blend that replaces a stop.

    Attributes:
        leave, join: times of the velocity profile between which it replaces the path [s]; also as σ
            (``sigma_leave``, ``sigma_join``) and as s of the two segments (``leave_s``, ``join_s``).
        duration: of the blend [s]. turn: share of that at which it is nearest to the vertex.
        parts: of the first line, up to ``turn``, and of the second.
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
        """Time that it saves [s]."""
        return self.join - self.leave - self.duration

    @property
    def phase(self) -> Array:
        """Its row of `mcserver.motion.kernels.phases`."""
        speed = (self.sigma_join - self.sigma_leave) / self.duration
        return np.array([[self.duration, self.sigma_leave, speed, 0.0, 0.0]])


@dataclass(frozen=True)
class Stop:
    """A stop between two segments of a velocity profile.

    Attributes:
        before, after: the segments. phases: the velocity profile. moment: time of the stop [s].
        begin, sigma: σ where ``before`` begins, and at the stop. max_blend_time: of a blend, to either side
            [s].
    """

    before: Segment
    after: Segment
    phases: Phases
    moment: float
    begin: float
    sigma: float
    max_blend_time: float


@dataclass(frozen=True)
class _State:
    """One end of a blend: s of its segment, σ, and position, velocity and acceleration of all columns."""

    s: float
    sigma: float
    position: Array
    velocity: Array
    acceleration: Array


def is_time_domain(segment: Segment) -> bool:
    """Return whether a segment is part of a time-domain blend."""
    return any(isinstance(curve, TimeDomainCurve) for curve in segment.curves)


class TimeDomainBlends:
    """Finds time-domain blends under the limits of a machine."""

    def __init__(self, limits: AxisLimits) -> None:
        self._limits = limits

    def find(self, stop: Stop) -> TimeDomainBlend | None:
        """Return the blend that saves most time within ``stop.after.tolerance``; None where none saves any.

        The result is cached in ``stop.after.corner``, since the next plan mostly has the same stop.
        """
        before, after = stop.before, stop.after
        if (
            not (may_be_passed_in_time(before) and may_be_passed_in_time(after))
            or not stop.max_blend_time > 0.0
        ):
            return None
        ramp_time = _shorter_ramp_time(stop)
        known = after.corner
        if (
            known is not None
            and math.isclose(known.max_blend_time, stop.max_blend_time)
            and math.isclose(known.ramp_time, ramp_time)
        ):
            if known.blend_time <= 0.0:
                return None
            found, deviation = self._try(stop, min(known.blend_time, stop.max_blend_time))
            if found is not None and deviation <= after.tolerance:
                return found
        best = self._search(stop, ramp_time)
        if best is not None and best.saved < MIN_SAVING * self._limits.cycle:
            best = None
        after.corner = KnownBlend(
            0.0 if best is None else stop.moment - best.leave, stop.max_blend_time, ramp_time
        )
        return best

    def _search(self, stop: Stop, ramp_time: float) -> TimeDomainBlend | None:
        """Return the longest blend within the tolerance: time saved and path deviation both grow with the
        blend time.
        """
        best: TimeDomainBlend | None = None
        good, bad = 0.0, math.inf
        blend_time = min(self._initial_blend_time(stop, ramp_time), stop.max_blend_time)
        if not blend_time > 0.0:
            return None
        for _ in range(MAX_TRIALS):
            corner, deviation = self._try(stop, blend_time)
            share = deviation / stop.after.tolerance
            if share <= 1.0:
                good, best = blend_time, corner or best
                if share >= NEAR or blend_time >= stop.max_blend_time:
                    break
            else:
                bad = blend_time
            blend_time *= min(max((AIM / max(share, 1e-6)) ** POWER, LEAST), MOST)
            if math.isfinite(bad):
                aside = ASIDE * (bad - good)
                blend_time = min(max(blend_time, good + aside), bad - aside)
            blend_time = min(blend_time, stop.max_blend_time)
        return best

    def _initial_blend_time(self, stop: Stop, ramp_time: float) -> float:
        """Return a first estimate of the blend time, within a factor of a few [s]."""
        weights = self._limits.weights
        leave = _state(stop.phases, stop.moment - ramp_time, stop.before, stop.begin)
        join = _state(stop.phases, stop.moment + ramp_time, stop.after, stop.sigma)
        vertex = stop.after.base
        far = min(float(np.linalg.norm((each.position - vertex) * weights)) for each in (leave, join))
        wanted = FAR * stop.after.tolerance
        if wanted < far:
            return ramp_time * math.sqrt(wanted / far)
        speed = max(float(np.linalg.norm(each.velocity * weights)) for each in (leave, join))
        return ramp_time + (wanted - far) / max(speed, 1e-9)

    def _try(self, stop: Stop, blend_time: float) -> tuple[TimeDomainBlend | None, float]:
        """Return the blend with a blend time [s], and its path deviation [m].

        The blend is None where it saves no time or is not allowed; the deviation is then 0 or infinite.
        """
        before, after = stop.before, stop.after
        leave = _state(stop.phases, stop.moment - blend_time, before, stop.begin)
        join = _state(stop.phases, stop.moment + blend_time, after, stop.sigma)
        columns = columns_of(before.mask | after.mask)
        best, deviation = None, 0.0
        for cruising in (False, True):
            curve = self._curve(leave, join, columns, blend_time, cruising=cruising)
            if curve is None:
                # no time saved, but a longer blend might save some
                continue
            deviation, turn = self._path_deviation(stop, leave, join, curve)
            if math.isfinite(deviation) and not self._keeps_torques(stop, curve):
                deviation = math.inf
            if math.isfinite(deviation):
                best = _corner(stop, blend_time, leave, join, curve, turn)
                break
        return best, deviation

    def _curve(
        self, leave: _State, join: _State, columns: NDArray[np.intp], blend_time: float, *, cruising: bool
    ) -> TimeDomainCurve | None:
        """Return the minimum-time trajectories from one state to the other; None where none beats the
        stop.
        """
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
        trajectories = np.empty((len(columns), PHASES, 5))
        bounds = np.stack((most, limits.jerk[columns]))
        duration = min_time_trajectories(states, bounds, 2.0 * blend_time, cruising, trajectories)
        if not duration < 2.0 * blend_time:
            return None
        trajectories[:, :, 1] += here[:, None]
        return TimeDomainCurve(tuple(columns.tolist()), duration, trajectories)

    def _keeps_torques(self, stop: Stop, curve: TimeDomainCurve) -> bool:
        """Return whether the joints' torques stay within their limits on a curve."""
        torque = self._limits.torque
        if torque is None:
            return True
        width = len(stop.after.base)
        s = np.linspace(0.0, 1.0, SAMPLES)
        position = np.tile(stop.after.base, (SAMPLES, 1))
        columns = list(curve.axes)
        position[:, columns] = curve.position(s)
        velocity, acceleration = np.zeros((SAMPLES, width)), np.zeros((SAMPLES, width))
        first, second, _ = curve.derivatives(s)
        velocity[:, columns] = first / curve.duration
        acceleration[:, columns] = second / curve.duration**2
        return torque.load(position, velocity, acceleration, stop.after.carried) <= 1.0

    def _path_deviation(
        self, stop: Stop, leave: _State, join: _State, curve: TimeDomainCurve
    ) -> tuple[float, float]:
        """Return the path deviation [m] and the share of the duration at which the vertex is nearest.

        The deviation is infinite where the curve is not allowed.
        """
        before, after = stop.before, stop.after
        columns = np.array(curve.axes, dtype=np.intp)
        if before.straight and after.straight:
            chord_error = 0.0
            programmed = np.stack((leave.position, after.base, join.position))[:, columns]
        else:
            programmed = sample_programmed_path(before, after, leave.s, join.s)[:, columns]
            chord_error = chord_error_of(programmed)
            if _length_of_points(programmed) < CHORDS * (join.sigma - leave.sigma):
                return math.inf, 0.5
        speeds = np.stack((leave.velocity, join.velocity))
        slower = math.sqrt(float((speeds * speeds).sum(axis=1).max()))
        lines = ((before, before.last), (after, after.first))
        caps = [(min(line.feed * length_of(tangent), slower), line.feed_speed) for line, tangent in lines]
        # for a handful of columns numpy's search would take longer than all the rest
        counted = [line.feed_columns.tolist() for line, _ in lines]
        feed_columns = [[float(axis in each) for axis in curve.axes] for each in counted]
        found: tuple[float, float] = path_deviation_of(
            curve.phases,
            curve.duration,
            np.ascontiguousarray(programmed),
            chord_error,
            self._limits.weights[columns],
            np.abs(speeds[:, columns]).max(axis=0),
            np.array(caps),
            np.array(feed_columns),
            self._limits.cycle,
        )
        return found


def _shorter_ramp_time(stop: Stop) -> float:
    """Return the duration of the shorter of the ramps to a stop and from it [s]."""
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
    """Return the mean acceleration of a phase."""
    last, _, _, acceleration, jerk = phases.rows[index].tolist()
    return float(acceleration + 0.5 * jerk * last)


def _length_of_points(points: Array) -> float:
    """Return the length of a polyline, shape (n, K)."""
    steps = np.diff(points, axis=0)
    return float(np.sqrt((steps * steps).sum(axis=1)).sum())


def _state(phases: Phases, moment: float, segment: Segment, begin: float) -> _State:
    """Return the state of a velocity profile on a segment that begins at σ = ``begin``."""
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
    stop: Stop, blend_time: float, leave: _State, join: _State, curve: TimeDomainCurve, turn: float
) -> TimeDomainBlend:
    columns = np.array(curve.axes, dtype=np.intp)
    mask = stop.before.mask | stop.after.mask
    base = stop.after.base

    def part(segment: Segment, low: float, high: float, *, opens: bool) -> Segment:
        return msgspec.structs.replace(
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
            arc=None,
        )

    return TimeDomainBlend(
        leave=stop.moment - blend_time,
        join=stop.moment + blend_time,
        sigma_leave=leave.sigma,
        sigma_join=join.sigma,
        leave_s=leave.s,
        join_s=join.s,
        duration=curve.duration,
        turn=turn,
        parts=(part(stop.before, 0.0, turn, opens=False), part(stop.after, turn, 1.0, opens=True)),
    )
