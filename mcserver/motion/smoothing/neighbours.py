"""Arcs and other curves beside chords: whether a curve that replaces the chords goes over into them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import Segment
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.smoothing.chord_runs import GENTLE
from mcserver.units import MM

# A line that meets an arc or another curve is a chord of it if it is at most so many times as long as the
# line at its other end, and their curvatures differ by at most this share of the greater one.
LONGER, UNLIKE = 1.5, 0.15


class Neighbours(NamedTuple):
    """Segments beside lines, none of them straight.

    Their metric is that of the tolerance.

    Attributes:
        out_of: what the motion flows out of before the first line; None: something else. into: what it flows
            into behind the last one; None: it rests there, as far as is known.
    """

    out_of: Segment | None = None
    into: Segment | None = None

    @property
    def needs_part(self) -> bool:
        """Whether a curve leaves a part of the last line: corners of tools are rounded at the tip."""
        return self.into is not None and self.into.leads_tip

    def change_end(self, lines: SegmentList, metric: Array) -> bool:
        """Return whether a curve over the lines ends otherwise than at rest."""
        return self.needs_part or self.tail(lines, metric) is not None

    def head(self, lines: SegmentList, metric: Array) -> Array | None:
        """Return the derivatives that a curve begins with to go on from ``out_of`` (`_meeting`)."""
        if self.out_of is None or self.out_of.finish < 1.0:
            return None
        ends = self.out_of.last, self.out_of.d2q_end
        return _meeting((lines[0], lines[1]), 0, self.out_of, ends, lines[0].tolerance, metric)

    def tail(self, lines: SegmentList, metric: Array) -> Array | None:
        """Return the derivatives that a curve ends with to go over into ``into`` (`_meeting`)."""
        if self.into is None:
            return None
        ends = self.into.first, self.into.d2q_start
        return _meeting((lines[-2], lines[-1]), 1, self.into, ends, self.into.tolerance, metric)


ALONE = Neighbours()


def _meeting(
    lines: tuple[Segment, Segment],
    which: int,
    beside: Segment,
    ends: tuple[Array, Array],
    tolerance: float,
    metric: Array,
) -> Array | None:
    """Return the derivatives of a segment where a line meets it.

    Args:
        lines: consecutive ones. which: of them meets it. ends: the segment's dp/ds and d²p/ds² there, shape
            (K,). tolerance: of the corner [m].

    Returns:
        By the length of the path in the metric, shape (4, K), the first row unset; None where the lines are
        no chords of it.
    """
    line = lines[which]
    if beside.mask & ~line.mask:
        return None
    slope, bend = ends
    along = slope * metric
    speed = float(np.linalg.norm(along))
    travels = [each.first * metric for each in lines]
    lengths = [float(np.linalg.norm(each)) for each in travels]
    if lengths[which] > LONGER * min(lengths):
        # it stands for more than a chord
        return None
    first, second = (travel / length for travel, length in zip(travels, lengths, strict=True))
    turn = float(np.linalg.norm(along / speed - (first, second)[which]))
    # by so much a circle is off the middle of a chord that it meets at this angle
    sagitta = 0.25 * turn * lengths[which] * MM * (line.finish - line.begin)
    if turn > GENTLE or sagitta > tolerance / line.lever:
        return None
    tangent = slope / speed
    across = (bend - tangent * float(along @ (bend * metric)) / speed) / speed**2
    curvature = float(np.linalg.norm(across * metric))
    bent = (second - first) * (2.0 / (lengths[0] + lengths[1]))
    most = max(curvature, float(np.linalg.norm(bent)))
    if float(np.linalg.norm(across * metric - bent)) > UNLIKE * most:
        return None
    # the third one as of a circle
    return np.array((np.zeros_like(slope), tangent, across, -(curvature**2) * tangent))
