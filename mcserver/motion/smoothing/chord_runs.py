"""Distinguish chords of a curve from lines that are programmed as such.

A blend from d before a vertex to d after it misses the vertex by about 0.22 d δ, δ being the turn: a
tolerance ε allows d = ε / 0.22 δ. A line is a *chord* of a curve where d is more than half of the line at
both of its vertices, so that the blends would meet. Where d is shorter, the turn is larger than a curve
through its neighbours would have: a corner. But where both vertices turn by similar angles in the same
direction, as in the tightest bend of a curve, d may be shorter, and much shorter where the turns are small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment_list import SegmentList

# Share of a line that a blend at one of its ends may use, as `mcserver.motion.geometry.blend.SHARE`.
SHARE = 0.49
# Distance of a blend from its vertex, in d times the difference of the unit tangents.
MISS = 0.22
# Vertices that turn by more are corners [difference of the unit tangents].
SHARPEST = 1.2
# Between vertices that turn alike half a line may be this many times d: the curve then follows the vertices
# more closely, still without a stop. Longer lines are a programmed polygon.
EVEN_BEND = 3.0
# The same where both turns are below `GENTLE`.
GENTLE_BEND = 7.0
GENTLE = 0.5
# Vertices turn alike if the smaller turn is at least this share of the larger one, and the cosine of the
# angle between their directions at least `SAME_WAY`.
ALIKE, SAME_WAY = 0.5, 0.5
# Turns below this are rounding.
STRAIGHT = 1e-9


@dataclass(frozen=True)
class Chords:
    """Consecutive lines in the metric of the tolerance: metres, a degree counting as a millimetre.

    Attributes:
        lengths: shape (n,). turns, tolerances: at the vertices between them, shape (n-1,), of joints that
            lead a tool's tip so that the tip keeps its tolerance. even: for each
            inner line, whether the vertices at both ends turn alike, shape (n-2,).
    """

    lengths: Array
    turns: Array
    tolerances: Array
    even: NDArray[np.bool_]

    @classmethod
    def of(cls, lines: SegmentList, weights: Array) -> Chords:
        """Measure straight segments, without the part of the first that has been passed."""
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
        # of a tool's tip where that may move most for its joints
        tolerances = path.tolerance[1:] / np.maximum(path.lever[:-1], path.lever[1:])
        return cls(lengths * remaining, turns, tolerances, even)

    def bends(self, vertex: int) -> bool:
        """Return whether a curve may pass a vertex."""
        return bool(self.turns[vertex] <= SHARPEST and self.tolerances[vertex] > 0.0)

    def runs(self, linked: int | None = None) -> list[tuple[int, int]]:
        """Return the first and last vertex of each run of vertices that one curve replaces.

        Vertex 0 is between lines 0 and 1.

        Args:
            linked: number of vertices after vertex 0 that belong to the first run in any case; None: vertex 0
                need not begin a run.
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
