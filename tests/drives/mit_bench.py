"""A motor in MIT mode on a bus in memory: the simulated one, and the bus of the executor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Self

from mcserver.can.port import recipient
from mcserver.drive_sim.from_machine import build_node
from mcserver.drive_sim.streamed_node import BOOT_S
from mcserver.drives.bus import DriveMode, DriveState, Setpoints
from mcserver.drives.can_bus import CanBus
from mcserver.machine.machine_file import Machine, parse_machine
from tests.drives.fake_can import FakeBus

CYCLE_S = 1e-3
TRAVEL = "min_position = -180.0\nmax_position = 180.0\n"


def mit_machine(kind: str, drive: str, axis: str = TRAVEL) -> Machine:
    """One joint whose motor has number 3."""
    return parse_machine(
        '[machine]\nname = "m"\n[[axis]]\nindex = 0\ntype = "rotary"\nmax_velocity = 360.0\n'
        f"max_acceleration = 3600.0\nmax_following_error = 20.0\n{axis}"
        f'[axis.drive]\nkind = "{kind}"\nbus = "can0"\nnode = 3\ncommand_timeout_ms = 20\n{drive}'
    )


@dataclass
class MitBench:
    """A bus and its motor, exchange by exchange.

    Attributes:
        described: one rotary axis. angle: of its motor when power comes [deg].
        stored: what the motor has then.
    """

    described: Machine
    angle: float = 0.0
    stored: dict[Any, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.now = 0.0
        self.port = FakeBus()
        self.motor: Any = build_node(self.described, self.described.axes[0], self._answer, self.angle / 360.0)
        self.motor._stored.update(self.stored)
        self.motor.switch_on(0.0)
        self.pass_time(2.0 * BOOT_S)
        self.port.nodes.append(self)  # type: ignore[arg-type]
        self.bus = CanBus(
            self.described,
            self.described.buses[0],
            [0],
            opener=lambda _address: self.port,
            wait=self.pass_time,
        )
        self.setpoints = Setpoints.of(1)

    def boot(self) -> Self:
        self.feedback = self.bus.boot()
        return self

    def _answer(self, identifier: int, payload: bytes) -> None:
        self.port.waiting.append((identifier, payload))

    def receive(self, identifier: int, payload: bytes) -> None:
        if recipient(identifier) in self.motor.identifiers():
            self.motor.receive(identifier, payload, self.now)

    def tick(self) -> None:
        """As a node of `FakeBus`: the motor speaks only when it is spoken to."""

    def pass_time(self, seconds: float) -> None:
        end = self.now + seconds
        while self.motor.wake <= end:
            self.now = max(self.now, self.motor.wake)
            self.motor.poll(self.now)
        self.now = end

    def exchange(self, mode: DriveMode, cycles: int = 1, **values: float) -> None:
        self.setpoints.mode[:] = mode
        for name, value in values.items():
            getattr(self.setpoints, name)[:] = value
        for _ in range(cycles):
            if self.feedback.state[0] != DriveState.ENERGIZED:
                self.setpoints.position[:] = self.feedback.position
            self.bus.exchange(self.setpoints)
            self.pass_time(CYCLE_S)

    def energize(self) -> Self:
        self.exchange(DriveMode.POSITION, 30)
        assert self.state is DriveState.ENERGIZED
        return self

    @property
    def state(self) -> DriveState:
        return DriveState(int(self.feedback.state[0]))

    @property
    def degrees(self) -> float:
        return math.degrees(float(self.feedback.position[0]))
