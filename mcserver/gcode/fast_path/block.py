"""Interpret simple blocks: ``G01 X.. Y.. F..``, ``G02 X.. Y.. R..``, and the same without their code.

The result equals that of the block interpreter bit for bit, or is None if anything else matters: a tool, an
axis whose start is not known, a limit, a missing feed, an arc that is not defined.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from mcserver.gcode.fast_path.short_form import SimpleBlock
from mcserver.gcode.semantics.arc_geometry import (
    Arc,
    ArcFault,
    arc_by_centre,
    arc_by_radius,
    plane_extrema,
    radius_tolerance,
)
from mcserver.gcode.semantics.arc_plane import PLANES, NoPlane, choose_plane
from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.gcode.semantics.feed_time import FeedBasis, feed_basis
from mcserver.gcode.semantics.modal import Feed, ModalState, read_feed, smallest_feed
from mcserver.gcode.semantics.program_units import axis_scale, length_scale, move_duration, turning_speed
from mcserver.gcode.semantics.travel_limits import ROUNDING
from mcserver.motion.canonical import FeedGroup, MotionLine
from mcserver.motion.geometry.curves import ArcCurve, Curve, LineCurve
from mcserver.units import AxisType


class AxisRow(NamedTuple):
    """An axis as simple blocks need it: scales to SI, and its travel with `ROUNDING` [m or rad]."""

    metric: float
    inch: float
    least: float
    greatest: float
    linear: bool


def axis_rows(setup: Setup) -> dict[int, AxisRow]:
    """Build a row for each axis that the program may use."""
    return {
        index: AxisRow(
            metric=axis_scale(axis.type, inch=False),
            inch=axis_scale(axis.type, inch=True),
            least=axis.min_position - ROUNDING,
            greatest=axis.max_position + ROUNDING,
            linear=axis.type is AxisType.LINEAR,
        )
        for index, axis in setup.axes.items()
        # RS-274's feed counts X Y Z first (D-66): lines of other axes are left to the general reading
        if index in setup.leased and (index <= 2 or setup.machine.dialect.reference) and not axis.profiled
    }


class ArcFrame(NamedTuple):
    """An arc's axes, the plane's two first, with the column of each axis word and of each of I J K."""

    axes: tuple[int, ...]
    columns: tuple[int, ...]
    offsets: tuple[int, ...]
    rows: tuple[AxisRow, ...]


def _surely_inside(curve: ArcCurve, shape: Arc, rows: tuple[AxisRow, ...]) -> bool:
    """Return True if even the full circle stays within the travels, so that no extrema need be computed."""
    reach = shape.radius + abs(shape.growth)
    for column, row in enumerate(rows):
        start, end = curve.start[column], curve.end[column]
        if not row.least <= start <= row.greatest or not row.least <= end <= row.greatest:
            return False
        if column < 2:
            centre = shape.centre[column]
            if centre - reach < row.least or centre + reach > row.greatest:
                return False
    return True


def inside_travels(curve: ArcCurve, rows: tuple[AxisRow, ...]) -> bool:
    """Return True if the arc stays within the axes' travels."""
    low, high = plane_extrema(curve)
    for column, row in enumerate(rows):
        ends = curve.start[column], curve.end[column]
        ordered = (low[column], high[column]) if column < 2 else (min(ends), max(ends))
        if ordered[0] < row.least or ordered[1] > row.greatest:
            return False
    return True


def arc_frame(
    usable: Mapping[int, AxisRow], chosen: int | None, axes: tuple[int, ...], offsets: tuple[int, ...]
) -> ArcFrame | None:
    """Choose an arc's axes by the letters of its words; None if they need the block interpreter.

    Args:
        usable: rows by axis. chosen: the plane in force. axes, offsets: as of `SimpleBlock`, without values.
    """
    if axes and max(axes) > 2:
        return None
    try:
        plane = PLANES[choose_plane(chosen, frozenset(offsets), frozenset(axes))]
    except NoPlane:
        return None
    ordered = plane + tuple([index for index in axes if index not in plane])
    rows = [row for row in map(usable.get, ordered) if row is not None and row.linear]
    if len(rows) < len(ordered) or not set(offsets) <= set(plane):
        return None
    columns = tuple([ordered.index(index) for index in axes])
    return ArcFrame(ordered, columns, tuple([plane.index(offset) for offset in offsets]), tuple(rows))


