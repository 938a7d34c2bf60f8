"""How fast a program's rows may be played here: slopes of the rate, and the rate from which a stop is
possible.
"""

from __future__ import annotations

import math

import numpy as np

from mcserver.executor.headroom import CAP, FULL, HALF, OWN, SLOPE_MAX
from mcserver.executor.playback.playback import NEAR_U, Playback
from mcserver.executor.playback.rate import (
    FLOOR_SHARE,
    SMOOTHING_S,
    USED_SHARE,
    RateAccelerationLimits,
    RateRamp,
)
from mcserver.executor.shm.rings import ProgramRing, scalar_view
from mcserver.machine.machine_file import Machine


class RateLimiter:
    """Looks at the rows ahead of a playback; see `mcserver.executor.headroom`."""

    def __init__(self, ring: ProgramRing, playback: Playback, machine: Machine) -> None:
        acceleration = np.array([axis.max_acceleration for axis in machine.axes])
        self._ring = ring
        self._playback = playback
        self._room = USED_SHARE * acceleration
        self._floor = FLOOR_SHARE * acceleration
        self._cycle = machine.cycle_s
        self._u_cells = scalar_view(ring.row_u)
        self._cells = scalar_view(ring.headroom)

    def slopes(self, u: float, rate: float) -> RateAccelerationLimits:
        """How fast the rate may change over the rows that u passes in the next cycle."""
        ring, playback = self._ring, self._playback
        before = max(playback.following - 1, playback.first)
        last = ring.rows_written - 1
        if last < playback.first:
            return RateAccelerationLimits()
        passed = 2
        if before < playback.following:
            passed += int(u - self._u_cells[before % ring.rows] + rate - NEAR_U)
        numbers = [min(before + step, last) % ring.rows for step in range(passed)]
        velocity = ring.velocity[numbers] * playback.driven
        acceleration = np.diff(velocity, axis=0) / self._cycle
        direction = np.sign(velocity.sum(axis=0))
        along = acceleration * (direction * rate * rate)
        speed = np.abs(velocity).max(axis=0) + 1e-30
        down = (np.maximum(self._room + along.min(axis=0), self._floor) / speed).min()
        up = (np.maximum(self._room - along.max(axis=0), self._floor) / speed).min()
        return RateAccelerationLimits(min(float(down), SLOPE_MAX), min(float(up), SLOPE_MAX))

    def fastest(self, u: float, ramp: RateRamp, target: float, edge: float | None) -> float:
        """The greatest rate, up to ``target``, from which u can still stop before ``edge`` and keep all
        limits.

        w = r² may be as large as what it can lose until each row, plus what that row allows. Up to 100 % only
        the edge counts; rows allow 100 %.

        Args:
            ramp: the rate at present and its slope, for what passes until another slope has built up.
        """
        ring, playback = self._ring, self._playback
        before, after = playback.following - 1, playback.following
        if before < playback.first or after >= ring.rows_written:
            return min(target, 1.0) if after < ring.rows_written else 0.0
        share = min(max(u - self._u_cells[before % ring.rows], 0.0), 1.0)
        slow = 1.0
        if edge is not None:
            there, part = self._row_before(edge)
            slow = max(
                self._stoppable(before, share, there, part, FULL, math.inf),
                self._stoppable(before, share, there, part, HALF, 0.5),
            )
            slow = max(0.0, slow - max(ramp.slope, 0.0) * SMOOTHING_S)
        if target <= 1.0 or slow < 1.0:
            return min(target, slow)
        ahead, part = self._row_before(u + ramp.rate * SMOOTHING_S / self._cycle)
        own = self._sum_at(ahead, part, OWN)
        last = ring.rows_written - 1 if edge is None else max(self._row_before(edge)[0], after)
        w = min(
            self._least(after, max(min(ahead, last), after), near=True),
            self._least(ahead, max(ahead, last), near=False) - own,
        )
        if edge is not None:
            w = min(w, self._sum_at(*self._row_before(edge), OWN) - own)
        return max(1.0, min(target, math.sqrt(max(w, 0.0))))

    def _stoppable(self, here: int, share: float, there: int, part: float, column: int, most: float) -> float:
        """The rate from which u can stop by one of the sums; while the slope builds up, the rate falls
        less.
        """
        w = self._sum_at(there, part, column) - self._sum_at(here, share, column)
        gain = self._sum_at(here + 1, 0.0, column) - self._sum_at(here, 0.0, column)
        lag = 0.5 * gain / self._cycle * SMOOTHING_S
        return math.sqrt(lag * lag + max(min(w, most), 0.0)) - lag

    def _row_before(self, u: float) -> tuple[int, float]:
        """Return the number of the last row at or before u, and the share of the way to the next one."""
        ring, playback = self._ring, self._playback
        last = ring.rows_written - 1
        base = max(playback.following - 1, playback.first)
        number = base + int(u - self._u_cells[base % ring.rows] + NEAR_U)
        number = min(max(number, base), last)
        while number > base and self._u_cells[number % ring.rows] > u + NEAR_U:
            number -= 1
        return number, min(max(u - self._u_cells[number % ring.rows], 0.0), 1.0)

    def _sum_at(self, number: int, part: float, column: int) -> float:
        cells, rows = self._cells, self._ring.rows
        here: float = cells[number % rows, column]
        if part <= 0.0 or number + 1 >= self._ring.rows_written:
            return here
        there: float = cells[(number + 1) % rows, column]
        return here + part * (there - here)

    def _least(self, first: int, last: int, *, near: bool) -> float:
        """Return the least w that rows allow: by themselves, or (not ``near``) plus the sum that stands at
        them."""
        ring = self._ring
        low, high = first % ring.rows, last % ring.rows
        slices = [slice(low, high + 1)] if low <= high else [slice(low, ring.rows), slice(0, high + 1)]
        least = math.inf
        for part in slices:
            caps = ring.headroom[part, CAP]
            if near:
                caps = caps - ring.headroom[part, OWN]
            least = min(least, float(caps.min()))
        return least
