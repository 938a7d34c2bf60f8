"""A batch of lines interpreted in columns, and feed and modal state along it."""

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
    """Lines interpreted in columns.

    Attributes:
        modal: state after them.
        values: in the order of the lines; rapids are `MotionLine`, after the outputs that their S sets.
        taken: count of lines, including blank ones.
        without_effect: by letter without effect, the first line's number and the count of lines.
    """

    modal: ModalState
    values: Sequence[PathBatch | MotionLine | OutputLine]
    taken: int
    without_effect: Mapping[str, tuple[int, int]] = {}


def leading(sound: NDArray[np.bool_]) -> int:
    """Return the length of the leading run of True."""
    return len(sound) if sound.all() else int(sound.argmin())


def last_written(written: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return for each line the index, from 1, of the last line so far with a written value, or 0."""
    return np.maximum.accumulate(np.where(written, np.arange(1, len(written) + 1), 0))


def feeds_in_force(count: int, feeds: Array | None, modal: ModalState) -> tuple[Array, Array]:
    """Return the F in force on each line, as written and as a speed along a path [m/s]; 0: no F is in force.

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
    """Return the modal state after lines with these F and S, the last of which has this motion code."""
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
