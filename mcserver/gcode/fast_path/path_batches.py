"""Interpret lines of G00 to G03 in columns, whatever their words: most lines of CAM output.

Bit for bit as the block interpreter does line by line; see `mcserver.gcode.fast_path.batches`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.gcode.fast_path.arc_columns import ArcColumns, arcs_of, hypot
from mcserver.gcode.fast_path.axis_rows import arc_frame, axis_rows, inside_travels
from mcserver.gcode.fast_path.code_text import CodeText
from mcserver.gcode.fast_path.interpreted_batch import MIN_LINES, InterpretedBatch, leading, state_after
from mcserver.gcode.fast_path.usable_lines import Kind, UsableLines, places, speed_outputs, usable_lines
from mcserver.gcode.fast_path.vocabulary import Vocabulary
from mcserver.gcode.fast_path.word_columns import Shape, WordReader, WordTable
from mcserver.gcode.semantics.arc_geometry import radius_tolerance
from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.gcode.semantics.feed_time import NO_TRAVEL, FeedBasis, feed_basis, feed_class
from mcserver.gcode.semantics.modal import ModalState
from mcserver.gcode.semantics.program_units import length_scale, move_duration, turning_speed
from mcserver.gcode.semantics.rapids import rapid_group
from mcserver.motion.canonical import MotionLine, OutputLine, PathBatch
from mcserver.motion.geometry.curves import ArcCurve, Array

Mask = NDArray[np.bool_]


class PathBatchInterpreter:
    """Interprets batches with a table of the usable axes."""

    __slots__ = ("_profile", "_reader", "_rows", "_setup", "_vocabulary")

    def __init__(self, setup: Setup, vocabulary: Vocabulary) -> None:
        self._setup = setup
        self._rows = axis_rows(setup)
        self._profile = setup.machine.dialect.profile
        self._vocabulary = vocabulary
        self._reader = WordReader(self._vocabulary)

    def interpret(
        self, text: CodeText, number: int, modal: ModalState, commanded: CommandedState
    ) -> InterpretedBatch | None:
        """Interpret the batch at the beginning of the text, and advance the positions.

        Args:
            number: of the first line.
        """
        table = self._reader.read(text, MIN_LINES)
        if table is None:
            return None
        kinds = [self._kind_of(shape, modal, commanded) for shape in table.shapes]
        lines = usable_lines(table, kinds, modal, self._setup, self._vocabulary)
        axes = tuple(sorted({axis for kind in lines.kinds.values() for axis in kind.axes}))
        points = self._points(lines.table, axes, modal, commanded)
        count = leading(self._ends_inside(lines, axes, points))
        lines, points = lines.first(count), points[: count + 1]
        centres, sweeps = np.full((count, 2), np.nan), np.zeros(count)
        lengths, travels = np.zeros(count), np.zeros(count)
        curved = np.flatnonzero(lines.motion > 1)
        if len(curved):
            found, sound = self._arcs(curved, lines, axes, points, modal)
            sound_lines = leading(sound)
            if sound_lines < len(curved):
                count = int(curved[sound_lines])
            centres[curved], sweeps[curved] = found.centres, found.sweeps
            lengths[curved] = found.lengths(self._climbs(curved, lines, axes, points))
            travels[curved] = lengths[curved]
        lines = lines.first(count)
        table = lines.table
        if table.taken < MIN_LINES or count < 1:
            return None
        speeds = self._straight(lines, axes, points[: count + 1], lengths, travels)
        # rapids before the first F have none
        speeds, numbers = (np.where(each > 0.0, each, 1.0) for each in (speeds, lines.numbers))
        timing = (
            lengths[:count],
            travels[:count],
            move_duration(numbers) if modal.inverse_time else lengths[:count] / speeds,
            None if modal.inverse_time else speeds,
            np.full(count, self._setup.machine.corner_tolerance(modal.tolerance)),
            modal.exact_stop,
        )
        batch = PathBatch(
            number + table.lines,
            axes,
            points[: count + 1],
            tuple(kind.axes for kind in lines.kinds.values()),
            np.searchsorted(np.array(list(lines.kinds)), table.shape),
            centres[:count],
            sweeps[:count],
            *timing,
            speed_outputs(table, modal, self._vocabulary),
        )
        commanded.positions.update(zip(axes, points[count].tolist(), strict=True))
        after = state_after(modal, table.feeds, table.spindle, int(lines.motion[-1]))
        values = self._values(batch, lines, points, axes, modal)
        return InterpretedBatch(after, values, table.taken, table.without_effect(number))

    def _values(
        self,
        batch: PathBatch,
        lines: UsableLines,
        points: Array,
        axes: tuple[int, ...],
        modal: ModalState,
    ) -> Sequence[PathBatch | MotionLine | OutputLine]:
        """Return the lines as one batch, or as several with the rapids between them."""
        rapids = np.flatnonzero(lines.motion == 0).tolist()
        if not rapids:
            return (batch,)
        found: list[PathBatch | MotionLine | OutputLine] = []
        before = 0
        for index in [*rapids, len(batch)]:
            between = index - before
            if between >= MIN_LINES:
                found.append(batch.part(before, index))
            elif between:
                found += batch.part(before, index).values()
            before = index + 1
            if index < len(batch):
                kind = lines.kinds[int(lines.table.shape[index])].axes
                start, end = (
                    dict(zip(axes, points[row].tolist(), strict=True)) for row in (index, index + 1)
                )
                group = rapid_group(self._setup, modal, start, {axis: end[axis] for axis in kind})
                tolerance, line = float(batch.tolerances[index]), int(batch.lines[index])
                if batch.outputs is not None:
                    settings = batch.outputs.settings(float(batch.outputs.values[index]))
                    found += [OutputLine(line, settings, with_motion=True)] if settings else []
                found.append(MotionLine(line, (group,), exact_stop=True, tolerance=tolerance))
        return found

    def _kind_of(self, shape: Shape, modal: ModalState, commanded: CommandedState) -> Kind | None:
        """Return what lines of a shape produce; None if they need the block interpreter."""
        if shape.curved:
            further = not self._vocabulary.feed_of_axes
            frame = arc_frame(self._rows, modal.plane, shape.axes, shape.offsets, further=further)
            if frame is None or not commanded.synced(frame.axes):
                return None
            return Kind(frame.axes, True, FeedBasis.PATH)
        rows = [row for row in map(self._rows.get, shape.axes) if row is not None]
        linear = sum(row.linear for row in rows)
        basis = feed_basis(linear, len(rows) - linear) if self._vocabulary.feed_of_axes else FeedBasis.PATH
        if len(rows) < len(shape.axes) or not commanded.synced(shape.axes):
            return None
        if basis is FeedBasis.NONE and not modal.inverse_time:
            return None
        return Kind(shape.axes, False, basis)

    def _points(
        self, table: WordTable, axes: tuple[int, ...], modal: ModalState, commanded: CommandedState
    ) -> Array:
        """Compute the start of the first line and the end of each, shape (n+1, K) [m or rad]."""
        points = np.empty((len(table.lines) + 1, len(axes)))
        for column, axis in enumerate(axes):
            row, extruder = self._rows[axis], axis == self._setup.machine.dialect.extruder
            scale = row.inch if modal.inch else row.metric
            points[:, column] = places(
                table, axis, commanded.positions[axis], scale, modal, flow=modal.flow if extruder else 1.0
            )
        return points

    def _ends_inside(self, lines: UsableLines, axes: tuple[int, ...], points: Array) -> Mask:
        """Return which lines start and end within the travels of their axes."""
        least = np.array([self._rows[axis].least for axis in axes])
        greatest = np.array([self._rows[axis].greatest for axis in axes])
        inside = (points >= least) & (points <= greatest)
        sound = np.ones(len(points) - 1, np.bool_)
        if inside.all():
            return sound
        for index, kind in lines.kinds.items():
            rows = np.flatnonzero(lines.table.shape == index)
            for column in map(axes.index, kind.axes):
                sound[rows] &= inside[rows, column] & inside[rows + 1, column]
        return sound

    def _arcs(
        self,
        curved: NDArray[np.intp],
        lines: UsableLines,
        axes: tuple[int, ...],
        points: Array,
        modal: ModalState,
    ) -> tuple[ArcColumns, Mask]:
        """Compute the arcs, and whether each is defined and within the travels of its axes."""
        scale = length_scale(modal.inch)
        table = lines.table
        starts, ends, centres = np.empty((3, len(curved), 2))
        least, greatest = np.empty((2, len(curved), 2))
        shape = table.shape[curved]
        for index, kind in lines.kinds.items():
            if not kind.curved:
                continue
            of_kind = np.flatnonzero(shape == index)
            rows = curved[of_kind]
            for column, axis in enumerate(kind.axes[:2]):
                place = axes.index(axis)
                starts[of_kind, column] = points[rows, place]
                ends[of_kind, column] = points[rows + 1, place]
                centres[of_kind, column] = starts[of_kind, column]
                if axis in table.shapes[index].offsets:
                    centres[of_kind, column] += table.offsets[rows, axis] * scale
                least[of_kind, column] = self._rows[axis].least
                greatest[of_kind, column] = self._rows[axis].greatest
        found = arcs_of(
            starts,
            ends,
            centres,
            table.radii[curved] * scale,
            lines.motion[curved] == 2,
            radius_tolerance(self._profile, inch=modal.inch),
        )
        reach = (found.radii + np.abs(found.growths))[:, None]
        sure = ((found.centres - reach >= least) & (found.centres + reach <= greatest)).all(axis=1)
        sound = found.defined.copy()
        for index in np.flatnonzero(found.defined & ~sure).tolist():
            line = int(curved[index])
            kind = lines.kinds[int(table.shape[line])]
            columns = [axes.index(axis) for axis in kind.axes]
            curve = ArcCurve(
                kind.axes,
                tuple(points[line, columns].tolist()),
                tuple(points[line + 1, columns].tolist()),
                (float(found.centres[index, 0]), float(found.centres[index, 1])),
                float(found.sweeps[index]),
                0.0,
            )
            sound[index] = inside_travels(curve, tuple(self._rows[axis] for axis in kind.axes))
        return found, sound

    def _climbs(
        self, curved: NDArray[np.intp], lines: UsableLines, axes: tuple[int, ...], points: Array
    ) -> Array:
        """Return the displacements of the third axes of helices, shape (n,) [m]; 0 where none is named."""
        climbs = np.zeros(len(curved))
        shape = lines.table.shape[curved]
        for index, kind in lines.kinds.items():
            for axis in kind.axes[2:] if kind.curved else ():
                if axis > 2:
                    continue
                of_kind = np.flatnonzero(shape == index)
                rows, column = curved[of_kind], axes.index(axis)
                climbs[of_kind] = points[rows + 1, column] - points[rows, column]
        return climbs

    def _straight(
        self, lines: UsableLines, axes: tuple[int, ...], points: Array, lengths: Array, travels: Array
    ) -> Array:
        """Set lengths and travels of the straight lines; return the speeds of all lines [m/s or rad/s]."""
        speeds = lines.speeds.copy()
        for index, kind in lines.kinds.items():
            if kind.curved:
                continue
            rows = np.flatnonzero(lines.table.shape == index)
            if not self._vocabulary.feed_of_axes:
                self._by_class(kind, rows, lines, axes, points, (lengths, travels, speeds))
                continue
            columns = [axes.index(axis) for axis in kind.axes if self._rows[axis].linear]
            if columns:
                steps = points[rows + 1] - points[rows]
                travels[rows] = hypot(*[steps[:, column] for column in columns])
            lengths[rows] = travels[rows]
            if kind.basis is FeedBasis.TURN:
                column = axes.index(kind.axes[0])
                lengths[rows] = np.abs(points[rows + 1, column] - points[rows, column])
                speeds[rows] = turning_speed(lines.numbers[rows])
        return speeds

    def _by_class(
        self,
        kind: Kind,
        rows: NDArray[np.intp],
        lines: UsableLines,
        axes: tuple[int, ...],
        points: Array,
        timing: tuple[Array, Array, Array],
    ) -> None:
        """Set lengths, travels and speeds of lines whose F counts X Y Z first, as `profile_feed_basis`."""
        lengths, travels, speeds = timing
        steps = points[rows + 1] - points[rows]
        open_rows = np.ones(len(rows), np.bool_)
        classes: tuple[list[int], list[int], list[int]] = ([], [], [])
        for axis in kind.axes:
            classes[feed_class(axis, linear=self._rows[axis].linear)].append(axes.index(axis))
        turning = np.full(len(rows), not (classes[0] or classes[1]))
        for order, columns in enumerate(classes):
            if not columns:
                continue
            found = hypot(*[steps[:, column] for column in columns])
            taken = open_rows & (found > NO_TRAVEL)
            lengths[rows[taken]] = found[taken]
            turning[taken] = order == 2
            open_rows &= ~taken
        travels[rows] = np.where(turning, 0.0, lengths[rows])
        speeds[rows] = np.where(turning, turning_speed(lines.numbers[rows]), speeds[rows])
