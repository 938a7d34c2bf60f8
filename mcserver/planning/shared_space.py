"""Bound the positions of a machine's axes while its programs run: present positions and handed-over motion.

Each program's motion is claimed before the executor gets it, and the claim dropped once the executor's
feedback shows that the motion is over. So the bounds are never too small.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.shm.feedback import AxisCondition, FeedbackState, SlotState
from mcserver.machine.machine_file import Machine
from mcserver.units import AxisType

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Stands for an unlimited position: large, but distances can be computed with it [m].
ANYWHERE = 1e3
# Conditions of motion that does not end by itself.
ENDLESS = (AxisCondition.SPEED, AxisCondition.TORQUE)
MOVES = (*ENDLESS, AxisCondition.MOVING, AxisCondition.STOPPING)


class Extent(NamedTuple):
    """Bounds of each column's position, shape (K,) each [SI]."""

    low: Array
    high: Array


class Claim(NamedTuple):
    """The space that a handed-over motion may use.

    Attributes:
        columns: that it moves, shape (K,). extent: their bounds; valid in these columns only.
        until: end on the program's time axis [cycles]. alone: the executor moves the columns by itself from
            there on, possibly beyond the end of the program.
        number: of the claim in its program.
        zones: switched zones that it may enter, as bits. movers: columns that move the bodies that may enter,
            shape (K,).
        over: executor time at which the drives have completed it [s]; inf: u has not passed it.
    """

    columns: Mask
    extent: Extent
    until: float
    alone: bool
    number: int
    zones: int
    movers: Mask
    over: float = math.inf


class Wait(NamedTuple):
    """Programs that are waited for, and the executor time since when [s]."""

    programs: tuple[str, ...]
    since: float


@dataclass(eq=False)
class Tenant:
    """A program that moves axes.

    Attributes:
        lease: columns that no other program moves, shape (K,). moved: those of them that it has moved itself;
            the others may still be under way from before. claims: of its motion, in order.
        tell: called with the bit mask of the switched zones that lie ahead of it; None: not called.
        ended: executor time of its end [s]; None: it runs.
        wait: programs for which it waits before a contact; None: it does not wait.
    """

    program: str
    slot: int
    lease: Mask
    tell: Callable[[int], None] | None = None
    claims: list[Claim] = field(default_factory=list)
    ended: float | None = None
    wait: Wait | None = None
    moved: Mask = field(init=False)

    def __post_init__(self) -> None:
        self.moved = np.zeros_like(self.lease)

    def claim(self, claim: Claim) -> None:
        """Claim the space of a motion that is about to be handed over."""
        self.moved |= claim.columns
        self.claims.append(claim)


