"""Energizing drives that are slow, and over a bus that loses frames: no command is taken back for nothing."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.can.pdo_layout import Mode
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from tests.drives.can_rig import Bench, machine
from tests.drives.fake_can import DISABLED, ENABLED, FakeDrive

SEQUENCE = [0x06, 0x07, 0x0F]


def commands_of(bench: Bench, cycles: int = 40) -> list[int]:
    """Distinct controlwords in order, while the axis is energized."""
    drive = bench.drives[0]
    drive.controlwords.clear()
    bench.tell(DriveMode.POSITION)
    bench.exchange(cycles)
    return drive.controlwords


@pytest.mark.parametrize("cycle", range(2, 22))
def test_one_lost_tpdo_while_energizing_takes_no_command_back(cycle: int) -> None:
    bench = Bench(machine(1), (1000,))
    drive = bench.drives[0]
    drive.lost = {drive.syncs + cycle}
    assert commands_of(bench) == SEQUENCE
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    assert bench.feedback.fault[0] == DriveFault.NONE
    assert drive.jumps == [0]


@given(st.sets(st.integers(2, 40), max_size=12))
@settings(max_examples=60)
def test_whichever_tpdos_get_lost_the_axis_is_energized_without_a_jump(lost: set[int]) -> None:
    bench = Bench(machine(1, bus_keys="silence_cycles = 100"), (1000,))
    drive = bench.drives[0]
    drive.lost = {drive.syncs + each for each in lost}
    bench.tell(DriveMode.POSITION)
    bench.exchange(80)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    assert bench.feedback.fault[0] == DriveFault.NONE
    assert set(drive.jumps) == {0}


@pytest.mark.parametrize("shows", [True, False])
@pytest.mark.parametrize("slowness", [1, 3, 20, 500])
def test_a_drive_that_takes_its_time_is_waited_for(slowness: int, shows: bool) -> None:
    bench = Bench(machine(1), (1000,))
    bench.drives[0].slowness = slowness
    bench.drives[0].shows_transitions = shows
    assert commands_of(bench, 4 * slowness + 60) == SEQUENCE
    assert bench.feedback.state[0] == DriveState.ENERGIZED


def test_a_drive_that_still_shows_power_of_before_is_not_taken_for_energized() -> None:
    bench = Bench(machine(1), (1000,))
    bench.tell(DriveMode.POSITION)
    bench.exchange(20)
    bench.drives[0].slowness = 30
    bench.tell(DriveMode.OFF)
    bench.exchange(5)
    bench.tell(DriveMode.POSITION)
    states = []
    for _ in range(200):
        bench.exchange()
        states.append(int(bench.feedback.state[0]))
    first = states.index(DriveState.ENERGIZED)
    assert first > 60
    assert set(states[first:]) == {DriveState.ENERGIZED}
    assert bench.feedback.fault[0] == DriveFault.NONE


class SecretiveDrive(FakeDrive):
    """Shows no mode (6061h = 0) until it is enabled, as some makers have it; ``never``: not even then."""

    never = False
    other = 0

    def _answer(self) -> None:
        mode = self.shown
        if self.word != ENABLED or self.never:
            self.shown = self.other
        try:
            super()._answer()
        finally:
            self.shown = mode


def secretive() -> tuple[Bench, SecretiveDrive]:
    bench = Bench(machine(1), (1000,), SecretiveDrive)
    [drive] = bench.drives
    assert isinstance(drive, SecretiveDrive)
    return bench, drive


@pytest.mark.parametrize("slowness", [0, 20])
@pytest.mark.parametrize("shows", [True, False])
def test_a_drive_that_shows_no_mode_until_it_is_enabled_is_enabled_without_a_jump(
    slowness: int, shows: bool
) -> None:
    bench, drive = secretive()
    drive.slowness, drive.shows_transitions = slowness, shows
    assert commands_of(bench, 500 + 4 * slowness) == SEQUENCE
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    assert (bench.feedback.fault[0], drive.jumps) == (DriveFault.NONE, [0])


def test_a_drive_that_never_shows_its_mode_is_switched_off_again() -> None:
    bench, drive = secretive()
    drive.never = True
    bench.tell(DriveMode.POSITION)
    bench.exchange(1000)
    assert bench.feedback.state[0] == DriveState.FAULT
    assert bench.feedback.fault[0] == DriveFault.MODE
    assert drive.word == DISABLED


def test_a_drive_that_shows_another_mode_is_never_enabled() -> None:
    bench, drive = secretive()
    drive.other = Mode.PROFILE_VELOCITY
    bench.tell(DriveMode.POSITION)
    bench.exchange(2000)
    assert bench.feedback.state[0] == DriveState.STARTING
    assert drive.jumps == []
