"""Feedback of every cycle, from the executor to the server: a ring of rows that the writer overwrites.

A cycle is one row of doubles, copied at once. The writer counts a row after it is complete; the reader copies
rows and then drops those that the writer may have begun to overwrite meanwhile.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.executor.shm.mailbox import SLOTS

Array = NDArray[np.float64]

CYCLES = 2048
# Oldest rows that a reader drops, since the writer may be overwriting them.
GUARD = 8

_HEADER_WORDS = 8
TIME, CYCLE, LATE, LINE, ESTOP, INTERLOCK, _HOMED, _SILENT = (*range(7), 8)
_HALF = (1 << 32) - 1
_HEAD = 10
SLOT_U, SLOT_RATE, SLOT_STATE, SLOT_GENERATION = range(4)
_SLOT = 4


class Block(enum.IntEnum):
    """Quantities of the axes in a row, in order."""

    SETPOINT = 0
    VELOCITY = 1
    ACTUAL = 2
    ACTUAL_VELOCITY = 3
    TORQUE = 4
    CONDITION = 5


_BLOCKS = len(Block)


class AxisCondition(enum.IntEnum):
    """Condition of an axis as the executor sees it."""

    OFF = 0
    STARTING = 1
    HOLDING = 2  # energized, at rest in position mode
    MOVING = 3  # energized, its setpoint moves
    SPEED = 4
    TORQUE = 5
    STOPPING = 6
    RELEASED = 7
    FAULT = 8


class SlotState(enum.IntEnum):
    """State of a program's slot."""

    IDLE = 0  # never opened
    RUNNING = 1
    HELD = 2  # at standstill by feed hold, or by an override of 0
    PAUSED = 3  # M00, M01: until resumed
    STARVED = 4  # at standstill inside a motion whose rows have not come
    STOPPING = 5
    STOPPED = 6  # aborted; axes hold
    FAULTED = 7
    FINISHED = 8

    @property
    def free(self) -> bool:
        """Whether the slot may be opened."""
        return self in (SlotState.IDLE, SlotState.STOPPED, SlotState.FAULTED, SlotState.FINISHED)


@dataclass(frozen=True)
class SlotFeedback:
    """One slot: u [cycles], playback rate [1], state, and the generation that it plays."""

    u: float
    rate: float
    state: SlotState
    generation: int


class SlotView(msgspec.Struct, frozen=True):
    """One slot in the newest cycle: u [cycles], playback rate and override of its program [1]."""

    u: float
    rate: float
    override: float = 1.0


@dataclass(frozen=True)
class FeedbackState:
    """The machine in one cycle; arrays of shape (K,), SI.

    Attributes:
        time: [s]. cycle: its number. late_cycles: count since the start.
        line: line that set this cycle's row, 0 where none runs. estop: the emergency stop is latched.
        homed: mask of the homed columns.
        setpoint, velocity: commanded. actual, actual_velocity, torque: from the drives.
        condition: values of `AxisCondition`.
        interlocked: an input holds the programs, or has held them and they have not been resumed since.
        inputs, outputs: values of the machine's inputs and outputs, in the order of its file's model.
        owners: who has set each output last: a slot, or a constant of `mcserver.executor.io_bank`.
    """

    time: float
    cycle: int
    late_cycles: int
    line: int
    estop: bool
    setpoint: Array
    velocity: Array
    actual: Array
    actual_velocity: Array
    torque: Array
    condition: NDArray[np.int8]
    slots: tuple[SlotFeedback, ...]
    interlocked: bool
    inputs: Array
    outputs: Array
    owners: NDArray[np.int64]
    homed: int


