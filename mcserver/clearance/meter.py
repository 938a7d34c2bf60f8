"""The least distances of a run's bodies, by conservative advancement over its setpoints.

Bodies that are d apart cannot be nearer than d - m once the axes have moved by as much as can change their
distance by m (`Scene.levers`). So a distance is computed only where the motion since the last one has used up
what the pair had to spare, and between two cycles it is bounded by the motion between them: no contact is
passed over, however quick the motion is.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.clearance.distances import contact_mm, too_near
from mcserver.clearance.mounted import NOT_KNOWN, Exchange, Mounted
from mcserver.clearance.scene import Pair, Scene
from mcserver.clearance.slow_zones import SLOWER, SlowZones
from mcserver.errors import ConfigurationError, Diagnostic
from mcserver.machine.clearance_section import GivenBody
from mcserver.machine.machine_file import Machine
from mcserver.units import MM

Array = NDArray[np.float64]

# Least distances are found to this, or to a share of themselves where that is more [m].
RESOLUTION = 5e-5
SHARE = 0.05
# Pairs that stay this much more apart than the margin are not told [m].
FAR = 0.05
# Between two cycles motion is halved until it is shorter than this [m]; a contact below it is none.
FINEST = 1e-5
# Motion below this is none [m].
LEAST = 1e-12
# Cycles that are looked at together.
BLOCK = 1024
# Pairs in the report.
MOST_SHOWN = 20


@dataclass
class Nearest:
    """The least distance of a pair [m] with its time [s] and line; ``contact``: it is below the margin;
    ``certain``: its tools are known to be mounted.
    """

    distance: float
    time: float
    line: int
    contact: bool = False
    certain: bool = True

    def distance_mm(self, digits: int) -> float:
        """Return the distance [mm]; of a contact rounded down, so that none reads as the margin itself."""
        return contact_mm(self.distance, digits) if self.contact else round(self.distance / MM, digits)


class ClearanceMeter:
    """Looks at every cycle of a simulated run.

    Args:
        machine: has a clearance. start: positions of its axes before the first cycle, shape (K,) [SI].
        mounted: the tool table and work systems; None: those of the machine file.
        role: whose run it is; None: whoever's, so that all zones count.

    Zones that an input switches count as on; what enters them is a warning, for a server holds it there.

    Raises:
        ConfigurationError: as `Scene`.
    """

    def __init__(
        self,
        machine: Machine,
        start: Array,
        mounted: Mounted | None = None,
        role: str | None = None,
    ) -> None:
        assert machine.clearance is not None
        self._margin = machine.clearance.margin
        zones = machine.clearance.zones
        self._assumed_on = [each.name for each in zones if each.switch is not None and each.binds(role)]
        self._scene = Scene(machine)
        self._role = role
        self._binding = self._scene.binding(role)
        self._slow = SlowZones(self._scene, machine.cycle_s, self._binding)
        # by names of the body and the slow zone the first time and line at which it was too fast
        self._too_fast: dict[tuple[str, str], tuple[float, Diagnostic]] = {}
        self._last: Array = np.array(start, dtype=np.float64)
        # the bodies are there; None: they may be elsewhere
        self._placed: Array | None = None
        self._block: list[tuple[Array, NDArray[np.int64], Array]] = []
        self._waiting = 0
        self._time = 0.0
        # of each pair the distance computed last, and the motion since then
        self._distance: Array = np.zeros(len(self._scene.pairs))
        self._spent: Array = np.zeros(len(self._scene.pairs))
        self._nearest = [Nearest(math.inf, 0.0, 0) for _ in self._scene.pairs]
        if mounted is not None:
            self._scene.mount(mounted)
        self._begin(range(len(self._nearest)), 0)

    def _begin(self, pairs: Iterable[int], line: int) -> None:
        """Compute distances of pairs where the axes stand, behind a line."""
        self._scene.place(self._last)
        for pair in pairs:
            self._spent[pair] = 0.0
            counts = self._scene.active[pair] and self._binding[pair]
            if not counts or self._scene.speeds[pair] < math.inf:
                self._distance[pair] = math.inf
                continue
            at = self._distance[pair] = self._scene.distance(pair)
            contact = bool(at < self._margin)
            # a tool of which it is not known that it is mounted counts once something moves
            known = self._scene.certain(pair) or not contact
            if known and at < min(self._nearest[pair].distance, self._margin + FAR):
                self._nearest[pair] = Nearest(float(at), self._time, line, contact)

    def exchange(self, exchange: Exchange) -> None:
        """Take bodies of other tools, or that are brought, from the newest cycle on."""
        self._look()
        known = len(self._scene.pairs)
        self._scene.mount(self._scene.mounted.behind(exchange))
        changed = np.flatnonzero(self._scene.exchanged).tolist()
        if exchange.bodies:
            changed = self._take_brought(known)
        self._begin([pair for pair in changed if not self._nearest[pair].contact], exchange.line)

    @property
    def brought(self) -> tuple[GivenBody, ...]:
        """Bodies that the program has brought so far."""
        return self._scene.mounted.given.get("", ())

    def _take_brought(self, known: int) -> list[int]:
        """Return the pairs that are new; ``known``: how many there were."""
        scene = self._scene
        new = range(known, len(scene.pairs))
        self._binding = scene.binding(self._role)
        self._slow.count(np.array([each.names not in self._too_fast for each in scene.pairs]) & self._binding)
        self._distance = np.append(self._distance, np.zeros(len(new)))
        self._spent = np.append(self._spent, np.zeros(len(new)))
        self._nearest += [Nearest(math.inf, 0.0, 0) for _ in new]
        return list(new)

    def take(self, times: Array, lines: NDArray[np.int64], setpoint: Array) -> None:
        """Take cycles in order: times (n,) [s], lines (n,), setpoints (n, K) [SI]."""
        self._block.append((times.copy(), lines.copy(), setpoint.copy()))
        self._waiting += len(times)
        if self._waiting >= BLOCK:
            self._look()

    def contacts(self) -> list[Diagnostic]:
        """Return the first contact of each pair of names, in the order of their times."""
        self._look()
        first: dict[tuple[str, str], tuple[Nearest, Pair]] = {}
        for pair, nearest in self._by_time():
            if nearest.contact:
                first.setdefault(pair.names, (nearest, pair))
        found = [(nearest.time, self._diagnostic(pair, nearest)) for nearest, pair in first.values()]
        found += self._too_fast.values()
        return [diagnostic for _, diagnostic in sorted(found, key=lambda each: each[0])]

    def report(self) -> dict[str, Any]:
        """Return ``margin_mm``, ``least_mm`` (None: all stayed far apart), ``pairs``, the nearest first, and
        ``assumed_on``, the zones that an input switches.

        Of a pair that comes nearer than the margin it is the distance of the first contact: what the run
        would do behind it is not measured.
        """
        self._look()
        least: dict[tuple[str, str], Nearest] = {}
        for pair, nearest in sorted(self._by_time(), key=lambda each: each[1].distance):
            if nearest.distance < math.inf:
                least.setdefault(pair.names, nearest)
        rows = [
            {
                "bodies": list(names),
                "least_mm": nearest.distance_mm(3),
                "time_s": round(nearest.time, 6),
                "line": nearest.line,
            }
            for names, nearest in least.items()
        ]
        return {
            "margin_mm": self._margin / MM,
            "least_mm": rows[0]["least_mm"] if rows else None,
            "pairs": rows[:MOST_SHOWN],
            "assumed_on": self._assumed_on,
        }

    def _by_time(self) -> list[tuple[Pair, Nearest]]:
        found = zip(self._scene.pairs, self._nearest, strict=True)
        return sorted(found, key=lambda each: each[1].time)

    def _diagnostic(self, pair: Pair, nearest: Nearest) -> Diagnostic:
        one, other = pair.names
        where = f"at {nearest.time:.3f} s" if nearest.line else "before the program begins"
        if pair.zone:
            message, hint = (
                f"{pair.crosses()} {where}",
                "take another way, or change the [[zone]]",
            )
        else:
            message, hint = (
                f"{one!r} comes too near to {other!r} {where}: {too_near(nearest.distance, self._margin)}",
                "take another way; bodies that may touch are named in allowed of [clearance]",
            )
        if not nearest.certain:
            hint = NOT_KNOWN
        fault = Diagnostic(
            code="MC321" if pair.zone else "MC320",
            message=message,
            line=nearest.line,
            column=1,
            end_column=2,
            hint=hint,
        )
        return fault if pair.switch < 0 else held_there(fault)

    # ------------------------------------------------------------------ the motion

    def _look(self) -> None:
        if not self._block:
            return
        times, lines, rows = (np.concatenate(each) for each in zip(*self._block, strict=True))
        self._block, self._waiting = [], 0
        self._look_at_speeds(times, lines, np.vstack([self._last, rows]))
        # by pair in rows, which are searched
        moved = self._scene.levers.T @ np.abs(np.diff(rows, axis=0, prepend=self._last[None])).T
        # motion of each pair up to each cycle; what of it lies before its distance was computed last
        total = self._spent[:, None] + moved.cumsum(axis=1)
        base = np.zeros(len(self._nearest))
        due = [
            (int(total[pair].searchsorted(self._spare(pair))), pair)
            for pair in range(len(self._nearest))
            if total[pair, -1] >= self._spare(pair) and not self._nearest[pair].contact
        ]
        heapq.heapify(due)
        here, self._placed = -1, None
        while due and due[0][0] < len(rows):
            at, pair = due[0]
            if at != here:
                here, before, after = at, self._last if at == 0 else rows[at - 1], rows[at]
            low = float(self._distance[pair] + base[pair] - total[pair, at] + moved[pair, at])
            end = self._distance_at(pair, after)
            least = self._between(pair, before, after, low, end, float(moved[pair, at]))
            if least < min(self._nearest[pair].distance, self._margin + FAR):
                contact = least < self._margin
                certain = self._scene.certain(pair)
                self._nearest[pair] = Nearest(least, float(times[at]), int(lines[at]), contact, certain)
            self._distance[pair], base[pair] = end, total[pair, at]
            if self._nearest[pair].contact:
                heapq.heappop(due)
            else:
                later = int(total[pair, at + 1 :].searchsorted(base[pair] + self._spare(pair)))
                heapq.heapreplace(due, (at + 1 + later, pair))
        self._spent = total[:, -1] - base
        self._last, self._time = rows[-1], float(times[-1])

    def _look_at_speeds(self, times: Array, lines: NDArray[np.int64], way: Array) -> None:
        """Note where bodies are too fast in slow zones; ``way``: from the cycle before on."""
        while self._slow.pairs and (found := self._slow.first(way)) is not None:
            names = self._scene.pairs[found.pair].names
            time, line = float(times[found.step]), int(lines[found.step])
            message = f"{found.message(names)} at {time:.3f} s"
            fault = Diagnostic("MC322", message, line=line, column=1, end_column=2, hint=SLOWER)
            if self._scene.pairs[found.pair].switch >= 0:
                fault = held_there(fault)
            self._too_fast[names] = time, fault
            # said once
            self._slow.pairs.remove(found.pair)

    def _spare(self, pair: int) -> float:
        """Return the motion after which a pair may be a contact, or nearer than it ever was [m]."""
        nearer = min(self._nearest[pair].distance, self._margin + FAR)
        spare = float(self._distance[pair]) - max(self._margin, nearer - max(RESOLUTION, SHARE * nearer))
        return max(spare, LEAST)

    def _between(self, pair: int, before: Array, after: Array, low: float, end: float, moved: float) -> float:
        """Return the least distance found on the straight way between two places.

        Args:
            low: bound of the distance at ``before`` from below. end: the distance at ``after``.
            moved: the most that the way changes it.
        """
        if end < self._margin or moved < FINEST or 0.5 * (low + end - moved) >= self._margin:
            return end
        start = self._distance_at(pair, before)
        if 0.5 * (start + end - moved) >= self._margin:
            return end
        middle = 0.5 * (before + after)
        halfway = self._distance_at(pair, middle)
        first = self._between(pair, before, middle, start, halfway, 0.5 * moved)
        return min(first, self._between(pair, middle, after, halfway, end, 0.5 * moved))

    def _distance_at(self, pair: int, positions: Array) -> float:
        if positions is not self._placed:
            self._scene.place(positions)
            self._placed = positions
        return self._scene.distance(pair)


def held_there(fault: Diagnostic) -> Diagnostic:
    """Return what a contact with a zone is that an input switches: a hold, where it is on."""
    return msgspec.structs.replace(
        fault,
        severity="warning",
        message=f"{fault.message}, where its input has it on",
        hint="the program is held there until the input has it off, and goes on when it is resumed",
    )


def find_clearance_faults(machine: Machine) -> list[Diagnostic]:
    """Find what is wrong with a machine's bodies; what touches where its axes start is a warning."""
    if machine.clearance is None:
        return []
    try:
        meter = ClearanceMeter(machine, np.array([axis.initial_position for axis in machine.axes]))
    except ConfigurationError as error:
        return [Diagnostic(error.code, error.message, hint=error.hint)]
    return [msgspec.structs.replace(each, severity="warning") for each in meter.contacts()]
