"""Programs on twelve CANopen drives over real interfaces: drives, server and client in three processes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.e2e.conftest import connected
from tests.e2e_can.cell import running
from tests.e2e_can.machines import dog, slides
from tests.e2e_can.programs import arcs, assert_as_ideal, gait, on_ideal_drives, on_the_bus
from tests.socketcan.interfaces import BUSES

# an emulated machine is several times slower
CYCLE_HZ = 50.0
LIMIT_S = 900

SHORT = "G1010 P0\nG91 G94 F3000\nG01 X10\nG04 P0.2\nG1050\n"

pytestmark = pytest.mark.timeout(LIMIT_S)


async def test_one_short_move_is_true_on_one_bus(tmp_path: Path) -> None:
    with running(tmp_path, lambda addresses: slides(addresses, CYCLE_HZ), interfaces=BUSES[:1]) as cell:
        async with connected(cell.server) as machine:
            moved = await on_the_bus(machine, SHORT)
    assert moved.end[0] == pytest.approx(moved.setpoint[0, 0] + 10.0, abs=0.06)
    assert_as_ideal(moved, on_ideal_drives(SHORT, cell.raw), within=0.05, lag=2.0)


@pytest.mark.long
async def test_the_dog_walks_on_four_buses_as_on_ideal_drives(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    with running(tmp_path, lambda addresses: dog(addresses, CYCLE_HZ), interfaces=BUSES) as cell:
        async with connected(cell.server) as machine:
            walked = await on_the_bus(machine, gait())
    assert_as_ideal(walked, on_ideal_drives(gait(), cell.raw), within=0.05, lag=2.0)


@pytest.mark.long
async def test_the_arcs_are_true_on_one_bus(tmp_path: Path) -> None:
    with running(tmp_path, lambda addresses: slides(addresses, CYCLE_HZ), interfaces=BUSES[:1]) as cell:
        async with connected(cell.server) as machine:
            moved = await on_the_bus(machine, arcs())
    assert_as_ideal(moved, on_ideal_drives(arcs(), cell.raw), within=0.05, lag=2.0)
