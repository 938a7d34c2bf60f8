"""What the cycle watches of nodes besides process data, without a bus."""

from __future__ import annotations

import pytest

from mcserver.can.cob import Function, NmtState
from mcserver.drives.bus import DriveFault
from mcserver.drives.node_watch import NodeWatch
from tests.drives.can_rig import machine


class Latches:
    """Takes every fault."""

    def __init__(self) -> None:
        self.faults: list[DriveFault] = []

    def fail(self, index: int, fault: DriveFault, detail: int = 0) -> bool:
        del index, detail
        self.faults.append(fault)
        return True

    def restart(self, index: int) -> None:
        del index


@pytest.mark.parametrize(
    ("period", "seen"), [(0, [DriveFault.REBOOTED]), (100, [DriveFault.REBOOTED, DriveFault.HEARTBEAT])]
)
def test_a_drive_without_heartbeat_that_has_rebooted_is_not_missed(
    period: int, seen: list[DriveFault]
) -> None:
    axes = machine(1, drive=f"heartbeat_ms = {period}").axes
    latches = Latches()
    watch = NodeWatch(axes, [0], latches, 0.001)
    watch.handlers()[Function.HEARTBEAT + 1](bytes((NmtState.BOOT_UP,)))
    for _ in range(1000):
        watch.look()
    assert list(dict.fromkeys(latches.faults)) == seen
