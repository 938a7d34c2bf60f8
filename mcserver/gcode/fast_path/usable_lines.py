"""Lines whose words can be interpreted in columns, with the modal state of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.gcode.fast_path.interpreted_batch import feeds_in_force, last_written, leading
from mcserver.gcode.fast_path.vocabulary import Vocabulary
from mcserver.gcode.fast_path.word_columns import WordTable
from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.feed_time import FeedBasis
from mcserver.gcode.semantics.modal import ModalState, smallest_feed
from mcserver.motion.canonical import SpeedOutputs
from mcserver.motion.geometry.curves import Array


class Kind(NamedTuple):
    """What lines of one shape produce: axes of their curves, an arc's plane first, and what F measures."""

    axes: tuple[int, ...]
    curved: bool
    basis: FeedBasis


class UsableLines(NamedTuple):
    """Lines whose words can be read in columns.

    Attributes:
        kinds: by index in the table's shapes. motion: code in force, shape (n,).
        numbers, speeds: F in force, shape (n,), as written and as a speed along a path.
    """

    table: WordTable
    kinds: dict[int, Kind]
    motion: NDArray[np.int64]
    numbers: Array
    speeds: Array

    def first(self, count: int) -> UsableLines:
        """Return the first ``count`` lines."""
        return UsableLines(
            self.table.first(count),
            self.kinds,
            self.motion[:count],
            self.numbers[:count],
            self.speeds[:count],
        )


def usable_lines(
    table: WordTable, kinds: Sequence[Kind | None], modal: ModalState, setup: Setup, vocabulary: Vocabulary
) -> UsableLines:
    """Return the lines before the first whose words need the block interpreter.

    Args:
        kinds: of the table's shapes; None where lines of a shape need it.
    """
    curved = np.array([shape.curved for shape in table.shapes])[table.shape]
    sound = np.array([kind is not None for kind in kinds])[table.shape]
    codes = np.concatenate(([-1 if modal.motion is None else modal.motion], table.codes))
    motion = codes[last_written(table.codes >= 0)]
    sound &= (motion >= 0) & (curved == (motion > 1))
    numbers, speeds = feeds_in_force(len(table.lines), table.feeds, modal)
    if table.feeds is not None:
        sound &= ~(table.feeds < smallest_feed(modal))
    sound &= (numbers > 0.0) | (motion == 0)
    if table.tools is not None:
        sound &= np.isnan(table.tools) | (table.tools == (-1.0 if modal.tool is None else modal.tool))
    if table.spindle is not None:
        sound &= ~(table.spindle < 0.0)
        for column, scaled in _following(modal, vocabulary):
            output = setup.machine.outputs[column]
            refused = (table.spindle < output.low) | (table.spindle > output.high)
            # a scaled output follows the speed of axes, not that of a tool: refused (MC159)
            sound &= ~(refused | (table.spindle > 0.0) & (scaled and bool(setup.machine.tools)))
    count = leading(sound)
    used = np.flatnonzero(np.bincount(table.shape[:count])).tolist()
    known = {index: kind for index in used if (kind := kinds[index]) is not None}
    return UsableLines(table, known, motion, numbers, speeds).first(count)


def speed_outputs(table: WordTable, modal: ModalState, vocabulary: Vocabulary) -> SpeedOutputs | None:
    """Return the outputs that S of the lines sets; None without any."""
    following = _following(modal, vocabulary)
    if table.spindle is None or not following:
        return None
    return SpeedOutputs(following, table.spindle)


def _following(modal: ModalState, vocabulary: Vocabulary) -> tuple[tuple[int, bool], ...]:
    """Return the outputs that follow S at the spindle's present direction."""
    return () if modal.frame is None else vocabulary.outputs.get(modal.frame.direction, ())


def places(
    table: WordTable,
    axis: int,
    start: float,
    scale: float,
    modal: ModalState,
    *,
    flow: float = 1.0,
    shifted: bool = True,
) -> Array:
    """Return where the first line starts and where each ends along an axis or coordinate, shape (n+1,).

    Args:
        scale: of its words to [m or rad]. flow: a further factor of theirs. shifted: they count from the
            program's zero.
    """
    if axis not in table.axes:
        return np.full(len(table.lines) + 1, start)
    written = table.values[:, table.axes.index(axis)]
    incremental = modal.incremental or axis in modal.relative
    named = ~np.isnan(written)
    ends = written[named] * scale
    if flow != 1.0:
        ends *= flow
    if shifted and not incremental and modal.shift is not None:
        ends += modal.shift.get(axis, 0.0)
    ends = np.concatenate(([start], ends))
    if incremental:
        ends = np.add.accumulate(ends)
    found = ends[np.concatenate(([0], np.cumsum(named)))]
    return np.asarray(found)
