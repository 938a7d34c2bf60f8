"""Check a program's motion for contacts with bodies and zones before it is handed to the executor.

Rows are checked at their positions. Motion that the executor makes by itself (rapids, probing, homing,
speeds, torques) is checked at all positions that its axes may take, at any timing by holds, overrides and
stops. The axes of other programs are taken to be wherever they stand, or wherever motion that has been handed
over may still bring them.

Motion that enters a zone that an input switches is handed over. The executor is told which of these zones lie
ahead, and holds the program in the cycle in which one is switched on. A thread into such a zone is refused,
since its passes cannot be held.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.clearance.meter import held_there
from mcserver.clearance.mounted import Exchange, Mounted
from mcserver.clearance.ordered_speeds import slow_zones
from mcserver.clearance.scene import Scene
from mcserver.clearance.slow_zones import ROUNDING, SLOWER, SlowZones, TooFast
from mcserver.clearance.sweep import Contact, Sweep
from mcserver.errors import Diagnostic
from mcserver.executor.entries import Control, ControlKind, EventKind, ExecutorEvent
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shaped_entries import AT_THEIR_PLACE, GOING_ON
from mcserver.machine.clearance_section import GivenBody
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import AxisOperation
from mcserver.motion.pieces import Rows
from mcserver.motion.thread_cam import MOST_SPEED
from mcserver.planning.alone_extents import STRAIGHT, AloneExtents
from mcserver.planning.contact_words import touching
from mcserver.planning.shared_space import Array, Claim, Extent, Mask, SharedSpace, Tenant
from mcserver.planning.switched_zones import SwitchedZones
from mcserver.planning.waiting import Waiting

# Rows that share one claim of space.
NOTED_ROWS = 50
_CAPTURE = list(AxisOperation).index(AxisOperation.CAPTURE)


class ClearanceGuard:
    """Checks what one program hands over, in order.

    Args:
        machine: has a clearance. space: of all programs. tenant: this program. role: as which it runs; None:
            any. by_hand: it is a jog, which may leave a zone that is on.

    Attributes:
        contact: the first contact ahead, before which the program ends; None: it stays clear.
        waiting: for other programs, before bodies that they move.
        held: motion into zones that an input switches, the first of each pair.
    """

    def __init__(
        self,
        machine: Machine,
        sweep: Sweep,
        space: SharedSpace,
        tenant: Tenant,
        *,
        role: str | None = None,
        by_hand: bool = False,
    ) -> None:
        self._machine = machine
        self._sweep = sweep
        self._role = role
        scene = sweep.scene
        self._counted: Mask = np.zeros(len(scene.pairs), np.bool_)
        self._slow = slow_zones(scene, machine, self._counted)
        self._switched: dict[int, SwitchedZones] = {}
        self._by_hand = by_hand
        self.held: dict[int, Diagnostic] = {}
        self._speeds = np.array([axis.max_velocity for axis in machine.axes])
        # how far drives may be from the rows that are handed over
        shaping = machine.shaping
        self._beside: Array = np.zeros(len(machine.axes)) if shaping is None else np.array(shaping.deviations)
        self._space = space
        self._tenant = tenant
        space.enter(tenant)
        self.waiting = Waiting(space, tenant)
        self._floors: Array | None = None
        self._mounted = sweep.scene.mounted
        # bodies that programs have brought; None: pairs have not been counted yet
        self._given: Mapping[str, tuple[GivenBody, ...]] | None = None
        self._count_pairs()
        self._now: Array = np.zeros(len(machine.axes))
        # columns that this program has moved: bounds of where its motion so far ends; equal where that is
        # known exactly
        width = len(machine.axes)
        self._known: Mask = np.zeros(width, np.bool_)
        self._low: Array = np.zeros(width)
        self._high: Array = np.zeros(width)
        # columns that were de-energized after that: they may be pushed away
        self._loose: Mask = self._known.copy()
        self._targets: dict[int, float] = {}
        self._alone = AloneExtents(machine.axes, space.anywhere)
        self._settling: Mask = self._known.copy()
        # number of claims made, and that number at each mark that the executor has not reached yet
        self._claims = 0
        self._marks: deque[int] = deque()
        self.contact: Diagnostic | None = None

    def _count_pairs(self) -> None:
        """Count the pairs of the scene again: another program may have brought bodies, or has ended."""
        scene = self._sweep.scene
        if self._given == scene.mounted.given:
            return
        self._given = scene.mounted.given
        if self._floors is not None:
            self._floors = scene.keep_own(self._floors, -np.inf)
        binding = scene.binding(self._role)
        self._counted = binding & (scene.switches < 0)
        self._slow.count(self._counted)
        for each in self._switched.values():
            each.count(scene, binding)
        for number in sorted(set(scene.switches[binding].tolist()) - {-1, *self._switched}):
            self._switched[number] = SwitchedZones(self._machine, scene, number, binding)

    @property
    def _slowed(self) -> list[SlowZones]:
        return [self._slow, *(each.slow for each in self._switched.values())]

    def admit_rows(self, rows: Rows) -> int:
        """Return how many of some rows may be handed over; after these the program ends or waits."""
        self.waiting.fault = None
        extent = self._extent()
        bits = np.arange(len(self._known), dtype=np.uint64)
        driven = (rows.axes[:, None] >> bits & np.uint64(1)).astype(np.bool_)
        moved: Mask = np.asarray(driven.any(axis=0))
        way = np.vstack([0.5 * (extent.low + extent.high), rows.position])
        # a column that a row does not drive stays where the row before left it
        last = np.where(np.vstack([np.ones_like(moved), driven]), np.arange(len(way))[:, None], 0)
        way = np.take_along_axis(way, np.maximum.accumulate(last, axis=0), axis=0)
        half = np.where(moved, self._beside, 0.5 * (extent.high - extent.low))
        contact = self._judge(way, half, moved)
        count = len(rows) if contact is None else contact.step
        fast = self._slow.first(way[: count + 1])
        if fast is not None:
            count = fast.step
            self._end(self._too_fast(fast, int(rows.line[count])))
        elif contact is not None:
            self._stop_before(contact, int(rows.line[count]), "take another way", waits=True)
        else:
            self.waiting.end()
        ahead = []
        for zones in self._switched.values():
            entered = self._entered(zones, way[: count + 1], half, moved, rows.line)
            if entered is not None:
                ahead.append((entered, zones))
        for first in range(0, count, NOTED_ROWS):
            # with the position before them
            part = way[first : min(first + NOTED_ROWS, count) + 1]
            until = float(rows.first + first + len(part) - 2)
            zones_ahead = [zones for step, zones in ahead if step < first + NOTED_ROWS]
            extent = Extent(part.min(axis=0), part.max(axis=0))
            self._claim(moved, extent, until, zones_ahead, alone=False)
        if count:
            self._put(moved, way[count], way[count])
            for slow in self._slowed:
                slow.keep(way[: count + 1])
        return count

    def admit_control(self, control: Control) -> bool:
        """Return whether an entry may be handed over; else the program ends or waits before it."""
        self.waiting.fault = None
        kind = control.kind
        columns = self._columns(control.axes)
        # other kinds start only once shaped setpoints have settled: at rest
        if kind not in AT_THEIR_PLACE | GOING_ON or kind is ControlKind.WAIT:
            for slow in self._slowed:
                if kind is not ControlKind.WAIT or not slow.moving(~columns):
                    slow.forget()
        if kind is ControlKind.WAIT:
            self._arrive(columns, control.u)
        elif kind is ControlKind.PASSED:
            self._marks.append(self._claims)
        elif kind is ControlKind.FOLLOW_FROM:
            self._alone.follow_from = control.values
        elif kind is ControlKind.SETTLE:
            self._settling = columns
        elif kind is ControlKind.AXIS and control.operation == _CAPTURE:
            self._loose &= ~columns
        elif kind in (ControlKind.REFERENCE, ControlKind.AXIS):
            self._loose |= columns
        elif kind is ControlKind.END and control.values is not None:
            end = np.array(control.values)
            self._put(columns, end, end)
        elif kind in (
            ControlKind.RAPID,
            ControlKind.PROBE,
            ControlKind.THREAD,
            ControlKind.SPEED,
            ControlKind.TORQUE,
            ControlKind.FOLLOW,
            ControlKind.HOME,
        ):
            return self._admit_alone(control, columns)
        return True

    def exchange(self, exchange: Exchange) -> None:
        """Replace bodies of tools or of the program, or move zones with a work system, from here on.

        The motion before has been played.
        """
        sweep = self._sweep
        sweep.mount(sweep.scene.mounted.behind(exchange, self._tenant.program))
        extent = self._extent()
        way = np.vstack([0.5 * (extent.low + extent.high)] * 2)
        # other programs may be on their way to where the zone or body is now
        half = 0.5 * (extent.high - extent.low)
        pairs = sweep.scene.given if exchange.bodies else sweep.scene.exchanged
        contact = self._judge(way, half, np.ones(len(half), np.bool_), pairs)
        if contact is not None:
            self._end(self._touching(contact, exchange.line, "take another way"))

    def stand(self, positions: Mapping[int, float]) -> None:
        """Note where axes stand that others have moved, by axis number [m or rad]."""
        at = np.zeros(len(self._known))
        columns = np.zeros(len(self._known), np.bool_)
        for axis, position in positions.items():
            column = self._machine.column_of(axis)
            at[column], columns[column] = position, True
        self._put(columns, at, at)

    def on_event(self, event: ExecutorEvent) -> None:
        """Take an event of the program's slot."""
        if event.kind is EventKind.SETTLED:
            # nothing has been planned after it, and others may have moved axes that stand
            at, loose = np.array(event.values[: len(self._known)]), self._loose & ~self._settling
            self._put(self._settling | (self._known & (self._low == self._high)), at, at)
            self._loose = loose
        elif event.kind is EventKind.PASSED and self._marks:
            self._pass(self._marks.popleft())
        elif event.kind is EventKind.PAUSED:
            # no motion is handed over beyond a pause
            self._pass(self._claims)
        elif event.kind in (EventKind.FINISHED, EventKind.STOPPED):
            self._tenant.ended = event.time
            # the bodies that it has brought go with it
            self._sweep.mount(self._sweep.scene.mounted.of_running(self._space.running))
        elif event.kind is EventKind.FAULT and event.code == FaultCode.ZONE_HOLD and event.token:
            # the program was moving, so it is stopped
            self.contact = self.contact or self._inside(int(event.values[1]), event.line)

    def refresh(self) -> None:
        """Tell the executor which switched zones lie ahead, as motion passes."""
        if self._switched and self._tenant.tell is not None:
            self._space.refresh()

    # ------------------------------------------------------------------ what the executor moves by itself

    def _admit_alone(self, control: Control, columns: Mask) -> bool:
        extent = self._extent()
        swept, ends = self._alone.extents(control, columns, extent)
        if control.kind in STRAIGHT:
            # on a straight line
            way = np.vstack([0.5 * (extent.low + extent.high)] * 2)
            way[1, columns] = np.array(control.values)[columns]
            half = np.where(columns, self._beside, 0.5 * (extent.high - extent.low))
        else:
            way = np.vstack([0.5 * (swept.low + swept.high)] * 2)
            half = 0.5 * (swept.high - swept.low) + np.where(columns, self._beside, 0.0)
        contact = self._judge(way, half, columns) or self._fast_alone(
            way, half, columns, control, self._counted
        )
        if contact is not None:
            hint = "take another way"
            if control.kind is ControlKind.RAPID:
                hint = "its axes each come in their own time: give each a G00 of its own, or use G01"
            elif control.kind is ControlKind.HOME:
                hint = "home the axis that lifts the tool first, by a lower order, or jog clear of it"
            elif control.kind is ControlKind.FOLLOW:
                hint = "let the axes go less far: a narrower low and high of open_servo"
            self._stop_before(contact, control.line, hint, waits=control.kind is ControlKind.RAPID)
            return False
        self.waiting.end()
        line = np.array([control.line])
        ahead = [
            zones
            for zones in self._switched.values()
            if self._entered(zones, way, half, columns, line) is not None
            or self._may_be_fast(zones, way, half, columns, control)
        ]
        if ahead and control.kind is ControlKind.THREAD:
            # a pass is not held before a zone that is switched on meanwhile
            self.contact = Diagnostic(
                code="MC321",
                message="a thread would come into a zone that an input switches, before which it is not held",
                line=control.line,
                hint="cut the thread where no such zone is",
            )
            return False
        self._claim(columns, swept, control.u, ahead, alone=True)
        self._put(columns, ends.low, ends.high)
        if control.kind is ControlKind.RAPID and control.values is not None:
            self._targets.update((each, control.values[each]) for each in np.flatnonzero(columns).tolist())
        return True

    def _pass(self, number: int) -> None:
        """Note that all motion up to a claim is over, except what the executor makes by itself."""
        self._tenant.claims = [
            claim._replace(until=-math.inf) if claim.number <= number else claim
            for claim in self._tenant.claims
            if claim.alone or claim.number > number
        ]

    def _arrive(self, columns: Mask, u: float) -> None:
        """Note that columns have reached their targets at u."""
        for column in np.flatnonzero(columns).tolist():
            if column in self._targets:
                self._low[column] = self._high[column] = self._targets.pop(column)
        self._tenant.claims = [
            claim._replace(alone=False, until=u, over=math.inf)
            if not (claim.columns & ~columns).any()
            else claim
            for claim in self._tenant.claims
        ]

    # ------------------------------------------------------------------ where columns are

    def _extent(self) -> Extent:
        """Return where columns may be when the next motion begins."""
        extent, self._now = self._space.extent(self._tenant)
        low, high = extent
        low[self._known], high[self._known] = self._low[self._known], self._high[self._known]
        low[self._loose] = np.minimum(low, self._now)[self._loose]
        high[self._loose] = np.maximum(high, self._now)[self._loose]
        return extent

    def _put(self, columns: Mask, low: Array, high: Array) -> None:
        self._low[columns], self._high[columns] = low[columns], high[columns]
        self._known |= columns
        self._loose &= ~columns
        for column in np.flatnonzero(columns).tolist():
            self._targets.pop(column, None)

    def _claim(
        self,
        columns: Mask,
        extent: Extent,
        until: float,
        ahead: Sequence[SwitchedZones],
        *,
        alone: bool,
    ) -> None:
        """Claim the space of a motion; ``ahead``: switched zones that it may enter."""
        self._claims += 1
        extent = Extent(extent.low - self._beside, extent.high + self._beside)
        zones = sum(each.bit for each in ahead)
        movers = columns.copy()
        for each in ahead:
            movers |= each.movers
        self._tenant.claim(Claim(columns, extent, until, alone, self._claims, zones, movers))
        self._space.tell()

    def _columns(self, mask: int) -> Mask:
        return np.array([mask >> column & 1 for column in range(len(self._known))], np.bool_)

    # ------------------------------------------------------------------ contacts

    def _judge(self, way: Array, half: Array, moved: Mask, pairs: Mask | None = None) -> Contact | None:
        """Return the first contact on a way, of ``pairs`` only if given."""
        scene = self._sweep.scene
        self._count_pairs()
        if self._floors is not None and self._mounted != scene.mounted:
            # exchanged bodies may be nearer than those before: forget their lower bounds
            self._floors[scene.exchanged] = -np.inf
        self._mounted = scene.mounted
        self._floors = self._sweep.floors(self._now, self._floors)
        judged = self._counted if pairs is None else self._counted & pairs
        return self._sweep.first_contact(way, half, moved, np.where(judged, self._floors, -np.inf))

    def _entered(
        self, zones: SwitchedZones, way: Array, half: Array, moved: Mask, lines: NDArray[np.int64]
    ) -> int | None:
        """Return the first step on which a body is in switched zones, or enters them; None without one.

        A jog may leave them while they are on. ``lines``: of each step, or one for all.
        """
        assert self._floors is not None
        floors = self._sweep.margins()
        if self._by_hand and zones.on(self._space.inputs):
            floors = self._floors
        contact = self._sweep.first_contact(way, half, moved, np.where(zones.counted, floors, -np.inf))
        step = len(way) - 1 if contact is None else contact.step
        fast = zones.slow.first(way[: step + 1])
        if fast is not None:
            fault = self._too_fast(fast, int(lines[min(fast.step, len(lines) - 1)]))
            self.held.setdefault(fast.pair, held_there(fault))
            return fast.step
        if contact is not None:
            fault = self._touching(contact, int(lines[min(step, len(lines) - 1)]), "")
            self.held.setdefault(contact.pair, held_there(fault))
            return step
        return None

    def _may_be_fast(
        self, zones: SwitchedZones, way: Array, half: Array, moved: Mask, control: Control
    ) -> bool:
        contact = self._fast_alone(way, half, moved, control, zones.counted)
        if contact is not None:
            self.held.setdefault(contact.pair, held_there(self._touching(contact, control.line, "")))
        return contact is not None

    def _fast_alone(
        self, way: Array, half: Array, moved: Mask, control: Control, counted: Mask
    ) -> Contact | None:
        """Return a contact where a body may enter a slow zone faster than the zone allows."""
        scene = self._sweep.scene
        speeds = self._speeds
        if control.kind in STRAIGHT:
            turns = abs(control.value) * MOST_SPEED if control.kind is ControlKind.THREAD else 1.0
            speeds = np.minimum(speeds, control.seconds * turns)
        fast = (
            counted & scene.active & (np.where(moved, speeds, 0.0) @ scene.levers > ROUNDING * scene.speeds)
        )
        if not fast.any():
            return None
        return self._sweep.first_contact(way, half, moved, np.where(fast, 0.0, -np.inf))

    def _inside(self, switch: int, line: int) -> Diagnostic | None:
        """Return the fault of a moved body inside zones that are switched on; None without one."""
        self._count_pairs()
        scene = self._sweep.scene
        mine = scene.levers[self._tenant.lease].any(axis=0)
        _, now = self._space.extent(self._tenant)
        scene.place(now)
        for zones in self._switched.values():
            stopped = zones.counted & scene.active & mine & np.isinf(scene.speeds)
            for pair in np.flatnonzero(stopped).tolist() if zones.bit == 1 << switch else ():
                if scene.distance(pair) < 0.0:
                    body, zone = scene.pairs[pair].names
                    return Diagnostic(
                        code="MC324",
                        message=f"{body!r} was inside of the zone {zone!r} when its input switched it on",
                        line=line,
                        hint="see who is there; a jog may lead out of it, then begin the program again",
                    )
        return None

    def _too_fast(self, fast: TooFast, line: int) -> Diagnostic:
        names = self._sweep.scene.pairs[fast.pair].names
        return Diagnostic(code="MC322", message=fast.message(names), line=line, hint=SLOWER)

    def _end(self, fault: Diagnostic) -> None:
        self.waiting.end()
        self.contact = fault

    def _stop_before(self, contact: Contact, line: int, hint: str, *, waits: bool) -> None:
        """End the program before a contact, or wait for other programs that move one of the two bodies."""
        others = self._others(contact)
        fault = self._touching(contact, line, hint, others)
        waits = waits and bool(others) and not self._by_hand
        ending = self.waiting.before(fault, others) if waits else fault
        if ending is not None:
            self._end(ending)

    def _others(self, contact: Contact) -> list[str]:
        """Return the other programs that move one of the two bodies."""
        return self._space.movers(self._sweep.scene.levers[:, contact.pair] > 0.0, self._tenant)

    def _touching(
        self, contact: Contact, line: int, hint: str, others: Sequence[str] | None = None
    ) -> Diagnostic:
        assert self._machine.clearance is not None
        others = self._others(contact) if others is None else others
        return touching(self._sweep.scene, contact, line, hint, self._machine.clearance.margin, others)


