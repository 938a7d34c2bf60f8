"""Power of lasers from line to line: off in rapids, in proportion to the speed under M4 (D-77)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import msgspec
import numpy as np

from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import FeedGroup, MotionLine, OutputSetting, PathBatch
from mcserver.units import AxisType


class Power(msgspec.Struct, frozen=True):
    """Value of an output from some time on.

    Attributes:
        axes: mask of the columns whose path speed scales a laser's value. speed: path speed at which the
            output has the value [m/s or rad/s]; 0: the value is not scaled.
    """

    value: float
    axes: int = 0
    speed: float = 0.0


class _Path(NamedTuple):
    """Path of a line that a laser follows: `Power.axes`, and the programmed speed; inf without one."""

    axes: int
    speed: float


class Beams:
    """State of the lasers of one program."""

    def __init__(self, machine: Machine) -> None:
        self._lasers = frozenset(at for at, each in enumerate(machine.outputs) if each.laser)
        self._bits = {axis.index: 1 << column for column, axis in enumerate(machine.axes)}
        self._linear = frozenset(axis.index for axis in machine.axes if axis.type is AxisType.LINEAR)
        self._set: dict[int, OutputSetting] = {}
        self._given: dict[int, Power] = {}

    def take(self, settings: Iterable[OutputSetting]) -> dict[int, Power]:
        """Note what the program sets at rest or with its next motion; return the values by column."""
        found = {each.column: Power(each.value) for each in settings}
        for each in settings:
            if each.column in self._lasers:
                self._set[each.column] = each
                self._given[each.column] = found[each.column]
        return found

    def changes_with(self, line: MotionLine) -> Mapping[int, Power]:
        """Return the lasers whose power changes as a motion begins, besides what `take` has returned."""
        return self._changes(self._path(line))

    def along(self, batch: PathBatch) -> Iterator[tuple[int, dict[int, Power]]]:
        """Yield the lines of a batch at whose beginning outputs change, with the values by column."""
        outputs = batch.outputs
        scaled = any(each.scaled and each.value != 0.0 for each in self._set.values())
        if outputs is None and not scaled:
            # lasers that were off in a rapid come on again
            changes = self._changes(None)
            if changes:
                yield batch.line, changes
            return
        linear = sum(self._bits[axis] for axis in self._linear)
        axes = [
            linear if self._linear.intersection(frame) else sum(self._bits[axis] for axis in frame)
            for frame in batch.frames
        ]
        speeds = batch.speeds
        if speeds is None:
            speeds = np.divide(
                batch.lengths,
                batch.requested,
                out=np.zeros(len(batch)),
                where=batch.requested > 0.0,
            )
        words = np.full(len(batch), np.nan) if outputs is None else outputs.values
        for line, frame, speed, word in zip(
            batch.lines.tolist(), batch.frame.tolist(), speeds.tolist(), words.tolist(), strict=True
        ):
            taken = {} if outputs is None else self.take(outputs.settings(word))
            changes = {**taken, **self._changes(_Path(axes[frame], speed))}
            if changes:
                yield line, changes

    def _changes(self, path: _Path | None) -> dict[int, Power]:
        found: dict[int, Power] = {}
        for column, each in self._set.items():
            power = _power(each, path)
            if power != self._given[column]:
                found[column] = self._given[column] = power
        return found

    def _path(self, line: MotionLine) -> _Path | None:
        """Return the path of a line; None for motion that the executor makes by itself, with lasers off."""
        feeds = [each for each in line.groups if isinstance(each, FeedGroup)]
        if not feeds:
            return None
        group = feeds[0]
        if math.isinf(group.requested):
            return _Path(0, math.inf)
        curve = group.curves[group.reference]
        speed = group.speed
        if speed is None:
            speed = curve.length / group.duration if group.duration else 0.0
        axes = frozenset(curve.axes)
        if axes & self._linear:
            # blends also move axes of the next line; another comma group is another path
            axes = self._linear.difference(*(each.axes for each in feeds[1:]))
        return _Path(sum(self._bits[axis] for axis in axes), speed)


def _power(setting: OutputSetting, path: _Path | None) -> Power:
    if setting.value == 0.0 or path is None:
        return Power(setting.value)
    if math.isinf(path.speed):
        return Power(0.0)
    return Power(setting.value, path.axes, path.speed) if setting.scaled else Power(setting.value)
