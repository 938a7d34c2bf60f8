"""Setpoints from a program's rows: exact at whole u, cubic Hermite between, and how fast u may pass."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.axes import ColumnMasks
from mcserver.executor.feedback import FeedbackRow
from mcserver.executor.headroom import CAP, FULL, HALF, OWN, SLOPE_MAX, Array
from mcserver.executor.rate import FLOOR_SHARE, SMOOTHING_S, USED_SHARE, RateRamp, Slopes
from mcserver.executor.rings import ProgramRing, scalar_view

# Two values of u that are closer are the same [cycles].
NEAR_U = 1e-7


@dataclass(frozen=True)
class Jump:
    """The first row of a motion is not where its axis is: the column, the distance and what is allowed."""

    column: int
    distance: float
    allowed: float


class Playback:
    """The rows of one program as they are played.

    Attributes:
        active: mask of the columns between BEGIN and END.
        line: line of the row played last.
    """

    def __init__(
        self,
        ring: ProgramRing,
        row: FeedbackRow,
        masks: ColumnMasks,
        acceleration: Array,
        jump: Array,
        cycle_s: float,
    ) -> None:
        """``jump``: shape (K,), how far the first row of a motion may be from the axis's setpoint."""
        self._ring = ring
        self._row = row
        self._masks = masks
        self._acceleration = acceleration
        self._jump = jump
        self._cycle = cycle_s
        count = ring.axes
        self._u_cells = scalar_view(ring.row_u)
        self._mask_cells = scalar_view(ring.row_mask)
        self._line_cells = scalar_view(ring.row_line)
        self._headroom = scalar_view(ring.headroom)
        self._scratch = np.zeros(count)
        self._difference = np.zeros(count)
        self._start_position = np.zeros(count)
        self._start_u = np.zeros(count)
        self.open(0)

    def open(self, base: int) -> None:
        """Begins with row number ``base``."""
        self._first = base
        self._next = base
        self.active = 0
        self._fresh = 0
        self._unchecked = 0
        self._begun = 0.0
        self.line = 0

    # ------------------------------------------------------------------ rows

    @property
    def empty(self) -> bool:
        """Whether no row of this program has come yet."""
        return self._ring.rows_written == self._first

    @property
    def last_u(self) -> float:
        """u of the last row there is; below 0 where there is none."""
        written = self._ring.rows_written
        if written == self._first:
            return -1.0
        return float(self._u_cells[(written - 1) % self._ring.rows])

    def seek(self, u: float) -> None:
        """Lets the row at or before u be the current one, and frees those before it."""
        ring, cells = self._ring, self._u_cells
        number, written, rows = self._next, ring.rows_written, ring.rows
        bound = u + NEAR_U
        while number < written and cells[number % rows] <= bound:
            number += 1
        if number != self._next:
            self._next = number
            # the row before the current one is not needed any more
            ring.free_rows(max(self._first, number - 1))

    def drop(self) -> None:
        """Frees all rows: nothing more of this program is played."""
        self._first = self._next = self._ring.rows_written
        self._ring.free_rows(self._next)
        self.active = self._fresh = 0

    # ------------------------------------------------------------------ beginning and ending

    def begin(self, mask: int, u: float) -> None:
        """Rows drive these columns from u on, from where their setpoints are."""
        self.active |= mask
        self._fresh |= mask
        self._unchecked |= mask
        bools = self._masks.bools(mask)
        np.copyto(self._start_position, self._row.setpoint, where=bools)
        self._start_u[bools] = u
        self._begun = u

    def end(self, mask: int, u: float, final: tuple[float, ...] | None) -> None:
        """Rows have ended: the columns hold ``final``, else their last row, at or right after u."""
        mask &= self.active
        self.seek(u)
        bools = self._masks.bools(mask)
        ring, number = self._ring, self._next
        if final is not None:
            np.copyto(self._row.setpoint, np.array(final), where=bools)
        else:
            self._interpolate(u, 0.0)
            current = number - 1
            exact = current >= self._first and self._u_cells[current % ring.rows] > u - NEAR_U
            if not exact and number < ring.rows_written and self._u_cells[number % ring.rows] < u + 1.0:
                # the row after a fractional end holds the target where it stands still
                at = number % ring.rows
                resting = bools & self._masks.bools(self._mask_cells[at]) & (ring.velocity[at] == 0.0)
                np.copyto(self._row.setpoint, ring.position[at], where=resting)
        self._row.velocity[bools] = 0.0
        self.active &= ~mask
        self._fresh &= ~mask
        self._unchecked &= ~mask
        if not self.active:
            # rows up to here are no start of a motion that begins later, even at this very u
            self._first = self._next

    def leave(self, mask: int) -> None:
        """Columns are not driven any more; their setpoints stay."""
        mask &= self.active
        self._row.velocity[self._masks.bools(mask)] = 0.0
        self.active &= ~mask
        self._fresh &= ~mask
        self._unchecked &= ~mask

    def jump(self) -> Jump | None:
        """A first row that is too far from where its axis is; looked at once it has come."""
        ring = self._ring
        number = self._next
        if number - 1 >= self._first and self._u_cells[(number - 1) % ring.rows] >= self._latest_start():
            number -= 1
        if number >= ring.rows_written:
            return None
        at = number % ring.rows
        mask = self._unchecked & self._mask_cells[at]
        self._unchecked &= ~mask
        for column in self._masks.columns(mask):
            distance = abs(float(ring.position[at, column]) - float(self._start_position[column]))
            cycles = max(1.0, float(self._u_cells[at]) - self._start_u[column])
            allowed = self._jump[column] * min(cycles, 2.0)
            if not distance <= allowed:
                return Jump(column, distance, allowed)
        return None

    def start_of(self, column: int) -> float:
        """Where the axis was as its rows began."""
        return float(self._start_position[column])

    @property
    def at_start(self) -> bool:
        """Whether the motion has not come to its first row."""
        return self.active != 0 and self._fresh == self.active

    def unmoved(self, u: float) -> bool:
        """Whether the motion stands at its very beginning."""
        return self.at_start and u <= self._begun + NEAR_U

    @property
    def rests_at_end(self) -> bool:
        """Whether the last row there is has no velocity."""
        ring = self._ring
        return not ring.velocity[(ring.rows_written - 1) % ring.rows].any()

    def _latest_start(self) -> float:
        columns = list(self._masks.columns(self._unchecked))
        return float(self._start_u[columns].max()) - NEAR_U

    @property
    def unchecked(self) -> bool:
        """Whether a first row has not been looked at."""
        return self._unchecked != 0

    # ------------------------------------------------------------------ playing

    def play(self, u: float, rate: float) -> None:
        """Setpoints of the active columns at u; ``rate`` scales their velocities."""
        self.seek(u)
        number = self._next - 1
        if number >= self._first:
            at = number % self._ring.rows
            if self._u_cells[at] > u - NEAR_U:
                self._play_row(at, rate)
                return
        self._interpolate(u, rate)

    def _play_row(self, at: int, rate: float) -> None:
        ring, row = self._ring, self._row
        mask = self._mask_cells[at] & self.active
        self._fresh &= ~mask
        self.line = self._line_cells[at]
        bools = self._masks.bools(mask)
        np.copyto(row.setpoint, ring.position[at], where=bools)
        if rate == 1.0:
            np.copyto(row.velocity, ring.velocity[at], where=bools)
        else:
            np.multiply(ring.velocity[at], rate, out=self._scratch)
            np.copyto(row.velocity, self._scratch, where=bools)

    def _interpolate(self, u: float, rate: float) -> None:
        ring = self._ring
        before, after = self._next - 1, self._next
        if before >= self._first:
            at = before % ring.rows
            reached = self._fresh & self._mask_cells[at] & self._started_by(self._u_cells[at])
            self._fresh &= ~reached
        if after >= ring.rows_written:
            if before >= self._first:
                self._play_row(before % ring.rows, 0.0)
            return
        at = after % ring.rows
        after_u: int = self._u_cells[at]
        self.line = self._line_cells[at]
        driven = self.active & self._mask_cells[at]
        joined = 0
        if before >= self._first and self._u_cells[before % ring.rows] == after_u - 1:
            joined = driven & self._mask_cells[before % ring.rows] & ~self._fresh
        if joined:
            first = before % ring.rows
            self._hermite(
                ring.position[first],
                ring.velocity[first],
                at,
                u - (after_u - 1),
                1.0,
                rate,
                self._masks.bools(joined),
            )
        for column in self._masks.columns(driven & ~joined):
            self._lead_in(column, at, after_u, u, rate)

    def _started_by(self, u: int) -> int:
        mask = 0
        for column in self._masks.columns(self._fresh):
            if self._start_u[column] <= u + NEAR_U:
                mask |= 1 << column
        return mask

    def _lead_in(self, column: int, at: int, after_u: int, u: float, rate: float) -> None:
        """From rest, where the axis was, to its first row."""
        row, ring = self._row, self._ring
        start = float(after_u - 1)
        if self._fresh >> column & 1:
            start = max(start, self._start_u[column])
            origin = self._start_position[column]
        else:
            origin = ring.position[(self._next - 1) % ring.rows, column]
        span = after_u - start
        share = (u - start) / span if span > NEAR_U else 1.0
        if share <= 0.0:
            row.velocity[column] = 0.0
            return
        target, speed = float(ring.position[at, column]), float(ring.velocity[at, column])
        seconds = span * self._cycle
        rise = share * share * (3.0 - 2.0 * share)
        row.setpoint[column] = (
            origin + rise * (target - origin) + seconds * speed * share * share * (share - 1.0)
        )
        slope = (
            6.0 * share * (1.0 - share) * (target - origin) / seconds + share * (3.0 * share - 2.0) * speed
        )
        row.velocity[column] = slope * rate

    def _hermite(
        self,
        start: Array,
        speed: Array,
        at: int,
        share: float,
        span: float,
        rate: float,
        where: NDArray[np.bool_],
    ) -> None:
        """Cubic from (start, speed) to the row at ``at``, ``share`` of the way; span in cycles."""
        ring, row = self._ring, self._row
        seconds = span * self._cycle
        difference, scratch = self._difference, self._scratch
        end_speed = ring.velocity[at]
        np.subtract(ring.position[at], start, out=difference)
        if not (speed * end_speed).any() and self._steep(start, speed, at, share, rate, where):
            return
        left = 1.0 - share
        np.multiply(difference, share * share * (3.0 - 2.0 * share), out=scratch)
        scratch += start
        scratch += (seconds * share * left * left) * speed
        scratch -= (seconds * share * share * left) * ring.velocity[at]
        np.copyto(row.setpoint, scratch, where=where)
        np.multiply(difference, 6.0 * share * left / seconds, out=scratch)
        scratch += (left * (1.0 - 3.0 * share)) * speed
        scratch += (share * (3.0 * share - 2.0)) * ring.velocity[at]
        scratch *= rate
        np.copyto(row.velocity, scratch, where=where)

    def _steep(
        self, start: Array, speed: Array, at: int, share: float, rate: float, where: NDArray[np.bool_]
    ) -> bool:
        """A motion that ends, or begins, between two rows: a cubic would swing past its rest.

        With one speed zero, the other v and the way d, a cubic is monotone up to v·dt = 3·d. Beyond that the motion is
        at rest for a part of the cycle; at constant acceleration the part in which it moves is 2·d/v.

        Returns:
            False where no axis is like that, and nothing was done.
        """
        ring, row, difference = self._ring, self._row, self._difference
        end_speed = ring.velocity[at]
        moving = speed + end_speed
        steep = where & (np.abs(moving) * self._cycle > 3.0 * np.abs(difference))
        if not steep.any():
            return False
        self._steep_axes(steep, start, speed, at, share, rate)
        rest = where & ~steep
        if rest.any():
            left = 1.0 - share
            rise = share * share * (3.0 - 2.0 * share)
            position = start + rise * difference + (self._cycle * share * left) * (left * speed - share * end_speed)
            slope = (
                (6.0 * share * left / self._cycle) * difference
                + (left * (1.0 - 3.0 * share)) * speed
                + (share * (3.0 * share - 2.0)) * end_speed
            )
            np.copyto(row.setpoint, position, where=rest)
            np.copyto(row.velocity, rate * slope, where=rest)
        return True

    def _steep_axes(
        self, steep: NDArray[np.bool_], start: Array, speed: Array, at: int, share: float, rate: float
    ) -> None:
        row, difference = self._row, self._difference
        end_speed = self._ring.velocity[at]
        for column in np.nonzero(steep)[0].tolist():
            way, moving = float(difference[column]), float(speed[column] + end_speed[column])
            part = max(0.0, 2.0 * way / (moving * self._cycle))
            # seen from the row with the speed
            from_speed = share if speed[column] != 0.0 else 1.0 - share
            left = max(0.0, 1.0 - from_speed / part) if part > 0.0 else 0.0
            gone = way * (1.0 - left * left)
            row.setpoint[column] = start[column] + (gone if speed[column] != 0.0 else way - gone)
            row.velocity[column] = rate * moving * left

    # ------------------------------------------------------------------ how fast u may pass

    def slopes(self, u: float, rate: float) -> Slopes:
        """How fast the rate may change over the rows that u passes in the next cycle."""
        ring = self._ring
        before = max(self._next - 1, self._first)
        last = ring.rows_written - 1
        if last < self._first:
            return Slopes()
        passed = 2
        if before < self._next:
            passed += int(u - self._u_cells[before % ring.rows] + rate - NEAR_U)
        numbers = [min(before + step, last) % ring.rows for step in range(passed)]
        where = self._masks.bools(self.active)
        velocity = ring.velocity[numbers] * where
        acceleration = np.diff(velocity, axis=0) / self._cycle
        direction = np.sign(velocity.sum(axis=0))
        along = acceleration * (direction * rate * rate)
        speed = np.abs(velocity).max(axis=0) + 1e-30
        floor = FLOOR_SHARE * self._acceleration
        room = USED_SHARE * self._acceleration
        down = (np.maximum(room + along.min(axis=0), floor) / speed).min()
        up = (np.maximum(room - along.max(axis=0), floor) / speed).min()
        return Slopes(min(float(down), SLOPE_MAX), min(float(up), SLOPE_MAX))

    def fastest(self, u: float, ramp: RateRamp, target: float, edge: float | None) -> float:
        """The greatest rate, up to ``target``, from which u can still stop before ``edge`` and keep all limits.

        See `mcserver.executor.headroom`: w = r² may be as large as what it can lose until each row, plus what
        that row allows. Up to 100 % only the edge counts; rows allow 100 %.

        Args:
            ramp: the rate at present and its slope, for what passes until another slope has built up.
        """
        ring = self._ring
        before, after = self._next - 1, self._next
        if before < self._first or after >= ring.rows_written:
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
        way = ramp.rate * SMOOTHING_S / self._cycle
        ahead, part = self._row_before(u + way)
        own = self._headroom_at(ahead, part, OWN)
        last = ring.rows_written - 1 if edge is None else max(self._row_before(edge)[0], after)
        w = min(
            self._least(after, max(min(ahead, last), after), near=True),
            self._least(ahead, max(ahead, last), near=False) - own,
        )
        if edge is not None:
            w = min(w, self._headroom_at(*self._row_before(edge), OWN) - own)
        return max(1.0, min(target, math.sqrt(max(w, 0.0))))

    def _stoppable(self, here: int, share: float, there: int, part: float, column: int, most: float) -> float:
        """The rate from which u can stop by one of the sums; while the slope builds up, the rate falls less."""
        w = self._headroom_at(there, part, column) - self._headroom_at(here, share, column)
        gain = self._headroom_at(here + 1, 0.0, column) - self._headroom_at(here, 0.0, column)
        lag = 0.5 * gain / self._cycle * SMOOTHING_S
        return math.sqrt(lag * lag + max(min(w, most), 0.0)) - lag

    def _row_before(self, u: float) -> tuple[int, float]:
        """Number of the last row at or before u, and the share of the way to the next one."""
        ring = self._ring
        last = ring.rows_written - 1
        base = max(self._next - 1, self._first)
        number = base + int(u - self._u_cells[base % ring.rows] + NEAR_U)
        number = min(max(number, base), last)
        while number > base and self._u_cells[number % ring.rows] > u + NEAR_U:
            number -= 1
        return number, min(max(u - self._u_cells[number % ring.rows], 0.0), 1.0)

    def _headroom_at(self, number: int, part: float, column: int) -> float:
        cells, rows = self._headroom, self._ring.rows
        here: float = cells[number % rows, column]
        if part <= 0.0 or number + 1 >= self._ring.rows_written:
            return here
        there: float = cells[(number + 1) % rows, column]
        return here + part * (there - here)

    def _least(self, first: int, last: int, *, near: bool) -> float:
        """Least w that rows allow: by themselves, or (not ``near``) plus the sum that stands at them."""
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
