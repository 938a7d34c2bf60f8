"""An executor on a virtual clock with CiA 402 axes on buses in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mcserver.drives.bus import DriveMode, DriveState, Feedback, Setpoints
from mcserver.drives.can_bus import CanBus
from mcserver.executor.executor import Executor
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.drives.fake_can import FakeBus, FakeDrive
from tests.executor.rig import Rig

COUNTS = 10_000


def machine(
    axes: int = 2,
    *,
    cycle_hz: float = 1000.0,
    drive: str = "",
    axis: str = "max_following_error = 2.0",
    buses: int = 1,
    bus: str = "can",
    bus_keys: str = "",
) -> Machine:
    """Linear axes of 10 mm and 10 000 counts a motor turn, spread over buses can0, can1, …"""
    text = f'[machine]\nname = "m"\ncycle_hz = {cycle_hz}\n'
    if bus_keys:
        text += "".join(f'[[bus]]\nname = "{bus}{index}"\n{bus_keys}\n' for index in range(buses))
    for index in range(axes):
        text += f'[[axis]]\nindex = {index}\ntype = "linear"\nmax_velocity = 1000.0\n'
        text += f"max_acceleration = 10000.0\nunits_per_motor_rev = 10.0\n{axis}\n"
        text += f'[axis.drive]\nkind = "cia402"\nbus = "{bus}{index % buses}"\nnode = {index + 1}\n'
        text += f"counts_per_motor_rev = {COUNTS}\nrated_torque = 2.0\n{drive}\n"
    return parse_machine(text)


def bus_in_memory(described: Machine, port: FakeBus, columns: Sequence[int] = (0,)) -> CanBus:
    """The bus of these axes' drives, on a port that is already there."""
    section = described.bus_of(described.axes[columns[0]])
    return CanBus(described, section, list(columns), opener=lambda _: port, wait=lambda _: None)


@dataclass
class CanRig(Rig):
    """A `Rig` whose drives are fake ones on buses in memory."""

    positions: Sequence[int] = ()
    ports: dict[str, FakeBus] = field(default_factory=dict)
    drives: list[FakeDrive] = field(default_factory=list)
    make: type[FakeDrive] = FakeDrive
    homed: bool = True

    def __post_init__(self) -> None:
        described = self.machine
        by_bus: dict[str, list[int]] = {}
        for column, axis in enumerate(described.axes):
            port = self.ports.setdefault(axis.drive.bus, FakeBus())
            by_bus.setdefault(axis.drive.bus, []).append(column)
            position = self.positions[column] if self.positions else 0
            self.drives.append(self.make(port, axis.drive.node, position, described.cycle_s))
        buses = [bus_in_memory(described, self.ports[name], columns) for name, columns in by_bus.items()]
        self.executor = VirtualExecutor(described, buses=buses, recorder=self._record, homed=self.homed)
        self.program = self.open(0)

    @property
    def core(self) -> Executor:
        return self.executor.executor


class Bench:
    """One bus without an executor: exchanges by hand."""

    def __init__(
        self, described: Machine, positions: Sequence[int] = (), make: type[FakeDrive] = FakeDrive
    ) -> None:
        self.machine = described
        self.port = FakeBus()
        self.drives = [
            make(self.port, axis.drive.node, positions[column] if positions else 0, described.cycle_s)
            for column, axis in enumerate(described.axes)
        ]
        self.bus = bus_in_memory(described, self.port, range(len(described.axes)))
        self.feedback: Feedback = self.bus.boot()
        self.setpoints = Setpoints.of(len(described.axes))
        self.setpoints.position[:] = self.feedback.position

    def tell(self, mode: DriveMode) -> None:
        self.setpoints.mode[:] = mode

    def exchange(self, cycles: int = 1, *, follow: bool = True) -> None:
        """Setpoints of axes that are not energized are where the encoder is, as the executor has it."""
        for _ in range(cycles):
            if follow:
                free = self.feedback.state != DriveState.ENERGIZED
                np.copyto(self.setpoints.position, self.feedback.position, where=free)
            self.bus.exchange(self.setpoints)


def energized(positions: tuple[int, ...] = (1000,)) -> Bench:
    """A bench whose axes hold where they were."""
    bench = Bench(machine(len(positions)), positions)
    bench.tell(DriveMode.POSITION)
    bench.exchange(20)
    assert set(bench.feedback.state.tolist()) == {DriveState.ENERGIZED}
    return bench
