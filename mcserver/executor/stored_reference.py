"""What a server keeps of an axis's reference from one start to the next."""

from __future__ import annotations

import msgspec


class StoredReference(msgspec.Struct, frozen=True):
    """The reference of an axis from an earlier start.

    Attributes:
        offset: position minus encoder reading [m or rad].
        reading: what the encoder has to read now for it to hold [m or rad]; None: an absolute encoder, for
            which it holds whatever it reads.
    """

    offset: float
    reading: float | None = None
