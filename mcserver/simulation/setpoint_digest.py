"""A digest of every setpoint of a run: two computers that plan the same motion have the same one."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class SetpointDigest:
    """Is shown every cycle of a run."""

    def __init__(self) -> None:
        self._sha256 = hashlib.sha256()

    def take(self, times: Array, lines: NDArray[np.int64], setpoint: Array) -> None:  # noqa: ARG002
        """Look at cycles in order: setpoints (n, K) [SI], each number as little-endian IEEE 754."""
        self._sha256.update(np.ascontiguousarray(setpoint, "<f8").tobytes())

    def hexdigest(self) -> str:
        """Return the SHA-256 so far, whatever the pieces in which cycles came."""
        return self._sha256.hexdigest()
