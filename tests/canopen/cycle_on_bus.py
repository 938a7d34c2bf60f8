"""The executor's end of a bus on which slaves that are not ours have been booted."""

from __future__ import annotations

from collections.abc import Sequence

from mcserver.canopen.service import CanopenService
from mcserver.drives.bus import DriveMode, DriveState, Setpoints
from mcserver.drives.can_bus import CanBus
from mcserver.machine.machine_file import Machine
from tests.canopen.local_drives import LocalDrive, until


class Cycle:
    """The cycle on a bus whose drives have been booted: exchanges as the SYNCs are answered."""

    def __init__(self, service: CanopenService, machine: Machine, drives: Sequence[LocalDrive]) -> None:
        self.machine = service.agreed(machine)
        for drive in drives:
            drive.listen()
        self.bus = CanBus(self.machine, self.machine.buses[0], list(range(len(self.machine.axes))))
        self.feedback = self.bus.boot()
        self.setpoints = Setpoints.of(len(self.machine.axes))
        self.setpoints.position[:] = self.feedback.position

    def run(self, mode: DriveMode, until_state: DriveState, column: int = 0) -> None:
        self.setpoints.mode[:] = mode

        def reached() -> bool:
            free = self.feedback.state != DriveState.ENERGIZED
            self.setpoints.position[free] = self.feedback.position[free]
            self.bus.exchange(self.setpoints)
            return int(self.feedback.state[column]) == until_state

        until(reached, f"{until_state.name}; it is {self.feedback.state} {self.feedback.fault}")

    def close(self) -> None:
        self.bus.close()
