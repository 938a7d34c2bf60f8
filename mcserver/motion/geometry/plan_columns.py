"""What smoothing and planning take of segments, in columns, besides `PathColumns`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import Segment

# Tools carried by each of some segments.
Carried = tuple[tuple[int, ...], ...]
# Columns of `PlanColumns` that are arrays.
EVERY = ("mask", "fed", "duration", "feed", "requested", "feed_speed", "tolerance")


@dataclass(frozen=True, eq=False)
class PlanColumns:
    """Columns of n segments on end, each of shape (n,) and as of `Segment`.

    Attributes:
        duration: NaN without a T. fed: ``feed_columns`` as bits. carried: None where none carries a tool.
    """

    mask: NDArray[np.uint64]
    fed: NDArray[np.uint64]
    duration: Array
    feed: Array
    requested: Array
    feed_speed: Array
    tolerance: Array
    carried: Carried | None = None

    @classmethod
    def of(cls, segments: Sequence[Segment]) -> PlanColumns:
        """Return the columns of segments, at least one."""
        carried = tuple([each.carried for each in segments])
        return cls(
            mask=np.array([each.mask for each in segments], np.uint64),
            fed=np.array([bits_of(each.feed_columns) for each in segments], np.uint64),
            duration=np.array([math.nan if each.duration is None else each.duration for each in segments]),
            feed=np.array([each.feed for each in segments]),
            requested=np.array([each.requested for each in segments]),
            feed_speed=np.array([each.feed_speed for each in segments]),
            tolerance=np.array([each.tolerance for each in segments]),
            carried=carried if any(carried) else None,
        )

    @classmethod
    def joined(cls, parts: Sequence[PlanColumns]) -> PlanColumns:
        """Return columns one behind the other, at least one of them."""
        if len(parts) == 1:
            return parts[0]
        carried: Carried | None = None
        if any(part.carried is not None for part in parts):
            carried = tuple(
                each
                for part in parts
                for each in (((),) * len(part.mask) if part.carried is None else part.carried)
            )
        every = {name: np.concatenate([getattr(part, name) for part in parts]) for name in EVERY}
        return cls(**every, carried=carried)


def bits_of(columns: NDArray[np.intp]) -> int:
    """Return columns as bits."""
    bits = 0
    for column in columns.tolist():
        bits |= 1 << column
    return bits
