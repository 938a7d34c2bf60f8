"""An array whose rows come at its end and go at either end."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.generic)
_LEAST = 64


class Growing(Generic[T]):
    """Rows of one width; adding and dropping cost no more than the rows concerned, on average.

    Args:
        width: columns.
    """

    def __init__(self, width: int, dtype: np.dtype[Any]) -> None:
        self._data: NDArray[T] = np.empty((_LEAST, width), dtype)
        self._low = self._high = 0

    @property
    def rows(self) -> NDArray[T]:
        """The rows that are there, shape (n, width); a view until rows are added."""
        return self._data[self._low : self._high]

    def add(self, rows: NDArray[T]) -> None:
        """Adds rows (m, width) at the end."""
        if self._high + len(rows) > len(self._data):
            kept = self.rows
            data: NDArray[T] = np.empty((max(_LEAST, 2 * (len(kept) + len(rows))), kept.shape[1]), kept.dtype)
            data[: len(kept)] = kept
            self._data, self._low, self._high = data, 0, len(kept)
        self._data[self._high : self._high + len(rows)] = rows
        self._high += len(rows)

    def drop(self, count: int) -> None:
        """Forgets the first rows."""
        self._low += count

    def cut(self, count: int) -> None:
        """Forgets all but the first ``count`` rows."""
        self._high = self._low + count
