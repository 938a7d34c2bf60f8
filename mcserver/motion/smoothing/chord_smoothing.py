"""Replace chords among consecutive lines by parts of a spline, one part for each line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.path_columns import SPLINE, PathColumns, SplineParts, bits_of
from mcserver.motion.geometry.segment import AxisLimits, Segment, columns_of
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.geometry.segment_rows import SegmentRows
from mcserver.motion.geometry.spline_curve import Spline, SplineCurve
from mcserver.motion.kernels.spline_fit import AT_REST, JOINED, fit
from mcserver.motion.kernels.spline_samples import PartSamples, count_samples, sample_parts
from mcserver.motion.smoothing.chord_runs import SHARE, Chords
from mcserver.motion.smoothing.neighbours import ALONE, Neighbours
from mcserver.motion.smoothing.part_feeds import feeds_of_parts, keep_feed_of_tip
from mcserver.units import MM

# Longest smoothing length L of the fit [m].
LONGEST = 4e-3
# Or so many times the longest chord of a run, if that is more.
CHORD_LENGTHS = 2.5
# L is at most so many times the length of a run: a curve is hardly smoother for more, and powers of L over
# tiny chords exceed the precision of numbers.
RUN_LENGTHS = 10.0
# Initial L at a single vertex, in tolerances over its turn; the right one is about a third of it.
VERTEX_REACH = 8.0
# How far a curve reaches into the lines before and after its vertices, in L: the effect of a vertex decays as
# exp(-x / 2 L).
FADE = 8.0
# Share of the tolerance that the fit may use.
TOLERANCE_SHARE = 0.98
# Share of a line with a T that a curve at one of its ends may use.
TIMED_SHARE = 0.25
# Least share of a line that is left between the curves at its ends.
REST = 0.02


@dataclass(frozen=True)
class OpenCurve:
    """The part of a curve that more lines may still change: it ends at rest only because none have come.

    Attributes:
        lead: the line before it, whose part of the curve stays; None: it begins at rest. chords: the lines
            that it replaces. jets: its position and three derivatives by its parameter at the start of each
            line and at its end, shape (n+1, 4, K).
    """

    lead: Segment | None
    chords: SegmentList
    jets: Array

    def without(self, count: int) -> OpenCurve | None:
        """Return it without its first lines, whose parts no longer change; None where nothing is left."""
        if count == 0:
            return self
        if count > len(self.chords):
            return None
        return OpenCurve(self.chords[count - 1], self.chords[count:], self.jets[count:])


@dataclass(frozen=True)
class SmoothRun:
    """Parts of one spline, one for each line.

    Attributes:
        parts: in order. samples: of their limits. joined: whether it continues the curve before it.
        open: the part that may still change.
    """

    parts: SegmentList
    samples: PartSamples
    joined: bool
    open: OpenCurve | None


Item = Segment | SmoothRun


@dataclass(frozen=True)
class _Bounds:
    """Where a curve begins and ends: s of its first and last line, and the number of conditions there."""

    begin: float
    finish: float
    start: int
    end: int


class _Given(NamedTuple):
    """Derivatives that a curve is given at its ends; None: it begins and ends along its lines.

    Attributes:
        jet: position and derivatives at its first vertex, where it continues a curve, shape (4, K).
        head, tail: as of `mcserver.motion.smoothing.neighbours`.
    """

    jet: Array | None = None
    head: Array | None = None
    tail: Array | None = None


class ChordSmoother:
    """Smooths chords in the metric of a machine's tolerances."""

    def __init__(self, limits: AxisLimits) -> None:
        self._weights = limits.weights
        self._metric = limits.weights / MM

    def smooth(self, lines: SegmentList, *, rests: bool, beside: Neighbours = ALONE) -> list[Item]:
        """Replace chords among consecutive straight segments.

        Args:
            rests: whether the motion rests at the start of the first line.

        Returns:
            Segments and curves, in order; first the rest of the first line, if any is left.
        """
        runs = Chords.of(lines, self._weights).runs() if len(lines) > 2 else []
        return self._items(lines, runs, beside, rests=rests) or list(lines)

    def go_on(self, curve: OpenCurve, lines: SegmentList, into: Segment | None = None) -> list[Item] | None:
        """Extend an open curve over more lines, or change its end; None where that is not possible.

        Args:
            into: as of `Neighbours`.
        """
        known = len(curve.chords)
        every = SegmentList(() if curve.lead is None else (curve.lead,))
        every.extend(curve.chords)
        every.extend(lines)
        if len(every) < 2:
            return None
        beside = Neighbours(into=into)
        if not lines and not beside.change_end(every, self._metric):
            return None
        chords = Chords.of(every, self._weights)
        if curve.lead is None:
            return self._items(every, chords.runs(known - 2), beside, rests=True)
        if not chords.bends(0):
            return None
        runs = chords.runs(max(known - 1, 0))
        return self._items(every, runs, beside, rests=False, jet=curve.jets[0])

    def _items(
        self,
        lines: SegmentList,
        runs: list[tuple[int, int]],
        beside: Neighbours,
        *,
        rests: bool,
        jet: Array | None = None,
    ) -> list[Item] | None:
        """Return the items of lines with the given runs of vertices.

        Args:
            jet: position and derivatives that the first run has to begin with, shape (4, K); where no curve
                does, None is returned.
        """
        lines = lines.copy()
        items: list[Item] = []
        index = 0 if jet is None else 1
        for first, last in runs:
            head = beside.head(lines, self._metric) if first == 0 and jet is None else None
            tail = beside.tail(lines, self._metric) if last == len(lines) - 2 else None
            given = _Given(jet if first == 0 else None, head, tail)
            curve = partial(
                self._curve,
                lines,
                (first, last),
                rests=rests and first == 0,
                ends=last == len(lines) - 2 and not beside.needs_part,
            )
            made = curve(given=given)
            if made is None and (head is not None or tail is not None):
                made = curve(given=_Given(given.jet))
            if made is None and jet is not None and first == 0:
                return None
            if made is None:
                continue
            items += [*lines[index:first], *made]
            index = last + 2
            if isinstance(made[-1], Segment):
                # the rest of the last line is the first line of the next item
                items.pop()
                index = last + 1
                lines[index] = made[-1]
        return [*items, *lines[index:]]

    def _curve(
        self,
        lines: SegmentList,
        run: tuple[int, int],
        *,
        rests: bool,
        ends: bool,
        given: _Given,
    ) -> list[Item] | None:
        """Return the rest of the line before a run of vertices, its curve, and the rest of the line after it.

        Args:
            rests: whether it may begin at the start of its first line. ends: whether it may end at the end
                of its last line.

        Returns:
            None where no curve is within the tolerance.
        """
        first, last = run[0], run[1] + 1
        inner = lines[first : last + 1]
        chords = Chords.of(inner, self._weights)
        longest = max(LONGEST, CHORD_LENGTHS * float(chords.lengths[1:-1].max(initial=0.0)))
        allowed = chords.tolerances * TOLERANCE_SHARE
        tolerances = np.minimum(np.append(allowed, allowed[-1]), np.append(allowed[0], allowed))
        reaches = _vertex_reaches(chords.turns, allowed, longest)
        before, after = inner[0], inner[-1]
        begin, start = inner[1].begin, JOINED
        if given.jet is None:
            begin, start = _begin(before, FADE * float(reaches[0]), chords, rests=rests)
        if given.head is not None:
            begin, start = before.begin, JOINED
        finish, end = _finish(after, FADE * float(reaches[-1]), chords, ends=ends)
        if given.tail is not None:
            finish, end = after.finish, JOINED
        skip = 1 if given.jet is not None else 0
        bounds = _Bounds(begin, finish, start, end)
        drawn = inner[skip:]
        even = np.zeros(len(inner), np.bool_)
        if len(inner) > 2:
            even = np.pad(chords.even, 1, "edge")
        spline = self._fit(drawn, bounds, chords.turns[skip:], even[skip:], tolerances[skip:], given, longest)
        if spline is None:
            return None
        curve = self._parts(drawn, bounds, spline, given, ends and end == AT_REST, inner[0] if skip else None)
        made: list[Item] = []
        if given.jet is None and begin > before.begin:
            made.append(msgspec.structs.replace(before.between(before.begin, begin), closes=False))
        made.append(curve)
        if finish < after.finish:
            made.append(msgspec.structs.replace(after.between(finish, after.finish), opens=False))
        return made

    def _fit(
        self,
        lines: SegmentList,
        bounds: _Bounds,
        turns: Array,
        even: NDArray[np.bool_],
        tolerances: Array,
        given: _Given,
        longest: float,
    ) -> tuple[Spline, Array, NDArray[np.intp]] | None:
        """Return the spline, the parameters of the lines' ends, shape (n+1,), and its columns."""
        jet, head, tail = given
        path = lines.columns(0, len(lines))
        mask = int(np.bitwise_or.reduce(path.mask))
        if jet is not None:
            # columns that still move where the curve is continued
            for column in np.nonzero(jet[1:].any(axis=0))[0].tolist():
                mask |= 1 << column
        columns = columns_of(mask)
        metric = self._metric[columns]
        begin = bounds.begin if jet is None else lines[0].begin
        places = np.concatenate((path.bases[:1] + begin * path.travels[:1], path.bases + path.travels))
        places[-1] = (
            path.bases[-1] + bounds.finish * path.travels[-1] if bounds.finish < 1.0 else path.ends[-1]
        )
        origin = places[0][columns]
        points: Array = (places[:, columns] - origin) * metric
        travels = np.diff(points, axis=0)
        lengths = np.sqrt(np.einsum("ij,ij->i", travels, travels))
        if not lengths.min() > 0.0:
            return None
        t = np.concatenate(([0.0], np.cumsum(lengths)))
        first, last = np.zeros((2, 4, len(columns)))
        first[0], first[1] = points[0], travels[0] / lengths[0]
        last[0], last[1] = points[-1], travels[-1] / lengths[-1]
        if jet is not None:
            first[:] = jet[:, columns] * metric
            first[0] = (jet[0, columns] - origin) * metric
        if head is not None:
            first[1:] = head[1:, columns] * metric
        if tail is not None:
            last[1:] = tail[1:, columns] * metric
        # more than the whole run is no more freedom
        limit = np.minimum(tolerances / MM, t[-1])
        most = min(longest / MM, RUN_LENGTHS * float(t[-1]))
        reach = np.full(len(t), most)
        reach[1:-1] = _vertex_reaches(turns, np.minimum(limit[:-1], limit[1:]), most)
        found, knots, spans = fit(
            t, points, reach, most, limit, even, (bounds.start, first), (bounds.end, last)
        )
        if not found:
            return None
        spans /= metric
        spans[:, 0] += origin
        return Spline(knots[5:-5].copy(), spans, places[-1][columns]), t, columns

    def _parts(
        self,
        lines: SegmentList,
        bounds: _Bounds,
        fitted: tuple[Spline, Array, NDArray[np.intp]],
        given: _Given,
        is_open: bool,
        lead: Segment | None,
    ) -> SmoothRun:
        spline, t, columns = fitted
        jet, head, tail = given
        joined = jet is not None
        width = len(self._weights)
        jets = np.zeros((len(t), 4, width))
        jets[:, :, columns] = spline.at(t).transpose(1, 0, 2)
        rest = np.ones(width, np.bool_)
        rest[columns] = False
        jets[:, 0, rest] = lines[0].base[rest]
        for index, condition, line, met in (
            (0, bounds.start, lines[0], head),
            (-1, bounds.end, lines[-1], tail),
        ):
            if met is not None:
                jets[index, 1:] = met[1:]
            elif condition == JOINED and not (joined and index == 0):
                # exactly the derivatives of the line
                jets[index, 1] = line.first / float(
                    np.linalg.norm(line.first[columns] * self._metric[columns])
                )
                jets[index, 2:] = 0.0
        path = lines.columns(0, len(lines))
        spans = np.diff(t)
        fed = (path.fed[:, None] >> np.arange(width, dtype=np.uint64) & np.uint64(1)).astype(np.bool_)
        samples, slopes = self._samples(fed, spline, t, columns)
        feeds = feeds_of_parts(path, fed, spans, slopes)
        keep_feed_of_tip(feeds, lines, path, spline, t, columns, samples.offset)
        source = _rows(path, jets, t, spline, columns, feeds)
        # the first and the last part may replace only a part of their line
        last_part = len(lines) - 1
        parts = SegmentList([source.segment(0)])
        parts.extend(SegmentList.of(source)[1:last_part])
        if last_part > 0:
            parts.append(source.segment(last_part))
        parts[0].tolerance = 0.0 if joined else lines[0].tolerance
        for index, begin, finish in (
            (0, bounds.begin, lines[0].finish if len(lines) > 1 else bounds.finish),
            (-1, lines[-1].begin if len(lines) > 1 else bounds.begin, bounds.finish),
        ):
            line, part = lines[index], parts[index]
            if begin > line.begin or finish < line.finish:
                part.duration, part.requested = line.between(begin, finish).duration, 0.0
                part.opens, part.closes = (
                    line.opens and begin <= line.begin,
                    line.closes and finish >= line.finish,
                )
        if bounds.begin > lines[0].begin or head is not None:
            # what comes before the curve goes over into it without a turn
            parts[0].tolerance = 0.0
        remaining = _open_curve(lines, bounds, jets, t, lead) if is_open else None
        return SmoothRun(parts, samples, joined, remaining)

    def _samples(
        self, fed: NDArray[np.bool_], spline: Spline, t: Array, columns: NDArray[np.intp]
    ) -> tuple[PartSamples, Array]:
        offset = np.empty(len(t), np.intp)
        count_samples(spline.breaks, t, offset)
        rows, slopes = np.zeros((offset[-1], 5 * len(self._weights) + 2)), np.empty((len(fed), 2))
        sample_parts(spline.breaks, spline.spans, t, offset, columns, fed[:, columns], rows, slopes)
        return PartSamples(rows, offset, np.diff(t)), slopes


