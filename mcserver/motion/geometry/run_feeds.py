"""How fast the lines of a run are to be driven, as their segments say it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mcserver.motion.canonical import PathBatch
from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import NO_TRAVEL


class RunFeeds(NamedTuple):
    """Columns of n segments, each of shape (n,) and as of `Segment`.

    Attributes:
        duration: NaN under G94. scale: feed scale that all of them are for.
    """

    feed: Array
    requested: Array
    duration: Array
    feed_speed: Array
    scale: float

    @classmethod
    def of(cls, run: PathBatch, lengths: Array, scale: float) -> RunFeeds:
        """Return those of a run at a feed scale.

        Args:
            lengths: of its lines, as F counts them, shape (n,).
        """
        feed, speeds = np.full(len(run), math.inf), np.full(len(run), math.inf)
        requested = run.requested / scale
        if run.speeds is None:
            return cls(feed, requested, requested.copy(), speeds, scale)
        long = lengths > NO_TRAVEL
        np.divide(run.speeds, lengths, out=feed, where=long)
        np.divide(1.0, run.requested, out=feed, where=~long & (run.requested > 0.0))
        feed *= scale
        return cls(feed, requested, np.full(len(run), math.nan), run.speeds * scale, scale)

    @property
    def timing(self) -> Array:
        """Feed [1/s], requested time and T (NaN without one) of each segment [s], shape (n, 3)."""
        return np.column_stack((self.feed, self.requested, self.duration))
