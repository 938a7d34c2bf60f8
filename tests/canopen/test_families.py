"""Slaves in the manner of public families: booted, enabled without a jump, moved, broken, reset, moved."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from mcserver.canopen.machine_file_check import check_drives
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from tests.canopen.cycle_on_bus import Cycle
from tests.canopen.families import FAMILIES, FamilyDrive
from tests.canopen.local_drives import until
from tests.canopen.rig import RunningHub, Watched, machine_on

# python-canopen's own reader of EDS files
pytestmark = pytest.mark.filterwarnings("ignore:The 'warn' method is deprecated:DeprecationWarning")

BEGIN = 777
# counts of 4096 a turn of 10 mm
WAY_M, WAY_COUNTS = 0.01, 4096


@pytest.fixture
def drive(hub: RunningHub, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[FamilyDrive]:
    family = FAMILIES[request.param]
    (tmp_path / "drive.eds").write_text(family.text)
    made = FamilyDrive(hub, family, position=BEGIN).start()
    yield made
    made.close()


@pytest.mark.parametrize(("drive", "name"), [(name, name) for name in FAMILIES], indirect=["drive"])
def test_a_drive_of_a_family_is_booted_moved_broken_and_recovered(
    hub: RunningHub, watched: Watched, tmp_path: Path, drive: FamilyDrive, name: str
) -> None:
    keys = (
        f'eds = "{tmp_path}/drive.eds"\nheartbeat_ms = 1000\ncommand_timeout_ms = 5000\n{FAMILIES[name].keys}'
    )
    machine = machine_on(hub.address(), [1], keys, bus="silence_cycles = 1000")
    assert [each.message for each in check_drives(machine) if each.severity == "error"] == []
    cycle = Cycle(watched.start(machine), machine, [drive])
    if (0x6007, 0) in drive.habits.allows:
        # quick stop when the master is silent, or what of its options serves nearly as well
        assert drive.value(0x6007) == max(drive.habits.allows[0x6007, 0])
    points = 'mode = "pp"' in FAMILIES[name].keys
    try:
        for goal in (BEGIN + WAY_COUNTS, BEGIN):
            start = drive.position[0]
            cycle.run(DriveMode.POSITION, DriveState.ENERGIZED)
            for _ in range(5):
                cycle.bus.exchange(cycle.setpoints)
            assert drive.position[0] == start, "it moved when it was enabled"
            target = cycle.feedback.position[0] + (goal - start) * WAY_M / WAY_COUNTS
            if points:
                cycle.setpoints.goal[:], cycle.setpoints.goal_speed[:] = target, 0.05
            else:
                cycle.setpoints.position[:] = target

            def there(goal: int = goal) -> bool:
                cycle.bus.exchange(cycle.setpoints)
                assert cycle.feedback.fault[0] == DriveFault.NONE
                return abs(drive.position[0] - goal) <= 1

            until(there, "motion")
            if goal == BEGIN:
                break
            drive.break_down()
            cycle.run(DriveMode.POSITION, DriveState.FAULT)
            assert cycle.feedback.fault[0] == DriveFault.OTHER
            cycle.setpoints.goal[:] = float("nan")
            cycle.run(DriveMode.RESET, DriveState.OFF)
    finally:
        cycle.close()


def test_an_encoder_that_can_neither_be_changed_nor_scaled_and_is_another_is_said(
    hub: RunningHub, watched: Watched, tmp_path: Path
) -> None:
    text = FAMILIES["Delta"].text.replace("DefaultValue=4096", "DefaultValue=8192")
    (tmp_path / "drive.eds").write_text(text)
    drive = FamilyDrive(hub, replace(FAMILIES["Delta"], text=text)).start()
    try:
        machine = machine_on(hub.address(), [1], f'eds = "{tmp_path}/drive.eds"')
        [doubt] = [each for each in check_drives(machine) if "608Fh" in each.message]
        assert (doubt.code, doubt.severity) == ("MC022", "warning")
        watched.start(machine)
        assert "608Fh:01: the machine file has another encoder" in watched.sentences[-1]
    finally:
        drive.close()
