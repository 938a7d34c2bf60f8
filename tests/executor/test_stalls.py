"""A cycle that stalls: drives stand, so motion is ended where it is and never goes on at speed."""

from __future__ import annotations

import os

import numpy as np
import pytest

from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode, remedy_of
from mcserver.executor.process import run_loop
from mcserver.executor.shm.feedback import AxisCondition, SlotState
from mcserver.machine.machine_file import parse_machine
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.executor.rig import CYCLE_S, Program, Rig, machine, under_way
from tests.executor.test_process import ScriptedClock
from tests.machine_text import axes_text

STALL = 2000


def moving(drive: str = "ideal") -> Rig:
    """A program in the midst of a fast move."""
    return under_way(Rig(machine(drive=drive, velocity=1000.0)), 0.8)


def codes(rig: Rig) -> list[tuple[int, int]]:
    return [(event.program, event.code) for event in rig.of(EventKind.FAULT)]


def test_a_stalled_cycle_ends_motion_where_it_is() -> None:
    rig = moving()
    before = rig.setpoint[-1].copy()
    assert (rig.setpoint[-1, 0] - rig.setpoint[-2, 0]) / CYCLE_S > 0.5
    rig.executor.miss(STALL)
    rig.step(50)
    assert (rig.setpoint[1000:] == before).all()
    assert not rig.executor.feedback.velocity.any()
    assert rig.executor.feedback.slots[0].state is SlotState.FAULTED


def test_a_stall_is_reported_for_the_machine_and_for_each_program_with_its_duration() -> None:
    rig = moving()
    rig.executor.miss(STALL)
    rig.step(5)
    assert codes(rig) == [(-1, FaultCode.CYCLE_STALLED), (0, FaultCode.CYCLE_STALLED)]
    event = rig.of(EventKind.FAULT)[0]
    assert event.values[:2] == pytest.approx((2.001, 0.05))
    assert "2.001 s" in remedy_of(event.code, event.axis, event.values)[0]
    assert [stopped.line for stopped in rig.of(EventKind.STOPPED)] == [1]
    assert rig.executor.feedback.late_cycles == STALL


def test_some_late_cycles_are_only_counted() -> None:
    rig = moving()
    for _ in range(5):
        rig.executor.miss(45)
        rig.step(20)
    rig.run()
    assert codes(rig) == []
    assert rig.setpoint[-1, 0] == pytest.approx(0.8)
    assert rig.executor.feedback.late_cycles == 225


def test_the_machine_file_says_how_long_drives_bridge() -> None:
    axis = axes_text()
    assert parse_machine(f'[machine]\nname = "m"\n{axis}').stall_limit_s == 0.05
    slow = f'[machine]\nname = "m"\nsetpoint_timeout_s = 0.3\n{axis}'
    assert parse_machine(slow).stall_limit_s == 0.3
    assert parse_machine(f'[machine]\nname = "m"\ncycle_hz = 20\n{axis}').stall_limit_s == 0.25


def test_a_rapid_under_way_is_ended_too() -> None:
    rig = Rig(machine(velocity=1000.0))
    rig.program.capture()
    rig.program.rapid({0: 0.5})
    rig.program.wait(1)
    rig.program.finish()
    rig.step(200)
    before = rig.setpoint[-1].copy()
    rig.executor.miss(STALL)
    rig.step(50)
    assert (rig.setpoint[200:] == before).all()
    assert codes(rig) == [(-1, FaultCode.CYCLE_STALLED), (0, FaultCode.CYCLE_STALLED)]


def test_an_axis_that_turns_is_brought_to_rest_within_its_limits() -> None:
    rig = Rig(machine(velocity=1000.0, travel=None))
    rig.program.capture()
    rig.program.speed({0: 0.5})
    rig.program.dwell(100.0)
    rig.program.finish()
    rig.step(300)
    rig.executor.miss(STALL)
    rig.step(200)
    assert not rig.executor.feedback.velocity.any()
    assert np.abs(rig.acceleration()[305:]).max() <= 10.0 * 1.01


def test_a_held_program_goes_on_when_it_is_resumed() -> None:
    rig = moving()
    rig.executor.mailbox.set_hold(True, 0)
    rig.step(500)
    rig.executor.miss(STALL)
    rig.step(5)
    assert codes(rig) == [(-1, FaultCode.CYCLE_STALLED)]
    rig.executor.mailbox.resume(0)
    rig.run()
    assert rig.setpoint[-1, 0] == pytest.approx(0.8)


def test_a_simulated_drive_holds_and_switches_off_by_its_time_out() -> None:
    rig = moving("simulated")
    rig.executor.miss(70)
    rig.step(5)
    assert rig.executor.feedback.condition[0] == AxisCondition.HOLDING
    rig = moving("simulated")
    rig.executor.miss(STALL)
    rig.step(5)
    assert rig.executor.feedback.condition[0] == AxisCondition.FAULT
    assert FaultCode.DRIVE_STATE_LOST in [code for _, code in codes(rig)]


def test_the_loop_of_the_process_sees_a_clock_that_jumps() -> None:
    virtual = VirtualExecutor(machine(velocity=1000.0))
    program = Program(virtual.open_slot(0), 2)
    program.capture()
    program.move({0: 0.4}, 1000)
    cycles = 0

    def asked() -> bool:
        nonlocal cycles
        cycles += 1
        return cycles > 600

    run_loop(virtual.executor, virtual.mailbox, ScriptedClock({500: 2_000_000_000}), os.getppid(), asked)
    _, rows = virtual.history.since(0)
    setpoint = virtual.history.block(rows, "setpoint")[:, 0]
    assert np.diff(setpoint)[495] > 0.0
    assert not np.diff(setpoint)[500:].any()
    assert [event.code for event in virtual.events() if event.kind is EventKind.FAULT][:1] == [459]
