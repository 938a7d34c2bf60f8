"""The data of consecutive segments as numpy columns, for smoothing, planning and sampling."""

from __future__ import annotations

import math
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

# Kinds of segments by how they are sampled; OTHER is sampled by `Segment.sample`.
STRAIGHT, ARC_KIND, SPLINE, OTHER = range(4)

# `Segment.carried` of several segments.
Carried = tuple[tuple[int, ...], ...]
# Columns of `PathColumns` that all segments have.
EVERY = (
    "line", "active", "opens", "closes", "feed_scale", "kind", "spans", "bases", "travels", "ends",
    "mask", "fed", "duration", "feed", "requested", "feed_speed", "lever", "tolerance",
)  # fmt: skip


class SplineParts(NamedTuple):
    """Segments ``first`` … ``behind`` - 1 are parts of a spline in some of the machine's columns."""

    spline: Spline
    columns: NDArray[np.intp]
    first: int
    behind: int


@dataclass(frozen=True, eq=False)
class PathColumns:
    """Columns of n consecutive segments in a machine of K columns.

    Attributes:
        line, active, opens, closes, feed_scale: as in `Segment`, shape (n,). kind: one of the kinds above.
        spans: scale, begin and finish, shape (n, 3). bases, travels, ends: `Segment.base`, ``first`` and
            ``end``, shape (n, K).
        mask, feed, requested, feed_speed, lever, tolerance: as in `Segment`, shape (n,). fed:
            ``feed_columns`` as bits. duration: NaN without a T.
        arcs: `Segment.arc`, shape (n, `ARC`), rows of other segments unset; None without arcs.
        domains: spline parameters at s = 0 and 1, shape (n, 2), rows of other segments unset; None without
            splines.
        splines: the splines, in order.
        carried: as in `Segment`; None where no segment carries a tool.
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
    mask: NDArray[np.uint64]
    fed: NDArray[np.uint64]
    duration: Array
    feed: Array
    requested: Array
    feed_speed: Array
    lever: Array
    tolerance: Array
    arcs: Array | None = None
    domains: Array | None = None
    splines: tuple[SplineParts, ...] = ()
    carried: Carried | None = None

    def __len__(self) -> int:
        return len(self.line)

    @classmethod
    def of(cls, segments: Sequence[Segment]) -> PathColumns:
        """Return the columns of one or more segments."""
        arcs = [None if each.straight else each.arc for each in segments]
        splines, domains = _splines_of(segments)
        carried = tuple([each.carried for each in segments])
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
            mask=np.array([each.mask for each in segments], np.uint64),
            fed=np.array([bits_of(each.feed_columns) for each in segments], np.uint64),
            duration=np.array([math.nan if each.duration is None else each.duration for each in segments]),
            feed=np.array([each.feed for each in segments]),
            requested=np.array([each.requested for each in segments]),
            feed_speed=np.array([each.feed_speed for each in segments]),
            lever=np.array([each.lever for each in segments]),
            tolerance=np.array([each.tolerance for each in segments]),
            arcs=_arc_rows(arcs),
            domains=domains,
            splines=splines,
            carried=carried if any(carried) else None,
        )

    @classmethod
    def joined(cls, parts: Sequence[PathColumns]) -> PathColumns:
        """Concatenate one or more sets of columns."""
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
            carried=_joined_tools(parts),
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
            carried=None if self.carried is None else self.carried[at],
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
    """Return the rows of arcs, zeros for other segments, shape (n, `ARC`); None without arcs."""
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


def _joined_tools(parts: Sequence[PathColumns]) -> Carried | None:
    if all(part.carried is None for part in parts):
        return None
    return tuple(
        each for part in parts for each in (((),) * len(part) if part.carried is None else part.carried)
    )


def bits_of(columns: NDArray[np.intp]) -> int:
    """Return the bit mask of columns."""
    bits = 0
    for column in columns.tolist():
        bits |= 1 << column
    return bits
