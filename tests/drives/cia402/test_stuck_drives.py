"""Drives that do not do as commanded: nothing holds or lets go behind the machine's back."""

from __future__ import annotations

from mcserver.drives.bus import DriveState
from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.feedback import AxisCondition
from mcserver.motion.canonical import AxisOperation
from tests.drives.can_rig import CanRig, machine

# Cycles of the time-out for drives, and more.
LONG = 5600


def energized() -> CanRig:
    rig = CanRig(machine(2))
    rig.program.start_line(1)
    rig.program.capture()
    rig.program.end_line()
    rig.run_until(EventKind.LINE_END)
    return rig


def condition(rig: CanRig, column: int) -> int:
    return int(rig.core.row.condition[column])


def test_a_drive_that_did_not_energize_in_time_does_not_do_so_later() -> None:
    rig = CanRig(machine(2))
    rig.drives[1].stuck = True
    rig.program.start_line(1)
    rig.program.capture()
    rig.program.end_line()
    fault = rig.run_until(EventKind.FAULT, LONG)
    assert (fault.code, fault.axis, fault.line) == (FaultCode.NO_ENERGIZE, 1, 1)
    rig.drives[1].stuck = False
    rig.step(200)
    assert condition(rig, 1) == AxisCondition.FAULT
    assert rig.core.bank.states[1] != DriveState.ENERGIZED
    rig.recover()
    rig.step(200)
    assert condition(rig, 1) == AxisCondition.HOLDING


def test_a_drive_that_goes_on_holding_after_g1001_is_a_fault() -> None:
    rig = energized()
    rig.drives[1].stuck = True
    rig.program.start_line(2)
    rig.program.axis(AxisOperation.OFF)
    rig.program.end_line()
    rig.run_until(EventKind.LINE_END)
    fault = rig.run_until(EventKind.FAULT, LONG)
    assert (fault.code, fault.axis) == (FaultCode.NOT_OFF, 1)
    assert condition(rig, 1) == AxisCondition.FAULT
    rig.step(LONG)
    assert len(rig.of(EventKind.FAULT)) == 1


def test_a_drive_that_lets_go_in_time_is_none() -> None:
    rig = energized()
    rig.program.start_line(2)
    rig.program.axis(AxisOperation.OFF)
    rig.program.end_line()
    rig.step(LONG)
    assert not rig.of(EventKind.FAULT)
    assert condition(rig, 1) == AxisCondition.OFF


def test_a_released_axis_may_go_on_holding() -> None:
    rig = energized()
    rig.program.start_line(2)
    rig.program.axis(AxisOperation.RELEASE)
    rig.program.end_line()
    rig.step(LONG)
    assert not [event for event in rig.of(EventKind.FAULT) if event.code == FaultCode.NOT_OFF]