def _rows(
    path: PathColumns, jets: Array, t: Array, spline: Spline, columns: NDArray[np.intp], feeds: Array
) -> SegmentRows:
    """Return the parts of a spline that replace consecutive lines.

    Args:
        path: of the lines. jets: position and three derivatives at the parts' ends, shape (n+1, 4, K).
        t: the spline's parameters there, shape (n+1,). columns: that the spline moves. feeds: greatest ds/dt
            of each part [1/s].
    """
    count, widths = len(path), np.diff(t)
    slopes, bends = jets[:, 1], jets[:, 2]
    along, across = widths[:, None], widths[:, None] ** 2
    ends = np.stack(
        (slopes[:-1] * along, slopes[1:] * along, bends[:-1] * across, bends[1:] * across), axis=1
    )
    spans = np.zeros((count, 3))
    spans[:, 0], spans[:, 2] = np.linalg.norm(slopes, axis=1)[:-1] * widths, 1.0
    moved = tuple(columns.tolist())
    places = t.tolist()
    parts = replace(
        path,
        active=np.full(count, np.bitwise_or.reduce(path.active)),
        kind=np.full(count, SPLINE, np.int8),
        spans=spans,
        travels=np.ascontiguousarray(ends[:, 0]),
        mask=np.full(count, bits_of(columns), np.uint64),
        feed=feeds,
        tolerance=np.zeros(count),
        arcs=None,
        domains=np.column_stack((t[:-1], t[1:])),
        splines=(SplineParts(spline, columns, 0, count),),
    )
    return SegmentRows(
        parts,
        ends,
        lambda index: (SplineCurve(moved, spline, places[index], places[index + 1]), columns),
    )


