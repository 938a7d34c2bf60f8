"""Feedback of a bus is some cycles old: an axis is late by what it is off its way, not by that age."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from tests.drives.can_rig import COUNTS, CanRig, machine


@pytest.mark.parametrize("sign", [1, -1])
def test_a_fast_axis_far_from_zero_is_not_late_by_the_age_of_its_feedback(sign: int) -> None:
    rig = CanRig(machine(1, axis="max_following_error = 1.0"), positions=[sign * 10 * COUNTS])
    rig.program.capture()
    rig.step(100)
    rig.program.position = rig.executor.feedback.setpoint.copy()
    rig.program.move({0: sign * 0.4}, 600)
    rig.play()
    assert [event.code for event in rig.of(EventKind.FAULT)] == []
    assert rig.actual[-1, 0] == pytest.approx(sign * 0.4, abs=1e-5)
    # 0.94 m/s: what is seen is behind by more than may be followed
    assert np.abs(rig.setpoint - rig.actual).max() > 1e-3


def test_a_drive_that_stands_is_late_by_its_way_and_not_by_the_age() -> None:
    rig = CanRig(machine(1, axis="max_following_error = 1.0"), positions=[10 * COUNTS])
    rig.program.capture()
    rig.step(100)
    rig.program.position = rig.executor.feedback.setpoint.copy()
    rig.program.move({0: 0.4}, 600)
    rig.step(300)
    rig.drives[0].jammed = True
    fault = rig.fault_within(50)
    assert fault.code == FaultCode.FOLLOWING_ERROR
