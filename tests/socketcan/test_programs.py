"""Programs on twelve CANopen drives over real interfaces: drives, server and client in three processes."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
from mcclient import Machine

from tests.e2e.conftest import connected
from tests.e2e_can import modes
from tests.e2e_can.cell import Cell, running
from tests.e2e_can.machines import MIXED, dog, mixed, slides
from tests.e2e_can.programs import arcs, assert_as_ideal, gait, on_ideal_drives, on_the_bus
from tests.socketcan.interfaces import BUSES

# an emulated machine is several times slower
CYCLE_HZ = 50.0
LIMIT_S = 900

SHORT = "G1010 P0\nG91 G94 F3000\nG01 X10\nG04 P0.2\nG1050\n"

pytestmark = pytest.mark.timeout(LIMIT_S)


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory, socketcan: None) -> Iterator[Cell]:  # noqa: ARG001
    """One server for the short ones, with a drive of each mode: its start is most of what they take."""
    nodes = [range(1, len(MIXED) + 1)]
    folder = tmp_path_factory.mktemp("modes")
    with running(
        folder, lambda addresses: mixed(addresses, CYCLE_HZ), interfaces=BUSES[:1], processes=nodes
    ) as made:
        yield made


@pytest.fixture
async def machine(cell: Cell) -> AsyncIterator[Machine]:
    async with connected(cell.server) as made:
        yield made


async def test_one_short_move_is_true_on_one_bus(machine: Machine, cell: Cell) -> None:
    moved = await on_the_bus(machine, SHORT)
    assert moved.end[0] == pytest.approx(moved.setpoint[0, 0] + 10.0, abs=0.06)
    assert_as_ideal(moved, on_ideal_drives(SHORT, cell.raw), within=0.05, lag=2.0)


async def test_pp_goes_to_a_point_and_is_refused_a_path(machine: Machine) -> None:
    await modes.goes_to_a_point_and_follows_no_path(machine)


async def test_pins_of_a_drive_are_the_machines(machine: Machine, cell: Cell) -> None:
    await modes.has_the_pins_of_its_drives(machine, cell)


async def test_an_axis_is_homed_by_the_switch_on_its_drive(machine: Machine) -> None:
    await modes.homes_by_the_switch_on_its_drive(machine)


async def test_the_bus_is_scanned_while_the_machine_runs(machine: Machine) -> None:
    await modes.knows_who_is_on_its_bus(machine)


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
