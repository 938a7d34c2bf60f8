"""Interpret runs of simple blocks in columns: the same values as line by line, without an object for each.

Lines of the same words, straight ones, are the quickest (`PlainRun`); all others of G01 to G03 go together
(`PathRun`).

Bit for bit: numbers are read as `float` reads them; products, sums, quotients and comparisons are the same
IEEE operations in the same order (an accumulated sum adds one after the other); the root of the sum of
squares is `math.hypot` itself, since `numpy.hypot` may differ in the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from mcserver.gcode.fast_path.block import AxisRow, axis_rows
from mcserver.gcode.fast_path.code_text import CodeText
from mcserver.gcode.fast_path.columns import LineColumns, read_columns
from mcserver.gcode.fast_path.kept_runs import KeptRuns
from mcserver.gcode.fast_path.path_runs import PathRunInterpreter
from mcserver.gcode.fast_path.run_state import MIN_LINES, feeds_in_force, leading, state_after
from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.gcode.semantics.feed_time import FeedBasis, feed_basis
from mcserver.gcode.semantics.modal import ModalState, smallest_feed
from mcserver.gcode.semantics.program_units import move_duration, turning_speed
from mcserver.motion.canonical import PathRun, PlainRun
from mcserver.motion.geometry.curves import Array

MAX_LINES = 4096
# so many lines of the same words are read by themselves; fewer together with those of other words behind them
_ENOUGH = 256
_FIRST_WINDOW = 32
_GROWTH = 4
_MAX_BACKOFF = 64


class RunInterpreter:
    """Finds and interprets runs, with a window that adapts to the program.

    The window grows with the runs found, so that short runs do not read the same lines again and again. After
    a failed attempt the next one waits, twice as long each time: one odd line between two runs costs little,
    and so does a program without runs.

    Args:
        kept: where the check of a program keeps its runs, and the run of it takes them from.
    """

    __slots__ = ("_backoff", "_kept", "_paths", "_retry_at", "_rows", "_tolerance", "_window")

    def __init__(self, setup: Setup, kept: KeptRuns | None = None) -> None:
        self._kept = kept
        self._tolerance = setup.machine.path_tolerance
        self._rows = axis_rows(setup)
        self._paths = PathRunInterpreter(self._rows, self._tolerance, setup.machine.dialect.profile)
        self._window = _FIRST_WINDOW
        self._backoff = 1
        self._retry_at = 0

    def window(self, number: int) -> int:
        """Return how many lines from line ``number`` on an attempt would read; 0: no attempt now."""
        return 0 if number < self._retry_at else self._window

    def interpret(
        self, texts: Sequence[str], number: int, modal: ModalState, commanded: CommandedState, most: int
    ) -> tuple[ModalState, PlainRun | PathRun, int] | None:
        """Return the modal state after the run, the run and its count of lines, and advance the positions."""
        size = min(len(texts), self.window(number), most)
        if size < MIN_LINES:
            return None
        found = self._taken(size, number, modal, commanded)
        if found is None:
            found = self._read(texts[:size], number, modal, commanded)
            if found is not None and self._kept is not None:
                after, run, taken = found
                self._kept.keep(run, taken, modal, after, ended=taken < size)
        if found is None:
            if self._backoff > 1:
                self._window = _FIRST_WINDOW
            self._retry_at = number + self._backoff
            self._backoff = min(2 * self._backoff, _MAX_BACKOFF)
            return None
        taken = found[2]
        self._retry_at = 0
        self._backoff = 1
        self._window = min(MAX_LINES, max(_FIRST_WINDOW, taken * (_GROWTH if taken == size else 2)))
        return found

    def _taken(
        self, size: int, number: int, modal: ModalState, commanded: CommandedState
    ) -> tuple[ModalState, PlainRun | PathRun, int] | None:
        """Take lines that the check of the program has interpreted."""
        if self._kept is None:
            return None
        return self._kept.take(number, size, min(size, _ENOUGH), modal, commanded)

    def _read(
        self, texts: Sequence[str], number: int, modal: ModalState, commanded: CommandedState
    ) -> tuple[ModalState, PlainRun | PathRun, int] | None:
        if modal.tool is not None or modal.exact_next or modal.relative or commanded.poses:
            return None
        text = CodeText.of(texts)
        columns = read_columns(text, min(len(texts), _ENOUGH))
        if columns is None:
            return self._paths.interpret(text, number, modal, commanded)
        return self._plain(columns, number, modal, commanded)

    def _plain(
        self, columns: LineColumns, number: int, modal: ModalState, commanded: CommandedState
    ) -> tuple[ModalState, PlainRun, int] | None:
        """Interpret lines of the same words."""
        if not (columns.coded or modal.motion == 1):
            return None
        if not commanded.synced(columns.axes):
            return None
        rows = [row for row in map(self._rows.get, columns.axes) if row is not None]
        if len(rows) < len(columns.axes):
            return None
        linear = [column for column, row in enumerate(rows) if row.linear]
        measure = feed_basis(len(linear), len(rows) - len(linear))
        if measure is FeedBasis.NONE and not modal.inverse_time:
            return None
        if columns.feeds is not None:
            columns = columns.first(leading(~(columns.feeds < smallest_feed(modal))))
        points = _points(columns, rows, modal, commanded.positions)
        columns = columns.first(max(0, leading(_inside(points, rows)) - 1))
        count = len(columns.lines)
        if columns.taken < MIN_LINES or count < 1:
            return None
        numbers, speeds = feeds_in_force(count, columns.feeds, modal)
        if measure is FeedBasis.TURN:
            speeds = turning_speed(numbers)
        if not numbers[0] > 0.0:
            return None
        points = points[: count + 1]
        travels = _travels(points, linear)
        lengths = np.abs(points[1:, 0] - points[:-1, 0]) if measure is FeedBasis.TURN else travels
        run = PlainRun(
            number + columns.lines,
            columns.axes,
            points,
            lengths,
            travels,
            move_duration(numbers) if modal.inverse_time else lengths / speeds,
            None if modal.inverse_time else speeds,
            modal.exact_stop,
            self._tolerance if modal.tolerance is None else modal.tolerance,
        )
        commanded.positions.update(zip(columns.axes, points[-1].tolist(), strict=True))
        return state_after(modal, columns.feeds, 1), run, columns.taken


def _points(
    columns: LineColumns, rows: Sequence[AxisRow], modal: ModalState, positions: Mapping[int, float]
) -> Array:
    """Compute the start of the first line and the end of each, shape (n+1, K) [m or rad]."""
    points = np.empty((len(columns.lines) + 1, len(rows)))
    for column, (axis, row, values) in enumerate(zip(columns.axes, rows, columns.values, strict=True)):
        points[0, column] = positions[axis]
        np.multiply(values, row.inch if modal.inch else row.metric, out=points[1:, column])
        if modal.shift is not None and not modal.incremental:
            points[1:, column] += modal.shift.get(axis, 0.0)
    return np.add.accumulate(points, axis=0) if modal.incremental else points


def _inside(points: Array, rows: Sequence[AxisRow]) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which points lie within every axis's travel, shape (n+1,)."""
    least = np.array([row.least for row in rows])
    greatest = np.array([row.greatest for row in rows])
    inside = (points >= least) & (points <= greatest)
    return np.asarray(inside.all(axis=1))


def _travels(points: Array, linear: Sequence[int]) -> Array:
    """Compute the root of the sum of squares of the linear axes' displacements, shape (n,) [m]."""
    if not linear:
        return np.zeros(len(points) - 1)
    steps = (points[1:] - points[:-1]).T.tolist()
    return np.array(list(map(math.hypot, *[steps[column] for column in linear])))
