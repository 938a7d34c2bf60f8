"""The couplings of axes that follow others, from G1060 to G1061 (D-130, D-142).

A coupling belongs to its program. It ends with it: once a leader that the program moves has come to rest,
else at once; the follower, or what it does besides the program, then stops within its limits.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from mcserver.executor.axes import AxisBank
from mcserver.executor.coupling import Coupling, coupled_limits
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.independent import IndependentMotions
from mcserver.executor.superimposed import NotedWorks, SuperimposedCoupling
from mcserver.executor.target_follower import Bounds
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics

if TYPE_CHECKING:
    from mcserver.executor.slot import ProgramSlot


class Couplings:
    """The couplings of a machine that are in force.

    Attributes:
        engaged: all of them. mask: columns of the followers that nothing else moves. tied: with leaders that
            are ordered, and those that programs move, too. works: what inputs have noted for these.
    """

    def __init__(self, machine: Machine, bank: AxisBank, motions: IndependentMotions) -> None:
        self._machine, self._bank, self._motions = machine, bank, motions
        self.engaged: tuple[Coupling, ...] = ()
        self.mask = self.tied = 0
        self.works = NotedWorks(machine, bank)
        # of tools that follow, by the columns of their joints
        self._tools: dict[int, Callable[[int, int, deque[float] | None], Coupling]] = {}
        tools = [tool for tool in machine.tools if tool.follow is not None]
        kinematics = build_kinematics(machine) if tools else None
        if kinematics is not None:
            # a machine without tools starts without their solvers
            from mcserver.executor.tool_coupling import ToolCoupling

            for tool in tools:
                model = kinematics.tool(tool.number)
                self._tools[machine.mask_of(tool.axes)] = partial(ToolCoupling, machine, bank, tool, model)

    def prepare(self, axes: int, slot: int, generation: int, within: Bounds) -> Coupling:
        """Return a coupling of an axis, or of a tool's joints, for `couple`; nothing follows yet."""
        machine, bank = self._machine, self._bank
        noted = self.works.of(axes)
        if axes in self._tools:
            return self._tools[axes](slot, generation, noted)
        (column,) = bank.masks.columns(axes)
        axis = machine.axes[column]
        assert axis.follow is not None
        if axis.superimposed is not None:
            assert axis.reserved is not None
            follow, own = axis.follow, axis.reserved
            return SuperimposedCoupling(machine, bank, follow, [column], slot, generation, noted, own)
        place = float(bank.row.ordered[column])
        free = bool(self._motions.unlimited >> column & 1)
        limits = coupled_limits(axis, place, within, free=free)
        return Coupling(machine, bank, axis.follow, [column], slot, generation, place, within, limits)

    def couple(self, coupling: Coupling) -> None:
        """Let a column follow its leader from this cycle on."""
        self._hold((*self.engaged, coupling))

    def superimposed(self, slot: int | None = None) -> int:
        """Return the columns that follow besides what is ordered; ``slot``: of this program alone."""
        return _axes_of(each for each in self._besides if slot in (None, each.slot))

    @property
    def _besides(self) -> list[SuperimposedCoupling]:
        return [each for each in self.engaged if isinstance(each, SuperimposedCoupling)]

    @property
    def all_following(self) -> int:
        """Columns of all followers."""
        return _axes_of(self.engaged)

    @property
    def settling(self) -> int:
        """Columns of couplings that have ended, and whose offset is not at rest."""
        return _axes_of(each for each in self._besides if each.ending)

    def uncouple(self, axes: int) -> None:
        """End the couplings of some followers; those that move come to rest within their limits. A tool is
        let go with all its joints.
        """
        for coupling in self.engaged:
            coupling.ending |= bool(axes & coupling.axes)
        self.forget(axes & self.mask & ~self._motions.mask)

    def forget(self, axes: int) -> None:
        """End the couplings of some followers, which stand or are off."""
        self._hold(tuple(each for each in self.engaged if not axes & each.axes))

    def rest(self) -> None:
        """Let offsets be at rest where they are: drives got no setpoints for a time."""
        for coupling in self._besides:
            coupling.rest()

    def shift(self, column: int, distance: float) -> None:
        """Let a column's positions read ``distance`` more from now on."""
        self.works.shift(column, distance)
        for coupling in self.engaged:
            coupling.shift(column, distance)

    def follow(self, slots: Sequence[ProgramSlot], silent: int, *, urgent: bool) -> None:
        """Set the setpoints of all followers in this cycle, and end what has to end.

        Args:
            slots: of the programs, by number. silent: mask of columns whose drives answer no more. urgent:
                the emergency stop is latched.
        """
        for coupling in self.engaged:
            slot, axes = slots[coupling.slot], coupling.axes
            held = axes & self._bank.energized & self._bank.positioned
            gone = not slot.running or slot.generation != coupling.generation
            lost = coupling.leader.lost(silent)
            ends = coupling.ending or gone or urgent or lost or self._stops(coupling, slot)
            if isinstance(coupling, SuperimposedCoupling):
                if ends:
                    coupling.brake(urgent=urgent)
                if held != axes:
                    coupling.lose()
                moved = (self._motions.mask | slot.playback.active) & axes
                if not held or (ends and coupling.rests and not moved):
                    for column, offset in coupling.release(held).items():
                        for each in slots:
                            each.playback.shift(column, offset)
                    self.forget(axes)
                    continue
            elif not held:
                self.forget(axes)
                continue
            elif ends:
                if self._motions.mask & axes:
                    # its state is that before this cycle
                    self._motions.halt(coupling.column, -1 if gone else slot.index, 1.0, jerk=not urgent)
                self.forget(axes)
            else:
                coupling.step()
                registered = bool(self._motions.mask & axes)
                if coupling.rests and registered:
                    self._motions.drop(axes)
                elif not (coupling.rests or registered):
                    self._motions.follow(coupling.column, coupling.slot, coupling.state)
            if gone or not slot.goes_on:
                continue
            late = coupling.in_step and not coupling.error <= coupling.tolerance
            if lost:
                slot.fault(FaultCode.LEADER_LOST, slot.shown_line, coupling.leader.column)
            elif coupling.failed or (late and not ends):
                code, values = coupling.out_of_step()
                slot.fault(code, slot.shown_line, coupling.column, values)

    def _stops(self, coupling: Coupling, slot: ProgramSlot) -> bool:
        """Return whether a stop of the program ends a coupling now."""
        if slot.goes_on:
            return False
        leader = coupling.leader
        leads = not leader.measured and slot.axes >> leader.column & 1
        return not leads or not (self._motions.mask | slot.playback.active) >> leader.column & 1

    def _hold(self, engaged: tuple[Coupling, ...]) -> None:
        self.engaged = engaged
        self.tied = self.all_following
        self.mask = self.tied & ~self.superimposed()
        if self._bank.shaper is not None:
            self._bank.shaper.followers = tuple(each.step for each in self._besides)
        for each in engaged:
            self.tied |= 0 if each.leader.measured else 1 << each.leader.column


def _axes_of(couplings: Iterable[Coupling]) -> int:
    """Return the columns of couplings, none of which two have."""
    return sum(each.axes for each in couplings)
