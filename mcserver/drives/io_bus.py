"""The seam between the executor and inputs and outputs: what a bus has of them, once a cycle.

Outputs are handed over before drives are exchanged with, so that they leave with the setpoints of the same
cycle; inputs are read behind it. Values are raw: 0 and 1, or the number of an object; the executor scales
them.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@runtime_checkable
class IoBus(Protocol):
    """Inputs and outputs on one bus, such as those of a CAN bus's nodes."""

    @property
    def inputs(self) -> tuple[int, ...]:
        """Columns of the machine's inputs that are on this bus."""

    @property
    def outputs(self) -> tuple[int, ...]:
        """Columns of the machine's outputs that are on this bus."""

    def write_outputs(self, raw: Array) -> None:
        """Take the outputs' raw values, shape of `outputs`; they leave with the next exchange."""

    def read_inputs(self, raw: Array, fresh: NDArray[np.bool_]) -> None:
        """Fill in the newest raw values, shape of `inputs`; ``fresh``: False where the node is lost."""

    def read_outputs(self, fresh: NDArray[np.bool_]) -> None:
        """Fill in which outputs' nodes are there, shape of `outputs`."""
