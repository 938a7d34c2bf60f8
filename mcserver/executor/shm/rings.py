"""One program's ring of setpoint rows and ring of control entries, over one buffer.

Single writer (the planner's side), single reader (the executor's). The counters only grow; each is written by
one side. A payload is written before the counter that announces it, and read before the counter that frees
it: on x86-64 stores become visible in program order and CPython reorders nothing, so aligned 8-byte counters
are enough; other architectures would need a barrier here. A full ring has no room, and nothing is ever
overwritten.

What the reader has not come to can be replaced as a whole: the writer puts the new rows and entries where
there is room, and asks. The reader answers in its next cycle: it takes them in the place of the old ones, in
one go, or refuses, and nothing has changed. While a replacement is asked for, the counters of what is written
are the reader's.
"""

from __future__ import annotations

import struct
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Array, Control, ControlKind
from mcserver.executor.headroom import RATE_MAX, AxisLimits, HeadroomWriter
from mcserver.motion.geometry.row_torques import NUMBERS, stop_cycles
from mcserver.motion.pieces import LineEdges, Rows

ROWS = 4096
CONTROLS = 4096

_HEADER_WORDS = 16
_ROWS_WRITTEN, _ROWS_READ, _CONTROLS_WRITTEN, _CONTROLS_READ, _TORQUE_STOP = range(5)
# of a replacement: its number and that of the last one answered, below 0 where it was refused; the number of
# the first row and entry that it replaces, where those in their place stand meanwhile, and how many they are
_ASKED, _ANSWERED, _ROW, _ROW_FROM, _ROW_COUNT, _ENTRY, _ENTRY_FROM, _ENTRY_COUNT = range(5, 13)
# number of the row after those that come with it; kind, u, line, axes, seconds, operation, token, channel,
# value, whether values follow
_CONTROL = struct.Struct("<qqdqQdqqqdq")
# the same by word
_WITH, _KIND, _U, _LINE = range(4)
_WORDS = _CONTROL.size // 8
# what rounding may take u back by between entries
_ROUNDING = 1e-6
# By number: asked for twice a line, where calling the enumeration takes longer than all the rest.
_KINDS = MappingProxyType({kind.value: kind for kind in ControlKind})

Buffer = bytearray | memoryview
_Scalar = TypeVar("_Scalar", bound=np.generic)


def scalar_view(array: NDArray[Any]) -> Any:
    """An array's elements as Python numbers; reading one takes 20 ns, through numpy it takes 90."""
    view: Any = memoryview(array)  # type: ignore[arg-type]
    return view


