"""What a simulation keeps of every cycle: extremes always, rows if asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from mcserver.machine.io_section import Input, Output
from mcserver.machine.machine_file import Machine
from mcserver.simulation.tool_poses import ToolPoses

if TYPE_CHECKING:
    # it brings the compiler with it, and a command is there before a run is
    from mcserver.executor.block import Block

Array = NDArray[np.float64]

_BLOCK = 8192


class CycleTaker(Protocol):
    """Is shown every cycle of a simulation."""

    def take(self, times: Array, lines: NDArray[np.int64], setpoint: Array) -> None:
        """Look at cycles in order: times [s] and lines (n,), setpoints (n, K) [SI]."""


@dataclass(frozen=True)
class Recorded:
    """One row a cycle in mm and degrees (``mcserver simulate --output``).

    Attributes:
        time_s, line: shape (N,). axes: shape (K,), axis numbers. setpoint, actual: shape (N, K).
        tools: by tool number the poses that the setpoints give, shape (N, 6): X Y Z A B C [mm, deg].
        inputs, outputs: by name the values in each cycle, shape (N,).
    """

    time_s: Array
    line: Array
    axes: Array
    setpoint: Array
    actual: Array
    tools: Mapping[int, Array] = field(default_factory=dict)
    inputs: Mapping[str, Array] = field(default_factory=dict)
    outputs: Mapping[str, Array] = field(default_factory=dict)

    def with_tools(self, machine: Machine, poses: ToolPoses) -> Recorded:
        """Return the same run with the poses of all the machine's tools."""
        scale = np.array([axis.type.si_per_unit for axis in machine.axes])
        positions = self.setpoint * scale
        return replace(self, tools={tool: poses.of(tool, positions) for tool in poses.numbers})


class Recorder:
    """Called once a cycle by the virtual executor.

    Args:
        keep: rows are wanted. channels: the executor's own inputs and outputs, which it changes in place.
        takers: are shown every cycle's setpoints [SI], in this order.

    Attributes:
        line: line of the newest cycle. low, high, last: least, greatest and newest setpoints, shape
            (K,) [SI]. outputs_low, outputs_high: least and greatest value of each output, shape (O,).
    """

    def __init__(
        self,
        machine: Machine,
        keep: bool,
        channels: tuple[Array, Array] | None = None,
        takers: Sequence[CycleTaker] = (),
    ) -> None:
        self._machine = machine
        self._takers = takers
        self._keep = keep
        start = np.array([axis.initial_position for axis in machine.axes])
        self.low: Array = start.copy()
        self.high: Array = start.copy()
        self.last: Array = start.copy()
        self.line = 0
        self._width = len(machine.axes)
        nothing = np.zeros(0)
        self._inputs, self._outputs = (nothing, nothing) if channels is None else channels
        self.outputs_low: Array = self._outputs.copy()
        self.outputs_high: Array = self._outputs.copy()
        self._columns = 2 + 2 * self._width + len(self._inputs) + len(self._outputs)
        self._blocks: list[Array] = []
        self._fill = _BLOCK

    def __call__(self, time: float, line: int, setpoint: Array, actual: Array) -> None:
        """Record one cycle."""
        self._take(np.array([time]), np.array([line]), setpoint[None], actual[None], self._outputs[None])

    def block(self, times: Array, block: Block) -> None:
        """Record cycles in one go, at these executor times, shape (n,) [s]."""
        self._take(times, block.lines, block.setpoint, block.actual, block.outputs)

    def _take(
        self, times: Array, lines: NDArray[np.int64], setpoint: Array, actual: Array, outputs: Array
    ) -> None:
        _widen(self.low, self.high, setpoint)
        self.last[:] = setpoint[-1]
        self.line = int(lines[-1])
        if len(self._outputs):
            _widen(self.outputs_low, self.outputs_high, outputs)
        for taker in self._takers:
            taker.take(times, lines, setpoint)
        if not self._keep:
            return
        done = 0
        while done < len(times):
            if self._fill == _BLOCK:
                self._blocks.append(np.empty((_BLOCK, self._columns)))
                self._fill = 0
            part = slice(done, min(len(times), done + _BLOCK - self._fill))
            count = part.stop - part.start
            rows = self._blocks[-1][self._fill : self._fill + count]
            rows[:, 0], rows[:, 1] = times[part], lines[part]
            rows[:, 2 : 2 + self._width] = setpoint[part]
            at = 2 + 2 * self._width
            rows[:, 2 + self._width : at] = actual[part]
            # inputs do not change in a block
            rows[:, at : at + len(self._inputs)] = self._inputs
            rows[:, at + len(self._inputs) :] = outputs[part]
            self._fill += count
            done += count

    def recording(self) -> Recorded | None:
        """Return all cycles, if they were kept."""
        if not self._keep:
            return None
        if not self._blocks:
            rows = np.empty((0, self._columns))
        else:
            rows = np.concatenate([*self._blocks[:-1], self._blocks[-1][: self._fill]])
        scale = np.array([axis.type.si_per_unit for axis in self._machine.axes])
        at, machine = 2 + 2 * self._width, self._machine
        channels = rows[:, at:].T.copy()
        return Recorded(
            time_s=rows[:, 0].copy(),
            line=rows[:, 1].copy(),
            axes=np.array([float(axis.index) for axis in self._machine.axes]),
            setpoint=rows[:, 2 : 2 + self._width] / scale,
            actual=rows[:, 2 + self._width : at] / scale,
            inputs=_by_name(machine.inputs, channels[: len(self._inputs)]),
            outputs=_by_name(machine.outputs, channels[len(self._inputs) :]),
        )


def _widen(low: Array, high: Array, values: Array) -> None:
    """Let bounds, shape (m,), hold values, shape (n, m)."""
    # a reduction takes 2 µs, and most calls are for one cycle
    one = len(values) == 1
    np.minimum(low, values[0] if one else values.min(axis=0), out=low)
    np.maximum(high, values[0] if one else values.max(axis=0), out=high)


def _by_name(channels: Sequence[Input | Output], values: Array) -> dict[str, Array]:
    """Values by the names of inputs or outputs; a recorder without these has none."""
    return {each.name: column for each, column in zip(channels, values, strict=False)}
