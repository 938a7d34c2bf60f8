"""One program's ring of setpoint rows and ring of control entries, over one buffer.

Single writer (the planner), single reader (the executor). The counters only grow; each is written by one
side. A payload is written before the counter that announces it, and read before the counter that frees it: on
x86-64 stores become visible in program order and CPython does not reorder them, so aligned 8-byte counters
are enough; other architectures would need a barrier here. A full ring accepts nothing, so nothing is
overwritten.
"""

from __future__ import annotations

import struct
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Array, Control, ControlKind
from mcserver.executor.shm.target_box import TargetBox, target_box_size
from mcserver.executor.stopping import StopTimes
from mcserver.motion.geometry.row_torques import NUMBERS, stop_cycles
from mcserver.motion.pieces import LineEdges, Rows

ROWS = 4096
CONTROLS = 4096

_HEADER_WORDS = 8
_ROWS_WRITTEN, _ROWS_READ, _CONTROLS_WRITTEN, _CONTROLS_READ, _TORQUE_STOP, _ZONES_AHEAD = range(6)
# number of the row after those that belong to the entry; kind, u, line, axes, seconds, operation, token,
# channel, value, whether values follow
_CONTROL = struct.Struct("<qqdqQdqqqdq")
# indices of its words
_WITH, _KIND, _U, _LINE = range(4)
_WORDS = _CONTROL.size // 8
# tolerance for rounding of u, which must not decrease between entries
_ROUNDING = 1e-6
# By number: used twice a line, where calling the enumeration takes longer than all the rest.
_KINDS = MappingProxyType({kind.value: kind for kind in ControlKind})

Buffer = bytearray | memoryview
_Scalar = TypeVar("_Scalar", bound=np.generic)


def scalar_view(array: NDArray[Any]) -> Any:
    """View an array's elements as Python numbers; reading one takes 20 ns, through numpy 90 ns."""
    view: Any = memoryview(array)  # type: ignore[arg-type]
    return view


