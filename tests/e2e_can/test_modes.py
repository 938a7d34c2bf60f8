"""Drives of each mode on one bus behind one server: hub, drives, server and client are four processes."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterator

import pytest
from mcclient import Machine

from tests.e2e.conftest import connected
from tests.e2e_can import modes
from tests.e2e_can.cell import Cell, running
from tests.e2e_can.machines import MIXED, mixed

CYCLE_HZ = 200.0


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    nodes = [range(1, len(MIXED) + 1)]
    folder = tmp_path_factory.mktemp("modes")
    with running(folder, lambda addresses: mixed(addresses, CYCLE_HZ), channels=1, processes=nodes) as made:
        yield made


@pytest.fixture
async def machine(cell: Cell) -> AsyncIterator[Machine]:
    async with connected(cell.server) as made:
        yield made


async def test_csp_ip_and_cst_go_one_path(machine: Machine) -> None:
    await modes.goes_its_path_on_three_kinds_of_loops(machine, lag_mm=2.0)


async def test_pp_goes_to_a_point_and_is_refused_a_path(machine: Machine) -> None:
    await modes.goes_to_a_point_and_follows_no_path(machine)


async def test_pins_of_a_drive_are_the_machines(machine: Machine, cell: Cell) -> None:
    await modes.has_the_pins_of_its_drives(machine, cell)


async def test_an_axis_is_homed_by_the_switch_on_its_drive(machine: Machine) -> None:
    await modes.homes_by_the_switch_on_its_drive(machine)


async def test_the_bus_is_scanned_while_the_machine_runs(machine: Machine) -> None:
    await modes.knows_who_is_on_its_bus(machine)
