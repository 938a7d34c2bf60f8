"""The mailbox of orders from the server to the executor, besides motion: the newest value wins.

Every field is one aligned word with one writer. Requests that must not be missed are counters: each request
increments its counter, and the executor compares it with the last value it has seen. Fields that belong
together (a slot's axes and its generation) are written before the counter that announces them. A change
counter tells the executor in one read whether anything is new.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

import msgspec

from mcserver.executor.envelope_bounds import Envelope, decode_envelope

# Most programs that run at the same time.
SLOTS = 8

_CHANGES, _OVERRIDE, _HOLD, _STOP, _ESTOP, _RESET, _RESET_MASK, _SERVER_BEAT, _EXECUTOR_BEAT = range(9)
_QUIT, _EPOCH, _RESET_ESTOP, _IO_ORDERS, _RESUME = 9, 10, 11, 12, 13
_HEAD = 16
_S_OVERRIDE, _S_HOLD, _S_ABORT, _S_RESUME, _S_GENERATION, _S_AXES, _S_ROWS, _S_CONTROLS = range(8)
_S_UNHOMED, _S_ENVELOPE, _S_CONFIRM = 8, 9, 10
_SLOT = 16
# bytes for the envelope of a slot's program, after all words
_ENVELOPE_BYTES = 32 * 1024
# words of each output and input: number of orders, and the newest value
_CHANNEL = 2

OVERRIDE_MAX = 2.0
_ALL = (1 << 64) - 1


@dataclass(frozen=True)
class SlotOrders:
    """The orders for one slot; the executor compares counters with those it has seen.

    Attributes:
        resume: counter of ends of feed hold. confirm: counter of confirmations of a pause (M00, M01), which
            ``resume`` does not end. unhomed: the program may move axes that are not homed.
        envelope: of an approved run; None: not an approved run.
    """

    override: float
    hold: bool
    abort: int
    resume: int
    confirm: int
    generation: int
    axes: int
    rows_base: int
    controls_base: int
    unhomed: bool = False
    envelope: Envelope | None = None


@dataclass(frozen=True)
class MachineOrders:
    """Orders to the whole machine.

    Attributes:
        reset_estop: counter of emergency stops at the reset, which clears no later ones.
        resume: counter of ends of the feed hold of all programs.
    """

    override: float
    hold: bool
    stop: int
    reset: int
    reset_mask: int
    reset_estop: int
    resume: int


def mailbox_size(inputs: int = 0, outputs: int = 0) -> int:
    """Return the size of the mailbox in bytes."""
    return 8 * (_HEAD + SLOTS * _SLOT + (inputs + outputs) * _CHANNEL) + SLOTS * _ENVELOPE_BYTES


def signed(mask: int) -> int:
    """Return a mask of up to 64 columns as a signed number with the same bits."""
    return mask - (1 << 64) if mask >= 1 << 63 else mask


class CommandMailbox:
    """Both ends of the mailbox; the server's side may be used by several threads.

    Args:
        buffer: at least `mailbox_size` bytes, zeroed; None: memory of this process.
    """

    def __init__(
        self,
        buffer: bytearray | memoryview | None,
        *,
        inputs: int = 0,
        outputs: int = 0,
    ) -> None:
        size = mailbox_size(inputs, outputs)
        self._buffer = memoryview(bytearray(size) if buffer is None else buffer)
        if len(self._buffer) < size:
            raise ValueError(f"the mailbox needs {size} bytes, the buffer has {len(self._buffer)}")
        self._words = self._buffer[:size].cast("q")
        self._numbers = self._buffer[:size].cast("d")
        self._envelopes_at = size - SLOTS * _ENVELOPE_BYTES
        self._lock = threading.Lock()
        self._inputs, self._outputs = inputs, outputs
        self._decoded: dict[int, tuple[int, Envelope | None]] = {}

    def initialise(self) -> None:
        """Set overrides of 100 %; to be called by the side that made the buffer, before the other reads."""
        self._numbers[_OVERRIDE] = 1.0
        for slot in range(SLOTS):
            self._numbers[_HEAD + slot * _SLOT + _S_OVERRIDE] = 1.0

    # ------------------------------------------------------------------ the server's side

    def _count(self, word: int) -> None:
        with self._lock:
            self._words[word] += 1
            self._words[_CHANGES] += 1

    def _set(self, word: int, value: int) -> None:
        with self._lock:
            self._words[word] = value
            self._words[_CHANGES] += 1

    def _set_number(self, word: int, value: float) -> None:
        with self._lock:
            self._numbers[word] = value
            self._words[_CHANGES] += 1

    def _of(self, slot: int) -> int:
        if not 0 <= slot < SLOTS:
            raise ValueError(f"slot {slot} is outside 0 … {SLOTS - 1}")
        return _HEAD + slot * _SLOT

    def open_slot(
        self,
        slot: int,
        axes_mask: int,
        base: tuple[int, int],
        *,
        override: float = 1.0,
        hold: bool = False,
        unhomed: bool = False,
        envelope: Envelope | None = None,
    ) -> int:
        """Open a free slot for a new program.

        Args:
            axes_mask: columns that it may move. base: as `ProgramRing.restart` has returned.
            unhomed: it may move axes that are not homed. envelope: of an approved run.

        Raises:
            ValueError: the envelope does not fit.

        Returns:
            The generation; feedback shows it once the executor has opened the slot.
        """
        at = self._of(slot)
        bounds = b"" if envelope is None else msgspec.msgpack.encode(envelope)
        if len(bounds) > _ENVELOPE_BYTES:
            raise ValueError(f"an envelope of {len(bounds)} bytes")
        with self._lock:
            words = self._words
            first = self._envelopes_at + slot * _ENVELOPE_BYTES
            self._buffer[first : first + len(bounds)] = bounds
            words[at + _S_ENVELOPE] = len(bounds)
            words[at + _S_AXES] = signed(axes_mask)
            words[at + _S_ROWS], words[at + _S_CONTROLS] = base
            words[at + _S_HOLD] = int(hold)
            words[at + _S_UNHOMED] = int(unhomed)
            # counters start at 0 with the program, so that no request for another one is taken for its own
            words[at + _S_ABORT] = words[at + _S_RESUME] = words[at + _S_CONFIRM] = 0
            self._numbers[at + _S_OVERRIDE] = _bounded(override)
            words[at + _S_GENERATION] += 1
            words[_CHANGES] += 1
            return words[at + _S_GENERATION]

    def set_override(self, ratio: float, slot: int | None = None) -> None:
        """Order a feed override, 0 … 2, of one slot or of all programs."""
        word = _OVERRIDE if slot is None else self._of(slot) + _S_OVERRIDE
        self._set_number(word, _bounded(ratio))

    def set_hold(self, hold: bool, slot: int | None = None) -> None:
        """Order a feed hold, or its end, of one slot or of all programs."""
        self._set(_HOLD if slot is None else self._of(slot) + _S_HOLD, int(hold))
        if not hold and slot is None:
            self._count(_RESUME)

    def abort(self, slot: int) -> None:
        """Stop a program on its path and drop the rest of it."""
        self._count(self._of(slot) + _S_ABORT)

    def resume(self, slot: int) -> None:
        """End feed hold of a slot; a pause goes on waiting."""
        self.set_hold(False, slot)
        self._count(self._of(slot) + _S_RESUME)

    def end_pause(self, slot: int) -> None:
        """End the pause at which the slot's program waits (M00, M01, a tool change)."""
        self._count(self._of(slot) + _S_CONFIRM)

    def stop(self) -> None:
        """Abort every program and stop every axis within its limits; axes stay energized."""
        self._count(_STOP)

    def emergency_stop(self) -> None:
        """Stop and de-energize every axis; latched until `reset`. From any thread."""
        self._count(_ESTOP)

    def reset(self, mask: int = _ALL) -> None:
        """Clear the emergency stop and the latched faults of the columns in ``mask``.

        An emergency stop that comes before the executor has done so stays latched.
        """
        with self._lock:
            self._words[_RESET_MASK] = signed(mask)
            self._words[_RESET_ESTOP] = self._words[_ESTOP]
            self._words[_RESET] += 1
            self._words[_CHANGES] += 1

    def set_output(self, column: int, value: float) -> None:
        """Set an output of the machine."""
        if not 0 <= column < self._outputs:
            raise ValueError(f"output {column} is outside 0 … {self._outputs - 1}")
        self._order_channel(column, value)

    def set_input(self, column: int, value: float) -> None:
        """Set a simulated input of the machine."""
        if not 0 <= column < self._inputs:
            raise ValueError(f"input {column} is outside 0 … {self._inputs - 1}")
        self._order_channel(self._outputs + column, value)

    def _order_channel(self, number: int, value: float) -> None:
        at = _HEAD + SLOTS * _SLOT + number * _CHANNEL
        with self._lock:
            self._numbers[at + 1] = value
            self._words[at] += 1
            self._words[_IO_ORDERS] += 1
            self._words[_CHANGES] += 1

    def beat(self) -> None:
        """Signal that the server is alive."""
        self._words[_SERVER_BEAT] += 1

    def quit(self) -> None:
        """Ask the executor's process to stop motion and end."""
        self._words[_QUIT] = 1

    @property
    def executor_beat(self) -> int:
        """Counter of the executor's cycles."""
        return self._words[_EXECUTOR_BEAT]

    @property
    def epoch(self) -> float:
        """Unix time of executor time 0 [s]; 0 before the executor runs."""
        return self._numbers[_EPOCH]

    # ------------------------------------------------------------------ the executor's side

    @property
    def changes(self) -> int:
        """Counter of changes of any order."""
        return self._words[_CHANGES]

    @property
    def estop(self) -> int:
        """Counter of emergency stops, read every cycle."""
        return self._words[_ESTOP]

    @property
    def io_orders(self) -> int:
        """Number of orders for inputs and outputs."""
        return self._words[_IO_ORDERS]

    def output_order(self, column: int) -> tuple[int, float]:
        """Return the number of orders for an output, and the newest value."""
        return self._channel_order(column)

    def input_order(self, column: int) -> tuple[int, float]:
        """Return the number of orders for a simulated input, and the newest value."""
        return self._channel_order(self._outputs + column)

    def _channel_order(self, number: int) -> tuple[int, float]:
        at = _HEAD + SLOTS * _SLOT + number * _CHANNEL
        # read the counter first: a newer value with an older counter is read again
        count = self._words[at]
        return count, self._numbers[at + 1]

    @property
    def server_beat(self) -> int:
        return self._words[_SERVER_BEAT]

    @property
    def quitting(self) -> bool:
        return self._words[_QUIT] != 0

    def beat_executor(self) -> None:
        self._words[_EXECUTOR_BEAT] += 1

    def set_epoch(self, unix_time: float) -> None:
        self._numbers[_EPOCH] = unix_time

    def machine_orders(self) -> MachineOrders:
        words = self._words
        # read the counter first: a newer mask with an older counter is read again; an older mask with a newer
        # counter would be missed
        reset = words[_RESET]
        return MachineOrders(
            self._numbers[_OVERRIDE],
            words[_HOLD] != 0,
            words[_STOP],
            reset,
            words[_RESET_MASK] & _ALL,
            words[_RESET_ESTOP],
            words[_RESUME],
        )

    def effective_override(self, slot: int) -> float:
        """Return the feed override of a slot's program, multiplied by the machine's."""
        own = self._numbers[self._of(slot) + _S_OVERRIDE]
        return min(own * self._numbers[_OVERRIDE], OVERRIDE_MAX)

    def slot_orders(self, slot: int) -> SlotOrders:
        at = _HEAD + slot * _SLOT
        words = self._words
        generation = words[at + _S_GENERATION]
        return SlotOrders(
            override=self._numbers[at + _S_OVERRIDE],
            hold=words[at + _S_HOLD] != 0,
            abort=words[at + _S_ABORT],
            resume=words[at + _S_RESUME],
            confirm=words[at + _S_CONFIRM],
            generation=generation,
            axes=words[at + _S_AXES] & _ALL,
            rows_base=words[at + _S_ROWS],
            controls_base=words[at + _S_CONTROLS],
            unhomed=words[at + _S_UNHOMED] != 0,
            envelope=self._envelope(slot, generation),
        )

    def _envelope(self, slot: int, generation: int) -> Envelope | None:
        """Return the envelope of a slot's program, decoded once."""
        known, found = self._decoded.get(slot, (-1, None))
        if known != generation:
            first = self._envelopes_at + slot * _ENVELOPE_BYTES
            size = self._words[self._of(slot) + _S_ENVELOPE]
            found = decode_envelope(self._buffer[first : first + size]) if size else None
            self._decoded[slot] = generation, found
        return found


def _bounded(ratio: float) -> float:
    if not 0.0 <= ratio <= OVERRIDE_MAX:
        raise ValueError(f"an override of {ratio} is outside 0 … {OVERRIDE_MAX}")
    return float(ratio)
