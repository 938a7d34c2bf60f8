"""What the machine file sets besides the mode: integral, zero offset, foreign SYNC; and what G1000 says."""

from __future__ import annotations

import pytest

from mcserver.can.cob import SYNC
from mcserver.drives.bus import DriveMode, DriveState
from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.motion.canonical import AxisOperation
from tests.drives.can_rig import Bench, CanRig, machine

COUNT_M = 1e-6


def lagging(keys: str) -> float:
    """Error that a csv axis keeps under a load that pulls at its speed [m]."""
    bench = Bench(machine(1, drive=f'mode = "csv"\nposition_gain = 20.0\n{keys}'), (0,))
    bench.tell(DriveMode.POSITION)
    bench.exchange(30)
    drive = bench.drives[0]
    for _ in range(3000):
        # 2 mm/s away from the setpoint, whatever is commanded
        drive.exact -= 2.0
        bench.exchange()
    return abs(float(bench.setpoints.position[0] - bench.feedback.position[0]))


def test_with_csv_a_constant_load_leaves_an_error_that_the_integral_takes_away() -> None:
    assert lagging("") == pytest.approx(0.002 / 20.0, rel=0.2)
    assert lagging("integral_time_s = 0.2") < 10 * COUNT_M


def test_the_zero_offset_is_where_an_absolute_encoder_shows_0() -> None:
    bench = Bench(machine(1, drive="zero_offset = 12.5"), (2500,))
    assert bench.feedback.position[0] == pytest.approx(0.0125 + 2500 * COUNT_M)
    bench.tell(DriveMode.POSITION)
    bench.exchange(20)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    assert bench.drives[0].jumps == [0]
    bench.setpoints.position[:] = 0.0125
    bench.exchange(5, follow=False)
    assert bench.drives[0].position == 0


def test_with_a_foreign_sync_none_is_sent() -> None:
    described = machine(1, bus_keys='sync = "foreign"')
    with pytest.raises(Exception, match="MC411"):
        # nobody sends one here, and so no drive answers
        Bench(described, (0,))


def test_own_sync_ends_each_cycle() -> None:
    bench = Bench(machine(1), (0,))
    bench.port.sent.clear()
    bench.exchange(3)
    assert [identifier for identifier, _ in bench.port.sent].count(SYNC) == 3


def test_g1000_on_a_node_that_was_stopped_says_so() -> None:
    rig = CanRig(machine(1))
    rig.program.capture()
    rig.step(40)
    drive = rig.drives[0]
    drive.muted, drive.beating = True, False
    drive.say(0x700, bytes([4]))
    rig.step(10)
    assert [event.code for event in rig.of(EventKind.FAULT)] == [FaultCode.NOT_OPERATIONAL]
    program = rig.open(0)
    program.start_line(9)
    program.axis(AxisOperation.RESET)
    program.end_line()
    program.finish()
    rig.step(5600)
    codes = [event.code for event in rig.of(EventKind.FAULT)]
    assert codes[-1] == FaultCode.NOT_OPERATIONAL
    assert FaultCode.NO_RESET not in codes
