"""Feed and modal state along a batch of lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.modal import Feed, ModalState, read_feed
from mcserver.gcode.semantics.program_units import path_speed
from mcserver.motion.canonical import MotionLine, OutputLine, PathBatch
from mcserver.motion.geometry.curves import Array

MIN_LINES = 6  # fewer lines are slower in columns than one by one


class InterpretedBatch(NamedTuple):
    """Lines that were interpreted in columns.

    Attributes:
        modal: state behind them.
        values: in the order of the lines; rapids are `MotionLine`, behind the outputs that their S sets.
        taken: count of lines, blank ones included.
        without_effect: by letter, the first line's number and how many lines have it.
    """

    modal: ModalState
    values: Sequence[PathBatch | MotionLine | OutputLine]
    taken: int
    without_effect: Mapping[str, tuple[int, int]] = {}


def leading(sound: NDArray[np.bool_]) -> int:
    """Return how many are sound before the first that is not."""
    return len(sound) if sound.all() else int(sound.argmin())


def last_written(written: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return for each line the index, from 1, of the last one up to it where something is written, or 0."""
    return np.maximum.accumulate(np.where(written, np.arange(1, len(written) + 1), 0))


def feeds_in_force(count: int, feeds: Array | None, modal: ModalState) -> tuple[Array, Array]:
    """Return F in force on each line as written and as a speed along a path [m/s]; 0: no F is in force.

    Args:
        feeds: as written, shape (count,), NaN where none is; None where no line has one.
    """
    before = modal.feed or Feed(0.0, 0.0)
    numbers = np.full(count + 1, before.number)
    speeds = np.full(count + 1, before.speed)
    if feeds is not None:
        written = ~np.isnan(feeds)
        origin = last_written(written)
        numbers[1:] = np.where(written, feeds, 0.0)
        speeds[1:] = path_speed(numbers[1:], modal.inch)
        numbers[1:], speeds[1:] = numbers[origin], speeds[origin]
    return numbers[1:], speeds[1:]


def state_after(modal: ModalState, feeds: Array | None, spindle: Array | None, motion: int) -> ModalState:
    """Return the modal state behind lines with these F and S, the last of them of that motion code."""
    feed = modal.feed
    if spindle is not None:
        spun = spindle[~np.isnan(spindle)]
        if len(spun):
            frame = msgspec.structs.replace(modal.frame or Frame(), spindle_rpm=float(spun[-1]))
            modal = msgspec.structs.replace(modal, frame=frame, shift=frame.shift())
    if feeds is not None:
        written = feeds[~np.isnan(feeds)]
        if len(written):
            feed = read_feed(float(written[-1]), modal)
    if modal.motion == motion and feed is modal.feed:
        return modal
    return msgspec.structs.replace(modal, motion=motion, feed=feed)
