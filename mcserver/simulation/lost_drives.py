"""Where axes come when a drive is lost: it runs on by itself while the program's other axes stop.

The lost axis is anywhere between where it was and where its speed brings it as its drive says: by the
friction of the axis or by its brake, and in speed mode for the time that the drive goes on without commands.
The others are anywhere on their path from that cycle on, as far as the executor's stop may bring them once it
has noticed; axes that move by themselves are anywhere between here and their own stops. All of one is judged
with all of the other, for each axis in each cycle: none is missed, and one may be told that would not come.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.clearance.distances import contact_mm, too_near
from mcserver.clearance.meter import MOST_SHOWN
from mcserver.clearance.mounted import Exchange, Mounted
from mcserver.clearance.scene import Scene
from mcserver.clearance.sweep import Contact, Sweep
from mcserver.drives.servo_model import ServoModel
from mcserver.errors import Diagnostic
from mcserver.executor.stopping import SPARE_ROWS, StopTimes, stopping_rows
from mcserver.executor.supervision import patience_cycles
from mcserver.machine.axis import Axis
from mcserver.machine.drive import CanDrive
from mcserver.machine.machine_file import Machine
from mcserver.units import MM

Array = NDArray[np.float64]

# Cycles in which a drive may be lost that are judged together at first, and those that are taken in one go.
BLOCK = 64
TAKEN = 512
# Distances are found to about this [m], or to a share of themselves where that is more; sets that change them
# by less are halved no more.
RESOLUTION = 1e-3
SHARE = 0.1
# Pairs that stay this much more apart than the margin are not told [m].
FAR = 0.02
# Sets that are halved for one question.
MOST_HALVED = 500
# Rows of the others' path are joined straight, so many in one; what they are beside that counts.
STRIDE = 8
# A stop in its own time takes up to this many times what one from rest of acceleration takes: an acceleration
# that has begun ends first.
OWN_STOP = 2.5
# What a drive says is so old at the most, on top of how often it speaks [cycles].
OLDEST = 4
# An axis that moves by less stands [m or rad].
STANDS = 1e-9


class Lost(NamedTuple):
    """The nearest that a pair comes when one axis's drive is lost.

    Attributes:
        distance: [m]. time, line: when it is lost. shown: it was computed; else nothing shows them clear.
    """

    distance: float
    time: float
    line: int
    shown: bool

    def distance_mm(self, margin: float) -> float:
        """Return the distance [mm], not negative; below the margin [m] rounded down."""
        return contact_mm(self.distance, 1) if self.distance < margin else round(self.distance / MM, 1)


class RunOn(NamedTuple):
    """How far an axis may run on: by this, to there [SI], lost at a time [s] and line."""

    by: float
    to: float
    time: float
    line: int


class LostDrives:
    """Judges every cycle of a simulated run for the loss of any one drive.

    Args:
        machine: has a clearance. start: positions of its axes before the first cycle, shape (K,) [SI].
        alone: columns that move by themselves now, a bit each, and those among them that hold a speed.
        mounted: the tool table and work systems. role: whose run it is; None: whoever's.
    """

    def __init__(
        self,
        machine: Machine,
        start: Array,
        alone: Callable[[], tuple[int, int]],
        mounted: Mounted,
        role: str | None,
    ) -> None:
        assert machine.clearance is not None
        self._machine = machine
        self._margin = machine.clearance.margin
        scene = Scene(machine)
        scene.mount(mounted)
        self._sweep = Sweep(scene, self._margin, RESOLUTION, SHARE, MOST_HALVED)
        self._alone = alone
        self._alone_before = (0, 0)
        self._stops = StopTimes(machine)
        model = ServoModel(machine.axes, machine.cycle_s)
        brake = np.array([axis.drive.brake for axis in machine.axes])
        self._slowing: Array = np.where(brake, np.maximum(model.braking, model.friction), model.friction)
        self._holding = np.array([_holding_s(axis) for axis in machine.axes])
        self._low = np.array([axis.min_position - axis.in_position for axis in machine.axes])
        self._high = np.array([axis.max_position + axis.in_position for axis in machine.axes])
        shaping = machine.shaping
        # of a cycle and of a stop, to both sides of the path each
        self._beside = np.zeros(len(start)) if shaping is None else 2.0 * np.array(shaping.deviations)
        self._unnoticed = _unnoticed_cycles(machine) + (0 if shaping is None else math.ceil(shaping.length))
        # cycles that are not judged yet, behind the one before them
        self._times = np.zeros(1)
        self._lines = np.zeros(1, np.int64)
        self._rows: Array = np.array(start, dtype=np.float64)[None]
        self._own: NDArray[np.int64] = np.zeros((1, 2), np.int64)
        self._taken: list[tuple[Array, NDArray[np.int64], Array, NDArray[np.int64]]] = []
        self._waiting = 0
        # by column, of each pair: what it has to come nearer than to be told [m]
        self._role = role
        self._levels = self._told()
        self._nearest: dict[tuple[int, int], Lost] = {}
        self._furthest: dict[int, RunOn] = {}
        self._beyond: dict[int, RunOn] = {}
        # of the cycles that are being judged: from where to where each axis may be if its drive is lost
        self._least = self._most = self._rows

    def _told(self) -> Array:
        """Return what each pair has to come nearer than to be told, shape (K, P) [m]."""
        scene = self._sweep.scene
        counted = scene.binding(self._role) & np.isinf(scene.speeds)
        levels = np.where(counted, self._margin + FAR, -np.inf)
        return levels[None].repeat(len(self._machine.axes), axis=0)

    def take(self, times: Array, lines: NDArray[np.int64], setpoint: Array) -> None:
        """Take cycles in order: times [s] and lines (n,), setpoints (n, K) [SI]."""
        now = self._alone()
        own = np.array([one | other for one, other in zip(now, self._alone_before, strict=True)])
        self._alone_before = now
        self._taken.append(
            (times.copy(), lines.copy(), setpoint.copy(), own[None].repeat(len(times), axis=0))
        )
        self._waiting += len(times)
        if self._waiting >= TAKEN:
            self._look()

    def exchange(self, exchange: Exchange) -> None:
        """Take bodies that are others from the newest cycle on, in which nothing moves."""
        self.finish()
        scene = self._sweep.scene
        known = len(scene.pairs)
        self._sweep.mount(scene.mounted.behind(exchange))
        self._levels = np.concatenate((self._levels, self._told()[:, known:]), axis=1)

    def finish(self) -> None:
        """Judge what was taken up to a rest."""
        self._look(final=True)

    def findings(self) -> list[Diagnostic]:
        """Return warnings, in the order of axes: of each the nearest contact, and how far it leaves its
        travel.
        """
        found = []
        for column, axis in enumerate(self._machine.axes):
            near = [(lost, pair) for (each, pair), lost in self._nearest.items() if each == column]
            touching = [each for each in near if each[0].distance < self._margin]
            if touching:
                found.append(self._contact(axis, *min(touching, key=lambda each: each[0].distance)))
            if column in self._beyond:
                found.append(_leaves(axis, self._beyond[column]))
        return found

    def report(self) -> dict[str, Any]:
        """Return ``clear``: nothing touches and no travel is left; ``pairs``: by axis lost the nearest, as in
        the report of `ClearanceMeter`; ``runs_on``: the longest way of each axis.
        """
        axes, pairs = self._machine.axes, self._sweep.scene.pairs
        nearest: dict[tuple[int, tuple[str, str]], Lost] = {}
        for (column, pair), lost in sorted(self._nearest.items(), key=lambda each: each[1].distance):
            nearest.setdefault((column, pairs[pair].names), lost)
        return {
            "clear": not self.findings(),
            "pairs": [
                {
                    "axis": axes[column].index,
                    "bodies": list(names),
                    "least_mm": lost.distance_mm(self._margin),
                    "time_s": round(lost.time, 6),
                    "line": lost.line,
                }
                for (column, names), lost in islice(nearest.items(), MOST_SHOWN)
            ],
            "runs_on": [
                {
                    "axis": axes[column].index,
                    "by": round(run.by / axes[column].type.si_per_unit, 3),
                    "unit": axes[column].type.unit,
                    "time_s": round(run.time, 6),
                    "line": run.line,
                }
                for column, run in sorted(self._furthest.items())
            ],
        }

    # ------------------------------------------------------------------ the motion

    def _look(self, *, final: bool = False) -> None:
        """Judge the cycles behind which enough is known; ``final``: all."""
        if self._taken:
            times, lines, rows, own = (np.concatenate(each) for each in zip(*self._taken, strict=True))
            self._times, self._lines = np.append(self._times, times), np.append(self._lines, lines)
            self._rows, self._own = np.vstack([self._rows, rows]), np.vstack([self._own, own])
            self._taken, self._waiting = [], 0
        speeds = np.diff(self._rows, axis=0, append=self._rows[-1:]) / self._machine.cycle_s
        stops = self._stops.of(speeds)
        self._note_run_on(speeds)
        first = 1
        while first < len(self._rows):
            last = min(first + BLOCK, len(self._rows))
            ahead = self._ahead(stops, first, last, 1.0)
            if not final and last + self._unnoticed + math.ceil(ahead * OWN_STOP) >= len(self._rows):
                break
            for column in range(self._rows.shape[1]):
                self._search(column, first, last, stops)
            first = last
        keep = slice(first - 1, None)
        self._times, self._lines = self._times[keep], self._lines[keep]
        self._rows, self._own = self._rows[keep], self._own[keep]

    def _ahead(self, stops: Array, first: int, last: int, share: float) -> int:
        """Return so many rows behind ``last`` the others may come to, where they are to stop from then on."""
        rows = 0
        while True:
            found = stops[first - 1 : last + self._unnoticed + rows].max()
            more = math.ceil(share * stopping_rows(found)) + SPARE_ROWS
            if more <= rows:
                return rows
            rows = more

    def _note_run_on(self, speeds: Array) -> None:
        """Note from where to where each axis may be if its drive is lost in a cycle."""
        bits = np.arange(self._rows.shape[1])
        holding = np.where(self._own[:, 1:] >> bits & 1, self._holding, 0.0)
        before = np.vstack([speeds[:1], speeds[:-1]])
        ways = [each * holding + each * np.abs(each) / (2.0 * self._slowing) for each in (before, speeds)]
        low, high = (np.minimum(*ways), 0.0), (np.maximum(*ways), 0.0)
        self._least, self._most = self._rows + np.minimum(*low), self._rows + np.maximum(*high)
        for column in range(len(bits)):
            by = np.maximum(
                self._most[:, column] - self._rows[:, column], self._rows[:, column] - self._least[:, column]
            )
            at = int(by.argmax())
            if by[at] > max(STANDS, self._furthest.get(column, RunOn(0.0, 0.0, 0.0, 0)).by):
                self._furthest[column] = self._run_on(column, at)
            beyond = np.maximum(
                self._most[:, column] - self._high[column], self._low[column] - self._least[:, column]
            )
            at = int(beyond.argmax())
            known = self._beyond.get(column)
            if beyond[at] > 0.0 and (known is None or self._excess(column, known.to) < beyond[at]):
                self._beyond[column] = self._run_on(column, at)

    def _excess(self, column: int, place: float) -> float:
        return max(place - float(self._high[column]), float(self._low[column]) - place)

    def _run_on(self, column: int, at: int) -> RunOn:
        here = float(self._rows[at, column])
        to = max(
            float(self._most[at, column]), float(self._least[at, column]), key=lambda each: abs(each - here)
        )
        return RunOn(abs(to - here), to, float(self._times[at]), int(self._lines[at]))

    # ------------------------------------------------------------------ contacts

    def _search(self, column: int, first: int, last: int, stops: Array) -> None:
        """Find what comes near where a column's drive is lost in the cycles from first to before last."""
        while (contact := self._first_contact(column, first, last, stops)) is not None:
            if not contact.shown and self._levels[column, contact.pair] > self._margin:
                # how near it comes takes too long: whether it touches
                self._levels[column, contact.pair] = self._margin
                self._nearest.pop((column, contact.pair), None)
                continue
            lever = float(self._sweep.scene.levers[column, contact.pair])
            moved = float(np.ptp(self._rows[first - 1 : last, column])) * lever
            if last - first > 1 and moved > RESOLUTION:
                middle = (first + last) // 2
                self._search(column, first, middle, stops)
                self._search(column, middle, last, stops)
                return
            distance = contact.distance if contact.shown else 0.0
            # before the program's first cycle it has no line
            line = next(filter(None, self._lines[first:].tolist()), 0)
            self._nearest[column, contact.pair] = Lost(
                distance, float(self._times[first]), line, contact.shown
            )
            # one that touches comes no nearer; what is asked for lies above the level by a step
            nearer = min((1.0 - 2.0 * SHARE) * distance, distance - 2.0 * RESOLUTION)
            nearer = -np.inf if distance <= 0.0 else min(nearer, self._levels[column, contact.pair])
            self._levels[column, contact.pair] = nearer

    def _first_contact(self, column: int, first: int, last: int, stops: Array) -> Contact | None:
        lost = slice(first - 1, last)
        low, high = float(self._least[lost, column].min()), float(self._most[lost, column].max())
        end = last + self._unnoticed + self._ahead(stops, first, last, 1.0)
        own_end = last + self._unnoticed + self._ahead(stops, first, last, OWN_STOP)
        way = self._rows[first - 1 : end].copy()
        if high - low < STANDS and float(np.ptp(way[:, column])) < STANDS:
            # the others stop where they are judged anyway
            return None
        half = self._beside.copy()
        own = int(np.bitwise_or.reduce(self._own[first - 1 : own_end, 0]))
        for each in range(way.shape[1]):
            if each == column:
                span = (low, high)
            elif own >> each & 1:
                part = self._rows[first - 1 : own_end, each]
                span = (float(part.min()), float(part.max()))
            else:
                continue
            way[:, each] = 0.5 * (span[0] + span[1])
            half[each] += 0.5 * (span[1] - span[0])
        kept = np.unique(np.append(np.arange(0, len(way), STRIDE), len(way) - 1))
        places = np.arange(len(way))
        for each in range(way.shape[1]):
            straight = np.interp(places, kept, way[kept, each])
            half[each] += float(np.abs(way[:, each] - straight).max())
        moved = np.zeros(way.shape[1], np.bool_)
        moved[column] = True
        levels = self._levels[column]
        # sets that are halved no more lie above the level
        floors = np.maximum(levels + RESOLUTION, levels / (1.0 - SHARE))
        floors = np.where(self._sweep.scene.active, floors, -np.inf)
        return self._sweep.first_contact(way[kept], half, moved, floors)

    def _contact(self, axis: Axis, lost: Lost, pair: int) -> Diagnostic:
        one, other = self._sweep.scene.pairs[pair].names
        come = f"may come too near to {other!r}: {too_near(lost.distance, self._margin, 1)}"
        if not lost.shown:
            come = f"cannot be shown to stay clear of {other!r}"
        return _warning(
            "MC325",
            f"if the drive of axis {axis.index} is lost at {lost.time:.3f} s, {one!r} {come}",
            lost.line,
            "keep further away or go slower there, or give the drive a brake",
        )


