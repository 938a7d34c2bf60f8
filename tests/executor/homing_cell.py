"""A machine whose axes do not know where they are, on a virtual executor with simulated drives."""

from __future__ import annotations

from mcserver.drives.simulated import SimulatedBus
from mcserver.executor.entries import ControlKind, EventKind, ExecutorEvent, HomingPhase
from mcserver.executor.process_start import StoredReference
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.executor.rig import Array, Program, Watched
from tests.limits import EXACTLY, assert_keeps, limits_of
from tests.machine_text import axes_text

MM = 1e-3
SWITCH = 'method = "switch"\nvelocity = 50.0\nlatch_velocity = 2.0\nback_off = 3.0\n'


def machine(*axes: tuple[str, str], travel: float | None = 100.0, jerk: str = "", more: str = "") -> Machine:
    """Linear axes [mm], each with the lines of its drive and of its homing (none: no section); ``more``
    sections of the machine file.
    """
    keys = f"units_per_motor_rev = 5.0\n{jerk}"
    keys += "" if travel is None else f"min_position = {-travel}\nmax_position = {travel}\n"
    text = '[machine]\nname = "rig"\n'
    for index, (drive, homing) in enumerate(axes):
        section = f"[axis.homing]\n{homing}" if homing else ""
        text += axes_text([index], keys=keys + section, drive="simulated", drive_keys=drive)
    return parse_machine(text + more)


class Cell(Watched):
    """A virtual executor whose axes do not know where they are."""

    def __init__(
        self, made: Machine, *, references: dict[int, StoredReference] | None = None, unhomed: bool = False
    ) -> None:
        self.machine = made
        self.executor = VirtualExecutor(made, homed=False, references=references, recorder=self._record)
        self.unhomed = unhomed
        self.events: list[ExecutorEvent] = []
        self.setpoints: list[Array] = []
        self.drive_setpoints: list[Array] = []
        self.errors: list[Array] = []
        (self.bus,) = self.executor.buses
        assert isinstance(self.bus, SimulatedBus)

    def _record(self, _time: float, _line: int, setpoint: Array, actual: Array) -> None:
        self.setpoints.append(setpoint.copy())
        self.drive_setpoints.append(setpoint - self.executor.executor.bank.offset)
        self.errors.append(setpoint - actual)

    def program(self, *, unhomed: bool = False) -> Program:
        ring = self.executor.open_slot(0, unhomed=unhomed)
        program = Program(ring, len(self.machine.axes))
        program.position = self.executor.executor.row.setpoint.copy()
        return program

    def home(self, *axes: int) -> Program:
        program = self.program()
        program.capture()
        program.control(ControlKind.HOME, axes=sum(1 << axis for axis in axes))
        program.finish()
        return program

    def find_home(self, *axes: int) -> None:
        self.home(*axes)
        self.run()

    def run_to_phase(self, phase: HomingPhase, axis: int = 0, limit: int = 60000) -> None:
        for _ in range(limit):
            self.step()
            if any(each.axis == axis and each.token == phase for each in self.of(EventKind.HOMING)):
                return
        raise AssertionError(f"no {phase!r}: {self.events}")

    @property
    def homed(self) -> int:
        return self.executor.feedback.homed

    @property
    def offset(self) -> Array:
        return self.executor.executor.bank.offset / MM

    def phases(self, axis: int = 0) -> list[HomingPhase]:
        return [HomingPhase(each.token) for each in self.of(EventKind.HOMING) if each.axis == axis]

    def check_limits(self) -> None:
        """Of what the drives are told: a reading that is set leaves the axes where they are."""
        assert_keeps(self.drive_setpoints, limits_of(self.machine)[:2], self.machine.cycle_s, EXACTLY)