def program_ring_size(rows: int, controls: int, axes: int, torques: int = 0) -> int:
    """Return the size of a ring in bytes."""
    words = _HEADER_WORDS + rows * (5 + 2 * axes + NUMBERS * torques) + controls * (_CONTROL.size // 8 + axes)
    return 8 * words + target_box_size(axes)


class ProgramRing:
    """The rings of one program; writer and reader each make an object over the same buffer.

    Args:
        buffer: at least `program_ring_size` bytes, zeroed; None: memory of this process.
        axes: K, columns of the machine.
        torques: J, joints whose torques are limited.
        stops: computes the durations of stops from rows, for the writer; None: all 0.

    Attributes:
        entry_kind, entry_u, entry_line: shape (controls,); entry number n is at n % controls. For the
            reader.
        row_u, row_mask, row_line: shape (rows,); position, velocity: (rows, K); stop: (rows,), duration of a
            stop from there [cycles]; feed_scale: (rows,); torque: (rows, 3, J), see `row_torques`, 0 where
            unknown. Row number n of the program is at n % rows. For the reader.
        targets: of a program whose axes follow streamed targets.
    """

    def __init__(
        self,
        buffer: Buffer | None,
        rows: int = ROWS,
        controls: int = CONTROLS,
        axes: int = 1,
        stops: StopTimes | None = None,
        torques: int = 0,
    ) -> None:
        size = program_ring_size(rows, controls, axes, torques)
        if buffer is None:
            buffer = bytearray(size)
        if len(buffer) < size:
            raise ValueError(f"the ring needs {size} bytes, the buffer has {len(buffer)}")
        self.rows = rows
        self.controls = controls
        self.axes = axes
        self._buffer = memoryview(buffer)
        self._counters = self._buffer[: 8 * _HEADER_WORDS].cast("q")
        self._offset = 8 * _HEADER_WORDS
        self.row_u: NDArray[np.int64] = self._words(np.int64, rows)
        self.row_mask: NDArray[np.uint64] = self._words(np.uint64, rows)
        self.row_line: NDArray[np.int64] = self._words(np.int64, rows)
        self.position: Array = self._words(np.float64, rows * axes).reshape(rows, axes)
        self.velocity: Array = self._words(np.float64, rows * axes).reshape(rows, axes)
        self.stop: Array = self._words(np.float64, rows)
        self.feed_scale: Array = self._words(np.float64, rows)
        self.torque: Array = self._words(np.float64, rows * NUMBERS * torques).reshape(rows, NUMBERS, torques)
        self._values: Array = self._words(np.float64, controls * axes).reshape(controls, axes)
        self._controls_at = self._offset
        words = np.frombuffer(self._buffer, np.int64, controls * _WORDS, self._offset)
        self._entry_words: NDArray[np.int64] = words.reshape(controls, _WORDS)
        _, self.entry_kind, _, self.entry_line = self._entry_words.T[: _LINE + 1]
        self.entry_u: Array = self._entry_words.view(np.float64)[:, _U]
        cells = self._buffer[self._offset : self._offset + controls * _CONTROL.size]
        self._control_words, self._control_numbers = cells.cast("q"), cells.cast("d")
        self.targets = TargetBox(self._buffer[self._offset + len(cells) :], axes)
        self._stops = stops
        self._last_u = -1
        self._last_control_u = 0.0

    def _words(self, kind: type[_Scalar], count: int) -> NDArray[_Scalar]:
        array: NDArray[_Scalar] = np.frombuffer(self._buffer, kind, count, self._offset)
        self._offset += 8 * count
        return array

    # ------------------------------------------------------------------ the writer

    def restart(self) -> tuple[int, int]:
        """Begin a new program: u may start at 0 again.

        Returns:
            Numbers of its first row and first control entry, for the reader to begin at.
        """
        self._last_u = -1
        self._last_control_u = 0.0
        self._counters[_TORQUE_STOP] = 0
        self._counters[_ZONES_AHEAD] = 0
        self.targets.restart()
        return self._counters[_ROWS_WRITTEN], self._counters[_CONTROLS_WRITTEN]

    def put_zones_ahead(self, zones: int) -> None:
        """Set which zones the next motion may enter that inputs switch, as bits of `Clearance.switches`."""
        self._counters[_ZONES_AHEAD] = zones

    def row_room(self) -> int:
        """Return the number of rows that fit now."""
        return self.rows - (self._counters[_ROWS_WRITTEN] - self._counters[_ROWS_READ])

    def control_room(self) -> int:
        """Return the number of control entries that fit now."""
        return self.controls - (self._counters[_CONTROLS_WRITTEN] - self._counters[_CONTROLS_READ])

    def put_rows(self, rows: Rows) -> None:
        """Append rows, with u above the last one put.

        Raises:
            OverflowError: more rows than `row_room`; none was taken.
            ValueError: u decreases; none was taken.
        """
        count, first_u, torque = len(rows), rows.first, rows.torque
        if count == 0:
            return
        if count > self.row_room():
            raise OverflowError(f"{count} rows do not fit, there is room for {self.row_room()}")
        if first_u <= self._last_u:
            raise ValueError(f"row {first_u} comes after row {self._last_u}")
        stop = 0.0 if self._stops is None else self._stops.of(rows.velocity)
        if torque is not None:
            self._counters[_TORQUE_STOP] = max(self._counters[_TORQUE_STOP], stop_cycles(torque))
        written = self._counters[_ROWS_WRITTEN]
        places = np.arange(written, written + count) % self.rows
        self.row_u[places] = np.arange(first_u, first_u + count)
        self.row_mask[places] = rows.axes
        self.row_line[places] = rows.line
        self.position[places] = rows.position
        self.velocity[places] = rows.velocity
        self.torque[places] = 0.0 if torque is None else torque
        self.stop[places] = stop
        self.feed_scale[places] = 1.0 if rows.feed_scale is None else rows.feed_scale
        self._last_u = first_u + count - 1
        self._counters[_ROWS_WRITTEN] = written + count

    def stop_ahead(self) -> float:
        """Return the longest stop from the rows that the reader has not freed [cycles]."""
        return max(self.longest_stop(self._counters[_ROWS_READ]), float(self.torque_stop))

    def longest_stop(self, number: int) -> float:
        """Return the longest stop from rows ``number`` on, by the axes' limits [cycles]; 0 without rows."""
        written = self._counters[_ROWS_WRITTEN]
        if number >= written:
            return 0.0
        first, behind = number % self.rows, (written - 1) % self.rows + 1
        if first < behind:
            return float(self.stop[first:behind].max())
        return float(max(self.stop[first:].max(), self.stop[:behind].max()))

    def put_control(self, control: Control, rows: int = 0) -> None:
        """Append an entry, before the rows after it; its u is at least that of the last entry.

        Args:
            rows: number of rows that are put right after it and belong to it: the reader ignores the entry
                before these have come, so that u does not run on past a motion that begins.

        Raises:
            OverflowError: no `control_room`.
            ValueError: u goes back.
        """
        if self.control_room() < 1:
            raise OverflowError("no room for a control entry")
        if control.u < self._last_control_u - _ROUNDING:
            raise ValueError(f"a control entry at u = {control.u} comes after one at {self._last_control_u}")
        self._last_control_u = max(control.u, self._last_control_u)
        written = self._counters[_CONTROLS_WRITTEN]
        at = written % self.controls
        if control.values is not None:
            self._values[at] = control.values
        _CONTROL.pack_into(
            self._buffer,
            self._controls_at + at * _CONTROL.size,
            self._counters[_ROWS_WRITTEN] + rows,
            control.kind,
            control.u,
            control.line,
            control.axes,
            control.seconds,
            control.operation,
            control.token,
            control.channel,
            control.value,
            control.values is not None,
        )
        self._counters[_CONTROLS_WRITTEN] = written + 1

    def put_edges(self, edges: LineEdges, rows: int = 0) -> None:
        """Put `LINE_START` and `LINE_END` entries, as `put_control` does one by one.

        Raises:
            OverflowError: more than `control_room`; none was taken.
            ValueError: u goes back; none was taken.
        """
        count, u = len(edges), edges.u
        if count == 0:
            return
        if count > self.control_room():
            raise OverflowError(
                f"{count} control entries do not fit, there is room for {self.control_room()}"
            )
        latest = np.maximum.accumulate(np.concatenate(([self._last_control_u], u)))
        back = u < latest[:-1] - _ROUNDING
        if back.any():
            at = int(np.argmax(back))
            raise ValueError(f"a control entry at u = {u[at]} comes after one at {latest[at]}")
        self._last_control_u = float(latest[-1])
        written = self._counters[_CONTROLS_WRITTEN]
        words = np.zeros((count, _WORDS), np.int64)
        words[:, _WITH] = self._counters[_ROWS_WRITTEN] + rows
        words[:, _KIND] = np.where(edges.ends, ControlKind.LINE_END, ControlKind.LINE_START)
        words.view(np.float64)[:, _U] = u
        words[:, _LINE] = edges.line
        self._entry_words[np.arange(written, written + count) % self.controls] = words
        self._counters[_CONTROLS_WRITTEN] = written + count

    # ------------------------------------------------------------------ the reader

    @property
    def torque_stop(self) -> int:
        """The longest stop that the torques of this program's rows need [cycles]."""
        return self._counters[_TORQUE_STOP]

    @property
    def zones_ahead(self) -> int:
        """The zones of the last `put_zones_ahead`."""
        return self._counters[_ZONES_AHEAD]

    @property
    def rows_written(self) -> int:
        """One past the number of the last row."""
        return self._counters[_ROWS_WRITTEN]

    @property
    def controls_written(self) -> int:
        """One past the number of the last control entry."""
        return self._counters[_CONTROLS_WRITTEN]

    def free_rows(self, before: int) -> None:
        """Free the rows with numbers below ``before``."""
        self._counters[_ROWS_READ] = before

    def free_controls(self, before: int) -> None:
        """Free the control entries with numbers below ``before``."""
        self._counters[_CONTROLS_READ] = before

    def glance(self, number: int) -> tuple[int, int, float]:
        """Return of an existing entry: the number of the row after those that belong to it, its kind as a
        number, and u [cycles].
        """
        words, at = self._control_words, number % self.controls * _WORDS
        return words[at], words[at + _KIND], self._control_numbers[at + _U]

    def control(self, number: int) -> Control:
        """Return the control entry of a number, which must be written and not freed."""
        at = number % self.controls
        _, kind, u, line, axes, seconds, operation, token, channel, value, has_values = _CONTROL.unpack_from(
            self._buffer, self._controls_at + at * _CONTROL.size
        )
        values = tuple(self._values[at].tolist()) if has_values else None
        return Control(_KINDS[kind], u, line, axes, values, seconds, operation, token, channel, value)