def _leaves(axis: Axis, run: RunOn) -> Diagnostic:
    unit = axis.type
    return _warning(
        "MC326",
        f"if the drive of axis {axis.index} is lost at {run.time:.3f} s, it may run on by "
        f"{run.by / unit.si_per_unit:.1f} to {run.to / unit.si_per_unit:.1f} {unit.unit}, beyond its travel",
        run.line,
        "go slower towards the end of the travel, or give the drive a brake",
    )


def _warning(code: str, message: str, line: int, hint: str) -> Diagnostic:
    return Diagnostic(
        code=code, message=message, line=line, column=1, end_column=2, hint=hint, severity="warning"
    )


def _unnoticed_cycles(machine: Machine) -> int:
    """Return the most cycles from a drive's loss to the program's stop."""
    buses = (each.silence_cycles for each in machine.buses)
    drives = (axis.drive for axis in machine.axes)
    seldom = (each.answer_cycles(machine.cycle_s) - 1 for each in drives if isinstance(each, CanDrive))
    return max((patience_cycles(machine), *buses)) + max((0, *seldom)) + OLDEST


def _holding_s(axis: Axis) -> float:
    """Return how long a drive in speed mode may go on without commands [s]."""
    drive = axis.drive
    return drive.command_timeout_ms * 1e-3 if isinstance(drive, CanDrive) else drive.heartbeat_timeout_s
