"""Play a program's rows: setpoints are exact at whole u, interpolated between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.column_masks import ColumnMasks
from mcserver.executor.entries import Array
from mcserver.executor.shm.feedback import FeedbackRow
from mcserver.executor.shm.rings import ProgramRing, scalar_view
from mcserver.machine.machine_file import Machine
from mcserver.motion.kernels.rate_changes import NEAR_U
from mcserver.motion.kernels.rate_window import Window
from mcserver.motion.kernels.row_interpolation import interpolate_rows, interpolation_bounds

if TYPE_CHECKING:
    from mcserver.executor.envelope import EnvelopeGuard

# Rows that stay in the ring after they have been played: limits of setpoints near them depend on them.
KEPT_ROWS = 8
# Greatest distance to the first row of a motion, in cycles of the axis's greatest velocity, plus in_position.
JUMP_CYCLES = 1.5


@dataclass(frozen=True)
class Jump:
    """A first row of a motion that is too far from its axis: column, distance and allowed distance."""

    column: int
    distance: float
    allowed: float


class Playback:
    """Playback of one program's rows.

    Attributes:
        active: mask of the columns between BEGIN and END. driven: the same, shape (K,).
        first: number of the motion's first row. following: number of the row after u. written: one past the
            number of the last row that is admitted in this cycle.
        line: line of the row played last. bounds: of interpolation, see `row_interpolation`, shape (2, K)
            [m/s² or rad/s², per s³].
    """

    def __init__(self, ring: ProgramRing, row: FeedbackRow, masks: ColumnMasks, machine: Machine) -> None:
        self._ring = ring
        self._row = row
        self._masks = masks
        self._cycle = machine.cycle_s
        self._jump = np.array(
            [axis.max_velocity * machine.cycle_s * JUMP_CYCLES + axis.in_position for axis in machine.axes]
        )
        count = ring.axes
        self._u_cells = scalar_view(ring.row_u)
        self._mask_cells = scalar_view(ring.row_mask)
        self._line_cells = scalar_view(ring.row_line)
        self._scale_cells = scalar_view(ring.feed_scale)
        self._scratch = np.zeros(count)
        # None: all rows are admitted
        self.guard: EnvelopeGuard | None = None
        self.bounds = interpolation_bounds(
            np.array([axis.max_acceleration for axis in machine.axes]),
            np.array([axis.max_jerk for axis in machine.axes]),
            machine.cycle_s,
        )
        # setpoints of the last cycles, that of cycle n in row n % 4
        self._recent = np.zeros((4, count))
        self._cycles = 0
        self._start_position = np.zeros(count)
        self._start_u = np.zeros(count)
        self.open(0)

    def open(self, base: int) -> None:
        """Begin with row number ``base``."""
        self.first = base
        self.following = base
        self.written = base
        self.active = 0
        self._fresh = 0
        self._unchecked = 0
        self._begun = 0.0
        self.line = 0
        self._recent[:] = self._row.ordered

    def shift(self, column: int, distance: float) -> None:
        """Add ``distance`` to the positions of a column at rest."""
        self._recent[:, column] += distance
        self._start_position[column] += distance

    # ------------------------------------------------------------------ rows

    def look(self) -> None:
        """Admit the rows that have come, before control entries, which precede their rows, are taken."""
        written = self._ring.rows_written
        self.written = written if self.guard is None else self.guard.admit(self.following, written)

    @property
    def driven(self) -> NDArray[np.bool_]:
        return self._masks.bools(self.active)

    @property
    def empty(self) -> bool:
        """Whether no row of this program has come yet."""
        return self.written == self.first

    def feed_scale(self, u: float) -> float:
        """Return the feed scale of the row after u, or of the last row [1]."""
        self.seek(u)
        number = min(self.following, self.written - 1)
        return 1.0 if number < self.first else float(self._scale_cells[number % self._ring.rows])

    def stop_until_last(self, u: float) -> float:
        """Return the longest stop from the rows around u up to the last row [cycles]."""
        self.seek(u)
        return self._ring.longest_stop(max(self.first, self.following - 1))

    @property
    def last_u(self) -> float:
        """u of the last row; below 0 before the first."""
        written = self.written
        if written == self.first:
            return -1.0
        return float(self._u_cells[(written - 1) % self._ring.rows])

    def seek(self, u: float) -> None:
        """Make the row at or before u the current one, and free older rows."""
        ring, cells = self._ring, self._u_cells
        number, written, rows = self.following, self.written, ring.rows
        bound = u + NEAR_U
        while number < written and cells[number % rows] <= bound:
            number += 1
        if number != self.following:
            self.following = number
            ring.free_rows(max(self.first, number - KEPT_ROWS))

    def drop(self) -> None:
        """Free all rows without playing them."""
        self.look()
        self.first = self.following = self.written
        self._ring.free_rows(self.following)
        self.active = self._fresh = 0

    # ------------------------------------------------------------------ beginning and ending

    def begin(self, mask: int, u: float) -> None:
        """Drive columns by rows from u on, starting at their present setpoints."""
        self.active |= mask
        self._fresh |= mask
        self._unchecked |= mask
        bools = self._masks.bools(mask)
        np.copyto(self._start_position, self._row.ordered, where=bools)
        self._start_u[bools] = u
        self._begun = u

    def end(self, mask: int, u: float, final: tuple[float, ...] | None) -> None:
        """End the rows of columns, which hold ``final``, or else the row at or right after u."""
        mask &= self.active
        self.seek(u)
        bools = self._masks.bools(mask)
        ring, number = self._ring, self.following
        if final is not None:
            np.copyto(self._row.ordered, np.array(final), where=bools)
        else:
            self._interpolate(u, 0.0)
            current = number - 1
            exact = current >= self.first and self._u_cells[current % ring.rows] > u - NEAR_U
            if not exact and number < self.written and self._u_cells[number % ring.rows] < u + 1.0:
                # the row after a fractional end has the target, at rest
                at = number % ring.rows
                resting = bools & self._masks.bools(self._mask_cells[at]) & (ring.velocity[at] == 0.0)
                np.copyto(self._row.ordered, ring.position[at], where=resting)
        self.leave(mask)
        if not self.active:
            # rows up to here are not the first row of a later motion, even of one that begins at this u
            self.first = self.following

    def leave(self, mask: int) -> None:
        """Stop driving columns; their setpoints stay."""
        mask &= self.active
        self._row.ordered_velocity[self._masks.bools(mask)] = 0.0
        self.active &= ~mask
        self._fresh &= ~mask
        self._unchecked &= ~mask

    def jump(self) -> Jump | None:
        """Return a first row that is too far from its axis, once that row has come; None without one."""
        ring = self._ring
        number = self.following
        if number - 1 >= self.first and self._u_cells[(number - 1) % ring.rows] >= self._latest_start():
            number -= 1
        if number >= self.written:
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
        """Return the position of an axis when its rows began."""
        return float(self._start_position[column])

    @property
    def at_start(self) -> bool:
        """Whether the motion has not reached its first row."""
        return self.active != 0 and self._fresh == self.active

    def unmoved(self, u: float) -> bool:
        """Return whether the motion is still at its beginning."""
        return self.at_start and u <= self._begun + NEAR_U

    @property
    def rests_at_end(self) -> bool:
        """Whether the last row is at rest."""
        ring = self._ring
        return not ring.velocity[(self.written - 1) % ring.rows].any()

    def _latest_start(self) -> float:
        columns = list(self._masks.columns(self._unchecked))
        return float(self._start_u[columns].max()) - NEAR_U

    @property
    def unchecked(self) -> bool:
        """Whether a first row has not been checked by `jump`."""
        return self._unchecked != 0

    # ------------------------------------------------------------------ blocks of cycles

    def whole_rows(self, u: float, limit: int) -> int:
        """Return how many rows after a whole u, up to ``limit``, can be played one per cycle.

        They follow u and each other without a gap, drive all active columns, are planned at a feed scale of
        1, and each belongs to a line.
        """
        ring, number = self._ring, self.following
        if self._fresh or self._unchecked or number - 1 < self.first:
            return 0
        if self._u_cells[(number - 1) % ring.rows] != u:
            return 0
        rows = self._places(min(self.written - number, limit))
        active = np.uint64(self.active)
        fits = (ring.row_u[rows] == int(u) + 1 + np.arange(len(rows))) & (ring.row_line[rows] != 0)
        fits &= ring.feed_scale[rows] == 1.0
        fits &= (ring.row_mask[rows] & active) == active
        return len(rows) if fits.all() else int(np.argmin(fits))

    def ahead(self, count: int, setpoint: Array, velocity: Array) -> NDArray[np.int64]:
        """Write the next ``count`` of `whole_rows`, in the columns that they drive, and return their lines.

        Args:
            setpoint, velocity: shape (count, K), written.
        """
        ring, rows, driven = self._ring, self._places(count), self.driven
        setpoint[:, driven] = ring.position[rows][:, driven]
        velocity[:, driven] = ring.velocity[rows][:, driven]
        return ring.row_line[rows]

    def _places(self, count: int) -> NDArray[np.intp]:
        """Return the indices of the next rows in the ring."""
        return np.arange(self.following, self.following + count) % self._ring.rows

    def skip(self, u: float, setpoints: Array) -> None:
        """Skip to u after a block that has played the rows before; ``setpoints``: its own, shape (n, K)."""
        self.seek(u)
        self.line = self._line_cells[(self.following - 1) % self._ring.rows]
        self.note(setpoints)

    def note(self, setpoints: Array) -> None:
        """Record the setpoints of cycles, once they are set, shape (n, K)."""
        for setpoint in setpoints[-4:]:
            self._recent[self._cycles & 3] = setpoint
            self._cycles += 1

    # ------------------------------------------------------------------ playing

    def play(self, u: float, rate: float) -> None:
        """Set the row's setpoints of the active columns for u; ``rate`` scales their velocities."""
        self.seek(u)
        number = self.following - 1
        if number >= self.first:
            at = number % self._ring.rows
            if self._u_cells[at] > u - NEAR_U:
                self._play_row(at, rate)
                return
        self._interpolate(u, rate)

    def _recent_setpoints(self) -> Array:
        """Return the setpoints of the last three cycles, the newest last, shape (3, K)."""
        latest: Array = self._recent[[(self._cycles + step) & 3 for step in (1, 2, 3)]]
        return latest

    def window(self, u: float, ahead: int) -> Window | None:
        """Return the rows around u and up to ``ahead`` rows after it; None where there are none yet."""
        ring = self._ring
        self.seek(u)
        written = self.written
        first = max(self.first, self.following - KEPT_ROWS + 1)
        behind = min(self.following + ahead, written)
        if first >= behind or self.following >= written:
            return None
        fresh = self._masks.bools(self._fresh)
        last = ring.velocity[(behind - 1) % ring.rows]
        driven = self._driven_until(first, behind)
        return Window(
            first=first,
            behind=behind,
            from_rest=self.following - 1 < self.first,
            ends=behind == written and not last[driven].any(),
            begun=self._begun,
            start=self._start_position,
            driven=driven,
            displaced=fresh & (self._start_position != self._row.ordered),
            recent=self._recent_setpoints(),
        )

    def _driven_until(self, first: int, behind: int) -> NDArray[np.bool_]:
        """Return the axes that are driven now, and those that join the motion on rows first to behind - 1.

        A change of the rate that begins before an axis joins may go on after it.
        """
        driven = self.driven
        rows = np.arange(first, behind) % self._ring.rows
        masks = self._ring.row_mask[rows]
        joining = int(np.bitwise_or.reduce(masks)) & ~self.active
        if not joining:
            return driven
        driven = driven.copy()
        for column in self._masks.columns(joining):
            (joined,) = np.nonzero(masks >> np.uint64(column) & np.uint64(1))
            at = int(joined[0])
            if at > 0:
                # after a stop it may have made independent motion before this row
                step = self._ring.position[rows[at], column] - self._ring.position[rows[at - 1], column]
                driven[column] = abs(float(step)) <= self._jump[column]
        return driven

    def _play_row(self, at: int, rate: float) -> None:
        ring, row = self._ring, self._row
        mask = self._mask_cells[at] & self.active
        self._fresh &= ~mask
        self.line = self._line_cells[at]
        bools = self._masks.bools(mask)
        np.copyto(row.ordered, ring.position[at], where=bools)
        if rate == 1.0:
            np.copyto(row.ordered_velocity, ring.velocity[at], where=bools)
        else:
            np.multiply(ring.velocity[at], rate, out=self._scratch)
            np.copyto(row.ordered_velocity, self._scratch, where=bools)

    def _interpolate(self, u: float, rate: float) -> None:
        ring = self._ring
        before, after = self.following - 1, self.following
        if before >= self.first:
            at = before % ring.rows
            reached = self._fresh & self._mask_cells[at] & self._started_by(self._u_cells[at])
            self._fresh &= ~reached
        if after >= self.written:
            if before >= self.first:
                self._play_row(before % ring.rows, 0.0)
            return
        at = after % ring.rows
        after_u: int = self._u_cells[at]
        self.line = self._line_cells[at]
        driven = self.active & self._mask_cells[at]
        joined = 0
        if before >= self.first and self._u_cells[before % ring.rows] == after_u - 1:
            joined = driven & self._mask_cells[before % ring.rows] & ~self._fresh
        if joined:
            interpolate_rows(
                ring.position,
                ring.velocity,
                before % ring.rows,
                at,
                u - (after_u - 1),
                self._cycle,
                rate,
                self.bounds,
                self._masks.bools(joined),
                self._row.ordered,
                self._row.ordered_velocity,
            )
        for column in self._masks.columns(driven & ~joined):
            self._lead_in(column, at, after_u, u, rate)

    def _started_by(self, u: int) -> int:
        columns = self._masks.columns(self._fresh)
        return sum(1 << column for column in columns if self._start_u[column] <= u + NEAR_U)

    def _lead_in(self, column: int, at: int, after_u: int, u: float, rate: float) -> None:
        """Interpolate from rest at an axis's start position to its first row."""
        row, ring = self._row, self._ring
        start = float(after_u - 1)
        if self._fresh >> column & 1:
            start = max(start, self._start_u[column])
            origin = self._start_position[column]
        else:
            origin = ring.position[(self.following - 1) % ring.rows, column]
        span = after_u - start
        share = (u - start) / span if span > NEAR_U else 1.0
        if share <= 0.0:
            row.ordered_velocity[column] = 0.0
            return
        target, speed = float(ring.position[at, column]), float(ring.velocity[at, column])
        seconds = span * self._cycle
        rise = share * share * (3.0 - 2.0 * share)
        row.ordered[column] = (
            origin + rise * (target - origin) + seconds * speed * share * share * (share - 1.0)
        )
        slope = (
            6.0 * share * (1.0 - share) * (target - origin) / seconds + share * (3.0 * share - 2.0) * speed
        )
        row.ordered_velocity[column] = slope * rate
