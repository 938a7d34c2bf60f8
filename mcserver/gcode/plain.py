"""The short way for plain moves: ``G01 X.. Y.. F..``, ``G02 X.. Y.. R..``, and the same without their code.

It gives the very same values as the general way, or None wherever anything else has to be looked at: a tool,
an axis whose start is not known, a limit, a missing feed, an arc that is not defined.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mcserver.gcode.arc_geometry import ArcFault, arc_by_centre, arc_by_radius, plane_extrema
from mcserver.gcode.arc_plane import PLANES, NoPlane, choose_plane
from mcserver.gcode.commanded import Commanded
from mcserver.gcode.draft import Setup
from mcserver.gcode.feed_time import Measure, measure_axes
from mcserver.gcode.limits import ROUNDING
from mcserver.gcode.modal import Feed, ModalState, read_feed
from mcserver.gcode.plain_words import Plain
from mcserver.gcode.program_units import axis_scale, length_scale, move_duration, turning_speed
from mcserver.gcode.targets import SMALLEST_FEED
from mcserver.motion.canonical import FeedGroup, MotionLine
from mcserver.motion.path import ArcCurve, Curve, LineCurve
from mcserver.units import AxisType


class _Row(NamedTuple):
    metric: float
    inch: float
    least: float
    greatest: float
    linear: bool


class PlainMoves:
    """Tables of the usable axes, looked up once a word."""

    __slots__ = ("_rows", "_tolerance")

    def __init__(self, setup: Setup) -> None:
        self._tolerance = setup.machine.path_tolerance
        self._rows = {
            index: _Row(
                metric=axis_scale(axis.type, inch=False),
                inch=axis_scale(axis.type, inch=True),
                least=axis.min_position - ROUNDING,
                greatest=axis.max_position + ROUNDING,
                linear=axis.type is AxisType.LINEAR,
            )
            for index, axis in setup.axes.items()
            if index in setup.leased
        }

    def interpret(
        self, number: int, move: Plain, modal: ModalState, commanded: Commanded
    ) -> tuple[ModalState, MotionLine] | None:
        """The modal state after the line, and the line; positions in ``commanded`` go on."""
        motion = modal.motion if move.code is None else move.code
        if not motion or modal.tool is not None or not commanded.simple:
            return None
        feed = modal.feed
        if move.feed is not None:
            if move.feed < SMALLEST_FEED:
                return None
            feed = read_feed(move.feed, modal)
        if feed is None or move.curved != (motion != 1):
            return None
        if motion == 1:
            return self._line(number, move, modal, commanded, feed)
        return self._arc(number, move, modal, commanded, feed, motion)

    def _line(
        self, number: int, move: Plain, modal: ModalState, commanded: Commanded, feed: Feed
    ) -> tuple[ModalState, MotionLine] | None:
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
            if not row.least <= end <= row.greatest or not row.least <= start <= row.greatest:
                return None
            starts.append(start)
            ends.append(end)
            if row.linear:
                travels.append(end - start)
        travel = length = math.hypot(*travels)
        measure = measure_axes(len(travels), len(ends) - len(travels))
        if measure is Measure.TURN:
            length = abs(ends[0] - starts[0])
        elif measure is Measure.NONE and not modal.inverse_time:
            return None
        curve = LineCurve(move.axes, tuple(starts), tuple(ends), length)
        for index, end in zip(move.axes, ends, strict=True):
            positions[index] = end
        speed = turning_speed(feed.number) if measure is Measure.TURN else feed.speed
        return self._finish(number, modal, curve, feed, speed, travel, 1)

    def _arc(
        self, number: int, move: Plain, modal: ModalState, commanded: Commanded, feed: Feed, motion: int
    ) -> tuple[ModalState, MotionLine] | None:
        positions = commanded.positions
        inch = modal.inch
        scale = length_scale(inch)
        ends: dict[int, float] = {}
        for index, value in zip(move.axes, move.values, strict=True):
            row = self._rows.get(index)
            if row is None or not row.linear or index > 2:
                return None
            end = value * scale
            ends[index] = end + positions[index] if modal.incremental else end
        coordinates = [coordinate for coordinate, _ in move.offsets]
        try:
            first, second = plane = PLANES[
                choose_plane(modal.plane, frozenset(coordinates), frozenset(move.axes))
            ]
        except NoPlane:
            return None
        further = tuple(index for index in move.axes if index != first and index != second)
        axes = plane + further
        rows = [self._rows.get(index) for index in axes]
        if any(row is None or not row.linear for row in rows):
            return None
        starts = tuple([positions[index] for index in axes])
        finish = tuple([ends.get(index, positions[index]) for index in axes])
        begin, end_point = (starts[0], starts[1]), (finish[0], finish[1])
        try:
            if move.radius is not None:
                shape = arc_by_radius(begin, end_point, move.radius * scale, motion == 2, 1)
            else:
                centre = [begin[0], begin[1]]
                for coordinate, value in move.offsets:
                    if coordinate not in plane:
                        return None
                    centre[plane.index(coordinate)] += value * scale
                shape = arc_by_centre(begin, end_point, (centre[0], centre[1]), motion == 2, 1)
        except ArcFault:
            return None
        length = shape.path_length(*[b - a for a, b in zip(starts[2:], finish[2:], strict=True)])
        curve = ArcCurve(axes, starts, finish, shape.centre, shape.sweep, length)
        low, high = plane_extrema(curve)
        for column, row in enumerate(rows):
            assert row is not None
            ordered = (low[column], high[column]) if column < 2 else sorted((starts[column], finish[column]))
            if ordered[0] < row.least or ordered[1] > row.greatest:
                return None
        positions.update(ends)
        return self._finish(number, modal, curve, feed, feed.speed, length, motion)

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
            )
        return modal, line
