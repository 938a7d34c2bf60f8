"""What playing segments takes of each, in columns: their setpoints, and where their lines begin and end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.segment import Segment
from mcserver.motion.geometry.spline_curve import Spline, spline_part
from mcserver.motion.kernels.arc_segments import ARC

# Kinds of segments, by how they are sampled; those of any other kind by `Segment.sample`.
STRAIGHT, ARC_KIND, SPLINE, OTHER = range(4)

# Columns of `PathColumns` that all segments have.
EVERY = ("line", "active", "opens", "closes", "feed_scale", "kind", "spans", "bases", "travels", "ends")


class SplineParts(NamedTuple):
    """Segments ``first`` … ``behind`` - 1 are parts of a spline in some of the machine's columns."""

    spline: Spline
    columns: NDArray[np.intp]
    first: int
    behind: int


@dataclass(frozen=True, eq=False)
class PathColumns:
    """Segments on end, n of them, in a machine of K columns.

    Attributes:
        line, active, opens, closes, feed_scale: as of `Segment`, shape (n,). kind: one of the kinds above.
        spans: scale, begin and finish, shape (n, 3). bases, travels, ends: `Segment.base`, ``first`` and
            ``end``, shape (n, K).
        arcs: `Segment.arc` of those that are arcs, shape (n, `ARC`); None where none is.
        domains: parameters of parts of splines at s = 0 and 1, shape (n, 2); of others not set.
        splines: these splines, in order.
    """

    line: NDArray[np.int64]
    active: NDArray[np.uint64]
    opens: NDArray[np.bool_]
    closes: NDArray[np.bool_]
    feed_scale: Array
    kind: NDArray[np.int8]
    spans: Array
    bases: Array
    travels: Array
    ends: Array
    arcs: Array | None
    domains: Array | None
    splines: tuple[SplineParts, ...]

    def __len__(self) -> int:
        return len(self.line)

    @classmethod
    def of(cls, segments: Sequence[Segment]) -> PathColumns:
        """Return the columns of segments, at least one."""
        arcs = [None if each.straight else each.arc for each in segments]
        splines, domains = _splines_of(segments)
        kinds = [
            STRAIGHT if each.straight else OTHER if arc is None else ARC_KIND
            for each, arc in zip(segments, arcs, strict=True)
        ]
        for _, _, first, behind in splines:
            kinds[first:behind] = [SPLINE] * (behind - first)
        return cls(
            line=np.array([each.line for each in segments], np.int64),
            active=np.array([each.active for each in segments], np.uint64),
            opens=np.array([each.opens for each in segments]),
            closes=np.array([each.closes for each in segments]),
            feed_scale=np.array([each.feed_scale for each in segments]),
            kind=np.array(kinds, np.int8),
            spans=np.array([(each.scale, each.begin, each.finish) for each in segments]),
            bases=np.array([each.base for each in segments]),
            travels=np.array([each.first for each in segments]),
            ends=np.array([each.end if len(each.end) else each.base for each in segments]),
            arcs=_arc_rows(arcs),
            domains=domains,
            splines=splines,
        )

    @classmethod
    def joined(cls, parts: Sequence[PathColumns]) -> PathColumns:
        """Return columns one behind the other, at least one of them."""
        if len(parts) == 1:
            return parts[0]
        splines: list[SplineParts] = []
        passed = 0
        for part in parts:
            for each in part.splines:
                here = each._replace(first=each.first + passed, behind=each.behind + passed)
                last = splines[-1] if splines else None
                if last is not None and last.spline is here.spline and last.behind == here.first:
                    here = last._replace(behind=here.behind)
                    splines.pop()
                splines.append(here)
            passed += len(part)
        return cls(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in EVERY},
            arcs=_joined_rows([part.arcs for part in parts], parts, ARC),
            domains=_joined_rows([part.domains for part in parts], parts, 2),
            splines=tuple(splines),
        )

    def part(self, first: int, behind: int) -> PathColumns:
        """Return segments ``first`` … ``behind`` - 1."""
        if first == 0 and behind == len(self):
            return self
        at = slice(first, behind)
        splines = [
            each._replace(first=max(each.first, first) - first, behind=min(each.behind, behind) - first)
            for each in self.splines
            if each.first < behind and each.behind > first
        ]
        return PathColumns(
            **{name: getattr(self, name)[at] for name in EVERY},
            arcs=None if self.arcs is None else self.arcs[at],
            domains=None if self.domains is None else self.domains[at],
            splines=tuple(splines),
        )


def _splines_of(segments: Sequence[Segment]) -> tuple[tuple[SplineParts, ...], Array | None]:
    """Return `PathColumns.splines` and ``domains`` of segments."""
    parts = [None if each.straight else spline_part(each) for each in segments]
    found = []
    domains: Array | None = None
    first = 0
    for spline, group in groupby(parts, lambda part: None if part is None else part.spline):
        curves = list(group)
        behind = first + len(curves)
        if spline is not None:
            if domains is None:
                domains = np.zeros((len(segments), 2))
            domains[first:behind] = [(each.low, each.high) for each in curves if each is not None]
            found.append(SplineParts(spline, segments[first].columns[0], first, behind))
        first = behind
    return tuple(found), domains


def _arc_rows(arcs: Sequence[Array | None]) -> Array | None:
    """Return the rows of arcs beside zeros, shape (n, `ARC`)."""
    if all(each is None for each in arcs):
        return None
    none = np.zeros(ARC)
    return np.array([none if each is None else each for each in arcs])


def _joined_rows(rows: Sequence[Array | None], parts: Sequence[PathColumns], width: int) -> Array | None:
    if all(each is None for each in rows):
        return None
    return np.concatenate(
        [
            np.zeros((len(part), width)) if each is None else each
            for each, part in zip(rows, parts, strict=True)
        ]
    )
