"""The short way for plain moves: ``G01 X.. Y.. F..`` and the same without its code.

It gives the very same values as the general way, or None wherever anything else has to be looked at: a tool,
an axis whose start is not known, a limit, a missing feed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mcserver.gcode.commanded import Commanded
from mcserver.gcode.draft import Setup
from mcserver.gcode.feed_time import Measure, measure_axes
from mcserver.gcode.limits import ROUNDING
from mcserver.gcode.modal import ModalState, read_feed
from mcserver.gcode.parser import PlainMove
from mcserver.gcode.program_units import axis_scale, move_duration, turning_speed
from mcserver.motion.canonical import FeedGroup, MotionLine
from mcserver.motion.path import LineCurve
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
        self, number: int, move: PlainMove, modal: ModalState, commanded: Commanded
    ) -> tuple[ModalState, MotionLine] | None:
        """The modal state after the line, and the line; positions in ``commanded`` go on."""
        if modal.tool is not None or not (move.coded or modal.motion == 1) or not commanded.simple:
            return None
        feed = modal.feed
        if move.feed is not None:
            if move.feed < 1e-6:
                return None
            feed = read_feed(move.feed, modal)
        if feed is None:
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
            if not row.least <= end <= row.greatest or not row.least <= start <= row.greatest:
                return None
            starts.append(start)
            ends.append(end)
            if row.linear:
                travels.append(end - start)
        length = math.hypot(*travels)
        measure = measure_axes(len(travels), len(ends) - len(travels))
        travel = length
        if measure is Measure.TURN:
            length = abs(ends[0] - starts[0])
        curve = LineCurve(move.axes, tuple(starts), tuple(ends), length)
        if modal.inverse_time:
            duration = move_duration(feed.number)
            group = FeedGroup((curve,), duration, duration)
        elif measure is Measure.NONE:
            return None
        else:
            speed = turning_speed(feed.number) if measure is Measure.TURN else feed.speed
            group = FeedGroup((curve,), length / speed, None, speed)
        for index, end in zip(move.axes, ends, strict=True):
            positions[index] = end
        line = MotionLine(
            number,
            (group,),
            modal.exact_stop or modal.exact_next,
            self._tolerance if modal.tolerance is None else modal.tolerance,
            travel,
        )
        if modal.motion != 1 or modal.exact_next or feed is not modal.feed:
            modal = ModalState(
                inch=inch,
                incremental=incremental,
                inverse_time=modal.inverse_time,
                exact_stop=modal.exact_stop,
                exact_next=False,
                tolerance=modal.tolerance,
                tool=None,
                feed=feed,
                plane=modal.plane,
                motion=1,
            )
        return modal, line
