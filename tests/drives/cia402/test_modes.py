"""Modes of operation of CiA 402 drives, and the rates at which they are driven."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from mcserver.can.cob import SYNC
from mcserver.can.pdo_layout import Mode
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.fault_codes import FaultCode
from tests.drives.can_rig import CanRig, energized, machine
from tests.drives.fake_can import ENABLED
from tests.executor.rig import quintic


def test_g1030_turns_the_axis_in_csv_and_goes_back_to_csp_at_a_rapid() -> None:
    rig = CanRig(machine(1))
    rig.program.capture()
    rig.program.speed({0: 0.05})
    rig.program.dwell(0.3)
    rig.run_until(EventKind.AXIS_DONE)
    rig.step(200)
    drive = rig.drives[0]
    assert (drive.shown, drive.word) == (Mode.CYCLIC_VELOCITY, ENABLED)
    assert drive.speed == 50_000
    assert rig.executor.feedback.actual_velocity[0] == pytest.approx(0.05, rel=1e-3)
    rig.program.rapid({0: 0.0})
    rig.program.wait(1)
    rig.play()
    assert (drive.shown, drive.word) == (Mode.CYCLIC_POSITION, ENABLED)
    assert not rig.of(EventKind.FAULT)
    assert abs(drive.position) <= 1


def test_a_speed_axis_gets_rpdo2_every_cycle_and_rpdo1_often_enough_for_its_time_out() -> None:
    bench = energized()
    bench.setpoints.velocity[:] = 0.01
    bench.tell(DriveMode.VELOCITY)
    bench.exchange(20)
    before = len(bench.port.sent)
    bench.exchange(100)
    identifiers = [cob for cob, _ in bench.port.sent[before:]]
    assert (identifiers.count(0x301), identifiers.count(0x201), identifiers.count(SYNC)) == (100, 10, 100)
    assert identifiers[-1] == SYNC


def test_both_rpdos_go_out_until_the_drive_shows_the_new_mode() -> None:
    bench = energized()
    bench.drives[0].mode_slowness = 8
    bench.tell(DriveMode.VELOCITY)
    before = len(bench.port.sent)
    bench.exchange(8)
    identifiers = [cob for cob, _ in bench.port.sent[before:]]
    assert (identifiers.count(0x201), identifiers.count(0x301)) == (8, 8)
    assert bench.feedback.state[0] == DriveState.ENERGIZED


def test_a_mode_that_never_comes_is_a_fault_after_a_quarter_of_a_second() -> None:
    bench = energized()
    bench.drives[0].mode_slowness = 1 << 30
    bench.tell(DriveMode.VELOCITY)
    bench.exchange(240)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    bench.exchange(20)
    assert (bench.feedback.state[0], bench.feedback.fault[0]) == (DriveState.FAULT, DriveFault.MODE)


def test_g1040_applies_torque_in_per_mille_of_the_rated_one() -> None:
    rig = CanRig(machine(1))
    rig.program.torque({0: 0.5})
    rig.program.dwell(1.0)
    rig.step(50)
    assert (rig.drives[0].shown, rig.drives[0].torque) == (Mode.CYCLIC_TORQUE, 250)
    assert rig.executor.feedback.torque[0] == pytest.approx(0.2)


def test_g1040_without_a_rated_torque_is_refused_before_anything_changes() -> None:
    described = machine(1)
    axis = described.axes[0]
    plain = msgspec.structs.replace(axis, drive=msgspec.structs.replace(axis.drive, rated_torque=0.0))
    rig = CanRig(msgspec.structs.replace(described, axes=(plain,)))
    rig.program.capture()
    rig.program.start_line(4)
    rig.program.torque({0: 0.5})
    fault = rig.run_until(EventKind.FAULT)
    assert (fault.code, fault.axis, fault.line) == (FaultCode.MODE_NOT_CONFIGURED, 0, 4)
    assert rig.drives[0].word == ENABLED


def test_a_csv_drive_follows_a_path_by_a_position_loop_here() -> None:
    rig = CanRig(machine(1, drive='mode = "csv"'), positions=[3000])
    rig.program.capture()
    rig.step(30)
    assert rig.drives[0].shown == Mode.CYCLIC_VELOCITY
    rig.program.position = rig.executor.feedback.setpoint.copy()
    rig.program.start_line(1)
    rig.program.move({0: 0.1}, 400)
    rig.program.wait(1)
    rig.play(line=True)
    assert not rig.of(EventKind.FAULT)
    assert rig.drives[0].position == pytest.approx(100_000, abs=5)
    moving = slice(100, 300)
    # the reading is two cycles behind the setpoint
    late = rig.setpoint[moving, 0] - rig.actual[102:302, 0]
    assert np.abs(late).max() < 5e-5


@pytest.mark.parametrize("cycle_hz", [100.0, 200.0, 500.0])
def test_slow_cycles_follow_a_path_and_change_from_speed_to_position_within_the_limits(
    cycle_hz: float,
) -> None:
    rig = CanRig(machine(2, cycle_hz=cycle_hz))
    program = rig.program
    program.capture()
    rig.step(30)
    program.start_line(1)
    count, end = round(2.0 * cycle_hz), np.array([0.4, 0.2])
    share, slope = quintic(np.arange(1, count + 1) / count)
    program.control(ControlKind.BEGIN, axes=3)
    program.rows(share[:, None] * end, slope[:, None] * end * cycle_hz / count, 3)
    program.control(ControlKind.END, axes=3)
    program.wait(3)
    program.speed({0: 0.2})
    program.dwell(0.5)
    program.rapid({0: 0.0})
    program.wait(3)
    rig.play(line=True)
    assert not rig.of(EventKind.FAULT)
    assert [drive.position for drive in rig.drives] == [0, 200_000]
    acceleration = np.diff(rig.setpoint[:, 0], 2) * cycle_hz**2
    assert np.abs(acceleration).max() <= 1.01 * 10.0
