"""A cell with a drive of each mode over a hub: hub, drives, server and client are four processes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator

import pytest
from mcclient import Machine, ProgramRejected, RequestRefused

from tests.e2e.conftest import connected
from tests.e2e.observing import run
from tests.e2e_can.cell import Cell, running
from tests.e2e_can.machines import HOMED, MIXED, POINTED, mixed

CYCLE_HZ = 100.0
LIMIT_S = 120.0
TO_A_POINT = ["G1010 P3", "G90 G00 [3]42"]


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


async def test_pp_goes_to_a_point_and_is_refused_a_path(machine: Machine) -> None:
    await run(machine, TO_A_POINT, [POINTED])
    assert (await machine.status()).axes.position[POINTED] == pytest.approx(42.0, abs=0.06)
    with pytest.raises((ProgramRejected, RequestRefused)) as refused:
        await run(machine, ["G01 [3]50 F600"], [POINTED])
    assert refused.value.code == "MC138"


async def test_pins_of_a_drive_are_the_machines(machine: Machine, cell: Cell) -> None:
    """An input at 60FDh, an output at 60FEh."""
    assert (await machine.status()).inputs[0].value == 0.0
    cell.drives_of(1).control.fault(1, "inputs", bits=1 << 17)
    async with asyncio.timeout(LIMIT_S):
        async for status in machine.telemetry():
            if status.inputs[0].value == 1.0:
                break
    await machine.set_output("brake", True)
    async with asyncio.timeout(LIMIT_S):
        while cell.drives_of(1).control.state(1)["outputs"] != 1 << 16:
            await asyncio.sleep(0.01)


async def test_an_axis_is_homed_by_the_switch_on_its_drive(machine: Machine) -> None:
    """Bit 2 of 60FDh closes at -20 mm of the encoder, which is 1 mm from now on."""
    await run(machine, [f"G1010 P{HOMED}"], [HOMED])
    async with asyncio.timeout(LIMIT_S):
        await machine.home([HOMED])
        async for status in machine.telemetry():
            if status.axes.homed[HOMED]:
                break
    await run(machine, [f"G90 G00 [{HOMED}]5"], [HOMED])
    assert (await machine.status()).axes.position[HOMED] == pytest.approx(5.0, abs=0.06)


async def test_the_bus_is_scanned_while_the_machine_runs(machine: Machine) -> None:
    [found] = await machine.drives_scan()
    assert [(node.node, node.axis) for node in found.nodes] == [
        (axis + 1, axis) for axis in range(len(MIXED))
    ]
    assert all({"csp", "ip", "cst", "pp"} <= set(node.modes) for node in found.nodes)
    assert found.machine_file.count("[[axis]]") == len(MIXED)
