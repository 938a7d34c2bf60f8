"""Simulated drives on a veth pair, driven by pysoem's master: boot-up, motion, faults and recovery."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from mcserver.canopen.access import OperatorAccess
from mcserver.canopen.views import SdoTarget
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.errors import McError
from mcserver.machine.machine_file import parse_machine
from tests.ethercat.conftest import Start
from tests.ethercat.rig import Cycle, SimulatedLine, line_of

On = tuple[SimulatedLine, Cycle]


@pytest.mark.parametrize("mode", ["csp", "csv"])
def test_drives_are_captured_without_a_jump_and_follow(start: Start, mode: str) -> None:
    line, cycle = start(3, drive=f'mode = "{mode}"\nrated_torque = 1.0')
    assert cycle.feedback.position == pytest.approx([0.0, 0.010, 0.020])
    cycle.command(DriveMode.POSITION, DriveState.ENERGIZED)
    before = [state["position"] for state in line.control.states()]
    assert before == pytest.approx([0, 65536, 131072], abs=2)
    for _ in range(100):
        cycle.setpoints.position[:] += 0.0001
        cycle.setpoints.velocity[:] = 0.01
        cycle.run(1)
    cycle.setpoints.velocity[:] = 0.0
    cycle.run(100)
    assert cycle.feedback.position == pytest.approx(cycle.setpoints.position, abs=2e-5)
    assert {state["al"] for state in line.control.states()} == {"OP"}
    assert not cycle.feedback.fault.any()


def test_drives_are_captured_in_torque_mode(start: Start) -> None:
    """How the loop follows is asked in memory: here a late cycle lets the torque before act on."""
    line, cycle = start(3, drive='mode = "cst"\nrated_torque = 1.0\ninertia = 1e-3\nfriction_decel = 1.0')
    cycle.command(DriveMode.POSITION, DriveState.ENERGIZED)
    assert {state["al"] for state in line.control.states()} == {"OP"}


def test_a_lost_frame_is_ridden_through(energized: On) -> None:
    line, cycle = energized
    line.control.fault(1, "frame_loss", frames=2)
    cycle.run(30)
    assert cycle.feedback.state.tolist() == [DriveState.ENERGIZED] * 3


def test_objects_are_reached_beside_the_cycle_that_is_their_master(energized: On) -> None:
    line, cycle = energized
    access = OperatorAccess(None)
    access.reachable.line = cycle.line
    read: list[object] = []
    refused: list[str] = []
    files: list[str] = []

    async def ask() -> None:
        named = await access.sdo_read(SdoTarget(0x1008, axis=1), None)
        read.append((named.value, named.fieldbus, named.node))
        await access.sdo_write(SdoTarget(0x6065, axis=1), None, 5000)
        read.append((await access.sdo_read(SdoTarget(0x6065, axis=1), None)).value)
        for index in (0x6040, 0x6091, 0x1C12, 0x1C32):
            try:
                await access.sdo_write(SdoTarget(index, axis=1), "u32", 0)
            except McError as error:
                refused.append(error.code)
        read.append(len(await access.listening.health(0.2)))
        trace = await access.listening.scope(1, 0.1)
        read.append(sorted({"607Ah:00", "6064h:00", ""} & {each.object for each in trace.signals}))
        shown = await access.drives()
        read.append([(each.axis, each.node, each.state, each.nmt, each.status) for each in shown])
        (scanned,) = await access.scan("line")
        read.append([(each.node, each.axis, each.what, "csp" in each.modes) for each in scanned.nodes])
        files.append(scanned.machine_file)

    def work() -> int:
        with line.namespace.entered():
            asyncio.run(ask())
        return 0

    cycle.run_beside(work, wanted=0)
    access.close()
    assert read[:4] == [("Simulated servo drive", "ethercat", 1), 5000, 1, ["", "6064h:00", "607Ah:00"]]
    assert read[4] == [(axis, axis, "operational", "op", "operation enabled") for axis in range(3)]
    assert read[5] == [(axis, axis, "drive", True) for axis in range(3)]
    assert [axis.drive.node for axis in parse_machine(files[0]).axes] == [1, 2, 3]
    assert refused == ["MC559"] * 4
    assert access.parameters(1).fieldbus == "ethercat"
    assert access.parameters(1).node == 1
    assert cycle.feedback.state.tolist() == [DriveState.ENERGIZED] * 3


def test_frames_that_stay_out_are_a_bus_that_is_away(start: Start) -> None:
    line, cycle = start(2, silence_cycles=3)
    cycle.energize()
    line.control.fault(1, "frame_loss", frames=300)
    cycle.until(lambda: bool(cycle.feedback.fault.all()), "a fault")
    assert set(cycle.feedback.fault.tolist()) <= {DriveFault.BUS_DOWN, DriveFault.COMMUNICATION}
    assert cycle.feedback.state.tolist() == [DriveState.FAULT] * 2


def test_a_slave_that_exchanges_nothing_is_a_fault_by_the_working_counter(energized: On) -> None:
    line, cycle = energized
    line.control.fault(2, "mute")
    cycle.until(lambda: bool(cycle.feedback.fault.any()), "a fault")
    assert set(cycle.feedback.fault.tolist()) <= {DriveFault.NONE, DriveFault.COMMUNICATION}
    line.control.clear()
    cycle.energize()


def test_a_drive_that_leaves_op_is_named_brought_back_and_not_energized(energized: On) -> None:
    line, cycle = energized
    line.control.fault(2, "safe_op", code=0x1B)
    cycle.until(lambda: bool(cycle.feedback.fault.any()), "a fault")
    assert cycle.feedback.fault.tolist() == [0, DriveFault.NOT_OPERATIONAL, 0]
    cycle.until(lambda: line.control.state(2)["al"] == "OP", "OP again")
    cycle.run(20)
    assert cycle.feedback.state.tolist() == [DriveState.ENERGIZED, DriveState.FAULT, DriveState.ENERGIZED]
    assert line.control.state(2)["power"] != "OPERATION_ENABLED"
    cycle.command(DriveMode.RESET, DriveState.OFF, 1)
    cycle.command(DriveMode.POSITION, DriveState.ENERGIZED, 1)


def test_a_drive_that_is_unplugged_and_plugged_in_is_configured_again(energized: On) -> None:
    line, cycle = energized
    line.control.fault(3, "unplug")
    cycle.until(lambda: bool(cycle.feedback.fault[2]), "a fault")
    cycle.run(50)
    assert cycle.feedback.state.tolist() == [DriveState.ENERGIZED, DriveState.ENERGIZED, DriveState.FAULT]
    line.control.clear(3)
    cycle.until(lambda: line.control.state(3)["al"] == "OP", "OP again")
    cycle.command(DriveMode.RESET, DriveState.OFF, 2)
    before = line.control.state(3)["position"]
    cycle.command(DriveMode.POSITION, DriveState.ENERGIZED, 2)
    assert line.control.state(3)["position"] == pytest.approx(before, abs=2)
    cycle.setpoints.position[2] += 0.0001
    cycle.run(50)
    assert np.abs(cycle.feedback.position - cycle.setpoints.position).max() < 2e-5


@pytest.mark.parametrize("cable", [1, 2], ids=["before the first", "between two"])
def test_a_ring_that_is_cut_goes_on_and_is_closed_again(
    start: Start, caplog: pytest.LogCaptureFixture, cable: int
) -> None:
    line, cycle = start(3, bus='redundant_interface = "ec2"')
    cycle.energize()
    for change, said in (
        (lambda: line.control.fault(cable, "cut"), "open at axis 0"),
        (line.control.clear, "closed"),
    ):
        change()
        cycle.until(lambda said=said: said in caplog.text, said)  # type: ignore[misc]
        cycle.setpoints.position[:] += 0.0001
        cycle.run(50)
        assert cycle.feedback.state.tolist() == [DriveState.ENERGIZED] * 3
        assert np.abs(cycle.feedback.position - cycle.setpoints.position).max() < 2e-5


def test_a_ring_goes_on_without_its_last_drive_and_has_it_back(start: Start) -> None:
    line, cycle = start(3, bus='redundant_interface = "ec2"')
    cycle.energize()
    line.control.fault(3, "unplug")
    cycle.until(lambda: bool(cycle.feedback.fault.any()), "a fault")
    cycle.run(50)
    assert cycle.feedback.state.tolist() == [DriveState.ENERGIZED, DriveState.ENERGIZED, DriveState.FAULT]
    line.control.clear(3)
    cycle.until(lambda: line.control.state(3)["al"] == "OP", "OP again")
    cycle.energize()


def test_drives_that_reboot_or_whose_process_ends_are_latched_and_found_again(start: Start) -> None:
    line, cycle = start(2)
    cycle.energize()
    line.control.fault(2, "sdo_abort", index=0x6060, code=0x06090030)
    line.control.fault(2, "reboot")
    cycle.until(lambda: bool(cycle.feedback.fault[1]), "a fault")
    assert cycle.feedback.fault.tolist() == [0, DriveFault.REBOOTED]
    cycle.run(20)
    assert line.control.state(2)["al"] == "PREOP"
    line.control.clear()
    cycle.until(lambda: line.control.state(2)["al"] == "OP", "OP again")
    cycle.energize()
    line.kill()
    cycle.until(lambda: bool(cycle.feedback.fault.all()), "a fault")
    assert set(cycle.feedback.fault.tolist()) <= {DriveFault.BUS_DOWN, DriveFault.COMMUNICATION}


def test_an_error_of_the_drive_stops_it_with_its_code(energized: On) -> None:
    line, cycle = energized
    line.control.fault(1, "emcy", code=0x2310)
    cycle.until(lambda: bool(cycle.feedback.fault[0]), "a fault")
    assert cycle.feedback.fault.tolist() == [DriveFault.EMERGENCY, 0, 0]
    assert cycle.feedback.detail[0] == 0x2310
    cycle.command(DriveMode.RESET, DriveState.OFF, 0)
    cycle.command(DriveMode.POSITION, DriveState.ENERGIZED, 0)


def test_a_released_drive_gets_no_energy(energized: On) -> None:
    line, cycle = energized
    cycle.setpoints.mode[0] = DriveMode.SILENT
    cycle.until(lambda: line.control.state(1)["power"] != "OPERATION_ENABLED", "off")
    assert cycle.feedback.state[1] == DriveState.ENERGIZED


def test_a_second_master_is_refused_before_it_resets_anything(energized: On) -> None:
    line, cycle = energized
    refused: list[str] = []

    def second() -> int:
        with pytest.raises(McError) as error:
            Cycle(line.namespace, line_of(3))
        refused.append(error.value.code)
        return 0

    cycle.run_beside(second, wanted=0)
    assert refused == ["MC560"]
    assert cycle.feedback.state.tolist() == [DriveState.ENERGIZED] * 3


def test_a_drive_with_profiles_of_its_own_goes_to_points(start: Start) -> None:
    line, cycle = start(1, drive='mode = "pp"')
    cycle.energize()
    cycle.setpoints.goal[:] = 0.005
    cycle.setpoints.goal_speed[:] = 0.05
    cycle.until(lambda: abs(cycle.feedback.position[0] - 0.005) < 2e-5, "at its goal")
    assert line.control.state(1)["mode"] == 1


def test_a_mode_is_changed_under_way(start: Start) -> None:
    line, cycle = start(1, drive="rated_torque = 1.0")
    cycle.energize()
    cycle.setpoints.velocity[:] = 0.02
    cycle.command(DriveMode.VELOCITY, DriveState.ENERGIZED)
    cycle.until(lambda: abs(cycle.feedback.velocity[0] - 0.02) < 2e-3, "at speed")
    assert line.control.state(1)["mode"] == 9
    cycle.setpoints.velocity[:] = 0.0
    cycle.until(lambda: abs(cycle.feedback.velocity[0]) < 1e-4, "at rest")
    assert not cycle.feedback.fault.any()
