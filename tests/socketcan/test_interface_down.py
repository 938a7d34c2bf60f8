"""An interface goes down under a motion, and comes back: what the drives and the server make of it."""

from __future__ import annotations

from typing import Any

import pytest

from tests.e2e.observing import run
from tests.e2e_can.bench import GROUP, LINE, START
from tests.e2e_can.disturbances import ON_ITS_BUS, Disturbance
from tests.e2e_can.faults import bench, disturb
from tests.e2e_can.signs import NoFrames
from tests.socketcan.interfaces import BUSES, set_up

# an emulated machine is several times slower
CYCLE_HZ = 50.0


def lower(_: Any) -> None:
    set_up(BUSES[0], False)


def lift(_: Any) -> None:
    set_up(BUSES[0], True)


@pytest.mark.timeout(900)
async def test_an_interface_that_goes_down_stops_the_group_and_the_axes_come_back_without_a_jump() -> None:
    gone = Disturbance("interface down", lower, lift, NoFrames(), concerned=ON_ITS_BUS, returns="bus.back")
    try:
        async with bench(CYCLE_HZ, BUSES[:2], patient=True) as made:
            await run(made.machine, START, list(GROUP))
            outcome = await disturb(made, gone)
    finally:
        set_up(BUSES[0], True)
    assert (outcome.code, outcome.line, outcome.latch) == ("MC429", LINE, "MC412")
    assert outcome.axis in ON_ITS_BUS
    assert outcome.reported is not None
    assert outcome.braked == outcome.reported + 1
    assert outcome.recovered
    assert outcome.jump == 0
