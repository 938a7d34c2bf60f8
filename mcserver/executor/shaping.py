"""Input shaping in the cycle: what drives get is a mean of what was ordered in the last cycles.

Everything before it (rows, rates, motions, stops, targets) orders positions as on a machine without shapers,
in `FeedbackRow.ordered`; everything behind it (drives, following errors, telemetry) has the shaped ones, in
`FeedbackRow.setpoint`. Weights are not negative and sum to 1, so every limit that holds for what is ordered
holds for what drives get. What an axis does for one that it follows besides is added behind that
(`mcserver.executor.superimposed`), and so is what a printer's E is led by
(`mcserver.executor.pressure_advance`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Array
from mcserver.executor.pressure_advance import PressureAdvance
from mcserver.executor.shm.feedback import FeedbackRow
from mcserver.machine.shaper_section import Shaping


class Shaper:
    """The setpoints that all axes were ordered in the last cycles, and the shaped ones of this cycle.

    Attributes:
        delay: by which the path comes later, the same for all axes [cycles].
        tool: that is in the spindle, 0: none, or it is not known.
        added, added_velocity: to what is shaped, shape (K,) [m or rad, per second].
        advance: of a printer's E; None: it has none. followers: of what follows others besides, called once
            setpoints are shaped, to set ``added``.
    """

    def __init__(self, shaping: Shaping, row: FeedbackRow, cycle_s: float) -> None:
        self._row = row
        self._cycle = cycle_s
        self.delay = shaping.delay
        self.advance: PressureAdvance | None = None
        self.followers: tuple[Callable[[], None], ...] = ()
        count, length = len(shaping.weights), shaping.length + 1
        if shaping.lead is not None:
            self.advance = PressureAdvance(shaping.lead, length, cycle_s)
        # the oldest first, as in the rings
        self._of_tools = {tool: np.zeros((length, count)) for tool in (0, *shaping.tools)}
        for tool, columns in {0: shaping.weights, **shaping.tools}.items():
            for column, weights in enumerate(columns):
                self._of_tools[tool][length - len(weights) :, column] = weights[::-1]
        self.tool = 0
        self._weights = self._of_tools[0].copy()
        self._last = self._last_cycles(self._weights)
        # those of the tool that is in, and whether an axis has not come to rest with it
        self._next = self._of_tools[0]
        self._changing = False
        self._delays = (self._weights * np.arange(length)[::-1, None]).sum(axis=0)
        self._length = length
        self._at = 0
        # each cycle is there twice, so that the latest ones are one piece
        self._positions = np.tile(row.ordered, (2 * length, 1))
        self._velocities = np.zeros((2 * length, count))
        self._age = np.full(count, length)
        self._scratch = np.zeros((length, count))
        self._sum = np.zeros(count)
        self.added: Array = np.zeros(count)
        self.added_velocity: Array = np.zeros(count)

    @property
    def before(self) -> Array:
        """What was ordered in the cycle before, shape (K,)."""
        newest: Array = self._positions[self._at]
        return newest

    def choose(self, tool: int) -> None:
        """Take the weights of the tool that is in, each axis where it rests and has arrived.

        Until then it has those of before, and counts as unsettled while either would still move it.
        """
        self.tool = tool
        self._next = self._of_tools.get(tool, self._of_tools[0])
        self._last = np.maximum(self._last_cycles(self._weights), self._last_cycles(self._next))
        self._change()

    def _change(self) -> None:
        """Change weights where all that they count is the same place: that moves nothing."""
        rests = self._age >= self._last
        self._weights[:, rests] = self._next[:, rests]
        self._last[rests] = self._last_cycles(self._next)[rests]
        self._changing = bool((self._next != self._weights).any())

    def shape(self) -> None:
        """Set the setpoints of this cycle from what is ordered."""
        row, length = self._row, self._length
        self._age += 1
        self._age[row.ordered != self._positions[self._at]] = 0
        step = None if self.advance is None else row.ordered - self._positions[self._at]
        at = self._at = (self._at + 1) % length
        for ring, new in ((self._positions, row.ordered), (self._velocities, row.ordered_velocity)):
            ring[at] = ring[at + length] = new
        if self._changing:
            self._change()
        latest = slice(at + 1, at + 1 + length)
        # of differences, so that an axis at rest is exactly where it was ordered
        np.subtract(self._positions[latest], row.ordered, out=self._scratch)
        np.multiply(self._scratch, self._weights, out=self._scratch)
        np.add(self._scratch.sum(axis=0, out=self._sum), row.ordered, out=row.setpoint)
        np.multiply(self._velocities[latest], self._weights, out=self._scratch)
        self._scratch.sum(axis=0, out=row.velocity)
        if self.advance is not None and step is not None:
            self.advance.lead(at, step)
            self.added[self.advance.column] = self.advance.offset
            self.added_velocity[self.advance.column] = self.advance.velocity
        for follow in self.followers:
            follow()
        row.setpoint += self.added
        row.velocity += self.added_velocity

    @property
    def unsettled(self) -> NDArray[np.bool_]:
        """Which axes have not come to where they were ordered, shape (K,)."""
        moved: NDArray[np.bool_] = (self._age < self._last) | (self._row.ordered != self.before)
        return moved

    def take_over(self, where: NDArray[np.bool_], position: Array, velocity: Array) -> None:
        """Go on from positions and velocities, shape (K,) each, as if these had been ordered before.

        What is ordered is ahead of them by the delay, so that drives go on from there without a jump.
        """
        self._forget_flow(where)
        row, length = self._row, self._length
        lag = np.arange(length)[::-1, None]
        step = np.where(where, velocity, 0.0)
        newest = position - self.added + step * self._delays * self._cycle
        latest = slice(self._at + 1, self._at + 1 + length)
        positions = self._positions[latest].copy()
        positions[:, where] = (newest - lag * step * self._cycle)[:, where]
        velocities = self._velocities[latest].copy()
        velocities[:, where] = step[where]
        for ring, new in ((self._positions, positions), (self._velocities, velocities)):
            # from the oldest on, in both copies
            ring[:length] = ring[length:] = np.roll(new, self._at + 1, axis=0)
        np.copyto(row.ordered, newest, where=where)
        np.copyto(row.ordered_velocity, step, where=where)
        np.copyto(row.setpoint, position, where=where)
        np.copyto(row.velocity, step, where=where)
        self._age[where] = np.where(step == 0.0, self._length, 0)[where]

    def rest(self, where: NDArray[np.bool_]) -> None:
        """Let axes be at rest where their drives were told to be last."""
        self.take_over(where, self._row.setpoint.copy(), np.zeros(len(where)))

    def show(self, where: NDArray[np.bool_], position: Array) -> None:
        """Let axes that nobody orders be where they are, shape (K,)."""
        self._forget_flow(where)
        row = self._row
        for ring, new in ((self._positions, position), (self._velocities, np.zeros(len(position)))):
            np.copyto(ring, new, where=where)
        np.copyto(row.ordered, position, where=where)
        np.copyto(row.setpoint, position, where=where)
        self._age[where] = self._length

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on."""
        self._positions[:, column] += distance

    def _forget_flow(self, where: NDArray[np.bool_]) -> None:
        """Let E be led no more, if it is one of these axes, shape (K,)."""
        if self.advance is not None and where[self.advance.column]:
            self.advance.clear()
            self.added[self.advance.column] = self.added_velocity[self.advance.column] = 0.0

    def _last_cycles(self, weights: Array) -> NDArray[np.intp]:
        """Return how many cycles ago the oldest setpoint was that counts, shape (K,)."""
        cycles: NDArray[np.intp] = len(weights) - 1 - np.argmax(weights != 0.0, axis=0)
        if self.advance is not None:
            column = self.advance.column
            cycles[column] = max(cycles[column], self.advance.last)
        return cycles
