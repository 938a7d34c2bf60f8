"""Probing in the cycle: a straight move until the probe changes, with the place latched in that cycle.

The move is one trajectory along the line, as those of single axes are, so a hold stops it on the line and a
resume goes on. When the probe changes it stops within the limits, and the program goes on from there.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mcserver.executor.barriers import Barrier
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import Array, Control, EventKind
from mcserver.executor.fault_codes import BarrierFault, FaultCode
from mcserver.executor.trajectories import MotionLimits
from mcserver.motion.canonical import ProbeKind


class Contact:
    """What the probe says: its input, or simulated planes that it meets from the side where it starts."""

    def __init__(self, cycle: Cycle, kind: ProbeKind) -> None:
        probe = cycle.machine.probe
        if probe is None:
            raise BarrierFault(FaultCode.NO_CONTACT, -1)
        self._cycle = cycle
        self._column: int | None = None
        self._wanted = kind.towards != probe.invert
        for column, each in enumerate(cycle.machine.inputs):
            if each.digital and each.number == probe.input:
                self._column = column
        planes = [(cycle.machine.column_of(axis), place) for axis, place in probe.planes.items()]
        simulated = self._column is None or cycle.machine.inputs[self._column].source is None
        self._planes = (
            [(column, place + _lift(cycle, column)) for column, place in planes]
            if simulated or cycle.homed.assumed
            else []
        )
        # in a simulation with nothing to meet, contact is where the move ends
        scripted = self._column is not None and bool(cycle.machine.inputs[self._column].script)
        self.at_end = cycle.homed.assumed and not self._planes and not scripted
        self._start = cycle.row.actual.copy()
        self._before = self._start.copy()

    @property
    def reached(self) -> bool:
        """Whether the probe is as it should be at the end of the move."""
        if self._planes:
            return any(self._crossed(column, place) for column, place in self._planes)
        if self._column is None or self.at_end:
            return False
        return (self._cycle.io.value(self._column) > 0.5) == self._wanted

    def _crossed(self, column: int, place: float) -> bool:
        start, now = float(self._start[column]), float(self._cycle.row.actual[column])
        return start != now and (start - place) * (now - place) <= 0.0

    def note(self) -> None:
        """Keep this cycle's readings for the next one."""
        self._before[:] = self._cycle.row.actual

    def place(self) -> Array:
        """Return where the axes were as the probe changed, shape (K,) [m or rad].

        At a plane the point on it; else half way between the two readings.
        """
        now = self._cycle.row.actual
        share = 0.5
        for column, place in self._planes:
            travel = float(now[column] - self._before[column])
            if self._crossed(column, place) and travel != 0.0:
                share = min(max((place - float(self._before[column])) / travel, 0.0), 1.0)
                break
        found: Array = self._before + share * (now - self._before)
        return found


def _lift(cycle: Cycle, column: int) -> float:
    """Return by how much positions of a column are more than where it is, for the mesh of a bed [m]."""
    return 0.0 if cycle.bed is None else cycle.bed.error_of(column)


class Probes(Barrier):
    """The barrier at which u stands while a probing move is under way.

    Args:
        rate: the slot's share of speed, 0 in feed hold.
    """

    def __init__(self, cycle: Cycle, control: Control, slot: int, rate: Callable[[], float]) -> None:
        assert control.values is not None
        self._cycle = cycle
        self._control = control
        self._slot = slot
        self._rate = rate
        self._kind = ProbeKind(control.operation)
        self._contact = Contact(cycle, self._kind)
        self._targets = {column: control.values[column] for column in cycle.bank.masks.columns(control.axes)}
        self._lead = -1
        self._found: Array | None = None

    def after(self, held: bool) -> bool:  # noqa: ARG002
        if self._lead < 0:
            self._begin()
            return False
        if self._found is None and self._contact.reached:
            self._found = self._contact.place()
            self._cycle.motions.halt(self._lead, self._slot)
        self._contact.note()
        if self._cycle.motions.mask & self._control.axes:
            return False
        return self._end()

    def _begin(self) -> None:
        if self._contact.reached:
            raise BarrierFault(FaultCode.PROBE_CLOSED, -1)
        row, axes = self._cycle.row, self._cycle.machine.axes
        travel = {column: abs(to - float(row.ordered[column])) for column, to in self._targets.items()}
        length = math.hypot(*travel.values())
        self._lead = max(travel, key=lambda column: travel[column])
        if length == 0.0:
            return
        share = travel[self._lead] / length
        moving = [(axes[column], each / length) for column, each in travel.items() if each > 0.0]
        velocity = min(self._control.seconds, min(axis.max_velocity / part for axis, part in moving))
        limits = MotionLimits(
            velocity * share,
            min(axis.max_acceleration / part for axis, part in moving) * share,
            min(axis.max_jerk / part for axis, part in moving) * share,
        )
        self._cycle.motions.move_line(self._slot, self._targets, 0.0, self._rate(), limits)

    def _end(self) -> bool:
        found = self._found
        if found is None and self._contact.at_end and self._kind.towards:
            found = self._cycle.row.actual
        place = self._cycle.row.actual if found is None else found
        if found is not None and self._control.token and self._cycle.bed is not None:
            self._cycle.bed.meet(found, real=not self._contact.at_end)
        reported = self._cycle.emit(
            EventKind.PROBED,
            self._slot,
            self._control.line,
            token=int(found is not None),
            values=tuple(np.asarray(place).tolist()),
        )
        if found is None and self._kind.needs:
            raise BarrierFault(FaultCode.NO_CONTACT, -1)
        # what the program goes on with must not get lost: it is reported again as soon as there is room
        return reported
