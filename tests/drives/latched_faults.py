"""What a fault of a drive or its bus does to a program in motion, on CAN as on EtherCAT."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.feedback import AxisCondition
from tests.executor.rig import Rig

# of the line that `Rig.set_off` brings the axes on
LINE = 3


def assert_stops_latches_and_recovers(
    rig: Rig,
    cause: Callable[[], None],
    mend: Callable[[], None],
    *,
    code: FaultCode,
    within: int,
    axis: int = 1,
    off_m: float = 1e-6,
) -> None:
    """Axes in motion stop on their path, the fault names axis and line and is latched until G1000 and G1010.

    Args:
        within: in which cycle it is reported at the latest.
        axis: the fault's; 0: it is one of the bus. Another axis comes to rest within its limits.
        off_m: how far from its setpoint an axis holds, which is then where it is.
    """
    cause()
    fault = rig.fault_within(within)
    assert (FaultCode(fault.code), fault.axis, fault.line, fault.program) == (code, axis, LINE, 0)
    before = rig.setpoint[-1, 0] - rig.setpoint[-2, 0]
    rig.step()
    assert rig.setpoint[-1, 0] - rig.setpoint[-2, 0] < before
    rig.run()
    assert rig.setpoint[-1, 0] < 0.4
    other = AxisCondition.FAULT
    if axis:
        other = AxisCondition.HOLDING
        assert np.abs(rig.acceleration(0)).max() <= 1.02 * 10.0
    assert rig.executor.feedback.condition.tolist() == [other, AxisCondition.FAULT]
    mend()
    rig.step(50)
    program = rig.open(0)
    program.start_line(9)
    program.capture()
    rig.run()
    assert rig.of(EventKind.FAULT)[-1].code == FaultCode.AXIS_LATCHED
    start = len(rig.setpoints)
    rig.recover()
    assert rig.executor.feedback.condition.tolist() == [AxisCondition.HOLDING] * 2
    # usually less than a count: a setpoint that held was between two of them
    assert np.abs(np.diff(rig.setpoint[start:], axis=0)).max() < off_m
