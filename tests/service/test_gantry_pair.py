"""The two drives of a gantry pair through the service: one lease, one home, one jog."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.drives.simulated import SimulatedBus
from mcserver.machine.machine_file import Machine
from mcserver.net.status import EdgeUnits, machine_status
from mcserver.service.program_options import ProgramOptions
from mcserver.service.servo import close_targets, open_servo, put_targets, streamed
from mcserver.service.target_stream import TargetMessage
from tests.executor.test_gantry import switched
from tests.service.virtual_cell import VirtualCell, refused

MM = 1e-3


def machine() -> Machine:
    return switched(-40.0, -40.1)


async def test_whoever_names_one_drive_has_both(cell: VirtualCell) -> None:
    program = await cell.ended(await cell.homing.home("test", [3]))
    assert (program.state, program.axes) == ("finished", (1, 3))
    assert cell.homed() == [True] * 3
    program = await cell.service.open("test", ProgramOptions(axes=[1]))
    assert program.axes == (1, 3)
    await cell.service.lines.submit("test", program.program, 1, ["G1010", "G1 Y60 F6000", "G0 Y40"])
    cell.service.lines.close("test", program.program)
    assert (await cell.ended(program)).state == "finished"
    assert [cell.position(column) / MM for column in (1, 2)] == pytest.approx([40.0, 40.0], abs=1e-3)


async def test_a_jog_of_the_leader_moves_both_and_one_of_the_second_drive_is_refused(
    cell: VirtualCell,
) -> None:
    assert (await cell.ended(await cell.jog(1, 5.0, 20.0))).state == "finished"
    assert [cell.position(column) / MM for column in (1, 2)] == pytest.approx([5.0, 5.0], abs=1e-3)
    assert await refused(cell, lambda _: cell.jog(3, 5.0, 20.0)) == "MC507"


async def test_a_stream_has_one_target_for_a_pair(cell: VirtualCell) -> None:
    await cell.ended(await cell.homing.home("test", [3]))
    program = await open_servo(cell.service, "test", [3], "")
    assert program.axes == (1, 3)
    assert streamed(cell.service.machine, program.axes) == [1]
    await cell.until(lambda: program.state == "running")
    start = cell.position(1)
    message = TargetMessage(1, 0.0, 2.0, np.array([[start + 5.0 * MM]]), None, None)
    put_targets(cell.service, program, message)
    await cell.until(lambda: cell.position(1) > start + 4.0 * MM)
    assert abs(cell.position(2) - cell.position(1)) < 0.05 * MM
    close_targets(cell.service, program)
    assert (await cell.ended(program)).state == "finished"


async def test_the_status_tells_the_skew(cell: VirtualCell) -> None:
    bus = cell.executor.buses[0]
    assert isinstance(bus, SimulatedBus)
    assert machine_status(cell.service, EdgeUnits(cell.service.machine)).axes.skew == [0.0, 0.0, 0.0]
    bus.push(2, 20.0 * MM)
    await cell.until(lambda: cell.position(2) > 0.3 * MM)
    axes = machine_status(cell.service, EdgeUnits(cell.service.machine)).axes
    assert axes.skew == [0.0, 0.0, axes.position[2] - axes.position[1]]
