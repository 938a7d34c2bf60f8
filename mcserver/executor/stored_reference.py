"""An axis's reference as stored by the server from one start to the next."""

from __future__ import annotations

import msgspec


class StoredReference(msgspec.Struct, frozen=True):
    """The reference of an axis from an earlier start.

    Attributes:
        offset: position minus encoder reading [m or rad].
        reading: reading of the encoder now for which the reference is valid [m or rad]; None: valid at any,
            for an absolute encoder.
    """

    offset: float
    reading: float | None = None
