"""What a cell with a drive of each mode has to do, on whatever buses it is."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest
from mcclient import Machine, ProgramRejected, RequestRefused

from tests.e2e.observing import run
from tests.e2e_can.cell import Cell
from tests.e2e_can.machines import HOMED, MIXED, POINTED
from tests.e2e_can.programs import on_the_bus

LIMIT_S = 120.0
PATH = (0, 1, 2)
# 10 mm of path in three axes: csp, ip and cst go it together
ALONG = "G1010 P0\nG1010 P1\nG1010 P2\nG91 G94 F1200\nG01 X6 Y6 Z5\nG04 P0.2\n"
TO_A_POINT = ["G1010 P3", "G90 G00 [3]42"]


async def goes_its_path_on_three_kinds_of_loops(machine: Machine, lag_mm: float) -> None:
    """The drives of csp and ip follow as closely as they can, the loop of cst within ``lag_mm``."""
    start = np.array((await machine.status()).axes.position)[list(PATH)]
    moved = await on_the_bus(machine, ALONG)
    gone = moved.setpoint[-1, : len(PATH)] - moved.setpoint[0, : len(PATH)]
    assert gone == pytest.approx([6.0, 6.0, 5.0], abs=1e-6)
    assert moved.setpoint[0, : len(PATH)] == pytest.approx(start, abs=0.1)
    behind = np.abs(moved.actual - moved.setpoint).max(axis=0)
    assert behind[2] < lag_mm, f"the torque loop is {behind[2]:.3f} mm behind"
    # within its in_position
    assert moved.end[2] == pytest.approx(moved.setpoint[-1, 2], abs=1.2)
    assert moved.end[:2] == pytest.approx(moved.setpoint[-1, :2], abs=0.06)


async def goes_to_a_point_and_follows_no_path(machine: Machine) -> None:
    """The drive of pp: G00 by acknowledged set-points, G01 refused."""
    await run(machine, TO_A_POINT, [POINTED])
    assert (await machine.status()).axes.position[POINTED] == pytest.approx(42.0, abs=0.06)
    with pytest.raises((ProgramRejected, RequestRefused)) as refused:
        await run(machine, ["G01 [3]50 F600"], [POINTED])
    assert refused.value.code == "MC138"


async def has_the_pins_of_its_drives(machine: Machine, cell: Cell) -> None:
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


async def homes_by_the_switch_on_its_drive(machine: Machine) -> None:
    """Bit 2 of 60FDh closes at -20 mm of the encoder, which is 1 mm from now on."""
    await run(machine, [f"G1010 P{HOMED}"], [HOMED])
    async with asyncio.timeout(LIMIT_S):
        await machine.home([HOMED])
        async for status in machine.telemetry():
            if status.axes.homed[HOMED]:
                break
    await run(machine, [f"G90 G00 [{HOMED}]5"], [HOMED])
    assert (await machine.status()).axes.position[HOMED] == pytest.approx(5.0, abs=0.06)


async def knows_who_is_on_its_bus(machine: Machine) -> None:
    """`mcctl drives scan`."""
    [found] = await machine.drives_scan()
    assert [(node.node, node.axis) for node in found.nodes] == [
        (axis + 1, axis) for axis in range(len(MIXED))
    ]
    assert all({"csp", "ip", "cst", "pp"} <= set(node.modes) for node in found.nodes)
    assert found.machine_file.count("[[axis]]") == len(MIXED)
