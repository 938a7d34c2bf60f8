"""What goes wrong: drives, following errors, silence, emergency stop; coordinated stops and latches."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.drives.bus import DriveFault
from mcserver.drives.simulated import SimulatedBus
from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.fault_codes import FaultCode, remedy_of
from mcserver.executor.shm.feedback import AxisCondition, SlotState, silent_of
from mcserver.motion.canonical import AxisOperation
from tests.executor.rig import CYCLE_S, Program, Rig, machine, quintic


def moving(axes: int = 3) -> tuple[Rig, SimulatedBus]:
    """Axes 0 and 1 go along a straight line at 0.4 m/s; further axes are free."""
    rig = Rig(machine(axes, drive="simulated", axis="max_following_error = 2.0"))
    rig.set_off(800)
    bus = rig.executor.buses[0]
    assert isinstance(bus, SimulatedBus)
    return rig, bus


def test_a_jammed_axis_stops_its_program_along_the_path() -> None:
    rig, bus = moving()
    bus.jam(1)
    fault = rig.run_until(EventKind.FAULT)
    assert (fault.code, fault.axis, fault.line, fault.program) == (407, 1, 3, 0)
    assert fault.values[0] > fault.values[1] == pytest.approx(0.002)
    rig.run()
    rig.step(20)
    assert rig.executor.feedback.slots[0].state is SlotState.FAULTED
    assert rig.of(EventKind.STOPPED)[0].line == 3
    # the other axis came to rest within its limits and still holds
    assert np.abs(rig.acceleration(0)).max() <= 1.02 * 10.0
    assert rig.executor.feedback.condition.tolist()[:2] == [AxisCondition.HOLDING, AxisCondition.FAULT]
    assert rig.setpoint[-1, 0] < 0.4


@pytest.mark.parametrize(
    ("cause", "code"),
    [
        (DriveFault.OVER_TEMPERATURE, 415),
        (DriveFault.OVER_CURRENT, 416),
        (DriveFault.VOLTAGE, 417),
        (DriveFault.ENCODER, 418),
        (DriveFault.OTHER, 410),
    ],
)
def test_a_drive_that_fails_stops_its_group_within_three_cycles(cause: DriveFault, code: int) -> None:
    rig, bus = moving()
    before = len(rig.setpoint)
    bus.trip(0, cause)
    rig.step(3)
    (fault,) = rig.of(EventKind.FAULT)
    assert (fault.code, fault.axis, fault.line) == (code, 0, 3)
    velocity = np.diff(rig.setpoint[:, 1]) / CYCLE_S
    assert velocity[-1] < velocity[before - 2]


def test_a_drive_that_fails_before_its_axis_joins_the_motion_is_named_once() -> None:
    rig = Rig(machine(2, drive="simulated"))
    program = rig.program
    program.capture()
    program.control(ControlKind.BEGIN, axes=1)
    share, slope = quintic(np.arange(1, 1801) / 1800)
    way = np.array([0.4, 0.0])
    program.rows(np.outer(share, way)[:900], np.outer(slope, way)[:900] / 1.8, 1)
    program.control(ControlKind.BEGIN, axes=2)
    program.rows(np.outer(share, way)[900:], np.outer(slope, way)[900:] / 1.8, 3)
    program.control(ControlKind.END, axes=3)
    rig.step(900)
    assert 800.0 < rig.executor.u(0) < 900.0
    bus = rig.executor.buses[0]
    assert isinstance(bus, SimulatedBus)
    bus.trip(1)
    rig.run()
    assert rig.executor.u(0) > 900.0
    assert [(event.code, event.axis) for event in rig.of(EventKind.FAULT)] == [(415, 1)]


def test_a_silent_drive_is_lost_after_some_cycles_and_named() -> None:
    rig, bus = moving()
    bus.silence(0)
    fault = rig.run_until(EventKind.FAULT, limit=20)
    assert (fault.code, fault.axis) == (411, 0)
    # what it said last is old, its velocity too, until it answers again
    assert rig.executor.executor.row.actual_velocity[0] > 0.1
    assert silent_of(rig.executor.executor.row.row) == 0b01
    bus.silence(0, 1)
    rig.step(3)
    assert silent_of(rig.executor.executor.row.row) == 0


def test_a_drive_that_is_silent_for_two_cycles_only_is_no_fault() -> None:
    rig, bus = moving()
    bus.silence(0, 2)
    rig.run()
    assert not rig.of(EventKind.FAULT)


def test_a_fault_of_one_program_leaves_the_others_running() -> None:
    rig = Rig(machine(3, drive="simulated", axis="max_following_error = 2.0"))
    rig.play()
    first, second = rig.open(0, 0b011), rig.open(1, 0b100)
    first.capture(0b011)
    first.start_line(1)
    first.move({0: 0.3}, 1000)
    second.capture(0b100)
    second.start_line(2)
    second.move({2: 0.3}, 1000)
    second.end_line()
    second.finish()
    rig.step(500)
    bus = rig.executor.buses[0]
    assert isinstance(bus, SimulatedBus)
    bus.trip(0)
    rig.run()
    assert [event.program for event in rig.of(EventKind.FAULT)] == [0]
    assert rig.setpoint[-1, 2] == pytest.approx(0.3)
    assert rig.time_of(EventKind.LINE_END, 2)


def test_a_fault_stays_latched_until_reset() -> None:
    rig, bus = moving()
    bus.trip(0)
    rig.run()
    program = rig.open(0)
    program.start_line(1)
    program.capture()
    refused = rig.run_until(EventKind.FAULT)
    assert (refused.code, refused.axis) == (412, 0)
    rig.run()
    program = rig.open(0)
    program.start_line(1)
    program.axis(AxisOperation.RESET)
    program.capture()
    program.rapid({0: 0.0})
    program.wait(1)
    program.end_line()
    rig.run_until(EventKind.LINE_END)
    assert rig.setpoint[-1, 0] == 0.0


def test_the_operators_reset_clears_only_what_is_latched() -> None:
    rig, bus = moving()
    bus.trip(0)
    rig.run()
    rig.executor.mailbox.reset()
    rig.step(5)
    assert rig.executor.feedback.condition.tolist() == [
        AxisCondition.OFF,
        AxisCondition.HOLDING,
        AxisCondition.HOLDING,
    ]


def test_an_emergency_stop_stops_de_energizes_and_latches() -> None:
    rig, _ = moving()
    rig.executor.mailbox.emergency_stop()
    rig.step(1)
    assert rig.executor.feedback.estop
    codes = {(event.code, event.program) for event in rig.of(EventKind.FAULT)}
    assert codes == {(400, -1), (400, 0)}
    rig.run()
    rig.step(5)
    assert rig.executor.executor.bank.energized == 0
    # it came to rest on the path before the drives went off
    assert np.abs(rig.setpoint[:, 1] - 0.5 * rig.setpoint[:, 0]).max() < 1e-4
    program = rig.open(0)
    program.capture()
    refused = rig.run_until(EventKind.STOPPED)
    assert refused.program == 0
    assert rig.of(EventKind.FAULT)[-1].code == 400
    rig.executor.mailbox.reset()
    rig.step(2)
    program = rig.open(0)
    program.capture()
    program.finish()
    rig.run_until(EventKind.FINISHED)
    assert rig.executor.executor.bank.energized == 7


def test_an_emergency_stop_ends_speeds_rapids_and_torques_too() -> None:
    rig = Rig(machine(3, drive="simulated", travel=None))
    program = rig.program
    program.speed({0: 0.5})
    program.rapid({1: 5.0})
    program.torque({2: 0.01})
    program.finish()
    rig.step(300)
    rig.executor.mailbox.emergency_stop()
    rig.step(300)
    assert rig.executor.executor.bank.energized == 0
    assert np.abs(np.diff(rig.setpoint[310:420, 1], 2)).max() / CYCLE_S**2 <= 1.02 * 10.0
    assert np.abs(np.diff(rig.actual[-5:], axis=0)).max() < 1e-5


def test_stop_of_the_machine_ends_programs_and_motion_without_one() -> None:
    rig = Rig(machine(2, travel=None))
    rig.program.speed({0: 0.5})
    rig.program.rapid({1: 5.0})
    rig.program.finish()
    rig.step(200)
    program = rig.open(1, 0)
    program.dwell(1000.0)
    rig.step(10)
    rig.executor.mailbox.stop()
    rig.run_until(EventKind.STOPPED)
    rig.step(300)
    assert np.all(np.diff(rig.setpoint[-10:], axis=0) == 0.0)
    assert rig.executor.executor.bank.energized == 3


def test_programs_with_common_axes_are_refused() -> None:
    rig = Rig(machine())
    rig.program.dwell(1.0)
    rig.step(5)
    rig.open(1, 0b01)
    rig.step(2)
    assert [(event.code, event.program) for event in rig.of(EventKind.FAULT)] == [(408, 1)]


def test_a_program_cannot_move_axes_that_are_not_its_own() -> None:
    rig = Rig(machine())
    rig.play()
    program = rig.open(0, 0b01)
    program.start_line(1)
    program.rapid({1: 0.1})
    fault = rig.run_until(EventKind.FAULT)
    assert (fault.code, fault.axis) == (419, 1)


def test_a_slot_that_was_stopped_plays_the_next_program_from_its_beginning() -> None:
    rig = Rig(machine())
    rig.program.capture()
    rig.program.start_line(1)
    rig.program.move({0: 0.4}, 1000)
    rig.step(300)
    rig.executor.mailbox.abort(0)
    rig.run_until(EventKind.STOPPED)
    stood = rig.setpoint[-1, 0]
    program = rig.open(0)
    program.position[0] = stood
    program.start_line(2)
    program.move({0: stood + 0.1}, 300)
    program.end_line()
    program.finish()
    rig.run()
    assert rig.setpoint[-1, 0] == pytest.approx(stood + 0.1, abs=1e-12)
    assert rig.time_of(EventKind.LINE_END, 2) - rig.time_of(EventKind.LINE_START, 2) == pytest.approx(0.3)


def test_every_fault_code_has_a_sentence_and_a_remedy() -> None:
    for code in FaultCode:
        message, hint = remedy_of(code, 7)
        assert message
        assert hint
        assert "{" not in message + hint


def test_an_axis_that_was_captured_outside_its_travel_may_come_back() -> None:
    rig = Rig(machine(drive="simulated", travel=100.0, drive_keys="friction_decel = 100.0"))
    bus = rig.executor.buses[0]
    assert isinstance(bus, SimulatedBus)
    bus.push(0, 0.3)
    rig.step(1000)
    assert rig.actual[-1, 0] > 0.101
    program: Program = rig.program
    program.rapid({0: 0.05})
    program.wait(1)
    program.finish()
    rig.run()
    assert not rig.of(EventKind.FAULT)
    assert rig.setpoint[-1, 0] == 0.05


def test_a_reset_that_waits_for_rest_does_not_clear_a_later_emergency_stop() -> None:
    rig, _bus = moving()
    mailbox = rig.executor.mailbox
    mailbox.emergency_stop()
    rig.step(5)
    mailbox.reset()
    rig.step(5)
    mailbox.emergency_stop()
    rig.run()
    rig.step(200)
    assert rig.executor.feedback.estop
    mailbox.reset()
    rig.step(5)
    assert not rig.executor.feedback.estop


def test_a_program_that_is_opened_behind_a_reset_runs_though_both_come_in_one_cycle() -> None:
    rig, _bus = moving()
    rig.executor.mailbox.emergency_stop()
    rig.run()
    rig.step(5)
    reported = len(rig.of(EventKind.FAULT))
    rig.executor.mailbox.reset()
    program = rig.open(0)
    program.capture()
    program.finish()
    rig.run_until(EventKind.FINISHED)
    assert len(rig.of(EventKind.FAULT)) == reported
    assert rig.executor.executor.bank.energized == 7


def test_of_a_reset_and_a_stop_in_one_cycle_the_later_one_holds() -> None:
    for stop_last in (True, False):
        rig, _bus = moving()
        rig.run()
        mailbox = rig.executor.mailbox
        orders = (
            [mailbox.reset, mailbox.emergency_stop] if stop_last else [mailbox.emergency_stop, mailbox.reset]
        )
        for order in orders:
            order()
        rig.step(50)
        assert rig.executor.feedback.estop is stop_last
