"""Columns of the machine as bit masks, boolean arrays and lists."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

# size of the cache; a machine uses few masks
_MASKS_KEPT = 4096


class ColumnMasks:
    """Boolean arrays and column lists of bit masks, cached for each mask.

    Attributes:
        bools: returns a mask as a boolean array, shape (K,); not to be changed.
        columns: returns the columns of a mask, ascending.
    """

    def __init__(self, count: int) -> None:
        def bools(mask: int) -> NDArray[np.bool_]:
            return np.array([mask >> column & 1 for column in range(count)], np.bool_)

        def columns(mask: int) -> tuple[int, ...]:
            return tuple(column for column in range(count) if mask >> column & 1)

        self.bools: Callable[[int], NDArray[np.bool_]] = lru_cache(_MASKS_KEPT)(bools)
        self.columns: Callable[[int], tuple[int, ...]] = lru_cache(_MASKS_KEPT)(columns)


def mask_of(flags: NDArray[np.bool_]) -> int:
    """Return the bit mask of a boolean array."""
    return int.from_bytes(np.packbits(flags, bitorder="little").tobytes(), "little")
