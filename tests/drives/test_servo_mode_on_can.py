"""Axes of CiA 402 drives that follow streamed targets: what the drives get, also when one of them fails."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.feedback import SlotState
from mcserver.executor.shm.target_box import Targets
from tests.drives.can_rig import COUNTS, CanRig, machine
from tests.executor.rig import CYCLE_S, Program
from tests.limits import EXACTLY, assert_keeps

JERK = 200.0
AXIS = f"max_following_error = 2.0\nmax_jerk = {JERK * 1e3}"
COUNTS_PER_M = COUNTS / 0.01


def following() -> CanRig:
    """A rig whose two axes follow, energized and at rest where their encoders are."""
    rig = CanRig(machine(axis=AXIS), positions=(5000, -2000))
    follow(rig, rig.program)
    return rig


def follow(rig: CanRig, program: Program) -> None:
    """Let both axes follow, as the service asks for it."""
    program.capture()
    program.control(ControlKind.HALT_AXES, axes=3)
    program.control(ControlKind.FOLLOW, axes=3)
    program.finish()
    rig.step(60)


def stream(rig: CanRig, cycles: int, start: tuple[float, float] = (0.005, -0.002)) -> None:
    """Targets every 10 ms: a sine on the first axis, its cosine's rise on the second."""
    box = rig.executor.sink(0).targets
    for cycle in range(cycles):
        if cycle % 10 == 0:
            now = rig.executor.feedback.time
            angle = 2.0 * math.pi * cycle * CYCLE_S
            place = [start[0] + 0.02 * math.sin(angle), start[1] + 0.02 * (1.0 - math.cos(angle))]
            speed = [0.04 * math.pi * math.cos(angle), 0.04 * math.pi * math.sin(angle)]
            box.put(Targets(np.array([[now + 0.01, *place, *speed]]), now, now + 0.1))
        rig.step()


def state(rig: CanRig) -> SlotState:
    return rig.executor.feedback.slots[0].state


def assert_limits(rig: CanRig, first: int = 59, columns: int = 2) -> None:
    moved = np.array(rig.setpoints[first:])[:, :columns]
    assert_keeps(moved, (1.0, 10.0, JERK), most=EXACTLY)


def test_drives_follow_from_where_their_encoders_are() -> None:
    rig = following()
    assert rig.setpoint[-1] == pytest.approx([0.005, -0.002])
    stream(rig, 2000)
    behind = np.abs(rig.actual[-1000:] - rig.setpoint[-1000:]).max()
    assert behind < 2e-3
    assert rig.of(EventKind.FAULT) == []
    assert_limits(rig)


def test_a_program_takes_the_axes_at_rest_without_a_jump() -> None:
    rig = following()
    stream(rig, 700)
    rig.executor.sink(0).targets.close()
    rig.run_until(EventKind.FINISHED, 3000)
    stands = rig.setpoint[-1].copy()
    program = rig.open(0)
    program.start_line(1)
    program.capture()
    program.rapid({0: 0.0, 1: 0.0})
    program.wait(3)
    program.finish()
    first = len(rig.setpoints)
    rig.run()
    assert np.abs(rig.setpoint[first] - stands).max() <= JERK * CYCLE_S**3
    assert rig.setpoint[-1] == pytest.approx([0.0, 0.0])


def test_a_drive_that_trips_stops_the_other_within_its_limits() -> None:
    rig = following()
    stream(rig, 300)
    rig.drives[1].trip(0x3210)
    stream(rig, 400)
    assert state(rig) is SlotState.FAULTED
    assert np.ptp(rig.setpoint[-50:, 0]) == 0.0
    assert_limits(rig, columns=1)
    assert abs(rig.drives[0].position / COUNTS_PER_M - rig.setpoint[-1, 0]) < 1e-5


def test_a_drive_that_says_nothing_more_ends_it_and_targets_move_nothing_then() -> None:
    rig = following()
    stream(rig, 300)
    rig.ports["can0"].nodes.remove(rig.drives[1])
    stream(rig, 400)
    assert state(rig) is SlotState.FAULTED
    stands = rig.setpoint[-1, 0]
    stream(rig, 100)
    assert rig.setpoint[-1, 0] == stands
    assert_limits(rig, columns=1)


def test_after_an_emergency_stop_it_follows_again_from_where_the_axes_have_come_to_rest() -> None:
    rig = following()
    stream(rig, 300)
    rig.executor.mailbox.emergency_stop()
    stream(rig, 300)
    assert state(rig) is SlotState.FAULTED
    assert not rig.core.bank.energized
    rig.executor.mailbox.reset()
    rig.step(20)
    rig.recover()
    first = len(rig.setpoints)
    follow(rig, rig.open(0))
    place = rig.setpoint[-1]
    stream(rig, 500, (float(place[0]), float(place[1])))
    codes = {fault.code for fault in rig.of(EventKind.FAULT)}
    assert codes <= {FaultCode.EMERGENCY_STOP}
    assert state(rig) is SlotState.RUNNING
    assert_limits(rig, first)
