"""Programs with axes in profile position, in the executor's cycle: G00 and G1020, hold, abort, capture."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.motion.canonical import AxisOperation
from tests.drives.can_rig import CanRig
from tests.drives.profile_drive import ProfileDrive, agreed

MM = 1e-3


def rig(axes: int = 1, axis: str = "max_following_error = 2.0", **keys: object) -> CanRig:
    made = CanRig(agreed(axes, axis=axis), make=ProfileDrive, **keys)  # type: ignore[arg-type]
    made.program.capture()
    return made


def drive_of(made: CanRig, column: int = 0) -> ProfileDrive:
    drive = made.drives[column]
    assert isinstance(drive, ProfileDrive)
    return drive


def test_a_rapid_ends_when_the_drive_has_arrived_however_its_profile_runs() -> None:
    made = rig()
    made.program.rapid({0: 20 * MM})
    made.program.wait(1)
    made.program.finish()
    made.run()
    assert made.of(EventKind.FAULT) == []
    assert drive_of(made).position == 20_000
    assert [target for target, _ in drive_of(made).taken] == [20_000]
    # 20 000 counts at 40 a cycle, where the limits would allow five times the speed
    assert len(made.setpoints) > 500


def test_a_move_shorter_than_a_cycle_reaches_the_drive() -> None:
    made = rig()
    made.program.rapid({0: 2e-6})
    made.program.wait(1)
    made.program.finish()
    made.run()
    made.step(20)
    assert drive_of(made).taken[-1][0] == 2
    assert drive_of(made).position == 2


def test_a_drive_that_is_slower_than_its_profile_is_waited_for_and_then_named() -> None:
    made = rig()
    drive_of(made).jammed = True
    made.program.rapid({0: 20 * MM})
    made.program.finish()
    fault = made.run_until(EventKind.FAULT)
    assert fault.code == FaultCode.FOLLOWING_ERROR
    assert fault.time > 5.0


def test_an_axis_that_is_pushed_away_after_it_has_arrived_is_a_following_error() -> None:
    made = rig()
    made.program.rapid({0: 20 * MM})
    made.program.wait(1)
    made.program.finish()
    made.run()
    drive = drive_of(made)
    drive.jammed, drive.exact = True, 15_000.0
    assert made.run_until(EventKind.FAULT, 20).code == FaultCode.FOLLOWING_ERROR


def test_a_hold_halts_the_drive_and_a_resume_takes_it_to_its_target() -> None:
    made = rig()
    made.program.rapid({0: 40 * MM})
    made.program.wait(1)
    made.program.finish()
    made.step(300)
    made.executor.mailbox.set_hold(True, 0)
    made.step(100)
    stood = drive_of(made).position
    made.step(300)
    assert 1000 < drive_of(made).position == stood < 39_000
    made.executor.mailbox.resume(0)
    made.run()
    assert made.of(EventKind.FAULT) == []
    assert drive_of(made).position == 40_000


def test_an_abort_halts_the_drive_and_the_setpoint_is_where_it_stopped() -> None:
    made = rig()
    made.program.rapid({0: 40 * MM})
    made.program.wait(1)
    made.program.finish()
    made.step(200)
    made.executor.mailbox.abort(0)
    made.run()
    made.step(50)
    stood = drive_of(made).position
    made.step(200)
    assert drive_of(made).position == stood < 39_000
    assert made.setpoint[-1, 0] == pytest.approx(stood * 1e-6)
    # and its next program starts there
    program = made.open(0)
    program.start_line(1)
    program.rapid({0: 1 * MM})
    program.wait(1)
    program.finish()
    made.run()
    assert drive_of(made).position == 1000
    assert [event.code for event in made.of(EventKind.FAULT)] == []


def test_an_axis_that_was_switched_off_does_not_go_on_to_its_old_target() -> None:
    made = rig()
    made.program.rapid({0: 20 * MM})
    made.program.wait(1)
    made.program.axis(AxisOperation.OFF)
    made.program.finish()
    made.run()
    made.step(50)
    drive_of(made).exact = 3000.0
    program = made.open(0)
    program.start_line(1)
    program.capture()
    program.dwell(0.5)
    program.finish()
    made.run()
    assert drive_of(made).position == 3000
    assert made.of(EventKind.FAULT) == []


def test_an_override_changes_the_profile_velocity_under_way() -> None:
    made = rig()
    made.program.rapid({0: 40 * MM})
    made.program.finish()
    made.step(100)
    made.executor.mailbox.set_override(0.25)
    made.step(200)
    speeds = [speed for _, speed in drive_of(made).taken]
    assert speeds[0] in (999_999, 1_000_000)
    assert speeds[-1] in (249_999, 250_000)
    assert {target for target, _ in drive_of(made).taken} == {40_000}


def test_a_coordinated_motion_with_such_an_axis_is_refused_and_nothing_moves() -> None:
    made = rig(2)
    made.program.move({0: 5 * MM, 1: 5 * MM}, 100)
    made.program.finish()
    fault = made.run_until(EventKind.FAULT)
    assert fault.code == FaultCode.FOLLOWS_NO_PATH
    made.step(200)
    assert [drive.position for drive in made.drives] == [0, 0]


def test_a_reference_given_at_rest_moves_the_goal_along_and_not_the_axis() -> None:
    made = rig(axis='max_following_error = 2.0\n[axis.homing]\nmethod = "manual"\n')
    made.program.rapid({0: 20 * MM})
    made.program.wait(1)
    made.program.finish()
    made.run()
    taken = list(drive_of(made).taken)
    made.core.bank.shift(0, 0.1)
    for shifted in made.core._cycle.shifted:
        shifted(0, 0.1)
    made.step(100)
    assert drive_of(made).position == 20_000
    assert drive_of(made).taken == taken
    assert made.actual[-1, 0] == pytest.approx(0.12)
    assert made.of(EventKind.FAULT) == []


def test_two_axes_go_each_to_its_own_target() -> None:
    made = rig(2)
    made.program.rapid({0: 20 * MM, 1: -5 * MM})
    made.program.wait(3)
    made.program.finish()
    made.run()
    assert [drive.position for drive in made.drives] == [20_000, -5000]
    assert np.isfinite(made.setpoint).all()
