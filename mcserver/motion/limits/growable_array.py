"""An array that grows at its end and shrinks at either end."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.generic)
# Rows that the array has room for initially.
_INITIAL_ROWS = 64


class GrowableArray(Generic[T]):
    """Rows of one shape; adding and dropping rows takes amortized time in proportion to their number.

    Args:
        dtype: of the elements. row: shape of one row; () makes the array one-dimensional.
    """

    def __init__(self, dtype: np.dtype[Any], row: tuple[int, ...] = ()) -> None:
        self._rows: NDArray[T] = np.empty((_INITIAL_ROWS, *row), dtype)
        self._low = self._high = 0

    @property
    def rows(self) -> NDArray[T]:
        """The rows in use, shape (n, *row); a view that is valid until rows are added."""
        return self._rows[self._low : self._high]

    def add(self, rows: NDArray[T]) -> None:
        """Append rows, shape (m, *row)."""
        count = len(rows)
        self._reserve(count)
        self._rows[self._high : self._high + count] = rows
        self._high += count

    def add_one(self, row: Any) -> None:
        """Append one row."""
        self._reserve(1)
        self._rows[self._high] = row
        self._high += 1

    def drop(self, count: int) -> None:
        """Remove the first rows."""
        self._low += count

    def truncate(self, count: int) -> None:
        """Remove all but the first ``count`` rows."""
        self._high = self._low + count

    def _reserve(self, count: int) -> None:
        if self._high + count <= len(self._rows):
            return
        kept = self.rows
        size = max(_INITIAL_ROWS, 2 * (len(kept) + count))
        grown: NDArray[T] = np.empty((size, *kept.shape[1:]), kept.dtype)
        grown[: len(kept)] = kept
        self._rows, self._low, self._high = grown, 0, len(kept)
