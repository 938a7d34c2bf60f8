"""G1000, G1001, G1002, G1010, G1011, and exact stop (D-34, D-40)."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.drives.simulated import SimulatedBus
from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.shm.feedback import AxisCondition
from mcserver.motion.canonical import AxisOperation
from tests.executor.rig import CYCLE_S, Rig, machine


def simulated(**more: object) -> Rig:
    return Rig(machine(drive="simulated", **more))  # type: ignore[arg-type]


def test_capture_costs_ideal_drives_no_time() -> None:
    rig = Rig(machine())
    rig.program.start_line(1)
    rig.program.capture()
    rig.program.end_line()
    rig.program.start_line(2)
    rig.program.move({0: 0.01}, 20)
    rig.play(line=True)
    assert rig.time_of(EventKind.LINE_END, 1) == 0.0
    assert rig.time_of(EventKind.LINE_END, 2) == pytest.approx(0.02)


def test_capture_waits_until_a_simulated_drive_holds() -> None:
    rig = simulated()
    rig.program.start_line(1)
    rig.program.capture()
    rig.play(line=True)
    assert 0.0 < rig.time_of(EventKind.LINE_END, 1) <= 2 * CYCLE_S
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.HOLDING] * 2


def test_capture_takes_the_encoder_as_setpoint_without_a_jump() -> None:
    keys = "initial_position = 12.3456\nencoder_resolution = 0.01"
    rig = simulated(axis="in_position = 0.1", drive_keys=keys)
    rig.program.capture()
    rig.play()
    rig.step(20)
    assert np.ptp(rig.actual, axis=0) == pytest.approx([0.0, 0.0])
    assert rig.setpoint[-1] == pytest.approx(rig.actual[-1])
    assert rig.setpoint[-1, 0] == pytest.approx(0.01235)


def test_capture_does_nothing_to_an_energized_axis() -> None:
    rig = simulated()
    rig.program.rapid({0: 0.1})
    rig.program.wait(1)
    rig.program.capture()
    rig.play()
    assert rig.setpoint[-1, 0] == 0.1


def test_a_coasting_axis_is_braked_within_its_limits_as_it_is_captured() -> None:
    rig = simulated(travel=None)
    program = rig.program
    program.speed({0: 0.5})
    program.dwell(0.2)
    program.axis(AxisOperation.OFF, 1)
    program.dwell(0.01)
    program.capture(1)
    rig.play()
    rig.step(50)
    # off after 201 cycles, when the setpoint becomes the encoder's reading
    assert np.abs(np.diff(rig.actual[205:, 0], 2)).max() / CYCLE_S**2 <= 1.2 * 10.0
    assert np.abs(rig.acceleration()[205:]).max() <= 1.05 * 10.0
    assert np.abs(np.diff(rig.actual[-10:, 0])).max() < 1e-9


def test_axis_operations_act_once_motion_before_them_has_ended() -> None:
    rig = Rig(machine())
    rig.program.rapid({0: 0.5})
    rig.program.start_line(2)
    rig.program.axis(AxisOperation.OFF)
    rig.play(line=True)
    assert rig.setpoint[-1, 0] == 0.5
    assert rig.time_of(EventKind.AXIS_DONE, 2) == pytest.approx(0.6, abs=0.0015)
    assert rig.executor.executor.bank.energized == 0


def test_off_lets_an_axis_coast_and_its_setpoint_is_the_encoder() -> None:
    rig = simulated(travel=None, drive_keys="friction_decel = 2000.0")
    program = rig.program
    program.speed({0: 0.5})
    program.dwell(0.2)
    program.axis(AxisOperation.OFF)
    rig.play()
    rig.step(400)
    coasting = np.diff(rig.actual[250:350, 0], 2) / CYCLE_S**2
    assert coasting == pytest.approx(-2.0, abs=1e-6)
    assert np.array_equal(rig.setpoint[-100:], rig.actual[-100:])


def test_stop_brings_the_axis_to_rest_before_the_program_goes_on() -> None:
    rig = simulated(travel=None)
    program = rig.program
    program.speed({0: 0.5})
    program.dwell(0.2)
    program.start_line(3)
    program.axis(AxisOperation.STOP)
    rig.play(line=True)
    assert rig.time_of(EventKind.LINE_END, 3) - rig.time_of(EventKind.LINE_START, 3) == pytest.approx(
        0.05, abs=0.005
    )
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.OFF] * 2
    assert abs(rig.executor.feedback.actual_velocity[0]) == 0.0


@pytest.mark.parametrize("brake", [False, True])
def test_a_released_drive_times_out_by_itself(brake: bool) -> None:
    keys = f"heartbeat_timeout_s = 0.05\nbrake = {str(brake).lower()}\nfriction_decel = 100.0"
    rig = simulated(travel=None, drive_keys=keys)
    program = rig.program
    program.capture()
    program.axis(AxisOperation.RELEASE)
    rig.play()
    rig.step(10)
    bus = rig.executor.buses[0]
    assert isinstance(bus, SimulatedBus)
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.RELEASED] * 2
    assert rig.executor.executor.bank.states.tolist() == [2, 2]
    rig.step(50)
    assert rig.executor.executor.bank.states.tolist() == [0, 0]
    # a push in an instant
    bus.push(0, 0.05)
    rig.step(1000)
    moved = abs(rig.actual[-1, 0])
    slowing = 10.0 if brake else 0.1
    assert moved == pytest.approx(0.5 * 0.05**2 / slowing, rel=0.2)


def test_reset_ends_the_capture() -> None:
    rig = simulated()
    rig.program.capture()
    rig.program.axis(AxisOperation.RESET, 1)
    rig.play()
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.OFF, AxisCondition.HOLDING]


def test_exact_stop_costs_ideal_drives_no_cycle() -> None:
    rig = Rig(machine())
    program = rig.program
    program.capture()
    for line, target in enumerate((0.1, 0.0, 0.2, -0.1), start=1):
        program.start_line(line)
        program.move({0: target}, 300)
        program.wait(1)
        program.end_line()
    rig.play()
    ends = [rig.time_of(EventKind.LINE_END, line) for line in range(1, 5)]
    assert ends == pytest.approx([0.3, 0.6, 0.9, 1.2], abs=1e-12)


def test_exact_stop_of_simulated_drives_takes_a_few_cycles_and_is_within_tolerance() -> None:
    rig = simulated(jerk=200000.0)
    program = rig.program
    program.start_line(1)
    program.rapid({0: 0.5})
    program.wait(1)
    program.end_line()
    end = rig.run_until(EventKind.LINE_END)
    ideal = 0.001 + 0.1 + 0.05 + 0.5
    assert ideal <= end.time <= ideal + 0.010
    assert np.abs(rig.actual[-3:, 0] - 0.5).max() <= 1e-5


def test_exact_stop_wants_the_encoder_in_tolerance_for_the_configured_cycles() -> None:
    # a slow loop, so that the encoder arrives after the setpoint
    slow = "bandwidth_hz = 5.0"
    rig = simulated(drive_keys=slow, motion="exact_stop_cycles = 7")
    program = rig.program
    program.start_line(1)
    program.rapid({0: 0.3})
    program.wait(1)
    program.end_line()
    rig.run_until(EventKind.LINE_END)
    within = np.abs(rig.actual[:, 0] - 0.3) <= 1e-5
    assert within[-7:].all()
    assert not within[-8]


def test_exact_stop_past_its_time_out_names_the_axis() -> None:
    rig = simulated(axis="in_position = 0.0001", drive_keys="encoder_resolution = 0.05")
    program = rig.program
    program.start_line(6)
    program.rapid({0: 0.1, 1: 0.10003})
    program.wait(3, seconds=0.2)
    program.end_line()
    fault = rig.run_until(EventKind.FAULT)
    rig.run()
    assert (fault.code, fault.axis, fault.line) == (402, 1, 6)
    assert fault.values == pytest.approx((2e-5, 1e-7), abs=1e-6)
    assert not rig.of(EventKind.LINE_END)


def test_the_time_out_of_an_exact_stop_does_not_run_in_feed_hold_nor_in_motion() -> None:
    rig = simulated()
    program = rig.program
    program.rapid({0: 0.9})
    program.wait(1, seconds=0.05)
    program.finish()
    rig.step(400)
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(500)
    rig.executor.mailbox.resume(0)
    rig.run()
    assert not rig.of(EventKind.FAULT)


def test_settle_tells_setpoints_and_encoders() -> None:
    rig = simulated(drive_keys="initial_position = 3.0")
    rig.program.capture(1)
    rig.program.control(ControlKind.SETTLE, axes=3, token=5)
    settled = rig.run_until(EventKind.SETTLED)
    assert settled.values == pytest.approx((0.003,) * 4)


def test_an_exact_stop_of_an_axis_that_stands_costs_simulated_drives_no_cycle() -> None:
    rig = simulated()
    program = rig.program
    program.capture()
    for line in (1, 2, 3):
        program.start_line(line)
        program.rapid({0: 0.0})
        program.wait(3)
        program.end_line()
    rig.play()
    assert rig.time_of(EventKind.LINE_END, 3) == rig.time_of(EventKind.LINE_START, 1)


def test_a_report_of_positions_that_finds_no_room_is_made_again_until_it_does() -> None:
    rig = Rig(machine())
    for token in range(300):
        rig.program.control(ControlKind.SETTLE, axes=1, token=token)
    rig.program.finish()
    rig.executor.step(5)
    first = rig.executor.events()
    rig.executor.step(5)
    tokens = [event.token for event in first + rig.executor.events() if event.kind is EventKind.SETTLED]
    assert len(first) < 300
    assert tokens == list(range(300))
