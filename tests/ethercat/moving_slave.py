"""A slave in memory that is moved by torques or speeds, and a line of two of them."""

from __future__ import annotations

import math
from typing import ClassVar

from tests.drives.fake_can import ENABLED
from tests.ethercat.memory_line import LineRig, MemorySlave, line_rig

CYCLE_S, COUNTS = 1e-3, 65536
RATED, INERTIA = 2.0, 2e-4
CST = f'mode = "cst"\nrated_torque = {RATED}\ninertia = {INERTIA}\n'
CSV = 'mode = "csv"\n'


class MovingSlave(MemorySlave):
    """A motor by its torque or its speed: what came with a frame acts until the next one."""

    inertia: ClassVar[float] = INERTIA
    sign: ClassVar[float] = 1.0
    exact: float | None = None
    rate = 0.0  # of the shaft [rad/s]

    def exchange(self) -> None:
        if self.exact is None:
            self.exact = float(self.objects[0x6064, 0])
        before = self.rate
        mode = self.objects[0x6060, 0] if self.word == ENABLED and not self.jammed else 0
        if mode == 10:
            torque = self.sign * self.objects[0x6071, 0] * RATED / 1000.0
            self.rate += torque / self.inertia * CYCLE_S
        elif mode == 9:
            self.rate = before = self.objects[0x60FF, 0] * 2.0 * math.pi / COUNTS
        else:
            self.rate = before = 0.0
        self.exact += 0.5 * (before + self.rate) * CYCLE_S / (2.0 * math.pi) * COUNTS
        self.objects[0x6064, 0] = round(self.exact)
        super().exchange()

    def _follow(self) -> None:
        pass


def rig_of(drive: str, **motor: float) -> LineRig:
    return line_rig(drive, type("Motor", (MovingSlave,), motor))
