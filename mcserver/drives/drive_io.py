"""Digital inputs and outputs of drives (60FDh, 60FEh:01) as the machine's, in the cycle of their bus."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.drives.bus import Array, Feedback
from mcserver.drives.cia402.axes import Cia402Axes
from mcserver.machine.axis import Axis
from mcserver.machine.io_object import IoObject
from mcserver.machine.machine_file import Machine


class DriveIo:
    """Inputs and outputs of the drives of one bus.

    Args:
        axes: of the CiA 402 drives, in the order of ``servo``. limit: cycles without an answer after which
            they are lost. feedback: of the bus.

    Attributes:
        inputs, outputs: columns of the machine's.
    """

    def __init__(
        self, machine: Machine, axes: Sequence[Axis], servo: Cia402Axes, limit: int, feedback: Feedback
    ) -> None:
        self._servo = servo
        self._feedback = feedback
        self._limit = max(limit, 1)
        by_number = {axis.index: place for place, axis in enumerate(axes)}
        self._sources = _places([each.source for each in machine.inputs], by_number)
        self._targets = _places([each.target for each in machine.outputs], by_number)
        self.inputs = tuple(column for column, _, _ in self._sources)
        self.outputs = tuple(column for column, _, _ in self._targets)
        initial = [machine.outputs[column].raw_of(machine.outputs[column].initial) for column in self.outputs]
        self.write_outputs(np.array(initial))

    @property
    def missing(self) -> list[int]:
        """Axes, by their places, whose inputs have not come lately."""
        ages = self._servo.readings.input_ages
        return [place for _, place, _ in self._sources if ages.get(place, 0) >= self._limit]

    def write_outputs(self, raw: Array) -> None:
        """Take the outputs' values, shape of `outputs`; they leave with the next exchange."""
        words = self._servo.rpdos.outputs
        for (_, place, bit), value in zip(self._targets, raw.tolist(), strict=True):
            words[place] = int(words[place]) | 1 << bit if value else int(words[place]) & ~(1 << bit)

    def read_inputs(self, raw: Array, fresh: NDArray[np.bool_]) -> None:
        """Fill in the newest values, shape of `inputs`; ``fresh``: False where they do not come any more."""
        ages = self._servo.readings.input_ages
        for at, (_, place, bit) in enumerate(self._sources):
            raw[at] = int(self._feedback.inputs[self._servo.local[place]]) >> bit & 1
            fresh[at] = ages.get(place, self._limit) < self._limit

    def read_outputs(self, fresh: NDArray[np.bool_]) -> None:
        """Fill in which outputs' drives answer, shape of `outputs`."""
        ages = self._servo.readings.ages
        for at, (_, place, _) in enumerate(self._targets):
            fresh[at] = ages[place] < self._limit


def _places(objects: Sequence[IoObject | None], by_number: dict[int, int]) -> list[tuple[int, int, int]]:
    """Return (column, place of the axis, bit) of what is on these drives."""
    return [
        (column, by_number[each.axis], each.bit or 0)
        for column, each in enumerate(objects)
        if each is not None and each.axis in by_number
    ]
