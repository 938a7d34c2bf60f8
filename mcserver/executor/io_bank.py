"""The machine's inputs and outputs: values, scripts, debouncing, interlocks, safe values."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from mcserver.drives.io_bus import IoBus
from mcserver.executor.entries import Array
from mcserver.executor.shm.feedback import FeedbackRow
from mcserver.executor.shm.mailbox import CommandMailbox
from mcserver.machine.machine_file import Machine

# Owners of outputs, besides the slots of programs.
NOBODY = -1
OPERATOR = -2
# From slot and mask of axes (0: all of its axes) to their path speeds in n cycles, 0 off a path, shape (n,)
# [m/s or rad/s].
SpeedsOf = Callable[[int, int], Array]
# A scripted change is due in the first cycle that is not earlier than this [s].
ROUNDING_S = 1e-9


class IoBank:
    """Inputs and outputs of one machine.

    Args:
        row: of the published values: inputs as programs see them, outputs as exchanged.
        buses: of real inputs and outputs; the others are simulated.

    Attributes:
        holding, stopping: columns of the inputs that hold or stop the machine now.
        zones: bits of `Clearance.switches` whose zones are on now.
        lost: columns of inputs and, counted after them, outputs whose node became silent in this cycle.
            missing: the first whose node is silent now; -1: none.
    """

    def __init__(self, machine: Machine, row: FeedbackRow, buses: Sequence[IoBus] = ()) -> None:
        self._inputs, self._outputs = machine.inputs, machine.outputs
        self._row = row
        self._buses = [(bus, np.array(bus.inputs, np.intp), np.array(bus.outputs, np.intp)) for bus in buses]
        self._cycle = machine.cycle_s
        self.holding: tuple[int, ...] = ()
        self.stopping: tuple[int, ...] = ()
        self.zones = 0
        # column of the input and level of each switch
        self._switches = switches_of(machine)
        self.lost: tuple[int, ...] = ()
        self.missing = -1
        self._interlocked = [
            column
            for column, each in enumerate(machine.inputs)
            if not (_never(each.hold_below, each.hold_above) and _never(each.stop_below, each.stop_above))
        ]
        # scaled values of the inputs' sources; simulated ones are set here
        self._source: Array = np.array([each.initial for each in machine.inputs])
        self._patience = [math.ceil(each.debounce / machine.cycle_s - 1e-9) for each in machine.inputs]
        self._pending = [0] * len(machine.inputs)
        self._script = sorted(
            (each.at_s, column, each.value)
            for column, channel in enumerate(machine.inputs)
            for each in channel.script
        )
        self._scripted = 0
        self._overruled: set[int] = set()
        self._moving = bool(machine.inputs)
        self._fresh = np.ones(len(machine.inputs) + len(machine.outputs), np.bool_)
        self._orders_seen = 0
        self._input_counts = [0] * len(machine.inputs)
        self._output_counts = [0] * len(machine.outputs)
        # values as set; published when they are exchanged
        self._wanted: Array = np.array([each.initial for each in machine.outputs])
        self._owner = [NOBODY] * len(machine.outputs)
        # by laser the mask of axes and the path speed at which it has its value; 0: not scaled
        self._lasers = {at: (0, 0.0) for at, each in enumerate(machine.outputs) if each.laser}
        row.inputs[:] = self._source
        row.outputs[:] = self._wanted
        row.owners[:] = NOBODY
        self._written = False
        self._look_at_interlocks()

    # ------------------------------------------------------------------ orders from outside

    def obey(self, mailbox: CommandMailbox, *, locked: bool) -> None:
        """Apply the orders of operators and simulations since the last call.

        Args:
            locked: outputs stay at their safe values (emergency stop).
        """
        if mailbox.io_orders == self._orders_seen:
            return
        self._orders_seen = mailbox.io_orders
        for column, channel in enumerate(self._outputs):
            count, value = mailbox.output_order(column)
            if count != self._output_counts[column]:
                self._output_counts[column] = count
                if not locked and channel.low <= value <= channel.high:
                    self.set(column, value, OPERATOR)
        for column, source in enumerate(self._inputs):
            count, value = mailbox.input_order(column)
            if count != self._input_counts[column]:
                self._input_counts[column] = count
                if source.source is None and math.isfinite(value):
                    self._overruled.add(column)
                    self._source[column] = value
                    self._moving = True

    def assume(self, inputs: Sequence[float], outputs: Sequence[float]) -> None:
        """Set inputs and outputs at the start of a simulation; empty: keep the machine file's values."""
        if inputs:
            self._source[:] = self._row.inputs[:] = inputs
        if outputs:
            self._wanted[:] = self._row.outputs[:] = outputs
            self._written = False
        self._look_at_interlocks()

    # ------------------------------------------------------------------ outputs

    def set(self, column: int, value: float, owner: int) -> None:
        """Set an output from the next exchange on."""
        self._wanted[column] = value
        self._owner[column] = owner
        self._written = False

    def scale(self, column: int, axes: int, speed: float) -> None:
        """Scale the power of a laser by the path speed of ``axes``, full at ``speed`` [m/s or rad/s].

        Speed 0: do not scale.
        """
        if column in self._lasers:
            self._lasers[column] = (axes, speed)

    def make_safe(self, owner: int | None = None) -> None:
        """Set outputs to their safe values: those that ``owner`` has set, or all."""
        for column, channel in enumerate(self._outputs):
            if owner is not None and self._owner[column] != owner:
                continue
            if channel.safe is not None:
                self._wanted[column] = channel.safe
            self._owner[column] = NOBODY
        self._written = False

    def disown(self, owner: int) -> None:
        """Release the outputs of a program that has ended in order, which keep their values."""
        self._owner = [NOBODY if each == owner else each for each in self._owner]
        self._written = False

    @property
    def settled(self) -> bool:
        """Whether every output that was set has been exchanged."""
        return self._written or bool((self._row.outputs == self._wanted).all())

    def value(self, column: int) -> float:
        """Return an input's value as of the latest exchange."""
        return float(self._row.inputs[column])

    # ------------------------------------------------------------------ the cycle

    def before_exchange(self, speeds_of: SpeedsOf) -> None:
        """Publish the outputs and pass them to their buses; ``speeds_of``: of this cycle."""
        if not self._written or self._lasers:
            self._written = True
            self.fill(self._row.outputs[None], speeds_of)
            self._row.owners[:] = self._owner
        for bus, _, columns in self._buses:
            if len(columns):
                bus.write_outputs(self._raw_outputs(columns))

    def fill(self, values: Array, speeds_of: SpeedsOf) -> None:
        """Write the published outputs of n cycles in which none is set.

        Args:
            values: shape (n, O), written. speeds_of: of these cycles.
        """
        values[:] = self._wanted
        for column, (axes, whole_at) in self._lasers.items():
            owner, power = self._owner[column], self._wanted[column]
            if owner < 0 or power == 0.0:
                values[:, column] = 0.0
                continue
            speeds = speeds_of(owner, axes)
            share = np.minimum(1.0, speeds / whole_at) if whole_at > 0.0 else speeds > 0.0
            values[:, column] = power * share

    def after_exchange(self, time: float) -> None:
        """Read the inputs; ``time``: executor time of the cycle [s]."""
        script, number = self._script, self._scripted
        while number < len(script) and script[number][0] <= time + ROUNDING_S:
            _, column, value = script[number]
            if column not in self._overruled:
                self._source[column] = value
                self._moving = True
            number += 1
        self._scripted = number
        if self._buses:
            self._read_buses()
        if self._moving:
            self._moving = self._debounce()
            self._look_at_interlocks()

    def idle_cycles(self, time: float, limit: int) -> int:
        """Return for how many cycles from ``time`` [s] on no input changes by itself, up to ``limit``."""
        if self._moving or self._buses:
            return 0
        if self._scripted == len(self._script):
            return limit
        due = (self._script[self._scripted][0] - ROUNDING_S - time) / self._cycle
        return max(0, min(limit, math.ceil(due)))

    def _debounce(self) -> bool:
        """Update inputs from their sources; return True while one is being debounced."""
        values, waits = self._row.inputs, False
        for column in np.nonzero(self._source != values)[0].tolist():
            if self._pending[column] >= self._patience[column]:
                values[column] = self._source[column]
            else:
                self._pending[column] += 1
                waits = True
        for column in np.nonzero(self._source == values)[0].tolist():
            self._pending[column] = 0
        return waits

    def _look_at_interlocks(self) -> None:
        values = self._row.inputs
        self.holding = tuple(
            column for column in self._interlocked if self._inputs[column].holds(float(values[column]))
        )
        self.stopping = tuple(
            column for column in self._interlocked if self._inputs[column].stops(float(values[column]))
        )
        self.zones = sum(
            1 << bit for bit, (column, high) in enumerate(self._switches) if bool(values[column]) is high
        )

    def switching(self, zones: int) -> tuple[int, int]:
        """Return the column of an input that switches one of these zones on, and the number of its bit."""
        bit = (self.zones & zones).bit_length() - 1
        return self._switches[bit][0], bit

    # ------------------------------------------------------------------ buses

    def _raw_outputs(self, columns: np.ndarray[tuple[int], np.dtype[np.intp]]) -> Array:
        return np.array([self._outputs[at].raw_of(float(self._row.outputs[at])) for at in columns.tolist()])

    def _read_buses(self) -> None:
        before, count = self._fresh.copy(), len(self._inputs)
        for bus, columns, outputs in self._buses:
            raw, fresh = np.zeros(len(columns)), np.ones(len(columns), np.bool_)
            bus.read_inputs(raw, fresh)
            self._fresh[columns] = fresh
            reached = np.ones(len(outputs), np.bool_)
            bus.read_outputs(reached)
            self._fresh[count + outputs] = reached
            for place, column in enumerate(columns.tolist()):
                if not fresh[place]:
                    continue
                value = self._inputs[column].value_of(float(raw[place]))
                if value != self._source[column]:
                    self._source[column] = value
                    self._moving = True
        self.lost = tuple(np.nonzero(before & ~self._fresh)[0].tolist())
        (missing,) = np.nonzero(~self._fresh)
        self.missing = int(missing[0]) if len(missing) else -1
        if self._pending and any(self._pending):
            self._moving = True


def switches_of(machine: Machine) -> list[tuple[int, bool]]:
    """Return the column of the input, and the level, of each of `Clearance.switches`."""
    columns = {each.number: at for at, each in enumerate(machine.inputs) if each.digital}
    switches = () if machine.clearance is None else machine.clearance.switches
    return [(columns[each.input], each.high) for each in switches]


def _never(low: float, high: float) -> bool:
    return low == -math.inf and high == math.inf
