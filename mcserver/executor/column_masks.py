"""Columns of the machine as bit masks, boolean arrays and lists."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# masks that are remembered; a machine uses few
_MASKS_KEPT = 4096


class ColumnMasks:
    """Boolean arrays and column lists of bit masks, made once for each mask."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._bools: dict[int, NDArray[np.bool_]] = {}
        self._columns: dict[int, tuple[int, ...]] = {}

    def bools(self, mask: int) -> NDArray[np.bool_]:
        """Return which columns a mask has, shape (K,); not to be changed."""
        array = self._bools.get(mask)
        if array is None:
            if len(self._bools) >= _MASKS_KEPT:
                self._bools.clear()
            array = np.array([mask >> column & 1 for column in range(self._count)], np.bool_)
            self._bools[mask] = array
        return array

    def columns(self, mask: int) -> tuple[int, ...]:
        """Return the columns in the mask, ascending."""
        columns = self._columns.get(mask)
        if columns is None:
            if len(self._columns) >= _MASKS_KEPT:
                self._columns.clear()
            columns = tuple(column for column in range(self._count) if mask >> column & 1)
            self._columns[mask] = columns
        return columns


def mask_of(flags: NDArray[np.bool_]) -> int:
    """Return the bit mask of a boolean array."""
    return int.from_bytes(np.packbits(flags, bitorder="little").tobytes(), "little")
