"""Runs of plain lines in columns: the very same values as line by line, without an object a line.

Bit for bit: numbers are read as `float` reads them; products, sums, quotients and comparisons are the same
IEEE operations in the same order (an accumulated sum adds one after the other); the root of the sum of
squares is `math.hypot` itself, since `numpy.hypot` may differ in the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from mcserver.gcode.fast_path.block import AxisRow, axis_rows
from mcserver.gcode.fast_path.columns import AlikeLines, read_alike
from mcserver.gcode.semantics.axis_words import SMALLEST_FEED
from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.commanded_state import Commanded
from mcserver.gcode.semantics.feed_time import Measure, measure_axes
from mcserver.gcode.semantics.modal import Feed, ModalState, read_feed
from mcserver.gcode.semantics.program_units import move_duration, path_speed, turning_speed
from mcserver.motion.canonical import PlainRun
from mcserver.motion.geometry.curves import Array

LEAST = 12  # lines: fewer cost more in columns than one by one
MOST = 4096
_FIRST_WINDOW = 32
_GROWTH = 4
_LONGEST_PAUSE = 64


class PlainRuns:
    """Finds runs, and keeps in mind where looking for one is worth its time.

    The text that is looked at grows with the runs that were found, so that short ones do not read the same
    lines again and again. After a look in vain the next waits, twice as long each time: one odd line between
    two runs costs little, and so does a program without runs.
    """

    __slots__ = ("_again", "_pause", "_rows", "_tolerance", "_window")

    def __init__(self, setup: Setup) -> None:
        self._tolerance = setup.machine.path_tolerance
        self._rows = axis_rows(setup)
        self._window = _FIRST_WINDOW
        self._pause = 1
        self._again = 0

    def window(self, number: int) -> int:
        """How many lines from line ``number`` on would be looked at; 0 where none."""
        return 0 if number < self._again else self._window

    def interpret(
        self, texts: Sequence[str], number: int, modal: ModalState, commanded: Commanded, most: int
    ) -> tuple[ModalState, PlainRun, int] | None:
        """The modal state after the run, the run and how many lines it takes; positions go on."""
        size = min(len(texts), self.window(number), most)
        if size < LEAST:
            return None
        found = self._read(texts[:size], number, modal, commanded)
        if found is None:
            if self._pause > 1:
                self._window = _FIRST_WINDOW
            self._again = number + self._pause
            self._pause = min(2 * self._pause, _LONGEST_PAUSE)
            return None
        taken = found[2]
        self._again = 0
        self._pause = 1
        self._window = min(MOST, max(_FIRST_WINDOW, taken * (_GROWTH if taken == size else 2)))
        return found

    def _read(
        self, texts: Sequence[str], number: int, modal: ModalState, commanded: Commanded
    ) -> tuple[ModalState, PlainRun, int] | None:
        if modal.tool is not None or modal.exact_next or commanded.poses:
            return None
        alike = read_alike(texts, LEAST)
        if alike is None or not (alike.coded or modal.motion == 1):
            return None
        if not commanded.settled(alike.axes):
            return None
        rows = [row for row in map(self._rows.get, alike.axes) if row is not None]
        if len(rows) < len(alike.axes):
            return None
        linear = [column for column, row in enumerate(rows) if row.linear]
        measure = measure_axes(len(linear), len(rows) - len(linear))
        if measure is Measure.NONE and not modal.inverse_time:
            return None
        if alike.feeds is not None:
            alike = alike.first(_leading(~(alike.feeds < SMALLEST_FEED)))
        points = _points(alike, rows, modal, commanded.positions)
        alike = alike.first(max(0, _leading(_inside(points, rows)) - 1))
        count = len(alike.lines)
        if alike.taken < LEAST or count < 1:
            return None
        numbers, speeds = _feeds(alike, modal, measure)
        if not numbers[0] > 0.0:
            return None
        points = points[: count + 1]
        travels = _travels(points, linear)
        lengths = np.abs(points[1:, 0] - points[:-1, 0]) if measure is Measure.TURN else travels
        run = PlainRun(
            number + alike.lines,
            alike.axes,
            points,
            lengths,
            travels,
            move_duration(numbers) if modal.inverse_time else lengths / speeds,
            None if modal.inverse_time else speeds,
            modal.exact_stop,
            self._tolerance if modal.tolerance is None else modal.tolerance,
        )
        commanded.positions.update(zip(alike.axes, points[-1].tolist(), strict=True))
        return _after(modal, alike.feeds), run, alike.taken


def _leading(sound: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> int:
    """How many are sound before the first that is not."""
    return len(sound) if sound.all() else int(sound.argmin())


def _points(
    alike: AlikeLines, rows: Sequence[AxisRow], modal: ModalState, positions: Mapping[int, float]
) -> Array:
    """Where the first line starts and where each ends, shape (n+1, K) [m or rad]."""
    points = np.empty((len(alike.lines) + 1, len(rows)))
    for column, (axis, row, values) in enumerate(zip(alike.axes, rows, alike.values, strict=True)):
        points[0, column] = positions[axis]
        np.multiply(values, row.inch if modal.inch else row.metric, out=points[1:, column])
    return np.add.accumulate(points, axis=0) if modal.incremental else points


def _inside(points: Array, rows: Sequence[AxisRow]) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Which points no axis's travel leaves out; both ends of a line have to be inside."""
    least = np.array([row.least for row in rows])
    greatest = np.array([row.greatest for row in rows])
    inside = (points >= least) & (points <= greatest)
    return np.asarray(inside.all(axis=1))


def _travels(points: Array, linear: Sequence[int]) -> Array:
    """Root of the sum of squares of the linear axes' travels, shape (n,) [m]."""
    if not linear:
        return np.zeros(len(points) - 1)
    steps = (points[1:] - points[:-1]).T.tolist()
    return np.array(list(map(math.hypot, *[steps[column] for column in linear])))


def _feeds(alike: AlikeLines, modal: ModalState, measure: Measure) -> tuple[Array, Array]:
    """F in force on each line as written, and as a speed [m/s or rad/s]; 0 where none is in force."""
    before = modal.feed or Feed(0.0, 0.0)
    numbers = np.full(len(alike.lines) + 1, before.number)
    speeds = np.full(len(alike.lines) + 1, before.speed)
    if alike.feeds is not None:
        written = ~np.isnan(alike.feeds)
        origin = np.maximum.accumulate(np.where(written, np.arange(1, len(numbers)), 0))
        numbers[1:] = np.where(written, alike.feeds, 0.0)
        speeds[1:] = path_speed(numbers[1:], modal.inch)
        numbers[1:], speeds[1:] = numbers[origin], speeds[origin]
    numbers = numbers[1:]
    return numbers, turning_speed(numbers) if measure is Measure.TURN else speeds[1:]


def _after(modal: ModalState, feeds: Array | None) -> ModalState:
    """The modal state behind a run."""
    feed = modal.feed
    if feeds is not None:
        written = feeds[~np.isnan(feeds)]
        if len(written):
            feed = read_feed(float(written[-1]), modal)
    if modal.motion == 1 and feed is modal.feed:
        return modal
    return msgspec.structs.replace(modal, motion=1, feed=feed)
