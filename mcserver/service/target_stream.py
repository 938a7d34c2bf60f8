"""Filter a client's messages of targets, and compute the curve to follow.

A message counts once and in order; not if it is late by the sender's clock: later than it counts for (a
chunk: that long after its last point). A single point farther away than its axis could have moved since the
last one counts only if the next point confirms it. Dropped messages are counted. Limits are enforced
elsewhere (`mcserver.executor.following`).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.executor.shm.target_box import POINTS, Targets
from mcserver.machine.axis import Axis
from mcserver.service.reports import ServoStatus
from mcserver.service.tool_targets import REACH, ToolTargets

if TYPE_CHECKING:
    from mckinematics.solver import MachineKinematics

Array = NDArray[np.float64]

# Interval assumed of a stream after its first message [s].
FIRST_INTERVAL_S = 0.01
# Greatest drift between the clocks of sender and server [1].
DRIFT = 1e-3
# Least share of an interval in which a late target is to be reached.
LEAST_SHARE = 0.5
# Longest chunk [s].
LONGEST_S = 60.0
# Greatest coordinate and speed of a target for an axis without travel limits, or a tool [m or rad, per s].
FARTHEST = 1e6
# Share of the top speed at which axes move to a tool's target that they cannot reach in time.
SLOWED_SHARE = 0.8
# Ratio of the least to the given time above which a target counts as out of reach in time.
LATE_SHARE = 1.1
# Least share of the top speed to compute with, if an override stops the axes.
LEAST_RATE = 1e-3


class TargetMessage(msgspec.Struct, frozen=True):
    """A message of targets in SI.

    Attributes:
        seq, sent, counts_s: as on the wire.
        positions, velocities: shape (m, n) [m or rad, per s]; for a tool poses and twists, n 3 or 6.
        times: shape (m,) after ``sent`` [s]; None: m is 1, for now.
        tool: of poses and twists; None: positions of axes. in_tool: twists are along its own axes.
    """

    seq: int
    sent: float
    counts_s: float
    positions: Array | None
    velocities: Array | None
    times: Array | None
    tool: int | None = None
    in_tool: bool = False


class Now(NamedTuple):
    """State of the machine when a message arrives.

    Attributes:
        time: executor time [s]. setpoint: of the program's axes, shape (n,) [m or rad]; None: at rest at 0.
        rate: share of their top speed under the override.
    """

    time: float
    setpoint: Array | None = None
    rate: float = 1.0


class TargetStream:
    """Targets of one program.

    Args:
        axes: of the program, in order. cycle_s: the executor's cycle [s]. kinematics: of the machine's tools.

    Attributes:
        si_per_unit: of the axes, shape (n,). status: counts of messages. answering: an acknowledgement is
            being sent.
    """

    def __init__(
        self, axes: Sequence[Axis], cycle_s: float, kinematics: MachineKinematics | None = None
    ) -> None:
        self._cycle_s = cycle_s
        self._tools = ToolTargets(kinematics, axes)
        self._width = len(axes)
        self.si_per_unit: Array = np.array([axis.type.si_per_unit for axis in axes])
        self._low = np.maximum([axis.min_position for axis in axes], -FARTHEST)
        self._high = np.minimum([axis.max_position for axis in axes], FARTHEST)
        self._top = np.array([axis.max_velocity for axis in axes])
        self.answering = False
        self._seq = 0
        # refused messages since the last sequence number
        self._unsound = 0
        self._sent = 0.0
        # least difference between the server's clock and the sender's, and time of its last update
        self._offset = np.inf
        self._heard = 0.0
        # newest point that counts, and when it was sent
        self._position: Array | None = None
        self._placed = 0.0
        # a point that was too far away, until the next one confirms it
        self._doubtful: Array | None = None
        self.status = ServoStatus(0, 0, 0, 0, 0, 0, 0, 0, 0, 0.0, 0.0)

    def take(self, message: TargetMessage, at: Now) -> Targets | None:
        """Return the curve for a message; None if it does not count. Counts it by its kind."""
        status, now = self.status, at.time
        if not self._is_sound(message):
            self._unsound += 1
            self.status = _more(status, "refused")
            return None
        if message.seq <= self._seq:
            self.status = _more(status, "doubled" if message.seq == self._seq else "reordered")
            return None
        # refused messages are not missing
        missing = max(message.seq - self._seq - 1 - self._unsound, 0) if self._seq else 0
        self._unsound = 0
        passed = message.sent - self._sent
        interval = passed / (missing + 1) if self._seq and passed > 0.0 else FIRST_INTERVAL_S
        self._seq, self._sent = message.seq, message.sent
        self._offset = min(self._offset + DRIFT * (now - self._heard), now - message.sent)
        self._heard = now
        age = now - message.sent - self._offset
        status = msgspec.structs.replace(status, lost=status.lost + missing, age_s=age)
        reach = 0.0 if message.times is None else float(message.times[-1])
        if age > reach + message.counts_s:
            self.status = _more(status, "late")
            return None
        interval = min(max(interval, self._cycle_s), message.counts_s)
        gap = min(max(message.sent - self._placed, interval), message.counts_s)
        slowed = False
        if message.tool is not None:
            led = self._lead(message, at, interval, gap)
            if isinstance(led, str):
                self.status = _more(status, led)
                return None
            message, slowed = led
        else:
            self._tools.forget()
            if message.times is None and self._is_doubtful(message.positions, gap):
                self.status = _more(status, "jumped")
                return None
        status = self.status = msgspec.structs.replace(status, interval_s=interval)
        with np.errstate(all="ignore"):
            curve = self._curve(message, now, age, gap)
        if not np.isfinite(curve.knots).all():
            # points are so close in time that the slope overflows
            self.status = _more(status, "refused")
            return None
        if message.positions is not None and self._outside(message.positions):
            status = _more(status, "clipped")
        if message.tool is not None and message.positions is not None and message.times is None:
            later = self._slowed(message.positions, curve, at)
            curve, slowed = later or curve, later is not None
        if slowed:
            status = _more(status, "slowed")
        self.status = _more(status, "taken")
        return curve

    # ------------------------------------------------------------------ what counts

    def _is_sound(self, message: TargetMessage) -> bool:
        """Return whether all numbers are finite and the shapes match the axes and the times."""
        times = message.times
        count = 1 if times is None else len(times)
        given = [each for each in (message.positions, message.velocities) if each is not None]
        width = self._width if message.tool is None else self._tools.rows(message.tool)
        shaped = all(each.shape == (count, width) for each in given) and given and width
        if not shaped or not 0 < count <= POINTS or not np.isfinite(message.sent):
            return False
        if times is not None:
            steps = np.diff(times, prepend=0.0)
            if not (np.isfinite(times).all() and (steps[1:] > 0.0).all() and times[0] >= 0.0):
                return False
            if times[-1] > LONGEST_S:
                return False
        most = sys.float_info.max if message.tool is None else FARTHEST
        return all((np.abs(each) <= most).all() for each in given) and 0.0 < message.counts_s < np.inf

    def _is_doubtful(self, positions: Array | None, gap: float) -> bool:
        """Return whether a point is too far from the last one, and from a doubtful one before it."""
        if positions is None:
            return False
        point, reach = positions[0], REACH * self._top * gap
        known = [each for each in (self._position, self._doubtful) if each is not None]
        with np.errstate(over="ignore"):
            # an infinite distance is not near
            near = not known or any((np.abs(point - each) <= reach).all() for each in known)
        self._doubtful = None if near else point
        return not near

    def _outside(self, positions: Array) -> bool:
        return bool((positions < self._low).any() or (positions > self._high).any())

    # ------------------------------------------------------------------ tools

    def _lead(
        self, message: TargetMessage, at: Now, interval: float, gap: float
    ) -> tuple[TargetMessage, bool] | Literal["jumped", "refused"]:
        """Convert a message for a tool to one for the axes; return it, and whether the tool is slowed."""
        tools, number, times = self._tools, message.tool, message.times
        assert number is not None
        here = np.zeros(self._width) if at.setpoint is None else at.setpoint
        rate = max(at.rate, LEAST_RATE)
        positions, velocities, slowed = message.positions, message.velocities, False
        if positions is None:
            assert velocities is not None
            steps = np.array([interval]) if times is None else np.diff(times, prepend=0.0)
            velocities, slowed = tools.twists(
                number, velocities, steps, here=here, share=rate, in_tool=message.in_tool
            )
        else:
            rest = here if self._position is None else self._position
            found = tools.poses(
                number, positions, near=(here, rest), gap=gap if times is None else None, now=at.time
            )
            if isinstance(found, str):
                return found
            positions = found
            if velocities is not None:
                velocities = tools.rates_at(number, positions, velocities, in_tool=message.in_tool)
            if times is not None and len(times) > 1:
                # slow all points alike, so that the path keeps its shape
                slower = float((tools.time_to(positions[1:], positions[0], rate) / np.diff(times)).max())
                slowed = slower > LATE_SHARE
                if slowed:
                    times = slower / SLOWED_SHARE * times
                    velocities = None if velocities is None else velocities * SLOWED_SHARE / slower
        return msgspec.structs.replace(
            message, positions=positions, velocities=velocities, times=times
        ), slowed

    def _slowed(self, positions: Array, curve: Targets, at: Now) -> Targets | None:
        """Return a slower curve of all axes to a target that they cannot reach in time; None if they can."""
        here = np.zeros(self._width) if at.setpoint is None else at.setpoint
        least = float(self._tools.time_to(positions, here, max(at.rate, LEAST_RATE))[0])
        if least <= LATE_SHARE * (curve.knots[-1, 0] - at.time):
            return None
        knots = _knots(np.array([at.time + least / SLOWED_SHARE]), positions, np.zeros_like(positions))
        return curve._replace(knots=knots)

    # ------------------------------------------------------------------ the curve

    def _curve(self, message: TargetMessage, now: float, age: float, gap: float) -> Targets:
        until, begun = now - age + message.counts_s, now - age
        velocities, positions = message.velocities, message.positions
        if velocities is not None:
            velocities = velocities.clip(-self._top, self._top)
        if positions is None:
            assert velocities is not None
            # the axes leave the last point
            self._position = self._doubtful = None
            times, last = np.array([self.status.interval_s]), 0.0
            if message.times is not None:
                times, last = message.times, float(message.times[-1])
            knots = _knots(begun + times, np.zeros_like(velocities), velocities)
            return Targets(knots, now, until + last, by_velocity=True)
        positions = positions.clip(self._low, self._high)
        before, self._position = self._position, positions[-1]
        self._placed = message.sent + (0.0 if message.times is None else float(message.times[-1]))
        if message.times is not None:
            slopes = _slopes(message.times, positions) if velocities is None else velocities
            slopes = slopes.clip(-self._top, self._top)
            knots = _knots(begun + message.times, positions, slopes)
            return Targets(knots, now, until + float(message.times[-1]))
        # reach the target when the next one is due, by the sender's clock; a late one is extrapolated to the
        # time at which it is reached
        interval = self.status.interval_s
        late = max(age - (1.0 - LEAST_SHARE) * interval, 0.0)
        at = begun + interval + late
        if velocities is not None:
            return Targets(_knots(np.array([at]), positions + late * velocities, velocities), now, until)
        near = before is not None and bool((np.abs(positions[0] - before) <= REACH * self._top * gap).all())
        if before is None or not near:
            return Targets(_knots(np.array([at]), positions, np.zeros_like(positions)), now, until)
        # quadratic spline through the midpoints between points: it does not overshoot, and comes to rest at
        # the last point if no more come
        slope = ((positions - before) / gap).clip(-self._top, self._top)
        rows = np.concatenate((0.5 * (positions + before), positions))
        knots = _knots(np.array([at, at + gap]), rows, np.concatenate((slope, 0.0 * slope)))
        return Targets(knots, now, until)


def _knots(times: Array, positions: Array, velocities: Array) -> Array:
    count, width = positions.shape
    found = np.empty((count, 1 + 2 * width))
    found[:, 0], found[:, 1 : 1 + width], found[:, 1 + width :] = times, positions, velocities
    return found


def _slopes(times: Array, positions: Array) -> Array:
    """Return velocities at points of a curve, from parabolas through three points; at rest at the end."""
    if len(times) < 2:
        return np.zeros_like(positions)
    slopes: Array = np.gradient(positions, times, axis=0)
    slopes[-1] = 0.0
    return slopes


def _more(status: ServoStatus, name: str) -> ServoStatus:
    return msgspec.structs.replace(status, **{name: getattr(status, name) + 1})