class FeedbackRow:
    """The row that the executor fills during a cycle: views of one array of doubles.

    Attributes:
        ordered, ordered_velocity: shape (K,), set by programs and motions. Without shapers they are the
            drives' setpoints themselves.
    """

    def __init__(self, axes: int, inputs: int = 0, outputs: int = 0) -> None:
        self.row: Array = np.zeros(row_width(axes, inputs, outputs))
        self.cells: Any = memoryview(self.row)  # type: ignore[arg-type]
        views = [self.row[_HEAD + block * axes : _HEAD + (block + 1) * axes] for block in range(_BLOCKS)]
        self.setpoint, self.velocity, self.actual, self.actual_velocity, self.torque, self.condition = views
        self.ordered, self.ordered_velocity = self.setpoint, self.velocity
        self._slots_at = _HEAD + _BLOCKS * axes
        self.inputs, self.outputs, self.owners = _io_blocks(self.row, axes, inputs, outputs)

    def separate_orders(self) -> None:
        """Give orders arrays of their own, from which shapers make the drives' setpoints."""
        self.ordered, self.ordered_velocity = self.setpoint.copy(), self.velocity.copy()

    def set_homed(self, mask: int) -> None:
        """Write which columns have a reference."""
        self._set_mask(_HOMED, mask)

    def set_silent(self, mask: int) -> None:
        """Write which columns have a drive that does not answer, so that its feedback is old."""
        self._set_mask(_SILENT, mask)

    def _set_mask(self, at: int, mask: int) -> None:
        # a double holds 53 bits
        self.cells[at] = mask & _HALF
        self.cells[at + 1] = mask >> 32 & _HALF

    def set_slot(self, slot: int, u: float, rate: float, state: int, generation: int) -> None:
        at = self._slots_at + slot * _SLOT
        cells = self.cells
        cells[at] = u
        cells[at + 1] = rate
        cells[at + 2] = state
        cells[at + 3] = generation


def homed_of(row: Sequence[float] | Array) -> int:
    """Return the mask of the homed columns of a row."""
    return _mask_at(row, _HOMED)


def silent_of(row: Sequence[float] | Array) -> int:
    """Return the mask of the columns of a row whose drives do not answer."""
    return _mask_at(row, _SILENT)


def _mask_at(row: Sequence[float] | Array, at: int) -> int:
    return int(row[at]) | int(row[at + 1]) << 32


def row_width(axes: int, inputs: int = 0, outputs: int = 0) -> int:
    """Return the number of doubles in a row."""
    return _HEAD + _BLOCKS * axes + _SLOT * SLOTS + inputs + 2 * outputs


def feedback_ring_size(axes: int, cycles: int = CYCLES, *, inputs: int = 0, outputs: int = 0) -> int:
    """Return the size of the ring in bytes."""
    return 8 * (_HEADER_WORDS + cycles * row_width(axes, inputs, outputs))


def _io_blocks(rows: Array, axes: int, inputs: int, outputs: int) -> tuple[Array, Array, Array]:
    """Return views of inputs, outputs and their owners in rows, along the last dimension."""
    at = _HEAD + _BLOCKS * axes + _SLOT * SLOTS
    ends = (at + inputs, at + inputs + outputs, at + inputs + 2 * outputs)
    return rows[..., at : ends[0]], rows[..., ends[0] : ends[1]], rows[..., ends[1] : ends[2]]