def _open_curve(
    lines: SegmentList, bounds: _Bounds, jets: Array, t: Array, lead: Segment | None
) -> OpenCurve:
    """Return the part of the last curve that is affected by its end at rest, so that more lines change it."""
    fade = min(FADE * LONGEST / MM, 0.5 * float(t[-1]))
    keep = int(np.searchsorted(t, float(t[-1]) - fade, side="right")) - 1
    keep = min(max(keep, 0), len(lines) - 1)
    if keep > 0:
        return OpenCurve(lines[keep - 1], lines[keep:], jets[keep:])
    if lead is not None or bounds.start == AT_REST:
        return OpenCurve(lead, lines.copy(), jets)
    # it begins on a line, without a turn
    rest = msgspec.structs.replace(
        lines[0].between(bounds.begin, lines[0].finish), opens=False, tolerance=lines[1].tolerance
    )
    chords = SegmentList([rest])
    chords.extend(lines[1:])
    return OpenCurve(lines[0], chords, jets)


def _vertex_reaches(turns: Array, tolerances: Array, longest: float) -> Array:
    """Return L at vertices: as long as a single one allows, at most ``longest``, shape (n,)."""
    with np.errstate(divide="ignore"):
        reaches: Array = np.minimum(longest, VERTEX_REACH * tolerances / turns)
    return reaches


def _begin(line: Segment, wanted: float, chords: Chords, *, rests: bool) -> tuple[float, int]:
    """Return the s at which a curve begins on its first line, and the number of conditions there."""
    remaining = float(chords.lengths[0])
    if rests and remaining <= 2.0 * wanted:
        return line.begin, AT_REST
    whole = remaining / (line.finish - line.begin)
    room = min(wanted, _share(line) * whole, (1.0 - REST) * remaining)
    return line.finish - room / whole, JOINED


def _finish(line: Segment, wanted: float, chords: Chords, *, ends: bool) -> tuple[float, int]:
    """Return the s at which a curve ends on its last line, and the number of conditions there."""
    remaining = float(chords.lengths[-1])
    if ends and remaining <= 2.0 * wanted:
        return line.finish, AT_REST
    whole = remaining / (line.finish - line.begin)
    return line.begin + min(wanted, _share(line) * whole) / whole, JOINED


def _share(line: Segment) -> float:
    """Return the share of a line that a curve at its end may use; with a T it needs the rest."""
    return SHARE if line.duration is None else TIMED_SHARE
