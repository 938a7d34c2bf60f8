"""What faults of a line do to a program: stopped within three cycles, named, latched, recovered."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mcserver.drives.cia402.loop_gains import ETHERCAT_DELAY_CYCLES
from mcserver.ethercat.slave import AlState
from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from tests.canopen.esi_files import device, esi, pdo
from tests.drives.latched_faults import assert_stops_latches_and_recovers
from tests.ethercat.memory_line import LineRig, line_rig
from tests.ethercat.moving_slave import CST, CSV, rig_of

Cause = Callable[[LineRig], None]


def moving(drive: str = "") -> LineRig:
    rig = rig_of(drive) if drive else line_rig()
    rig.set_off()
    return rig


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


def jammed(rig: LineRig) -> None:
    rig.drives[1].jammed = True


FAULTS: list[tuple[Cause, FaultCode, int]] = [
    (frames_lost, FaultCode.BUS_DOWN, 0),
    (silent, FaultCode.DRIVE_SILENT, 0),
    (gone, FaultCode.DRIVE_SILENT, 1),
    (left_op, FaultCode.NOT_OPERATIONAL, 1),
    (switched_off, FaultCode.DRIVE_REBOOTED, 1),
    (tripped, FaultCode.EMERGENCY_MESSAGE, 1),
    (jammed, FaultCode.FOLLOWING_ERROR, 1),
]
# to `max_following_error` at 0.2 m/s
JAMMED_CYCLES = 25


def mend(rig: LineRig) -> None:
    rig.master.silent = set()
    rig.master.lost = 0
    rig.say(AlState.OP, AlState.OP)
    rig.drives[1].jammed = False


@pytest.mark.parametrize("drive", ["", CSV, CST], ids=["csp", "csv", "cst"])
@pytest.mark.parametrize(("cause", "code", "axis"), FAULTS, ids=[each[0].__name__ for each in FAULTS])
def test_a_fault_stops_its_group_within_three_cycles_and_is_recovered_without_a_jump(
    cause: Cause, code: FaultCode, axis: int, drive: str
) -> None:
    rig = moving(drive)
    # the frame under way was there before
    assert_stops_latches_and_recovers(
        rig,
        lambda: cause(rig),
        lambda: mend(rig),
        code=code,
        axis=axis,
        within=3 + 1 + JAMMED_CYCLES * (cause is jammed),
        off_m=5e-5 if drive is CST else 1e-6,
    )
    assert [jump for drive in rig.drives for jump in drive.jumps] == [0] * 4


@pytest.mark.parametrize("lost", [1, 2])
def test_frames_that_are_lost_within_the_tolerance_leave_no_trace(lost: int) -> None:
    rig = moving()
    rig.master.lost = lost
    rig.run()
    assert not rig.of(EventKind.FAULT)
    assert rig.executor.feedback.actual == pytest.approx([0.4, 0.2], abs=1e-6)


def test_a_drive_with_fixed_process_data_follows_and_stands(tmp_path: Path) -> None:
    outputs = pdo("RxPdo", 0x1600, (0x6040, 16), (0x607A, 32), (0, 16), fixed=True)
    inputs = pdo("TxPdo", 0x1A00, (0x6041, 16), (0x606C, 32), (0x6064, 32), fixed=True)
    file = tmp_path / "drive.xml"
    file.write_text(esi(device(pdos=outputs + inputs)))
    rig = line_rig(f'eds = "{file}"')
    rig.set_off()
    rig.run()
    assert rig.executor.feedback.actual == pytest.approx([0.4, 0.2], abs=1e-6)
    assert not rig.of(EventKind.FAULT)


def test_a_reading_is_three_cycles_behind_its_setpoint() -> None:
    rig = moving()
    assert np.abs(rig.setpoint[-1] - rig.setpoint[-2]).max() > 1e-4
    assert rig.executor.feedback.actual == pytest.approx(rig.setpoint[-1 - ETHERCAT_DELAY_CYCLES], abs=1e-6)