def program_ring_size(rows: int, controls: int, axes: int, torques: int = 0) -> int:
    """Bytes that a ring takes."""
    words = _HEADER_WORDS + rows * (6 + 2 * axes + NUMBERS * torques) + controls * (_CONTROL.size // 8 + axes)
    return 8 * words


class ProgramRing:
    """Both ends of the rings of one program; each side makes its own object over the same buffer.

    Args:
        buffer: at least `program_ring_size` bytes, zeroed; None: memory of this process.
        axes: K, columns of the machine.
        torques: J, joints whose torques are limited.
        limits: what rows are weighed against for overrides above 100 %; only the writer needs it. None: rows
            may be played at any rate.

    Attributes:
        entry_rows, entry_kind, entry_u, entry_line: shape (controls,); entry number n stands at n % controls.
            ``entry_rows``: number of the row after those that come with it. The reader's view.
        row_u, row_mask, row_line: shape (rows,); position, velocity: (rows, K); headroom: (rows,);
            feed_scale: (rows,), the override at which they are played as they are, and pace: (rows,), the
            rate at which they are then;
            torque: (rows, 3, J), see `row_torques`, 0 where it is not known. Row number n of the program
            stands at n % rows. The reader's view.
    """

    def __init__(
        self,
        buffer: Buffer | None,
        rows: int = ROWS,
        controls: int = CONTROLS,
        axes: int = 1,
        limits: AxisLimits | None = None,
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
        self.headroom: Array = self._words(np.float64, rows)
        self.feed_scale: Array = self._words(np.float64, rows)
        self.pace: Array = self._words(np.float64, rows)
        self.torque: Array = self._words(np.float64, rows * NUMBERS * torques).reshape(rows, NUMBERS, torques)
        self._values: Array = self._words(np.float64, controls * axes).reshape(controls, axes)
        self._controls_at = self._offset
        words = np.frombuffer(self._buffer, np.int64, controls * _WORDS, self._offset)
        self._entry_words: NDArray[np.int64] = words.reshape(controls, _WORDS)
        self.entry_rows, self.entry_kind, _, self.entry_line = self._entry_words.T[: _LINE + 1]
        self.entry_u: Array = self._entry_words.view(np.float64)[:, _U]
        cells = self._buffer[self._offset : self._offset + controls * _CONTROL.size]
        self._control_words, self._control_numbers = cells.cast("q"), cells.cast("d")
        self._weigh = None if limits is None else HeadroomWriter(limits)
        self._last_u = -1
        self._last_control_u = 0.0
        # what these are once the replacement that is asked for has been taken
        self._then: tuple[HeadroomWriter | None, int, float] | None = None
        # how many rows had been written before the one that is tried
        self._tried: int | None = None

    def _words(self, kind: type[_Scalar], count: int) -> NDArray[_Scalar]:
        array: NDArray[_Scalar] = np.frombuffer(self._buffer, kind, count, self._offset)
        self._offset += 8 * count
        return array

    # ------------------------------------------------------------------ the writer

    def restart(self) -> tuple[int, int]:
        """A new program begins: u may start at 0 again.

        Returns:
            Numbers of its first row and first control entry, for the reader to begin at.
        """
        self._last_u = -1
        self._last_control_u = 0.0
        self._counters[_TORQUE_STOP] = 0
        self._counters[_ASKED] = self._counters[_ANSWERED] = 0
        self._then = None
        if self._weigh is not None:
            self._weigh.restart()
        return self._counters[_ROWS_WRITTEN], self._counters[_CONTROLS_WRITTEN]

    def row_room(self) -> int:
        """How many rows fit now."""
        return self.rows - (self._counters[_ROWS_WRITTEN] - self._counters[_ROWS_READ])

    def control_room(self) -> int:
        """How many control entries fit now."""
        return self.controls - (self._counters[_CONTROLS_WRITTEN] - self._counters[_CONTROLS_READ])

    def put_rows(
        self,
        first_u: int,
        position: Array,
        velocity: Array,
        axes: NDArray[np.uint64],
        line: NDArray[np.int64],
        torque: Array | None = None,
        feed_scale: Array | None = None,
        pace: float = 1.0,
    ) -> None:
        """Rows at u = first_u, first_u + 1, … (see `MotionSink`).

        Raises:
            OverflowError: more rows than `row_room`; none was taken.
            ValueError: u goes back; none was taken.
        """
        count = len(line)
        if count == 0:
            return
        if count > self.row_room():
            raise OverflowError(f"{count} rows do not fit, there is room for {self.row_room()}")
        if first_u <= self._last_u:
            raise ValueError(f"row {first_u} comes after row {self._last_u}")
        headroom = None if self._weigh is None else self._weigh.of(first_u, velocity, axes, torque)
        if torque is not None:
            self._counters[_TORQUE_STOP] = max(self._counters[_TORQUE_STOP], stop_cycles(torque))
        written = self._counters[_ROWS_WRITTEN]
        rows = Rows(first_u, position, velocity, axes, line, torque, feed_scale, pace)
        self._write_rows(written, rows, headroom)
        self._last_u = first_u + count - 1
        self._counters[_ROWS_WRITTEN] = written + count

    def _write_rows(self, number: int, rows: Rows, headroom: Array | None) -> None:
        """Write rows from ``number`` on."""
        first_u, count, torque, feed_scale = rows.first, len(rows.line), rows.torque, rows.feed_scale
        done = 0
        while done < count:
            at = (number + done) % self.rows
            part = min(count - done, self.rows - at)
            target, source = slice(at, at + part), slice(done, done + part)
            self.row_u[target] = np.arange(first_u + done, first_u + done + part)
            self.row_mask[target] = rows.axes[source]
            self.row_line[target] = rows.line[source]
            self.position[target] = rows.position[source]
            self.velocity[target] = rows.velocity[source]
            self.torque[target] = 0.0 if torque is None else torque[source]
            self.headroom[target] = RATE_MAX if headroom is None else headroom[source]
            self.feed_scale[target] = 1.0 if feed_scale is None else feed_scale[source]
            self.pace[target] = rows.pace
            done += part

    def put_control(self, control: Control, rows: int = 0) -> None:
        """Put an entry (see `MotionSink`) before the rows that lie past it, of which ``rows`` come with it.

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

    def put_edges(self, u: Array, line: NDArray[np.int64], ends: NDArray[np.bool_], rows: int = 0) -> None:
        """Put entries where lines begin and end (see `MotionSink`).

        Raises:
            OverflowError: more than `control_room`; none was taken.
            ValueError: u goes back; none was taken.
        """
        count = len(u)
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
        self._write_edges(written, LineEdges(u, line, ends), self._counters[_ROWS_WRITTEN] + rows)
        self._counters[_CONTROLS_WRITTEN] = written + count

    def _write_edges(self, number: int, edges: LineEdges, comes_with: int) -> None:
        """Write edges from entry ``number`` on, which count with the row before ``comes_with``."""
        count = len(edges)
        places = np.arange(number, number + count) % self.controls
        words = np.zeros((count, _WORDS), np.int64)
        words[:, _WITH] = comes_with
        words[:, _KIND] = np.where(edges.ends, ControlKind.LINE_END, ControlKind.LINE_START)
        words.view(np.float64)[:, _U] = edges.u
        words[:, _LINE] = edges.line
        self._entry_words[places] = words

    # ------------------------------------------------------------------ the writer replaces

    def last_rows(self, u: int, most: int) -> Array | None:
        """Return the velocities of up to ``most`` rows that end with the one at ``u`` and that the reader has
        not come to, shape (n, K) [m/s or rad/s]; None where such a row is not there.
        """
        counters = self._counters
        number = counters[_ROWS_WRITTEN] - (self._last_u - u)
        first = max(number - most, counters[_ROWS_READ])
        if first >= number or self.row_u[(number - 1) % self.rows] != u:
            return None
        found: Array = self.velocity[np.arange(first, number) % self.rows]
        return found

    def row_at(self, u: int) -> tuple[Array, Array] | None:
        """Return position and velocity (K,) of the row at ``u``; None where it is not there."""
        number = self._counters[_ROWS_WRITTEN] - 1 - (self._last_u - u)
        at = number % self.rows
        if (
            number >= self._counters[_ROWS_WRITTEN]
            or number < self._counters[_ROWS_READ]
            or self.row_u[at] != u
        ):
            return None
        return self.position[at].copy(), self.velocity[at].copy()

    def replacement_room(self, u: int) -> int:
        """Return how many rows could be put in the place of those behind ``u``."""
        counters = self._counters
        kept = counters[_ROWS_WRITTEN] - (self._last_u - u) - counters[_ROWS_READ]
        return min(self.rows - kept - (self._last_u - u), (self.rows - kept) // 2)

    def ask_replacement(self, rows: Rows, edges: LineEdges, entries_back: int) -> bool:
        """Ask the reader to take rows, and where lines begin and end, in the place of what is behind.

        Nothing may be put before `replacement_answer` has one.

        Args:
            rows: from a u that a row was put for, as smooth behind the row before as that one.
            edges: behind that row. entries_back: how many entries they replace, all of them such edges.

        Returns:
            False, and nothing asked, where there is no room, or what is replaced is no longer there.
        """
        counters, count = self._counters, len(rows.line)
        written, entries = counters[_ROWS_WRITTEN], counters[_CONTROLS_WRITTEN]
        number, entry = written - (self._last_u - rows.first + 1), entries - entries_back
        row_from, entry_from = max(written, number + count), max(entries, entry + len(edges))
        if number - 2 < counters[_ROWS_READ] or entry < counters[_CONTROLS_READ]:
            return False
        if row_from + count - counters[_ROWS_READ] > self.rows:
            return False
        if entry_from + len(edges) - counters[_CONTROLS_READ] > self.controls:
            return False
        before, earlier = (number - 1) % self.rows, (number - 2) % self.rows
        if self.row_u[before] != rows.first - 1 or self.row_u[earlier] != rows.first - 2:
            return False
        weigh, headroom = self._weigh, None
        if weigh is not None:
            mask = int(self.row_mask[earlier] & self.row_mask[before])
            weigh = weigh.behind(rows.first - 1, mask, self.velocity[earlier], self.velocity[before])
            headroom = weigh.of(rows.first, rows.velocity, rows.axes, rows.torque)
        self._write_rows(row_from, rows, headroom)
        self._write_edges(entry_from, edges, number)
        last_u = rows.first + count - 1
        self._then = (weigh, last_u, float(edges.u[-1]) if len(edges) else float(rows.first - 1))
        counters[_ROW], counters[_ROW_FROM], counters[_ROW_COUNT] = number, row_from, count
        counters[_ENTRY], counters[_ENTRY_FROM], counters[_ENTRY_COUNT] = entry, entry_from, len(edges)
        counters[_ASKED] += 1
        return True

    def replacement_answer(self) -> bool | None:
        """Return whether the reader has taken the replacement; None: it has not answered."""
        if self.replacement_asked:
            return None
        taken = self._counters[_ANSWERED] > 0
        if taken and self._then is not None:
            self._weigh, self._last_u, self._last_control_u = self._then
        self._then = None
        return taken

    # ------------------------------------------------------------------ the reader

    @property
    def torque_stop(self) -> int:
        """The longest stop that the torques of this program's rows ask for [cycles]."""
        return self._counters[_TORQUE_STOP]

    @property
    def rows_written(self) -> int:
        """Number of the row after the last one."""
        return self._counters[_ROWS_WRITTEN]

    @property
    def controls_written(self) -> int:
        """Number of the control entry after the last one."""
        return self._counters[_CONTROLS_WRITTEN]

    def free_rows(self, before: int) -> None:
        """Rows with numbers below ``before`` are read; their room is the writer's again."""
        self._counters[_ROWS_READ] = before

    def free_controls(self, before: int) -> None:
        """Control entries with numbers below ``before`` are read."""
        self._counters[_CONTROLS_READ] = before

    @property
    def replacement_asked(self) -> bool:
        """Whether a replacement waits for an answer."""
        return self._counters[_ASKED] != abs(self._counters[_ANSWERED])

    @property
    def answers(self) -> int:
        """Differs from before once a replacement was answered."""
        return self._counters[_ANSWERED]

    @property
    def replacement(self) -> tuple[int, int]:
        """Numbers of the first row and the first entry that are to be replaced."""
        return self._counters[_ROW], self._counters[_ENTRY]

    def try_replacement(self) -> None:
        """Put the new rows in the place of those behind, to be looked at: it is taken or refused next."""
        counters = self._counters
        self._tried = counters[_ROWS_WRITTEN]
        self._swap_rows()
        counters[_ROWS_WRITTEN] = counters[_ROW] + counters[_ROW_COUNT]

    def _swap_rows(self) -> None:
        counters = self._counters
        for array in self._row_arrays:
            _swap(array, counters[_ROW], counters[_ROW_FROM], counters[_ROW_COUNT])

    @property
    def _row_arrays(self) -> tuple[NDArray[Any], ...]:
        rows = (self.row_u, self.row_mask, self.row_line, self.position, self.velocity, self.torque)
        return (*rows, self.headroom, self.feed_scale, self.pace)

    def refuse_replacement(self) -> None:
        """Leave everything as it is, or was before it was tried."""
        tried, self._tried = self._tried, None
        if tried is not None:
            self._swap_rows()
            self._counters[_ROWS_WRITTEN] = tried
        self._counters[_ANSWERED] = -self._counters[_ASKED]

    def take_replacement(self) -> None:
        """Put the new rows and entries in the place of those behind."""
        counters = self._counters
        tried, self._tried = self._tried, None
        if tried is None:
            number, source, count = counters[_ROW], counters[_ROW_FROM], counters[_ROW_COUNT]
            for array in self._row_arrays:
                _move(array, number, source, count)
            counters[_ROWS_WRITTEN] = number + count
        entry, source, count = counters[_ENTRY], counters[_ENTRY_FROM], counters[_ENTRY_COUNT]
        _move(self._entry_words, entry, source, count)
        counters[_CONTROLS_WRITTEN] = entry + count
        counters[_ANSWERED] = counters[_ASKED]

    def rows_with(self, number: int) -> int:
        """Number of the row after those that come with a control entry, which must be there."""
        return self._control_words[number % self.controls * _WORDS]

    def glance(self, number: int) -> tuple[int, int, float]:
        """Return `rows_with`, the kind as a number, and u [cycles] of an entry, which must be there."""
        words, at = self._control_words, number % self.controls * _WORDS
        return words[at], words[at + _KIND], self._control_numbers[at + _U]

    def control(self, number: int) -> Control:
        """The control entry of that number, which must be written and not freed."""
        at = number % self.controls
        _, kind, u, line, axes, seconds, operation, token, channel, value, has_values = _CONTROL.unpack_from(
            self._buffer, self._controls_at + at * _CONTROL.size
        )
        values = tuple(self._values[at].tolist()) if has_values else None
        return Control(_KINDS[kind], u, line, axes, values, seconds, operation, token, channel, value)


def _swap(array: NDArray[Any], to: int, source: int, count: int) -> None:
    """Exchange elements of a ring with others; the two do not overlap."""
    size, done = len(array), 0
    while done < count:
        here, there = (to + done) % size, (source + done) % size
        part = min(count - done, size - here, size - there)
        kept = array[here : here + part].copy()
        array[here : here + part] = array[there : there + part]
        array[there : there + part] = kept
        done += part


def _move(array: NDArray[Any], to: int, source: int, count: int) -> None:
    """Copy elements of a ring to where others stand; the two do not overlap."""
    size, done = len(array), 0
    while done < count:
        here, there = (to + done) % size, (source + done) % size
        part = min(count - done, size - here, size - there)
        array[here : here + part] = array[there : there + part]
        done += part