class SimpleBlockInterpreter:
    """Interprets simple blocks with tables of the usable axes and of the arc planes by their words."""

    __slots__ = ("_frames", "_profile", "_rows", "_tolerance")

    def __init__(self, setup: Setup) -> None:
        self._tolerance = setup.machine.path_tolerance
        self._profile = setup.machine.dialect.profile
        self._rows = axis_rows(setup)
        # bounded: one entry for each choice and order of X Y Z, I J K and plane, some hundreds
        self._frames: dict[tuple[int | None, tuple[int, ...], tuple[int, ...]], ArcFrame | None] = {}

    def interpret(
        self, number: int, move: SimpleBlock, modal: ModalState, commanded: CommandedState
    ) -> tuple[ModalState, MotionLine] | None:
        """Return the modal state after the line and the line, and advance the positions in ``commanded``."""
        motion = modal.motion if move.code is None else move.code
        if not motion or modal.tool is not None or modal.relative:
            return None
        feed = modal.feed
        if move.feed is not None:
            if move.feed < smallest_feed(modal):
                return None
            feed = read_feed(move.feed, modal)
        if feed is None or move.curved != (motion != 1):
            return None
        if motion == 1:
            return self._line(number, move, modal, commanded, feed)
        return self._arc(number, move, modal, commanded, feed, motion)

    def _line(
        self, number: int, move: SimpleBlock, modal: ModalState, commanded: CommandedState, feed: Feed
    ) -> tuple[ModalState, MotionLine] | None:
        if not commanded.synced(move.axes):
            return None
        rows = self._rows
        positions = commanded.positions
        incremental = modal.incremental
        inch = modal.inch
        starts: list[float] = []
        ends: list[float] = []
        travels: list[float] = []
        for index, value in zip(move.axes, move.values, strict=True):
            row = rows.get(index)
            if row is None:
                return None
            start = positions[index]
            end = value * (row.inch if inch else row.metric)
            if incremental:
                end += start
            elif modal.shift is not None:
                end += modal.shift.get(index, 0.0)
            if not row.least <= end <= row.greatest or not row.least <= start <= row.greatest:
                return None
            starts.append(start)
            ends.append(end)
            if row.linear:
                travels.append(end - start)
        travel = length = math.hypot(*travels)
        measure = feed_basis(len(travels), len(ends) - len(travels))
        if measure is FeedBasis.TURN:
            length = abs(ends[0] - starts[0])
        elif measure is FeedBasis.NONE and not modal.inverse_time:
            return None
        curve = LineCurve(move.axes, tuple(starts), tuple(ends), length)
        for index, end in zip(move.axes, ends, strict=True):
            positions[index] = end
        speed = turning_speed(feed.number) if measure is FeedBasis.TURN else feed.speed
        return self._finish(number, modal, curve, feed, speed, travel, 1)

    def _arc(
        self,
        number: int,
        move: SimpleBlock,
        modal: ModalState,
        commanded: CommandedState,
        feed: Feed,
        motion: int,
    ) -> tuple[ModalState, MotionLine] | None:
        named = (modal.plane, move.axes, tuple([coordinate for coordinate, _ in move.offsets]))
        try:
            frame = self._frames[named]
        except KeyError:
            frame = self._frames[named] = arc_frame(self._rows, *named)
        if frame is None or not commanded.synced(frame.axes):
            return None
        positions = commanded.positions
        scale = length_scale(modal.inch)
        starts = tuple([positions[index] for index in frame.axes])
        ends = list(starts)
        shift = modal.shift
        for column, value in zip(frame.columns, move.values, strict=True):
            ends[column] = value * scale + starts[column] if modal.incremental else value * scale
            if shift is not None and not modal.incremental:
                ends[column] += shift.get(frame.axes[column], 0.0)
        finish = tuple(ends)
        begin, end_point = (starts[0], starts[1]), (finish[0], finish[1])
        tolerance = radius_tolerance(self._profile, inch=modal.inch)
        try:
            if move.radius is not None:
                shape = arc_by_radius(begin, end_point, move.radius * scale, motion == 2, 1, tolerance)
            else:
                centre = [starts[0], starts[1]]
                for column, (_, value) in zip(frame.offsets, move.offsets, strict=True):
                    centre[column] += value * scale
                shape = arc_by_centre(begin, end_point, (centre[0], centre[1]), motion == 2, 1, tolerance)
        except ArcFault:
            return None
        if shape.nearly_closed(begin, end_point):
            return None
        curve = shape.curve(frame.axes, starts, finish)
        if not _surely_inside(curve, shape, frame.rows) and not inside_travels(curve, frame.rows):
            return None
        for index, column in zip(move.axes, frame.columns, strict=True):
            positions[index] = finish[column]
        return self._finish(number, modal, curve, feed, feed.speed, curve.length, motion)

    def _finish(
        self,
        number: int,
        modal: ModalState,
        curve: Curve,
        feed: Feed,
        speed: float,
        travel: float,
        motion: int,
    ) -> tuple[ModalState, MotionLine]:
        if modal.inverse_time:
            duration = move_duration(feed.number)
            group = FeedGroup((curve,), duration, duration)
        else:
            group = FeedGroup((curve,), curve.length / speed, None, speed)
        line = MotionLine(
            number,
            (group,),
            modal.exact_stop or modal.exact_next,
            self._tolerance if modal.tolerance is None else modal.tolerance,
            travel,
        )
        if modal.motion != motion or modal.exact_next or feed is not modal.feed:
            modal = ModalState(
                inch=modal.inch,
                incremental=modal.incremental,
                inverse_time=modal.inverse_time,
                exact_stop=modal.exact_stop,
                exact_next=False,
                tolerance=modal.tolerance,
                tool=None,
                feed=feed,
                plane=modal.plane,
                motion=motion,
                frame=modal.frame,
                shift=modal.shift,
                relative=modal.relative,
                carried=modal.carried,
            )
        return modal, line
