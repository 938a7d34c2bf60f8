"""Programs on CANopen drives over real interfaces: drives, server and client in three processes."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from tests.e2e.conftest import connected
from tests.e2e.observing import run
from tests.e2e_can.bench import GROUP, LINE, START, Bench
from tests.e2e_can.cell import running
from tests.e2e_can.disturbances import ON_ITS_BUS, Disturbance
from tests.e2e_can.faults import bench, disturb
from tests.e2e_can.machines import dog, slides
from tests.e2e_can.programs import arcs, assert_as_ideal, gait, on_ideal_drives, on_the_bus
from tests.e2e_can.signs import NoFrames
from tests.socketcan.interfaces import BUSES, set_up

# an emulated machine is several times slower
CYCLE_HZ = 50.0
LIMIT_S = 900

SHORT = "G1010 P0\nG91 G94 F3000\nG01 X10\nG04 P0.2\nG1050\n"

pytestmark = [pytest.mark.timeout(LIMIT_S), pytest.mark.asyncio(loop_scope="module")]


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def made(socketcan: None) -> AsyncIterator[Bench]:  # noqa: ARG001
    """One server on two buses for the short ones: its start is most of what they take."""
    async with bench(CYCLE_HZ, BUSES[:2], patient=True) as started:
        yield started


async def test_one_short_move_is_true(made: Bench) -> None:
    moved = await on_the_bus(made.machine, SHORT)
    assert moved.end[0] == pytest.approx(moved.setpoint[0, 0] + 10.0, abs=0.06)
    assert_as_ideal(moved, on_ideal_drives(SHORT, made.cell.raw), within=0.05, lag=2.0)


async def test_the_buses_are_scanned_while_the_machine_runs(made: Bench) -> None:
    found = await made.machine.drives_scan()
    assert [(node.node, node.axis) for bus in found for node in bus.nodes] == [(1, 0), (2, 1), (3, 2), (4, 3)]


def lower(_: Any) -> None:
    set_up(BUSES[0], False)


def lift(_: Any) -> None:
    set_up(BUSES[0], True)


async def test_an_interface_that_goes_down_stops_the_group_and_the_axes_come_back_without_a_jump(
    made: Bench,
) -> None:
    gone = Disturbance("interface down", lower, lift, NoFrames(), concerned=ON_ITS_BUS, returns="bus.back")
    try:
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
