"""Nodes of a run in columns, and the groups of segments, or parts of one, that are planned as one each."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.parts import is_long, near_vertex, straight_limits
from mcserver.motion.kernels.sample_limits import bind_joints, ease_short

# What is known of a segment, in numbers: its length along σ; the greatest speed at its start, from the joint
# with the one before; the greatest speed on it, with the feed and by the axes alone; the feed along σ; the
# time that is asked for, and T under G93 (NaN: none) [s]; how far a stop at its start may be rounded [m].
EXTENT, CAP, TOP, SPEED, FEED, REQUESTED, DURATION, TOLERANCE = range(8)
NUMBERS = 8
# And in marks: the column and kind of limit that SPEED is by; one past its last sample, counted from the
# first sample of all; whether a vertex's sample stands at its start and its end; which of its edges a plan
# had to bind, of these bits: its start, where the vertex there ends to count, where that at its
# end begins to.
COLUMN, KIND, END, BEFORE, AFTER, KEY = range(6)
MARKS = 6
START, LEFT, RIGHT = 1, 2, 4

# Cycles that a group of segments may last, and how alike their speeds have to be.
GROUP = 4.0
SAME = 0.9
# A part of a segment is longer than this share of it.
DUST = 1e-9


class Columns(NamedTuple):
    """What is known of the n segments of a run.

    Attributes:
        numbers, marks: shapes (n, `NUMBERS`) and (n, `MARKS`). rows: their samples, of each segment its own,
            then that of a vertex at its start, then that of one at its end.
        dropped: samples that stood before the first one, and are gone. gone: what is gone of the first
            segment, along σ.
    """

    numbers: Array
    marks: NDArray[np.intp]
    rows: Array
    dropped: int
    gone: float


class Groups(NamedTuple):
    """A run of n segments in g groups.

    Attributes:
        bounds: σ at the segments' starts and at the end, shape (n+1,). starts: the groups' first segments,
            shape (g,). bits: which of the edges of that segment a group starts at, shape (g,).
        edges: σ at their starts and at the end, shape (g+1,).
        hard: greatest speeds at the groups' starts and at the end, shape (g+1,). caps: the same with the mean
            speeds of timed segments at both of their ends (D-33). tops: greatest speeds on the groups, (g,).
        rows: samples of the groups. offset: the groups' first samples, and one past the last, (g+1,).
    """

    bounds: Array
    starts: NDArray[np.intp]
    bits: NDArray[np.intp]
    edges: Array
    hard: Array
    caps: Array
    tops: Array
    rows: Array
    offset: NDArray[np.intp]


@compiled
def _starts(nodes: Columns, caps: Array, tops: Array, cycle: float) -> NDArray[np.intp]:
    """First segments of groups that are planned as one: short ones under nearly the same speed.

    A group is passed at the lowest of its caps; its segments together last few cycles, so hardly anything is
    lost, and a curve made of very short lines is planned in steps of milliseconds.
    """
    numbers, marks = nodes.numbers, nodes.marks
    count = len(tops)
    starts = np.empty(count, np.intp)
    starts[0] = 0
    found = 1
    span = GROUP * cycle
    low = high = tops[0]
    length = numbers[0, EXTENT]
    for index in range(1, count):
        least = min(low, caps[index], tops[index])
        most = max(high, tops[index])
        # a slow vertex at an end of the group would slow all of it; and what is left of a long segment stays
        # what it was when the motion on it was planned
        first = starts[found - 1]
        slow = marks[first, BEFORE] != 0 and numbers[first, CAP] < SAME * most
        slow = slow or (marks[index, AFTER] != 0 and caps[index + 1] < SAME * most)
        alone = (
            slow
            or (first == 0 and nodes.gone > 0.0)
            or marks[index, KEY] & START != 0
            or not math.isnan(numbers[index, DURATION])
            or not math.isnan(numbers[first, DURATION])
            or least < SAME * most
            or length + numbers[index, EXTENT] > span * least
        )
        if alone:
            starts[found] = index
            found += 1
            low = high = tops[index]
            length = numbers[index, EXTENT]
        else:
            low, high = least, most
            length += numbers[index, EXTENT]
    return starts[:found]


@compiled
def line_row(nodes: Columns, index: int) -> int:
    """The one sample of a straight segment without a time of its own; -1: the segment is none."""
    marks = nodes.marks
    low = marks[index - 1, END] - nodes.dropped if index > 0 else 0
    own = marks[index, END] - nodes.dropped - low - marks[index, BEFORE] - marks[index, AFTER]
    return low if own == 1 and math.isnan(nodes.numbers[index, DURATION]) else -1


@compiled
def _cuts(
    nodes: Columns, starts: NDArray[np.intp], tops: Array, limits: Array, cycle: float
) -> tuple[NDArray[np.bool_], Array]:
    """Which groups are a long segment, and where on it a vertex at its start ends to count and one at its end
    begins to, from its start on along σ; shape (n,) and (n, 2)."""
    numbers, marks = nodes.numbers, nodes.marks
    n = len(starts)
    long, cuts = np.zeros(n, np.bool_), np.zeros((n, 2))
    for group in range(n):
        first = starts[group]
        last = starts[group + 1] if group + 1 < n else len(tops)
        row = line_row(nodes, first)
        if last - first > 1 or row < 0 or marks[first, BEFORE] + marks[first, AFTER] == 0:
            continue
        acceleration, _ = straight_limits(nodes.rows[row], limits)
        before = after = fastest = 0.0
        if marks[first, BEFORE] != 0:
            fastest = min(numbers[first, CAP], tops[first])
            before = near_vertex(fastest, acceleration, cycle)
        if marks[first, AFTER] != 0:
            speed = min(numbers[first + 1, CAP], tops[first])
            after, fastest = near_vertex(speed, acceleration, cycle), max(fastest, speed)
        # what was in parts stays so while it is passed: its limits are those that the motion was planned with
        extent, gone = numbers[first, EXTENT], nodes.gone if first == 0 else 0.0
        long[group] = is_long(extent + gone, before, after, acceleration, fastest)
        dust = DUST * (extent + gone)
        cuts[group, 0] = before - gone if before - gone > dust else 0.0
        cuts[group, 1] = extent - after if after > dust else extent
        if cuts[group, 1] < dust:
            cuts[group, 1] = 0.0
    return long, cuts


@compiled
def _in_parts(groups: Groups, nodes: Columns, long: NDArray[np.bool_], cuts: Array) -> Groups:
    """The groups with the long segments in up to three parts: near the vertex at the start, between, and near
    the one at the end."""
    count = len(groups.starts)
    most = count + 2 * long.sum()
    starts, bits = np.empty(most, np.intp), np.empty(most, np.intp)
    edges, hard, caps = np.empty(most + 1), np.empty(most + 1), np.empty(most + 1)
    tops, offset = np.empty(most), np.zeros(most + 1, np.intp)
    rows = np.empty((len(nodes.rows) + 2 * long.sum(), nodes.rows.shape[1]))
    at = part = 0
    for group in range(count):
        low, high = groups.offset[group], groups.offset[group + 1]
        begin, extent = groups.edges[group], nodes.numbers[groups.starts[group], EXTENT]
        places = (0.0, cuts[group, 0], cuts[group, 1], extent) if long[group] else (0.0, 0.0, 1.0, 1.0)
        for place in range(3):
            if places[place + 1] <= places[place]:
                continue
            opens = places[place] <= 0.0
            starts[part], bits[part] = groups.starts[group], START if opens else (START, LEFT, RIGHT)[place]
            tops[part] = groups.tops[group]
            edges[part] = begin if opens else begin + places[place]
            hard[part] = groups.hard[group] if opens else groups.tops[group]
            caps[part] = groups.caps[group] if opens else groups.tops[group]
            for i in range(low, high):
                # of a long one its own sample, that of the vertex at its start, and of the one at its end
                if not long[group] or i == low or i == (low + 1, -1, high - 1)[place]:
                    rows[at] = nodes.rows[i]
                    at += 1
            part += 1
            offset[part] = at
    edges[part], hard[part], caps[part] = groups.edges[count], groups.hard[count], groups.caps[count]
    return Groups(
        groups.bounds,
        starts[:part],
        bits[:part],
        edges[: part + 1],
        hard[: part + 1],
        caps[: part + 1],
        tops[:part],
        rows[:at],
        offset[: part + 1],
    )


@compiled
def groups_of(nodes: Columns, entry: float, limits: Array, cycle: float) -> Groups:
    """The groups of a run from the speed ``entry`` to rest."""
    numbers, marks = nodes.numbers, nodes.marks
    count = len(numbers)
    bounds = np.empty(count + 1)
    bounds[0] = 0.0
    caps = np.empty(count + 1)
    tops = np.empty(count)
    for i in range(count):
        bounds[i + 1] = bounds[i] + numbers[i, EXTENT]
        caps[i], tops[i] = numbers[i, CAP], numbers[i, TOP]
    caps[0], caps[count] = entry, 0.0
    ease_short(bounds, caps, tops, cycle)
    bind_joints(caps, tops)
    starts = _starts(nodes, caps, tops, cycle)
    n = len(starts)
    edges, hard = np.empty(n + 1), np.empty(n + 1)
    group_tops = np.empty(n)
    offset = np.empty(n + 1, np.intp)
    offset[0] = 0
    for group in range(n):
        first = starts[group]
        last = starts[group + 1] if group + 1 < n else count
        edges[group], hard[group] = bounds[first], caps[first]
        top = tops[first]
        for i in range(first + 1, last):
            top = min(top, tops[i], caps[i])
        group_tops[group] = top
        offset[group + 1] = marks[last - 1, END] - nodes.dropped
    edges[n], hard[n] = bounds[count], 0.0
    nominal = hard.copy()
    for group in range(n):
        duration = numbers[starts[group], DURATION]
        if not math.isnan(duration):
            mean = numbers[starts[group], EXTENT] / duration
            for end in (group, group + 1):
                if 0 < end < n:
                    nominal[end] = min(nominal[end], mean)
    bits = np.full(n, START, np.intp)
    groups = Groups(bounds, starts, bits, edges, hard, nominal, group_tops, nodes.rows, offset)
    long, cuts = _cuts(nodes, starts, tops, limits, cycle)
    return _in_parts(groups, nodes, long, cuts) if long.any() else groups