class FeedbackRing:
    """Both ends of the ring.

    Args:
        buffer: at least `feedback_ring_size` bytes, zeroed; None: memory of this process.
    """

    def __init__(
        self,
        buffer: bytearray | memoryview | None,
        axes: int,
        cycles: int = CYCLES,
        *,
        inputs: int = 0,
        outputs: int = 0,
    ) -> None:
        size = feedback_ring_size(axes, cycles, inputs=inputs, outputs=outputs)
        self._buffer = memoryview(bytearray(size) if buffer is None else buffer)
        if len(self._buffer) < size:
            raise ValueError(f"the ring needs {size} bytes, the buffer has {len(self._buffer)}")
        width = row_width(axes, inputs, outputs)
        self._inputs, self._outputs = inputs, outputs
        self._axes, self._cycles = axes, cycles
        self._counter = self._buffer[: 8 * _HEADER_WORDS].cast("q")
        self._rows: Array = np.frombuffer(self._buffer, np.float64, cycles * width, 8 * _HEADER_WORDS)
        self._rows = self._rows.reshape(cycles, width)
        self._width = width
        # the same as Python numbers, which for a single row are read in a fraction of numpy's time
        self._cells = self._buffer[8 * _HEADER_WORDS : 8 * (_HEADER_WORDS + cycles * width)].cast("d")

    def put(self, row: Array) -> None:
        """Add a cycle, overwriting the oldest one."""
        written = self._counter[0]
        self._rows[written % self._cycles] = row
        self._counter[0] = written + 1

    def skip(self, count: int) -> None:
        """Count cycles without writing their rows, which nobody reads."""
        self._counter[0] += count

    def newest_setpoint(self, axes: int) -> Array:
        """Return the last cycle's setpoints, for the writer, shape (K,); all 0 before the first."""
        part: Array = self._rows[(self._counter[0] - 1) % self._cycles, _HEAD : _HEAD + axes]
        return part

    @property
    def written(self) -> int:
        """Number of cycles that were put; the newest row has this sequence number - 1."""
        return self._counter[0]

    def since(self, sequence: int, limit: int = CYCLES) -> tuple[int, Array]:
        """Return the rows from ``sequence`` on, or from the oldest one available.

        Returns:
            Sequence number of the first row, and the rows, shape (n, `row_width`); see `time_of` and the
            others.
        """
        written = self._counter[0]
        first = max(sequence, written - self._cycles + GUARD, 0)
        count = max(0, min(written - first, limit))
        at = first % self._cycles
        part = min(count, self._cycles - at)
        rows = np.concatenate([self._rows[at : at + part], self._rows[: count - part]])
        oldest = self._counter[0] - self._cycles + GUARD
        spoilt = max(0, min(oldest - first, count))
        return first + spoilt, rows[spoilt:]

    def latest(self) -> FeedbackState | None:
        """Return the newest cycle; None before the first."""
        row = self.newest_row()
        return self.state_of(np.array(row)) if row else None

    def newest_row(self) -> list[float]:
        """Return the newest cycle's row; empty before the first. See `axes_of`, `channels_of`."""
        return self._newest(0, self._width)

    def newest_slots(self) -> list[list[float]]:
        """Return every slot's numbers in the newest cycle, as `slots_of`; empty before the first."""
        at = _HEAD + _BLOCKS * self._axes
        cells = self._newest(at, at + _SLOT * SLOTS)
        return [cells[each : each + _SLOT] for each in range(0, len(cells), _SLOT)]

    def _newest(self, start: int, stop: int) -> list[float]:
        counter = self._counter
        while True:
            written = counter[0]
            if written == 0:
                return []
            at = (written - 1) % self._cycles * self._width
            cells: list[Any] = self._cells[at + start : at + stop].tolist()
            if counter[0] - written < self._cycles - GUARD:
                return cells

    def axes_of(self, row: list[float], block: Block) -> list[float]:
        """Return one quantity of all axes in one row, length K."""
        start = _HEAD + block * self._axes
        return row[start : start + self._axes]

    def block(self, rows: Array, name: str) -> Array:
        """Return one quantity of rows, shape (n, K), by its name in lower case in `Block`."""
        start = _HEAD + Block[name.upper()] * self._axes
        part: Array = rows[:, start : start + self._axes]
        return part

    def channels_of(self, row: list[float]) -> tuple[list[float], list[float], list[int]]:
        """Return inputs, outputs and owners of outputs of one row."""
        at = _HEAD + _BLOCKS * self._axes + _SLOT * SLOTS
        outputs = at + self._inputs
        owners = outputs + self._outputs
        return row[at:outputs], row[outputs:owners], [int(each) for each in row[owners:]]

    def io_of(self, rows: Array) -> tuple[Array, Array]:
        """Return the inputs and outputs of rows, shapes (n, I) and (n, O)."""
        inputs, outputs, _ = _io_blocks(rows, self._axes, self._inputs, self._outputs)
        return inputs, outputs

    def slots_of(self, rows: Array) -> Array:
        """Return the programs' slots of rows, shape (n, slots, 4): `SLOT_U`, `SLOT_RATE`, …"""
        at = _HEAD + _BLOCKS * self._axes
        return rows[:, at : at + _SLOT * SLOTS].reshape(len(rows), SLOTS, _SLOT)

    @staticmethod
    def time_of(rows: Array) -> Array:
        """Return the executor times of rows [s]."""
        part: Array = rows[:, TIME]
        return part

    def state_of(self, row: Array) -> FeedbackState:
        """Return a row as a value."""
        blocks = [
            row[_HEAD + block * self._axes : _HEAD + (block + 1) * self._axes].copy()
            for block in range(_BLOCKS)
        ]
        slots = [
            SlotFeedback(u, rate, SlotState(int(state)), int(generation))
            for u, rate, state, generation in self.slots_of(row[None])[0].tolist()
        ]
        inputs, outputs, owners = _io_blocks(row, self._axes, self._inputs, self._outputs)
        return FeedbackState(
            time=float(row[TIME]),
            cycle=int(row[CYCLE]),
            late_cycles=int(row[LATE]),
            line=int(row[LINE]),
            estop=bool(row[ESTOP]),
            setpoint=blocks[0],
            velocity=blocks[1],
            actual=blocks[2],
            actual_velocity=blocks[3],
            torque=blocks[4],
            condition=blocks[5].astype(np.int8),
            slots=tuple(slots),
            interlocked=bool(row[INTERLOCK]),
            inputs=inputs.copy(),
            outputs=outputs.copy(),
            owners=owners.astype(np.int64),
            homed=homed_of(row),
        )
