"""A CiA 402 drive homes itself (mode 6) in the executor's cycle, and the axis goes on from there."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.can.pdo_layout import TPDO1, Mode
from mcserver.executor.entries import ControlKind, EventKind, HomingPhase
from mcserver.executor.fault_codes import FaultCode
from tests.drives.can_rig import COUNTS, CanRig, machine
from tests.drives.fake_can import ENABLED, FakeDrive, Function, wrap

MM = 1e-3
HOME = -3 * COUNTS
PACE = 40  # counts a cycle
ATTAINED = 0x1400
ERROR = 0x2000


class HomingDrive(FakeDrive):
    """Goes to its home position in mode 6, reads 0 there, and says so; or fails."""

    attained = False
    fails = False

    def _move(self) -> None:
        started = self.word == ENABLED and self.shown == Mode.HOMING and self.controlword & 0x10
        if not started or self.attained:
            super()._move()
            return
        self.exact = max(float(HOME), self.exact - PACE)
        self.position = round(self.exact)
        if self.exact == HOME and not self.fails:
            self.attained = True
            self.exact, self.position = 0.0, 0

    def _answer(self) -> None:
        word = self.word | 0x0210
        if self.shown == Mode.HOMING:
            word |= ATTAINED if self.attained else ERROR if self.fails and self.exact == HOME else 0
        self.say(Function.TPDO1, TPDO1.packing.pack(word, self.shown, wrap(self.position)))


def homing_rig(position: str = "") -> CanRig:
    section = f'[axis.homing]\nmethod = "drive"\n{position}\n'
    axis = f"max_following_error = 2.0\n{section}"
    drive = "[axis.drive.homing]\nmethod = 17\ntimeout_s = 5.0"
    rig = CanRig(machine(1, axis=axis, drive=drive), make=HomingDrive, homed=False)
    rig.program.capture()
    rig.program.control(ControlKind.HOME, axes=1)
    rig.program.finish()
    return rig


@pytest.mark.parametrize(("position", "reads"), [("", 0.0), ("position = 7.5", 7.5)])
def test_the_drive_finds_its_home_and_the_axis_moves_from_there(position: str, reads: float) -> None:
    rig = homing_rig(position)
    rig.run()
    assert rig.of(EventKind.FAULT) == []
    phases = [HomingPhase(event.token) for event in rig.of(EventKind.HOMING)]
    assert phases == [HomingPhase.DRIVE, HomingPhase.HOLD, HomingPhase.DONE]
    assert rig.executor.feedback.homed == 1
    assert rig.executor.feedback.actual[0] / MM == pytest.approx(reads)
    rig.step(50)
    # taken back without a step: the drive stands at its home
    assert abs(rig.drives[0].position) <= 1
    assert np.ptp(rig.actual[-50:, 0]) < 2e-6
    program = rig.open(0)
    program.position = rig.executor.executor.row.setpoint.copy()
    program.move({0: (reads + 2.0) * MM}, 200)
    program.finish()
    before = len(rig.setpoints)
    rig.run()
    rig.step(5)
    assert rig.of(EventKind.FAULT) == []
    # by its own count the drive is 2 mm from its home
    assert rig.drives[0].position == pytest.approx(2 * COUNTS / 10, abs=1)
    assert np.abs(np.diff(rig.setpoint[before:, 0])).max() < 0.05 * MM


def test_a_drive_that_does_not_find_it_is_a_fault() -> None:
    rig = homing_rig()
    drive = rig.drives[0]
    assert isinstance(drive, HomingDrive)
    drive.fails = True
    rig.run()
    assert [event.code for event in rig.of(EventKind.FAULT)] == [FaultCode.HOMING_FAILED]
    assert rig.executor.feedback.homed == 0
