"""A drive in memory that takes torques alone: a mass of second order between two SYNCs."""

from __future__ import annotations

import math

from mcserver.can.pdo_layout import Mode
from mcserver.machine.machine_file import Machine
from tests.drives.can_rig import COUNTS, Bench, machine
from tests.drives.fake_can import ENABLED, FakeBus, FakeDrive

RATED, INERTIA = 2.0, 2e-4
CST = f'mode = "cst"\ninertia = {INERTIA}\n'
PARTS = 10


class TorqueDrive(FakeDrive):
    """Follows 6071h in mode 10, in which it does nothing else.

    Attributes:
        inertia: that the motor turns [kg·m²]. load: torque that acts on the shaft besides [N·m]. friction:
            against its motion [N·m·s/rad]. sign: -1.0: wired the wrong way round. permille: 6071h of each
            SYNC. most: 6072h. held: it has a brake, which closes without power.
    """

    def __init__(self, bus: FakeBus, node: int, position: int = 0, cycle_s: float = 1e-3) -> None:
        super().__init__(bus, node, position, cycle_s)
        self.inertia, self.load, self.friction, self.sign, self.most = INERTIA, 0.0, 0.0, 1.0, 32767
        self.held = True
        self.permille: list[int] = []
        self.rate = 0.0  # of the shaft [rad/s]
        self._acting = 0

    def _sync(self) -> None:
        super()._sync()
        # what came before this SYNC acts until the next one
        self._acting = max(-self.most, min(self.most, self.torque))
        self.permille.append(self.torque)

    def _move(self) -> None:
        enabled = self.word == ENABLED
        if self.jammed or (self.held and not enabled):
            self.rate = 0.0
            return
        driven = enabled and self.shown == Mode.CYCLIC_TORQUE
        applied = self.sign * self._acting * RATED / 1000.0 if driven else 0.0
        part = self.cycle_s / PARTS
        for _ in range(PARTS):
            before = self.rate
            self.rate += (applied + self.load - self.friction * self.rate) / self.inertia * part
            self.exact += 0.5 * (before + self.rate) * part / (2.0 * math.pi) * COUNTS
        self.position = round(self.exact)


def torque_machine(drive: str = "", axis: str = "max_following_error = 2.0") -> Machine:
    return machine(1, drive=CST + drive, axis=axis)


def torque_bench(drive: str = "", axis: str = "max_following_error = 2.0") -> Bench:
    return Bench(torque_machine(drive, axis), (1000,), TorqueDrive)
