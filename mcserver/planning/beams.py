"""Power of lasers from line to line: off in rapids, in proportion to the speed under M4 (D-77)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import msgspec

from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup, MotionLine, OutputSetting
from mcserver.units import AxisType


class Power(msgspec.Struct, frozen=True):
    """Value of an output from a moment on.

    Attributes:
        axes: mask of the columns whose speed together a laser's value is for. speed: that speed [m/s or
            rad/s]; 0: any.
    """

    value: float
    axes: int = 0
    speed: float = 0.0


class Beams:
    """Lasers of one program, as it has set them."""

    def __init__(self, machine: Machine) -> None:
        self._lasers = frozenset(at for at, each in enumerate(machine.outputs) if each.laser)
        self._bits = {axis.index: 1 << column for column, axis in enumerate(machine.axes)}
        self._linear = frozenset(axis.index for axis in machine.axes if axis.type is AxisType.LINEAR)
        self._set: dict[int, OutputSetting] = {}
        self._given: dict[int, Power] = {}

    @property
    def scaled(self) -> bool:
        """Whether a laser is on whose power goes with the speed: it needs that of every line."""
        return any(each.scaled and each.value != 0.0 for each in self._set.values())

    def take(self, settings: Iterable[OutputSetting]) -> dict[int, Power]:
        """Follow what the program sets at rest or with its next motion; return the values by column."""
        found = {each.column: Power(each.value) for each in settings}
        for each in settings:
            if each.column in self._lasers:
                self._set[each.column] = each
                self._given[each.column] = found[each.column]
        return found

    def changes_with(self, line: object) -> Mapping[int, Power]:
        """Return the lasers whose power changes as a motion begins, besides what `take` has returned."""
        found: dict[int, Power] = {}
        for column, each in self._set.items():
            power = self._power(each, line)
            if power != self._given[column]:
                found[column] = self._given[column] = power
        return found

    def _power(self, setting: OutputSetting, line: object) -> Power:
        constant = Power(setting.value)
        if setting.value == 0.0 or not isinstance(line, MotionLine):
            return constant
        feeds = [each for each in line.groups if isinstance(each, FeedGroup)]
        if not feeds:
            # what moves by itself is on no path: the executor leaves it dark
            return constant
        group = feeds[0]
        if math.isinf(group.requested):
            return Power(0.0)
        if not setting.scaled:
            return constant
        curve = group.curves[group.reference]
        speed = group.speed
        if speed is None:
            speed = curve.length / group.duration if group.duration else 0.0
        axes = frozenset(curve.axes)
        if axes & self._linear:
            # a corner is rounded by axes of the next line, too; another comma group is another path
            axes = self._linear.difference(*(each.axes for each in feeds[1:]))
        return Power(setting.value, sum(self._bits[axis] for axis in axes), speed)