class SharedSpace:
    """All programs' motion on one machine.

    Args:
        feedback: the executor's newest cycle.
    """

    def __init__(self, machine: Machine, feedback: Callable[[], FeedbackState | None]) -> None:
        self._feedback = feedback
        # delay of the drives after u by shaping [s]
        self._lag = 0.0 if machine.shaping is None else machine.shaping.length * machine.cycle_s
        self._tenants: list[Tenant] = []
        # by slot, the function to tell of switched zones ahead
        self._slots: dict[int, Callable[[int], None]] = {}
        self.travel = Extent(
            np.array([axis.min_position for axis in machine.axes]),
            np.array([axis.max_position for axis in machine.axes]),
        )
        self._turn = np.array(
            [math.pi if axis.type is AxisType.ROTARY else ANYWHERE for axis in machine.axes]
        )

    def enter(self, tenant: Tenant) -> None:
        """Add a program; the one that was in its slot has ended."""
        for each in self._tenants:
            if each.slot == tenant.slot and each.ended is None:
                each.ended = -math.inf
        self._tenants.append(tenant)
        if tenant.tell is not None:
            self._slots[tenant.slot] = tenant.tell

    @property
    def running(self) -> frozenset[str]:
        """Return the programs that run."""
        return frozenset(each.program for each in self._tenants if each.ended is None)

    def anywhere(self, column: int, here: float) -> tuple[float, float]:
        """Return the travel of a column, or a turn about ``here`` where it has no limit [SI]."""
        low, high, turn = self.travel.low[column], self.travel.high[column], self._turn[column]
        return (
            min(here, float(low)) if math.isfinite(low) else here - float(turn),
            max(here, float(high)) if math.isfinite(high) else here + float(turn),
        )

    def extent(self, asking: Tenant) -> tuple[Extent, Array]:
        """Return bounds of columns by all handed-over motion but the asking program's own, and their present
        positions, shape (K,).
        """
        newest = self._newest
        self._forget(newest)
        low, high = newest.setpoint.copy(), newest.setpoint.copy()
        known = np.zeros(len(low), np.bool_)
        for tenant in self._tenants:
            if tenant.ended is None:
                known |= tenant.moved
            if tenant is asking:
                continue
            for claim in tenant.claims:
                at = claim.columns
                known |= at
                low[at] = np.minimum(low[at], claim.extent.low[at])
                high[at] = np.maximum(high[at], claim.extent.high[at])
        # columns that move without a program that is known here
        for column in np.flatnonzero(np.isin(newest.condition, MOVES) & ~known).tolist():
            low[column], high[column] = self.anywhere(column, float(newest.setpoint[column]))
        return Extent(low, high), newest.setpoint

    @property
    def _newest(self) -> FeedbackState:
        newest = self._feedback()
        assert newest is not None
        return newest

    @property
    def time(self) -> float:
        """The executor's present time [s]."""
        return self._newest.time

    def locked(self, asking: Tenant) -> bool:
        """Return whether a program is in a deadlock, and was the last to begin waiting in it.

        It is if it is among the programs that it waits for, directly or through others, and all of these wait
        too: any of them that goes on may free it. A program that a person holds, as in feed hold, is not
        waiting.
        """
        newest = self._newest
        moving = (newest.velocity != 0.0) & ~np.isin(newest.condition, ENDLESS)
        running = {each.program: each for each in self._tenants if each.ended is None}
        found: list[Tenant] = []
        ahead = [asking]
        while ahead:
            this = ahead.pop()
            programs = self._awaited(this, newest.slots[this.slot].state, running)
            if not programs or (moving & this.lease).any() or not running.keys() >= set(programs):
                return False
            ahead += [running[each] for each in programs if running[each] not in found]
            found += [each for each in ahead if each not in found]
        waits = [each.wait.since for each in found if each.wait is not None]
        return asking in found and asking.wait is not None and asking.wait.since == max(waits)

    @staticmethod
    def _awaited(tenant: Tenant, state: SlotState, running: Mapping[str, Tenant]) -> Sequence[str]:
        """Return the programs that one waits for; empty: it can go on."""
        if state is SlotState.PAUSED:
            # it is resumed only once it has its axes again
            others = (each for each in running.values() if each is not tenant)
            return [each.program for each in others if (each.lease & tenant.lease).any()]
        if state in (SlotState.HELD, SlotState.STOPPING) or tenant.wait is None:
            return ()
        return tenant.wait.programs

    @property
    def inputs(self) -> Array:
        """Present values of the machine's inputs, shape (I,)."""
        return self._newest.inputs

    def refresh(self) -> None:
        """Drop claims of motion that is over, and tell which switched zones lie ahead of the programs."""
        self._forget(self._newest)
        self.tell()

    def tell(self) -> None:
        """Tell each program's slot which switched zones lie ahead.

        Those of its own motion, and those of other programs' motion with bodies that it moves too.
        """
        ahead = [claim for tenant in self._tenants for claim in tenant.claims if claim.zones]
        zones = dict.fromkeys(self._slots, 0)
        for tenant in self._tenants:
            for claim in ahead:
                if tenant.slot in zones and (claim.movers & tenant.lease).any():
                    zones[tenant.slot] |= claim.zones
        for slot, bits in zones.items():
            self._slots[slot](bits)

    def movers(self, columns: Mask, asking: Tenant) -> list[str]:
        """Return the other programs that move one of these columns, and may move it away.

        Not a program that lends its axes to the asking one and goes on only after that has ended; nor one
        that has ended and left axes turning.
        """
        ends = ~np.isin(self._newest.condition, ENDLESS)
        found = []
        for tenant in self._tenants:
            if tenant is asking or (tenant.ended is None and (tenant.lease & asking.lease).any()):
                continue
            moves = tenant.lease if tenant.ended is None else np.zeros_like(columns)
            for claim in tenant.claims:
                moves = moves | (claim.columns & ends)
            if (moves & columns).any():
                found.append(tenant.program)
        return found

    def _forget(self, newest: FeedbackState) -> None:
        """Drop claims whose motion is over."""
        moving = np.isin(newest.condition, MOVES)
        for tenant in self._tenants:
            slot = newest.slots[tenant.slot]
            over = tenant.ended is not None and newest.time > tenant.ended
            # a free slot still shows u of the last program
            passed = -math.inf if slot.state.free or tenant.ended is not None else slot.u - 1.0
            for number, claim in enumerate(tenant.claims):
                if passed > claim.until and claim.over == math.inf:
                    tenant.claims[number] = claim._replace(over=newest.time + self._lag)
            tenant.claims = [
                claim
                for claim in tenant.claims
                if (claim.alone and (moving & claim.columns).any()) or not (over or newest.time >= claim.over)
            ]
        self._tenants = [each for each in self._tenants if each.ended is None or each.claims]
