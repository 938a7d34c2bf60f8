"""What CAN drives and buses do to a program: stopped within three cycles, named, latched, recovered."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode, remedy_of
from mcserver.executor.shm.feedback import AxisCondition
from tests.drives.can_rig import CanRig, machine
from tests.drives.fake_can import READY
from tests.drives.latched_faults import LINE, assert_stops_latches_and_recovers

Cause = Callable[[CanRig], None]


def moving(buses: int = 1, axis: str = "max_following_error = 2.0") -> CanRig:
    rig = CanRig(machine(2, buses=buses, axis=axis), positions=[5000, -123])
    rig.set_off()
    return rig


def mute(rig: CanRig) -> None:
    rig.drives[1].muted = True


def short(rig: CanRig) -> None:
    rig.drives[1].short = True


def late(rig: CanRig) -> None:
    rig.drives[1].late = 5


def emergency(rig: CanRig) -> None:
    rig.drives[1].emergency(0x2310)


def tripped(rig: CanRig) -> None:
    rig.drives[1].trip(0x4310)


def reboot(rig: CanRig) -> None:
    rig.drives[1].reboot()


def dropped(rig: CanRig) -> None:
    rig.drives[1].word = READY


def stopped_node(rig: CanRig) -> None:
    rig.drives[1].say(0x700, bytes([0x04]))


def silent_fault(rig: CanRig) -> None:
    rig.drives[1].word = 0x08


def other_mode(rig: CanRig) -> None:
    rig.drives[1].mode_slowness = 1 << 30
    rig.drives[1].shown = 6


FAULTS: list[tuple[Cause, FaultCode]] = [
    (mute, FaultCode.DRIVE_SILENT),
    (short, FaultCode.DRIVE_SILENT),
    (late, FaultCode.DRIVE_SILENT),
    (emergency, FaultCode.EMERGENCY_MESSAGE),
    (tripped, FaultCode.EMERGENCY_MESSAGE),
    (silent_fault, FaultCode.DRIVE_FAULT),
    (reboot, FaultCode.DRIVE_REBOOTED),
    (stopped_node, FaultCode.NOT_OPERATIONAL),
    (dropped, FaultCode.DRIVE_STATE_LOST),
    (other_mode, FaultCode.MODE_REFUSED),
]


def fix(rig: CanRig) -> None:
    drive = rig.drives[1]
    drive.muted = drive.short = drive.jammed = False
    drive.late = drive.mode_slowness = 0
    drive.pending.clear()
    drive.operate()


@pytest.mark.parametrize(("cause", "code"), FAULTS, ids=[cause.__name__ for cause, _ in FAULTS])
def test_a_fault_stops_its_group_within_three_cycles_and_is_recovered_without_a_jump(
    cause: Cause, code: FaultCode
) -> None:
    rig = moving()
    # the cycle in which the answer to the latest SYNC is read saw nothing of it yet
    first = 1 if cause in (mute, short, late, dropped, silent_fault, other_mode) else 0
    assert_stops_latches_and_recovers(rig, lambda: cause(rig), lambda: fix(rig), code=code, within=3 + first)
    assert [jump for drive in rig.drives for jump in drive.jumps] == [0] * 4


@pytest.mark.parametrize("between", [0, 1, 2, 5])
def test_an_axis_that_is_energized_while_its_drive_still_clears_a_fault_waits_for_it(between: int) -> None:
    rig = moving()
    tripped(rig)
    rig.fault_within(4)
    rig.run()
    rig.executor.mailbox.reset()
    rig.step(between)
    program = rig.open(0)
    program.capture()
    program.finish()
    rig.run()
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.HOLDING] * 2
    assert [FaultCode(event.code) for event in rig.of(EventKind.FAULT)] == [FaultCode.EMERGENCY_MESSAGE]
    assert [jump for drive in rig.drives for jump in drive.jumps] == [0] * 3


def test_a_drive_that_does_not_clear_its_fault_names_it_where_it_is_energized() -> None:
    rig = moving()
    tripped(rig)
    rig.fault_within(4)
    rig.run()
    rig.drives[1].stuck = True
    rig.executor.mailbox.reset()
    program = rig.open(0)
    program.capture()
    program.finish()
    rig.run()
    assert [FaultCode(event.code) for event in rig.of(EventKind.FAULT)][1:] == [FaultCode.NO_RESET]
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.HOLDING, AxisCondition.FAULT]


def test_a_jammed_axis_is_a_following_error() -> None:
    rig = moving()
    rig.drives[1].jammed = True
    fault = rig.fault_within(20)
    assert (fault.code, fault.axis, fault.line) == (FaultCode.FOLLOWING_ERROR, 1, LINE)
    assert fault.values[0] > fault.values[1] == pytest.approx(0.002)


def test_the_delay_of_the_bus_is_no_following_error() -> None:
    # at 0.4 m/s an axis goes 0.4 mm in a cycle, and its reading is two cycles behind
    rig = moving(axis="max_following_error = 0.05")
    rig.run()
    assert not rig.of(EventKind.FAULT)
    assert np.abs(rig.setpoint[800:1000, 0] - rig.actual[800:1000, 0]).max() > 0.0005


def test_two_cycles_without_an_answer_are_borne() -> None:
    rig = moving()
    rig.drives[1].muted = True
    rig.step(2)
    rig.drives[1].muted = False
    rig.run()
    assert not rig.of(EventKind.FAULT)


def test_a_bus_that_goes_stops_all_its_axes_and_those_beside_them() -> None:
    rig = moving(buses=2)
    rig.ports["can1"].counters.down = True
    fault = rig.fault_within(3)
    assert (fault.code, fault.axis, fault.line) == (FaultCode.BUS_DOWN, 1, LINE)
    rig.run()
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.HOLDING, AxisCondition.FAULT]


def test_a_bus_without_room_to_send_is_down() -> None:
    rig = moving()
    rig.ports["can0"].full = True
    assert rig.fault_within(3).code == FaultCode.BUS_DOWN


def test_a_bus_that_comes_back_is_reported_and_recovers_by_g1000_and_g1010() -> None:
    rig = moving()
    port = rig.ports["can0"]
    port.counters.down = True
    rig.step(50)
    sent = len(port.sent)
    for drive in rig.drives:
        # nothing was heard from the master: the drives' own time-outs acted
        drive.word = 0x40
    port.counters.down = False
    rig.step(5)
    warning = rig.of(EventKind.FAULT)[-1]
    assert warning.code == FaultCode.BUS_BACK
    # nothing had been kept for later: the first cycle sends one RPDO an axis, and SYNC
    assert [identifier for identifier, _ in port.sent[sent : sent + 3]] == [0x201, 0x202, 0x080]
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.FAULT] * 2
    rig.recover()
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.HOLDING] * 2
    assert [jump for drive in rig.drives for jump in drive.jumps] == [0] * 4


def test_a_heartbeat_that_stops_is_a_fault_though_the_drive_goes_on() -> None:
    rig = moving()
    rig.drives[1].beating = False
    fault = rig.fault_within(400)
    assert (fault.code, fault.axis) == (FaultCode.HEARTBEAT_LOST, 1)


def test_an_emergency_message_is_reported_with_its_code_and_meaning() -> None:
    rig = moving()
    rig.drives[1].emergency(0x8611)
    fault = rig.fault_within(1)
    message, hint = remedy_of(fault.code, fault.axis, fault.values)
    assert "axis 1" in message
    assert "8611h, following error" in message
    assert "G1000 P1" in hint


def test_a_further_emergency_message_of_a_latched_axis_is_a_warning() -> None:
    rig = moving()
    rig.drives[1].emergency(0x2310)
    rig.step()
    rig.drives[1].emergency(0xFF01)
    rig.drives[1].emergency(0xFF01)
    rig.step()
    codes = [(event.code, event.values[1]) for event in rig.of(EventKind.FAULT)]
    assert codes == [(425, 0x2310), (FaultCode.DRIVE_MESSAGE, 0xFF01)]


def test_an_axis_that_stands_idle_latches_a_fault_too() -> None:
    rig = CanRig(machine(2))
    rig.play()
    rig.drives[0].trip(0x3210)
    rig.step(2)
    assert rig.executor.feedback.condition[0] == AxisCondition.FAULT
    program = rig.open(0)
    program.start_line(1)
    program.capture()
    rig.step(5)
    assert rig.of(EventKind.FAULT)[-1].code == FaultCode.AXIS_LATCHED
