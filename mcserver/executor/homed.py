"""The references of the axes: which axes are homed, and how an axis gets its position."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from mcserver.executor.axes import AxisBank
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.process_start import StoredReference
from mcserver.machine.machine_file import Machine

# Faults after which an incremental encoder may have lost counts or restarted.
LOSING = frozenset(
    {
        FaultCode.DRIVE_SILENT,
        FaultCode.ENCODER,
        FaultCode.DRIVE_REBOOTED,
        FaultCode.NOT_OPERATIONAL,
        FaultCode.HEARTBEAT_LOST,
        FaultCode.BUS_DOWN,
        FaultCode.POSITION_LOST,
        FaultCode.HOMING_FAILED,
    }
)


class HomedAxes:
    """The references of a machine's axes; axes without ``[axis.homing]`` are always homed.

    Args:
        assume: every axis counts as homed, as in simulations.
        shifted: functions to call with a column and the distance that is added to its positions; the list may
            grow.

    Attributes:
        mask: homed columns. required: columns that programs may move only once homed.
        absolute: columns whose reference outlives a loss of power. assumed: as ``assume``.
    """

    def __init__(
        self,
        machine: Machine,
        bank: AxisBank,
        shifted: Sequence[Callable[[int, float], None]],
        *,
        assume: bool = False,
    ) -> None:
        self._machine = machine
        self._bank = bank
        self._shifted = shifted
        self.assumed = assume
        self.required = self.absolute = kept = 0
        for column, axis in enumerate(machine.axes):
            if axis.homing is None:
                continue
            bit = 1 << column
            kept |= bit
            self.required |= bit if axis.homing.required else 0
            self.absolute |= bit if axis.homing.absolute else 0
        self._kept = kept
        self.mask = bank.all if assume else bank.all & ~kept

    def restore(self, references: Mapping[int, StoredReference]) -> None:
        """Restore references of an earlier start, by axis number, if still valid; before the first cycle."""
        for column, axis in enumerate(self._machine.axes):
            stored = references.get(axis.index)
            if stored is None or axis.homing is None:
                continue
            reading = float(self._bank.row.actual[column])
            if stored.reading is None or abs(reading - stored.reading) <= axis.in_position:
                self._shift(column, stored.offset)
                self.mask |= 1 << column

    @property
    def missing(self) -> int:
        """Return the columns without a reference, whose soft limits do not apply."""
        return self._bank.all & ~self.mask

    def barred(self, axes: int) -> int:
        """Return those of the columns that no program may move now."""
        return axes & self.required & ~self.mask

    def reading(self, column: int) -> float:
        """Return what the encoder of a column reads [m or rad]."""
        bank = self._bank
        correction = 0.0 if bank.compensator is None else bank.compensator.correction[column]
        return float(bank.row.actual[column] - bank.offset[column] + correction)

    def refer(self, column: int, position: float, at: float) -> None:
        """Give a column its reference: the position that is ``at`` now becomes ``position`` [m or rad].

        The drive does not move, and the following error stays.
        """
        self._shift(column, position - at)
        self.mask |= 1 << column

    def forget_offset(self, column: int) -> None:
        """Make a column's position equal to its encoder's reading."""
        self._shift(column, -float(self._bank.offset[column]))

    def lose(self, mask: int, *, absolute_too: bool = False) -> int:
        """Remove the references of columns; return the columns that had one."""
        lost = mask & self.mask & self._kept
        if not absolute_too:
            lost &= ~self.absolute
        self.mask &= ~lost
        return lost

    def _shift(self, column: int, distance: float) -> None:
        self._bank.shift(column, distance)
        for each in self._shifted:
            each(column, distance)
