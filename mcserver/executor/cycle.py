"""The state that the parts of one executor share in a cycle."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from mcserver.executor.axes import AxisBank
from mcserver.executor.column_masks import mask_of
from mcserver.executor.couplings import Couplings
from mcserver.executor.entries import Array, EventKind, ExecutorEvent
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.gantry import GantryPairs
from mcserver.executor.homed import HomedAxes
from mcserver.executor.independent import IndependentMotions
from mcserver.executor.io_bank import IoBank
from mcserver.executor.profiled import ProfiledAxes
from mcserver.executor.shm.event_ring import EventRing
from mcserver.executor.torque_feed_forward import TorqueFeedForward
from mcserver.machine.machine_file import Machine

if TYPE_CHECKING:
    from mcserver.executor.bed_mesh import BedMesh


class Cycle:
    """The running cycle, and the machine.

    Attributes:
        time: executor time of the cycle [s].
        estop: the emergency stop is latched.
        io: inputs and outputs. profiled: axes whose drives generate their profiles themselves.
        feed_forward: torques for drives with torque feed-forward; None: no drive has it.
        number: of the cycle. bed: the bed mesh that programs probe; None: none.
        history: shape (exact_stop_cycles, K), the latest encoder readings in the frame of programs, without
            superimposed motion; that of cycle n in row n % exact_stop_cycles.
        gantries: pairs of drives. couplings: axes that follow others.
        homed: the axes' references. shifted: functions to call with a column and the distance that is added
            to its positions from now on.
    """

    def __init__(
        self,
        machine: Machine,
        bank: AxisBank,
        motions: IndependentMotions,
        io: IoBank,
        events: EventRing,
        *,
        assume_homed: bool = False,
    ) -> None:
        self.machine = machine
        self.cycle_s = machine.cycle_s
        self.bank = bank
        self.row = bank.row
        self.motions = motions
        self.io = io
        self.profiled = ProfiledAxes(machine, bank, motions)
        self.feed_forward = TorqueFeedForward.of(machine, bank)
        self.time = 0.0
        self.number = 0
        self.estop = False
        self.history: Array = np.full((machine.exact_stop_cycles, len(machine.axes)), np.nan)
        # what was added to the shaped setpoints of the latest cycles; None: nothing ever is
        leads = machine.shaping is not None and machine.shaping.lead is not None
        adds = leads or any(axis.reserved for axis in machine.axes)
        self._added: Array | None = np.zeros((1 + bank.delay_cycles, len(machine.axes))) if adds else None
        self.gantries = GantryPairs(machine, bank, motions)
        self.couplings = Couplings(machine, bank, motions)
        self.shifted: list[Callable[[int, float], None]] = [self.gantries.shift, self.couplings.shift]
        self.homed = HomedAxes(machine, bank, self.shifted, assume=assume_homed)
        self.bed: BedMesh | None = None
        self._events = events

    @property
    def settling(self) -> int:
        """Columns that nothing moves any more, and whose drives are still told to move: by shapers, to take
        up backlash, or because they have followed another axis besides.
        """
        bank, moving = self.bank, self.couplings.settling
        if bank.shaper is not None:
            moving |= mask_of(bank.shaper.unsettled)
        if bank.compensator is not None:
            moving |= mask_of(bank.compensator.unsettled)
        return moving & bank.energized & ~self.motions.mask

    def note_readings(self) -> None:
        """Keep the encoder readings of this cycle."""
        shaper, now, added = self.bank.shaper, self.history[self.number % len(self.history)], self._added
        np.copyto(now, self.row.actual)
        if shaper is not None and added is not None:
            added[self.number % len(added)] = shaper.added
            # a reading that is behind is of a setpoint that was
            late = added[(self.number + 1) % len(added)]
            now -= np.where(self.bank.delayed, late, shaper.added)

    def ordered(self, column: int) -> float:
        """Return where a column's drive was told to be, as programs have positions."""
        shaper = self.bank.shaper
        added = 0.0 if shaper is None else float(shaper.added[column])
        return float(self.row.setpoint[column]) - added

    def emit(
        self,
        kind: EventKind,
        program: int,
        line: int,
        left: float = 0.0,
        *,
        code: int = 0,
        axis: int = -1,
        token: int = 0,
        values: tuple[float, ...] = (),
    ) -> bool:
        """Report an event ``left`` cycles before the end of this cycle; return False if there is no room."""
        time = self.time - left * self.cycle_s
        return self._events.put(ExecutorEvent(kind, program, line, time, code, axis, token, values))

    def fault(
        self, code: FaultCode, program: int, line: int, column: int = -1, values: tuple[float, ...] = ()
    ) -> None:
        """Report a fault; ``column`` -1: not of an axis."""
        axis = self.machine.axes[column].index if column >= 0 else -1
        self.emit(EventKind.FAULT, program, line, code=code, axis=axis, values=values)
