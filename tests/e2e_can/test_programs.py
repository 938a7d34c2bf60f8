"""Programs on twelve CANopen drives over a hub: hub, drives, server and client are four processes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.e2e.conftest import connected
from tests.e2e_can.cell import running
from tests.e2e_can.machines import dog, slides
from tests.e2e_can.programs import arcs, assert_as_ideal, gait, on_ideal_drives, on_the_bus

CYCLE_HZ = 100.0
BUSES = 4
# of the arcs; at their size: tests/socketcan
SCALE = 0.25


async def test_the_dog_walks_on_twelve_drives_as_on_ideal_ones(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    with running(tmp_path, lambda addresses: dog(addresses, CYCLE_HZ), channels=BUSES) as cell:
        async with connected(cell.server) as machine:
            walked = await on_the_bus(machine, gait())
    assert_as_ideal(walked, on_ideal_drives(gait(), cell.raw), within=0.01, lag=0.5)


async def test_the_arcs_are_true_on_twelve_drives_of_one_bus(tmp_path: Path) -> None:
    with running(tmp_path, lambda addresses: slides(addresses, CYCLE_HZ), channels=1) as cell:
        async with connected(cell.server) as machine:
            moved = await on_the_bus(machine, arcs(SCALE))
    assert_as_ideal(moved, on_ideal_drives(arcs(SCALE), cell.raw), within=0.01, lag=0.5)
