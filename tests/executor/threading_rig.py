"""A lathe with a spindle that is an axis, for the tests of threads."""

from __future__ import annotations

import numpy as np

from mcserver.drives.simulated import SimulatedBus
from mcserver.executor.entries import Array, EventKind
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.units import MM, TURN
from tests.executor.planned import Planned
from tests.limits import assert_keeps, limits_of
from tests.machine_text import axes_text

SPINDLE = 3
HEAD = '[machine]\nname = "lathe"\n[dialect]\nprofile = "cnc"\nspindle_axis = 3\n'
KEYS = "units_per_motor_rev = 360.0\nmax_following_error = 1e6\n"


def lathe(*, drive: str = "simulated") -> Machine:
    return parse_machine(lathe_text(drive=drive))


def lathe_text(*, drive: str = "simulated", resolution: float = 0.09) -> str:
    linear = axes_text(
        range(3),
        acceleration=1000.0,
        drive=drive,
        keys="max_jerk = 50000.0\nmin_position = -100.0\nmax_position = 100.0",
    )
    turning = axes_text(
        (SPINDLE,),
        rotary=True,
        velocity=20000.0,
        acceleration=40000.0,
        keys=KEYS,
        drive=drive,
        drive_keys=f"bandwidth_hz = 10\nencoder_resolution = {resolution}" if drive == "simulated" else "",
    )
    return f"{HEAD}{linear}{turning}"


class Turned(Planned):
    """A program on a lathe."""

    @property
    def bus(self) -> SimulatedBus:
        (bus,) = self.executor.executor.bank.buses
        assert isinstance(bus, SimulatedBus)
        return bus

    def path(self, line: int) -> slice:
        """The cycles of a line."""
        (begin,) = [each.time for each in self.of(EventKind.LINE_START) if each.line == line]
        ends = [each.time for each in self.of(EventKind.LINE_END) if each.line == line]
        ends += [self.executor.time]
        return slice(round(begin / self.machine.cycle_s), round(ends[0] / self.machine.cycle_s) + 1)

    @property
    def turns(self) -> Array:
        """The spindle's measured angle, shape (n,) [1]."""
        return np.array(self.actuals)[:, SPINDLE] / TURN

    def helix(self, line: int, pitch: float, start: float) -> Array:
        """Where setpoints of Z are beside the helix through ``start`` at angle 0, while Z has the spindle's
        speed, shape (n,) [mm].
        """
        along = self.path(line)
        z, turns = np.array(self.rows)[along, 2] / MM, self.turns[along]
        # beyond the run-in, before the run-out
        cruise = (np.abs(z - z[0]) > 2.0) & (np.abs(z - z[-1]) > 2.0)
        beside: Array = (z - start + pitch * turns)[cruise]
        return beside - pitch * np.round(beside / pitch)


def assert_keeps_limits(cell: Turned, line: int) -> None:
    """Velocity 100.1, acceleration 101 and jerk 105 % at the most, in every cycle of a line."""
    limits = [each[:3] for each in limits_of(cell.machine)]
    assert_keeps(np.array(cell.rows)[cell.path(line), :3], limits, cell.machine.cycle_s)
