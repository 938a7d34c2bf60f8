"""Position loops that are closed here, over EtherCAT: readings are a cycle older than on CAN."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.canopen.torque_tuning import margins, usual_gains
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.drives.cia402.loop_gains import ETHERCAT_DELAY_CYCLES
from mcserver.errors import ConfigurationError
from mcserver.executor.fault_codes import FaultCode
from mcserver.machine.machine_file import Machine, parse_machine
from tests.drives.fake_can import DISABLED
from tests.ethercat.moving_slave import CST, CSV, CYCLE_S, INERTIA, MovingSlave, rig_of
from tests.ethercat.rig import line_of


@pytest.mark.parametrize("drive", [CST, CSV])
def test_an_axis_follows_its_setpoints_and_stands_where_they_end(drive: str) -> None:
    rig = rig_of(drive)
    rig.set_off()
    late = ETHERCAT_DELAY_CYCLES
    pairs = zip(rig.setpoints[:-late], rig.actuals[late:], strict=True)
    errors = [np.abs(setpoint - actual).max() for setpoint, actual in pairs]
    assert max(errors[50:]) < 1e-4
    rig.run()
    rig.step(1500)
    assert rig.actuals[-1] == pytest.approx([0.4, 0.2], abs=5e-6)


@pytest.mark.parametrize(("beside", "stable"), [(1.15, True), (0.85, False)])
def test_the_torque_loop_is_stable_down_to_the_inertia_that_its_margin_says(
    beside: float, stable: bool
) -> None:
    gains = usual_gains(INERTIA, CYCLE_S, ETHERCAT_DELAY_CYCLES)
    margin = margins(gains, INERTIA, CYCLE_S, ETHERCAT_DELAY_CYCLES)
    assert margin.least < 1.0 / 3.0
    assert margin.greatest > 4.0
    rig = rig_of(CST, inertia=beside * margin.least * INERTIA)
    rig.program.capture()
    rig.step(40)
    (motor, _) = rig.drives
    assert isinstance(motor, MovingSlave)
    # a knock
    motor.rate += 1.0
    rig.step(250)
    swing = np.abs(np.array(rig.actuals[40:])[:, 0] - rig.actuals[39][0])
    assert bool(swing[-50:].max() < 0.5 * swing[:50].max()) is stable


def test_torque_that_pulls_the_wrong_way_ends_in_a_few_cycles() -> None:
    rig = rig_of(CST, sign=-1.0)
    rig.set_off(0)
    fault = rig.fault_within(400)
    assert fault.code in (FaultCode.RUNAWAY, FaultCode.FOLLOWING_ERROR)
    rig.step(20)
    assert rig.drives[fault.axis].word == DISABLED


def gains(cycle_hz: int, drive: str) -> Machine:
    return parse_machine(line_of(1, drive=drive).replace("cycle_hz = 100", f"cycle_hz = {cycle_hz}"))


@pytest.mark.parametrize(
    "drive", [f"{CST}velocity_gain = {160.0 * INERTIA}\n", f"{CSV}position_gain = 160.0\n"]
)
def test_gains_that_are_stable_on_can_alone_are_refused(drive: str) -> None:
    with pytest.raises(ConfigurationError, match="not stable over a bus"):
        gains(1000, drive)


def test_the_usual_gains_keep_the_margins_of_can() -> None:
    drive = cia402_drive(gains(1000, CST).axes[0])
    assert drive.velocity_gain == pytest.approx(0.075 * INERTIA * 1000.0)
    assert drive.position_gain == pytest.approx(0.2 * 75.0)
    assert drive.command_timeout_ms == 2000
