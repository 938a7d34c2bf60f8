"""mode = "cst": the position loop is closed in the master onto torques, on an axis of second order."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from tests.drives.can_rig import Bench, machine
from tests.drives.torque_drive import CST, INERTIA, RATED, TorqueDrive, torque_bench

COUNT_M = 1e-6
SECOND = 1000


def drive_of(bench: Bench) -> TorqueDrive:
    drive = bench.drives[0]
    assert isinstance(drive, TorqueDrive)
    return drive


def held(
    drive: str = "", load: float = 0.0, sign: float = 1.0, axis: str = "max_following_error = 2.0"
) -> Bench:
    """A bench whose axis has been energized where it stood."""
    bench = torque_bench(drive, axis=axis)
    drive_of(bench).load, drive_of(bench).sign = load, sign
    bench.tell(DriveMode.POSITION)
    for _ in range(30):
        bench.exchange()
        if bench.feedback.state[0] == DriveState.ENERGIZED:
            return bench
    raise AssertionError("it did not energize")


def error(bench: Bench) -> float:
    return float(bench.setpoints.position[0] - bench.feedback.position[0])


def swing(bench: Bench, cycles: int, stroke: float = 0.02, seconds: float = 0.4) -> list[float]:
    """Errors while the axis is taken to and fro smoothly [m], its setpoints two cycles ago."""
    start, behind, errors = float(bench.setpoints.position[0]), [float(bench.setpoints.position[0])] * 3, []
    for cycle in range(cycles):
        phase = 2.0 * math.pi * cycle / (seconds * SECOND)
        bench.setpoints.position[0] = start + 0.5 * stroke * (1.0 - math.cos(phase))
        behind = [*behind[1:], float(bench.setpoints.position[0])]
        bench.exchange(follow=False)
        errors.append(behind[0] - float(bench.feedback.position[0]))
    return errors


def test_an_axis_is_energized_without_torque_and_stands() -> None:
    bench = held()
    drive = drive_of(bench)
    assert set(drive.permille) == {0}
    bench.exchange(SECOND, follow=False)
    assert abs(drive.position - 1000) <= 2
    assert max(map(abs, drive.permille)) <= 20


def test_an_axis_follows_a_smooth_motion_by_the_torque_that_its_inertia_needs() -> None:
    bench = held()
    errors = swing(bench, 2 * SECOND)
    # 20 mm to and fro in 0.4 s: 2.5 m/s2, a tenth of a millimetre at most from where it should be
    assert max(map(abs, errors)) < 1e-4
    needed = 0.5 * 0.02 * (2.0 * math.pi / 0.4) ** 2 * (2.0 * math.pi / 0.01) * INERTIA / RATED * 1000.0
    assert max(drive_of(bench).permille) == pytest.approx(needed, rel=0.1)


@settings(max_examples=6)
@given(st.floats(0.3, 4.0), st.floats(0.0, 2e-4), st.floats(-0.5, 0.5))
def test_the_loop_is_stable_with_loads_that_are_not_as_the_machine_file_says(
    inertia: float, friction: float, load: float
) -> None:
    bench = held(axis="max_following_error = 10.0")
    drive = drive_of(bench)
    drive.inertia, drive.friction, drive.load = inertia * INERTIA, friction, load * RATED
    swing(bench, 200, stroke=0.002, seconds=0.2)
    bench.exchange(SECOND, follow=False)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    quiet = []
    for _ in range(100):
        bench.exchange(follow=False)
        quiet.append(error(bench))
    assert max(map(abs, quiet)) < 20 * COUNT_M


def test_a_steady_load_leaves_no_error_by_the_integral() -> None:
    bench = held(load=0.4 * RATED, axis="max_following_error = 10.0")
    bench.exchange(3 * SECOND, follow=False)
    assert abs(error(bench)) <= 5 * COUNT_M
    assert drive_of(bench).permille[-1] == pytest.approx(-400, abs=10)


def test_gravity_that_the_model_knows_is_held_from_the_first_cycle() -> None:
    weight = 0.5 * RATED
    sags = {}
    for known in (True, False):
        bench = held(
            "torque_feed_forward = true" if known else "", -weight, axis="max_following_error = 20.0"
        )
        start = drive_of(bench).position
        bench.setpoints.torque[:] = weight
        worst = 0
        for _ in range(SECOND):
            bench.exchange(follow=False)
            worst = max(worst, start - drive_of(bench).position)
        sags[known] = worst
        assert bench.feedback.state[0] == DriveState.ENERGIZED
    # with the model it falls while the drive is enabled and nobody holds it, without until the loop does
    assert sags[True] < 300
    assert sags[True] < sags[False] / 5


def test_torque_never_passes_the_greatest_and_the_integral_does_not_wind_up() -> None:
    bench = held("max_torque = 0.5", axis="max_following_error = 50.0")
    drive = drive_of(bench)
    # ten times what 0.5 N·m can accelerate: it lags, catches up, and comes to rest without a swing beyond
    start = float(bench.setpoints.position[0])
    for cycle in range(40):
        bench.setpoints.position[0] = start + 0.5 * 40.0 * (cycle / SECOND) ** 2
        bench.exchange(follow=False)
    end = float(bench.setpoints.position[0])
    beyond = 0.0
    for _ in range(3 * SECOND):
        bench.exchange(follow=False)
        beyond = max(beyond, float(bench.feedback.position[0]) - end)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    assert max(map(abs, drive.permille)) == 250
    assert abs(error(bench)) < 20 * COUNT_M
    assert beyond < 0.35 * (end - start)


def test_without_max_torque_the_rated_torque_is_the_greatest() -> None:
    bench = held(axis="max_following_error = 100.0")
    bench.setpoints.position[0] += 0.05
    bench.exchange(20, follow=False)
    assert max(drive_of(bench).permille) == 1000


def run_away(bench: Bench) -> int:
    """Lets it be pushed a little, then counts the cycles until it is given up."""
    drive = drive_of(bench)
    drive.load = 0.02 * RATED
    for cycle in range(SECOND):
        bench.exchange(follow=False)
        if bench.feedback.state[0] == DriveState.FAULT:
            return cycle
    raise AssertionError("nobody noticed")


def test_a_torque_of_the_wrong_sign_is_a_fault_long_before_the_following_error() -> None:
    bench = held(sign=-1.0, axis="max_following_error = 50.0")
    start = drive_of(bench).position
    run_away(bench)
    assert bench.feedback.fault[0] == DriveFault.RUNAWAY
    at_fault = len(drive_of(bench).permille)
    bench.exchange(20)
    # the cycle in which it is found already ends the torque
    assert set(drive_of(bench).permille[at_fault - 1 :]) == {0}
    assert abs(drive_of(bench).position - start) < 5000


def test_an_inverted_axis_with_its_drive_inverted_too_is_none_of_that() -> None:
    bench = held("invert = true")
    drive_of(bench).load = 0.3 * RATED
    bench.exchange(SECOND, follow=False)
    assert bench.feedback.state[0] == DriveState.ENERGIZED


@pytest.mark.parametrize("load", [-0.6, 0.6])
def test_a_load_that_the_motor_can_hold_is_no_runaway(load: float) -> None:
    bench = held(axis="max_following_error = 50.0")
    bench.exchange(100, follow=False)
    drive_of(bench).load = load * RATED
    bench.exchange(SECOND, follow=False)
    assert bench.feedback.fault[0] == DriveFault.NONE


def test_a_following_error_ends_the_torque_in_the_cycle_that_shows_it() -> None:
    bench = held(axis="max_following_error = 1.0")
    drive_of(bench).jammed = True
    for _ in range(SECOND):
        bench.setpoints.position[0] += 2e-5
        bench.exchange(follow=False)
        if abs(error(bench)) > 0.001 + 4e-5:
            break
    assert drive_of(bench).permille[-1] == 0
    bench.exchange()
    assert bench.feedback.fault[0] == DriveFault.FOLLOWING


def test_a_reading_from_nowhere_moves_the_axis_by_no_more_than_a_cycle_without_torque() -> None:
    bench = held(axis="max_following_error = 1.0")
    bench.exchange(100, follow=False)
    drive = drive_of(bench)
    before = len(drive.permille)
    drive.exact += 1e6
    drive.position += 1_000_000
    bench.exchange(4, follow=False)
    assert max(map(abs, drive.permille[before:])) <= 5
    assert bench.feedback.fault[0] == DriveFault.FOLLOWING


def test_lost_and_late_answers_neither_kick_the_axis_nor_end_its_motion() -> None:
    kicks = {}
    for name in ("quiet", "lost", "late"):
        bench = held()
        drive = drive_of(bench)
        drive.lost = set(range(0, 10_000, 7)) | set(range(1, 10_000, 7)) if name == "lost" else set()
        drive.late = 1 if name == "late" else 0
        errors = swing(bench, 2 * SECOND)
        assert bench.feedback.state[0] == DriveState.ENERGIZED
        steps = np.abs(np.diff(drive.permille[200:]))
        kicks[name] = float(steps.max())
        assert max(map(abs, errors)) < 1e-3
    assert kicks["lost"] < kicks["quiet"] + 100


@pytest.mark.parametrize("what", ["muted", "short"])
def test_answers_that_stay_out_or_have_a_wrong_length_end_the_torque(what: str) -> None:
    bench = held()
    swing(bench, 100)
    setattr(drive_of(bench), what, True)
    bench.exchange(4, follow=False)
    assert bench.feedback.fault[0] == DriveFault.COMMUNICATION
    assert drive_of(bench).permille[-1] == 0


def test_nobody_is_blind_for_more_than_ten_cycles_whatever_the_bus_allows() -> None:
    described = machine(1, drive=CST, axis="max_following_error = 5.0", bus_keys="silence_cycles = 1000")
    bench = Bench(described, (0,), TorqueDrive)
    bench.tell(DriveMode.POSITION)
    bench.exchange(30)
    drive_of(bench).muted = True
    bench.exchange(12, follow=False)
    assert bench.feedback.fault[0] == DriveFault.COMMUNICATION
    assert drive_of(bench).permille[-1] == 0


def test_a_second_master_that_takes_the_drive_off_is_a_fault() -> None:
    bench = held()
    bench.exchange(100, follow=False)
    drive = drive_of(bench)
    drive.word = 0x40
    bench.exchange(3, follow=False)
    assert bench.feedback.state[0] != DriveState.ENERGIZED
    assert drive.permille[-1] == 0
    bench.exchange(50)
    assert drive.word != 0x27


def test_an_axis_that_is_captured_again_begins_without_its_old_integral() -> None:
    bench = held(load=0.4 * RATED, axis="max_following_error = 10.0")
    bench.exchange(3 * SECOND, follow=False)
    bench.tell(DriveMode.OFF)
    bench.exchange(30)
    drive = drive_of(bench)
    drive.load = 0.0
    begin = len(drive.permille)
    bench.tell(DriveMode.POSITION)
    bench.exchange(30)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    assert max(map(abs, drive.permille[begin:])) <= 20


def test_torque_mode_and_back_leaves_the_loop_without_a_jump() -> None:
    bench = held()
    bench.exchange(50, follow=False)
    bench.tell(DriveMode.TORQUE)
    bench.setpoints.torque[:] = 0.0
    bench.exchange(50, follow=False)
    bench.setpoints.position[:] = bench.feedback.position
    bench.tell(DriveMode.POSITION)
    bench.exchange(200, follow=False)
    assert bench.feedback.state[0] == DriveState.ENERGIZED
    assert max(map(abs, drive_of(bench).permille)) <= 20


def test_a_coasting_axis_is_taken_over_at_its_speed() -> None:
    bench = torque_bench(axis="max_following_error = 5.0")
    drive = drive_of(bench)
    drive.held, drive.rate = False, 2.0 * math.pi * 10.0  # 100 mm/s
    bench.tell(DriveMode.POSITION)
    at = 0.0
    for _ in range(200):
        bench.setpoints.velocity[:] = 0.1
        if bench.feedback.state[0] != DriveState.ENERGIZED:
            bench.setpoints.position[:] = bench.feedback.position
        else:
            at += 1.0
            bench.setpoints.position[:] += 1e-4
        bench.bus.exchange(bench.setpoints)
    assert at > 100
    assert bench.feedback.fault[0] == DriveFault.NONE
    assert max(map(abs, drive.permille)) < 300
