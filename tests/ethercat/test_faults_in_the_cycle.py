"""What faults of a line do to a program: stopped within three cycles, named, latched, recovered."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mcserver.drives.registry import ETHERCAT_DELAY_CYCLES
from mcserver.ethercat.slave import AlState
from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.feedback import AxisCondition
from mcserver.motion.canonical import AxisOperation
from tests.ethercat.memory_line import LineRig, line_rig

LINE = 3
Cause = Callable[[LineRig], None]


def moving() -> LineRig:
    """Both axes are on their way along a straight line."""
    rig = line_rig()
    program = rig.program
    program.capture()
    rig.step(40)
    program.position = rig.executor.feedback.setpoint.copy()
    program.start_line(LINE)
    program.move({0: 0.4, 1: 0.2}, 1800)
    program.end_line()
    program.finish()
    rig.step(900)
    assert not rig.of(EventKind.FAULT)
    return rig


def fault_of(rig: LineRig, cycles: int) -> ExecutorEvent:
    for _ in range(cycles):
        rig.step()
        faults = rig.of(EventKind.FAULT)
        if faults:
            return faults[0]
    raise AssertionError(f"no fault in {cycles} cycles")


def frames_lost(rig: LineRig) -> None:
    rig.master.lost = 50


def silent(rig: LineRig) -> None:
    rig.master.silent = {1}


def gone(rig: LineRig) -> None:
    rig.master.silent = {1}
    rig.say(AlState.OP, AlState.NONE)


def left_op(rig: LineRig) -> None:
    rig.say(AlState.OP, AlState.SAFEOP)


def switched_off(rig: LineRig) -> None:
    rig.master.silent = {1}
    rig.say(AlState.OP, AlState.INIT)


def tripped(rig: LineRig) -> None:
    rig.drives[1].fail(0x2310)


FAULTS: list[tuple[Cause, FaultCode, int]] = [
    (frames_lost, FaultCode.BUS_DOWN, 0),
    (silent, FaultCode.DRIVE_SILENT, 0),
    (gone, FaultCode.DRIVE_SILENT, 1),
    (left_op, FaultCode.NOT_OPERATIONAL, 1),
    (switched_off, FaultCode.DRIVE_REBOOTED, 1),
    (tripped, FaultCode.EMERGENCY_MESSAGE, 1),
]


def mend(rig: LineRig) -> None:
    rig.master.silent = set()
    rig.master.lost = 0
    rig.say(AlState.OP, AlState.OP)


@pytest.mark.parametrize(("cause", "code", "axis"), FAULTS, ids=[each[0].__name__ for each in FAULTS])
def test_a_fault_stops_its_group_within_three_cycles_and_is_recovered_without_a_jump(
    cause: Cause, code: FaultCode, axis: int
) -> None:
    rig = moving()
    cause(rig)
    # the frame under way was there before
    fault = fault_of(rig, 3 + 1)
    assert (FaultCode(fault.code), fault.axis, fault.line) == (code, axis, LINE)
    before = rig.setpoint[-1, 1 - axis] - rig.setpoint[-2, 1 - axis]
    rig.step()
    assert rig.setpoint[-1, 1 - axis] - rig.setpoint[-2, 1 - axis] < before
    rig.run()
    assert rig.executor.feedback.condition[axis] == AxisCondition.FAULT
    mend(rig)
    rig.step(50)
    assert rig.executor.feedback.condition[axis] == AxisCondition.FAULT
    program = rig.open(0)
    program.start_line(1)
    program.axis(AxisOperation.RESET)
    program.capture()
    program.end_line()
    program.finish()
    rig.run()
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.HOLDING] * 2
    assert [jump for drive in rig.drives for jump in drive.jumps] == [0] * 4


@pytest.mark.parametrize("lost", [1, 2])
def test_frames_that_are_lost_within_the_tolerance_leave_no_trace(lost: int) -> None:
    rig = moving()
    rig.master.lost = lost
    rig.run()
    assert not rig.of(EventKind.FAULT)
    assert rig.executor.feedback.actual == pytest.approx([0.4, 0.2], abs=1e-6)


def test_a_reading_is_three_cycles_behind_its_setpoint() -> None:
    rig = moving()
    assert np.abs(rig.setpoint[-1] - rig.setpoint[-2]).max() > 1e-4
    assert rig.executor.feedback.actual == pytest.approx(rig.setpoint[-1 - ETHERCAT_DELAY_CYCLES], abs=1e-6)
