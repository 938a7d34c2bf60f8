"""Motion of canned cycles: rapids, feed moves, dwells and turns of the spindle, within the axes' travel.

Heights are coordinates along the program's directions from the machine's zero; positions of an axis, if the
directions are along the axes.
"""

from __future__ import annotations

from collections.abc import Mapping

from mcserver.gcode.profiles.directions import along, back, coupled
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_units import shown_position
from mcserver.gcode.semantics.rapids import rapid_group
from mcserver.gcode.semantics.travel_limits import ROUNDING
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.motion.canonical import (
    Canonical,
    DwellGroup,
    FeedGroup,
    MotionLine,
    SpeedGroup,
    SurfaceSpeed,
)
from mcserver.motion.geometry.curves import LineCurve


class CycleMotion:
    """Builds the consecutive motion lines of one block.

    Args:
        speed: of feed moves [m/s]. exact_stop: each feed move ends at rest; else as for a G01 of the block.
    """

    def __init__(self, block: BlockState, speed: float = 0.0, *, exact_stop: bool = True) -> None:
        self._block = block
        self._speed = speed
        self._exact_stop = exact_stop or block.modal.exact_stop
        self.lines: list[Canonical] = []

    def at(self, axis: int) -> float:
        """Return the tool's present height along an axis [m]."""
        return height(self._block, axis, self._block.commanded.positions)

    def ends(self, axis: int, level: float) -> dict[int, float]:
        """Return the ends of the axes along one direction at a height [m]; all else stays."""
        directions, positions = self._block.frame.directions, self._block.commanded.positions
        if coupled(directions, frozenset((axis,))) == {axis}:
            return {axis: along(directions, {axis: level})[axis]}
        way = along(directions, {axis: level - self.at(axis)})
        return {each: positions[each] + way[each] for each in sorted(way)}

    def rapid(self, targets: Mapping[int, float]) -> None:
        """Add a rapid of axes that are not at their targets yet."""
        positions = self._block.commanded.positions
        far = {axis: end for axis, end in targets.items() if abs(end - positions[axis]) > ROUNDING}
        if not far:
            return
        starts = {axis: self._block.commanded.start(axis) for axis in far}
        # along a tilted hole no axis may leave the line
        straight = self._block.frame.directions is not None
        group = rapid_group(self._block.setup, self._block.modal, starts, far, straight=straight)
        self.lines.append(MotionLine(self._block.parsed.number, (group,), exact_stop=True))
        for axis, end in far.items():
            self._block.end_at(axis, end)

    def feed(self, axis: int, level: float, speed: float | None = None) -> None:
        """Add a move along one direction at F, or at its own speed [m/s]."""
        length = abs(level - self.at(axis))
        if length <= ROUNDING:
            return
        ends = self.ends(axis, level)
        starts = tuple(self._block.commanded.positions[each] for each in ends)
        curve = LineCurve(tuple(ends), starts, tuple(ends.values()), length)
        speed = speed or self._speed
        group = FeedGroup((curve,), requested=length / speed, speed=speed)
        self.lines.append(
            MotionLine(
                self._block.parsed.number,
                (group,),
                exact_stop=self._exact_stop,
                tolerance=0.0 if self._exact_stop else self._block.path_tolerance,
                feed_length=length,
            )
        )
        for each, end in ends.items():
            self._block.end_at(each, end)

    def turn(self, axis: int, speed: float, seconds: float, surface: SurfaceSpeed | None = None) -> None:
        """Turn the spindle [rad/s], and wait for its ramp."""
        group = SpeedGroup((axis,), (speed,), surface)
        self.lines.append(MotionLine(self._block.parsed.number, (group,)))
        self._block.commanded.invalidate((axis,))
        self.dwell(seconds)

    def dwell(self, seconds: float) -> None:
        """Add a dwell at the bottom."""
        if seconds > 0.0:
            self.lines.append(MotionLine(self._block.parsed.number, (DwellGroup(seconds),)))


def height(block: BlockState, axis: int, place: Mapping[int, float]) -> float:
    """Return a place's coordinate along a direction of the program, from the machine's zero [m]."""
    return back(block.frame.directions, place).get(axis, 0.0)


def check_travel(
    block: BlockState, axis: int, end: float, source: ProfileWord | Action, what: str = "the line"
) -> bool:
    """Report a position beyond the travel of an axis (MC201); return whether it is."""
    limits = block.setup.axes[axis]
    if limits.min_position - ROUNDING <= end <= limits.max_position + ROUNDING:
        return False
    shown = shown_position(end, limits.type, block.modal.inch)
    block.faults.add(
        "MC201",
        f"{what} takes axis {axis} to {shown}, beyond its travel",
        source.span,
        "stay within the axis's travel",
        axis=axis,
    )
    return True
