"""Which of the lines on end stand for one curve, and which are meant as they are.

A vertex between two lines that turns by δ is missed by about 0.22 d δ if it is rounded from d before it to
d behind it: the tolerance ε asks for d = ε / 0.22 δ. A line is a *chord* where that is more than its half at
both of its vertices, so that their roundings would meet: neither the line nor its vertices are meant, but the
curve that they stand for. Where d is shorter, the bend is larger than its neighbours suggest: a corner. But
where both vertices turn alike and the same way, as in the tightest bend of a curve, d may be shorter, and
much shorter where they turn by little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment_list import SegmentList

# Share of a line that a rounding at one of its ends may use, as `mcserver.motion.geometry.blend.SHARE`.
SHARE = 0.49
# A vertex is missed by this share of d times the difference of the tangents.
MISS = 0.22
# Vertices that turn by more are corners [length of the difference of the unit tangents].
SHARPEST = 1.2
# How much shorter d may be than half a line between vertices that turn alike: the curve is then fitted more
# closely to the vertices, which still takes no stop; and where both turn by less than `GENTLE`. Longer lines
# are polygons that are meant.
EVEN_BEND, GENTLE_BEND = 3.0, 7.0
GENTLE = 0.5
# Vertices turn alike where the smaller turn is this share of the larger one, and the cosine of the angle
# between their directions is no less than this.
ALIKE, SAME_WAY = 0.5, 0.5
# Turns below are rounding.
STRAIGHT = 1e-9


@dataclass(frozen=True)
class Chords:
    """Lines on end in tolerance metric: metres, a degree counting as a millimetre.

    Attributes:
        lengths: shape (n,). turns, tolerances: at the vertices between them, shape (n-1,). even: of the inner
            lines, whether the vertices at both ends turn alike, shape (n-2,).
    """

    lengths: Array
    turns: Array
    tolerances: Array
    even: NDArray[np.bool_]

    @classmethod
    def of(cls, lines: SegmentList, weights: Array) -> Chords:
        """Return those of straight segments; what has been passed of the first is left out."""
        path = lines.columns(0, len(lines))
        travels = path.travels * weights
        lengths = np.sqrt(np.einsum("ij,ij->i", travels, travels))
        tangents = travels / lengths[:, None]
        bends = np.diff(tangents, axis=0)
        turns = np.sqrt(np.einsum("ij,ij->i", bends, bends))
        one, other = turns[:-1], turns[1:]
        even = np.minimum(one, other) >= ALIKE * np.maximum(one, other)
        even &= np.einsum("ij,ij->i", bends[:-1], bends[1:]) >= SAME_WAY * one * other
        remaining = path.spans[:, 2] - path.spans[:, 1]
        return cls(lengths * remaining, turns, path.tolerance[1:], even)

    def bends(self, vertex: int) -> bool:
        """Return whether a curve may pass a vertex."""
        return bool(self.turns[vertex] <= SHARPEST and self.tolerances[vertex] > 0.0)

    def runs(self, linked: int | None = None) -> list[tuple[int, int]]:
        """Find the runs of vertices that one curve rounds: the first and last of each.

        Vertex 0 is between lines 0 and 1.

        Args:
            linked: the first run begins at vertex 0 and holds so many more, whatever they are; None: it need
                not.
        """
        may = (self.turns <= SHARPEST) & (self.tolerances > 0.0)
        with np.errstate(divide="ignore"):
            distance = np.where(may, self.tolerances / (MISS * self.turns), 0.0)
        nearer = np.minimum(distance[:-1], distance[1:])
        gentle = np.maximum(self.turns[:-1], self.turns[1:]) <= GENTLE
        nearer[self.even] *= np.where(gentle, GENTLE_BEND, EVEN_BEND)[self.even]
        inner: NDArray[np.bool_] = SHARE * self.lengths[1:-1] < nearer
        if linked is not None:
            inner[:linked] = True
        found: list[tuple[int, int]] = []
        first = 0
        for last in [*np.nonzero(~inner)[0].tolist(), len(self.turns) - 1]:
            forced = linked is not None and first == 0
            if forced or (last > first and self.turns[first : last + 1].max() > STRAIGHT):
                found.append((first, last))
            first = last + 1
        return found
