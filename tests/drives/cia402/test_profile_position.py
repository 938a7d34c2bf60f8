"""Profile position: set-points one by one, acknowledged, to drives that have neither csp nor ip."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.canopen.configuration import configure
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.settings import settings_of
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.drives.cia402.profile_position import (
    ACKNOWLEDGED,
    HALT,
    NEW_SETPOINT,
    ProfilePosition,
    Refusal,
)
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import Machine, parse_machine
from tests.drives.can_rig import Bench, bus_in_memory, machine
from tests.drives.profile_drive import PP, ProfileDrive, agreed
from tests.machine_text import axes_text


class ProfileBench(Bench):
    """One profile-position drive, with the process data that it agrees to at boot-up."""

    drives: list[ProfileDrive]  # type: ignore[assignment]

    def __init__(self, described: Machine, position: int = 0) -> None:
        super().__init__(described)
        self.port.nodes.clear()
        self.drives = [ProfileDrive(self.port, 1, position, described.cycle_s)]
        self.bus = bus_in_memory(described, self.port)
        self.feedback = self.bus.boot()
        self.setpoints.position[:] = self.feedback.position
        self.port.sent.clear()

    def go(self, target_mm: float, cycles: int, speed_mm: float = 100.0) -> None:
        self.setpoints.goal[0] = target_mm / 1e3
        self.setpoints.goal_speed[0] = speed_mm / 1e3
        self.exchange(cycles)


def energized(position: int = 1000) -> ProfileBench:
    bench = ProfileBench(agreed(), position)
    bench.tell(DriveMode.POSITION)
    bench.exchange(20)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    return bench


def test_a_goal_is_handed_over_once_and_reached_on_the_profile_of_the_drive() -> None:
    bench = energized()
    bench.go(5.0, 200)
    [drive] = bench.drives
    assert drive.taken == [(5000, 100_000)]
    assert drive.position == 5000
    assert len(drive.pulses) == 1


def test_nothing_that_an_earlier_master_left_in_the_drive_moves_it() -> None:
    bench = ProfileBench(agreed(), 1000)
    [drive] = bench.drives
    drive.stale = 90_000
    bench.tell(DriveMode.POSITION)
    bench.exchange(200)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    assert drive.position == 1000
    assert drive.taken == []
    bench.go(2.0, 100)
    assert drive.position == 2000


def test_a_goal_under_way_is_replaced_at_once_and_so_is_its_speed() -> None:
    bench = energized(0)
    bench.go(50.0, 50)
    bench.go(-1.0, 20, 40.0)
    bench.go(-1.0, 200, 60.0)
    [drive] = bench.drives
    assert drive.taken == [(50_000, 100_000), (-1000, 40_000), (-1000, 60_000)]
    assert drive.position == -1000


def test_without_a_goal_the_axis_halts_and_stays_until_a_new_set_point_is_taken() -> None:
    bench = energized(0)
    bench.go(50.0, 50)
    [drive] = bench.drives
    bench.setpoints.goal[0] = math.nan
    bench.exchange(5)
    stood = drive.position
    assert 0 < stood < 50_000
    bench.exchange(300)
    assert drive.position == stood
    # the same goal again is a new set-point
    bench.go(50.0, 1500)
    assert drive.position == 50_000
    assert len(drive.taken) == 2


def test_after_a_halt_the_axis_never_moves_towards_the_goal_before() -> None:
    bench = energized(10_000)
    [drive] = bench.drives
    drive.ack_after = 60
    bench.go(50.0, 5)
    bench.setpoints.goal[0] = math.nan
    bench.exchange(1)
    bench.setpoints.goal[0] = 0.0
    track = []
    for _ in range(600):
        bench.exchange()
        track.append(drive.position)
    assert max(track) == 10_000
    assert track[-1] == 0


def test_a_drive_that_never_acknowledges_is_a_fault_and_is_switched_off() -> None:
    bench = energized()
    bench.drives[0].ack_after = None
    bench.go(5.0, 240)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    bench.exchange(40)
    assert bench.feedback.state[0] == DriveState.FAULT
    assert bench.feedback.fault[0] == DriveFault.SETPOINT
    assert bench.feedback.detail[0] == Refusal.NOT_ACKNOWLEDGED
    bench.exchange(5)
    assert bench.drives[0].controlword == 0
    assert bench.drives[0].position == 1000


def test_a_drive_that_keeps_its_acknowledgement_takes_no_second_goal() -> None:
    bench = energized()
    bench.drives[0].keeps_ack = True
    bench.go(5.0, 100)
    bench.go(1.0, 400)
    assert bench.feedback.fault[0] == DriveFault.SETPOINT
    assert bench.feedback.detail[0] == Refusal.STILL_ACKNOWLEDGED


def test_a_slow_drive_is_waited_for() -> None:
    bench = energized()
    bench.drives[0].ack_after = 200
    bench.go(5.0, 450)
    assert bench.drives[0].position == 5000
    assert bench.drives[0].pulses[0] >= 200


def test_a_following_error_of_the_drive_is_one() -> None:
    bench = energized()
    bench.go(5.0, 20)
    bench.drives[0].slip = True
    bench.exchange(3)
    assert bench.feedback.fault[0] == DriveFault.FOLLOWING


def test_a_goal_beyond_32_bits_is_never_sent() -> None:
    bench = energized()
    bench.go(3e6, 5)
    assert bench.feedback.fault[0] == DriveFault.SETPOINT
    assert bench.feedback.detail[0] == Refusal.OUT_OF_RANGE
    assert bench.drives[0].taken == []


def test_process_data_of_a_wrong_length_acknowledge_nothing() -> None:
    bench = energized()
    bench.drives[0].short = True
    bench.go(5.0, 2)
    bench.exchange(20)
    assert bench.feedback.fault[0] == DriveFault.COMMUNICATION
    assert bench.drives[0].taken in ([], [(5000, 100_000)])
    assert bench.drives[0].controlword == 0


def test_late_and_lost_process_data_do_not_lose_a_goal() -> None:
    bench = energized()
    [drive] = bench.drives
    drive.lost = {drive.syncs + each for each in (1, 2, 4, 5, 7, 10)}
    bench.go(5.0, 200)
    assert drive.taken == [(5000, 100_000)]
    drive.late = 2
    bench.go(1.0, 200)
    assert drive.taken[1:] == [(1000, 100_000)]
    assert drive.position == 1000


def test_profiles_keep_the_limits_of_the_axis_rounded_down() -> None:
    [settings_] = settings_of(machine(1, drive=PP))
    writes, planned = configure(settings_, 0.001, generic_dictionary(1), 127)
    written = {each.index: int.from_bytes(each.payload, "little") for each in writes if each.index >= 0x6000}
    for index, limit in ((0x6081, 1_000_000), (0x6083, 10_000_000), (0x6084, 10_000_000)):
        assert limit - 1 <= written[index] <= limit
    assert (written[0x6086], written[0x605D], written[0x6060]) == (0, 1, 1)
    mapped = [each.index for pdo in planned.process_data.rpdos for each in pdo.objects]
    assert mapped == [0x6040, 0x6060, 0x607A, 0x6081]


def test_a_drive_without_a_profile_acceleration_is_refused() -> None:
    dictionary = generic_dictionary(1)
    del dictionary.indices[0x6083]
    [settings_] = settings_of(machine(1, drive=PP))
    with pytest.raises(ConfigurationError, match="6083h"):
        configure(settings_, 0.001, dictionary, 127)


@pytest.mark.parametrize(
    ("keys", "refused"),
    [
        ('[axis.homing]\nmethod = "hard-stop"\ntorque = 1.0\ntravel = 5.0\n', "the drive makes the motion"),
        ("torque_feed_forward = true\n", "the torque is not known here"),
    ],
)
def test_what_needs_a_path_is_refused_by_the_machine_file(keys: str, refused: str) -> None:
    drive = f'bus = "can0"\nnode = 1\nrated_torque = 1.0\ncounts_per_motor_rev = 1000\n{PP}{keys}'
    with pytest.raises(ConfigurationError, match=refused):
        parse_machine(f'[machine]\nname = "m"\n{axes_text(rotary=True, drive="cia402", drive_keys=drive)}')


_GOALS = st.one_of(st.none(), st.integers(-3, 3))


@settings(max_examples=60)
@given(
    goals=st.lists(st.tuples(_GOALS, st.integers(1, 40)), min_size=1, max_size=12),
    answers=st.lists(st.booleans(), min_size=20, max_size=20),
    ack_after=st.integers(0, 30),
)
def test_the_drive_only_ever_goes_to_the_latest_goal_and_bit_4_rises_only_when_bit_12_is_low(
    goals: list[tuple[int | None, int]], answers: list[bool], ack_after: int
) -> None:
    profile = ProfilePosition(1e-3, sends_speed=True)
    high = low = 0
    acknowledged = False
    setpoint: int | None = None
    latest: int | None = None
    previous = 0
    for goal, cycles in [*goals, (2, 200)]:
        latest = goal
        for cycle in range(cycles):
            fresh = answers[cycle % len(answers)]
            refusal = profile.step(goal, 5, ACKNOWLEDGED if acknowledged else 0, fresh=fresh)
            assert refusal is None
            bits = profile.bits
            if bits & NEW_SETPOINT and not previous & NEW_SETPOINT:
                assert not acknowledged
                high = 0
            if bits & NEW_SETPOINT:
                high, low = high + 1, 0
                if high > ack_after and not acknowledged:
                    acknowledged = True
                    setpoint = profile.target
            else:
                low += 1
                acknowledged = acknowledged and low < 2
            previous = bits
            if goal is None:
                assert bits & HALT
    if any(answers):
        assert not profile.bits & HALT
        assert setpoint == latest == 2