class ClearanceGuards:
    """Make the guards of one machine's programs, which check against each other's motion.

    Args:
        machine: has a clearance. space: its programs' motion.

    Raises:
        ConfigurationError: as `Scene`.
    """

    def __init__(self, machine: Machine, space: SharedSpace) -> None:
        assert machine.clearance is not None
        self._machine = machine
        self._sweep = Sweep(Scene(machine), machine.clearance.margin)
        self._space = space

    def guard(
        self,
        program: str,
        slot: int,
        axes: frozenset[int],
        begins: Mounted | None = None,
        *,
        tell: Callable[[int], None] | None = None,
        role: str | None = None,
        by_hand: bool = False,
    ) -> ClearanceGuard:
        """Return the guard of a program that begins now.

        Args:
            axes: its lease. begins: the tool table and work systems that it begins with; None: the present
                ones. tell: called with the bit mask of the switched zones that lie ahead; None: it is never
                held. role, by_hand: as in `ClearanceGuard`.
        """
        mounted = self._sweep.scene.mounted
        if begins is not None:
            now = mounted.at_begin(begins, beside_others=bool(self._space.running))
            if now != mounted:
                self._sweep.mount(now)
        lease = np.array([axis.index in axes for axis in self._machine.axes], np.bool_)
        tenant = Tenant(program, slot, lease, tell)
        guard = ClearanceGuard(self._machine, self._sweep, self._space, tenant, role=role, by_hand=by_hand)
        # the slot's last program may have ended without an event
        self._sweep.mount(self._sweep.scene.mounted.of_running(self._space.running))
        return guard
