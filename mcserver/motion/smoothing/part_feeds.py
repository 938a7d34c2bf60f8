"""Feed rates of the parts of a curve that stand for lines."""

from __future__ import annotations

from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.curves import Array
from mcserver.motion.geometry.path_columns import PathColumns
from mcserver.motion.geometry.segment import NO_TRAVEL
from mcserver.motion.geometry.segment_list import SegmentList
from mcserver.motion.geometry.spline_curve import Spline

# Speeds of a tip that are evaluated for each step between a part's samples, and a margin for those between.
TIP_SAMPLES, BETWEEN_SAMPLES = 2, 1.002


def keep_feed_of_tip(
    feeds: Array,
    lines: SegmentList,
    path: PathColumns,
    spline: Spline,
    t: Array,
    columns: NDArray[np.intp],
    offset: NDArray[np.intp],
) -> None:
    """Set ``feeds`` (n,) of parts that move a tool's tip so that the tip keeps its line's feed rate.

    Args:
        offset: of the samples that the parts' bends need, as of `PartSamples`.
    """
    led = np.flatnonzero(np.isfinite(path.feed) & ~np.isfinite(path.feed_speed)).tolist()
    for rates, group in groupby(led, lambda index: lines[index].curves[0].tool_rates):
        if rates is None:
            continue
        at = np.array(list(group))
        chain = lines[int(at[0])].columns[0]
        steps = TIP_SAMPLES * (np.diff(offset)[at] - 1)
        first = np.cumsum(steps + 1) - steps - 1
        part = np.repeat(np.arange(len(at)), steps + 1)
        shares = (np.arange(len(part)) - first[part]) / steps[part]
        spans = t[at + 1] - t[at]
        jets = spline.at(t[at[part]] + shares * spans[part])
        whole = np.tile(path.bases[at[0]], (len(part), 1))
        slopes = np.zeros_like(whole)
        whole[:, columns], slopes[:, columns] = jets[0], jets[1]
        moved = np.einsum("nij,nj->ni", rates(whole[:, chain])[:, :3], slopes[:, chain])
        fastest = np.maximum.reduceat(np.linalg.norm(moved, axis=1), first) * spans
        wanted = path.feed[at] * [lines[index].curves[0].max_path_rate for index in at.tolist()]
        feeds[at] = wanted / np.maximum(BETWEEN_SAMPLES * fastest, 1e-300)


def feeds_of_parts(path: PathColumns, fed: NDArray[np.bool_], spans: Array, slopes: Array) -> Array:
    """Return the greatest ds/dt of each part that keeps the feed rate of its line [1/s].

    Args:
        path: of the lines. fed: columns that their path speeds count, shape (n, K). spans: of the parts
            in the spline's parameter, shape (n,). slopes: as `sample_parts` writes them.
    """
    travels, speeds, feeds = path.travels, path.feed_speed, path.feed
    whole = np.linalg.norm(np.where(fed, travels, 0.0), axis=1)
    slopes = np.maximum(slopes, 1e-300)
    by_speed = np.isfinite(speeds) & (whole > NO_TRAVEL)
    found = np.where(by_speed, speeds / slopes[:, 0], feeds * np.linalg.norm(travels, axis=1) / slopes[:, 1])
    return np.asarray(found / spans)
