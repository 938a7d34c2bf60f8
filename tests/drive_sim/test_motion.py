"""Modes, units and motor of the simulated drive."""

from __future__ import annotations

import math
import random
import struct
from itertools import pairwise

import pytest

from mcserver.can.cob import SYNC, Function
from mcserver.can.pdo_layout import TPDO2, Mode
from mcserver.drive_sim.motor import Hardware
from tests.drive_sim.bench import (
    DISABLE_VOLTAGE,
    ENABLE,
    ENABLED,
    FAULT,
    HALT,
    NODE,
    PERIOD_S,
    STATE_MASK,
    SWITCH_ON_DISABLED,
    Aborted,
    Bench,
)

COUNTS = 65536
INTERNAL_LIMIT, TARGET_REACHED, BIT_12, BIT_13 = 1 << 11, 1 << 10, 1 << 12, 1 << 13
NEW_SETPOINT, AT_ONCE, RELATIVE = 1 << 4, 1 << 5, 1 << 6
INTERPOLATE = 1 << 4


@pytest.fixture
def bench() -> Bench:
    return Bench().operate()


def drive(bench: Bench, cycles: int, velocity: int = 0, torque: int = 0, controlword: int = ENABLE) -> None:
    """Cycles of velocity and torque mode: RPDO2 besides RPDO1."""
    for _ in range(cycles):
        bench.receive(Function.RPDO2 + NODE, struct.pack("<Hih", controlword, velocity, torque))
        bench.cycle(controlword)


def until_rest(bench: Bench, controlword: int) -> int:
    """Cycles until the target is reached; the last statusword."""
    for _ in range(5000):
        statusword = bench.cycles(1, controlword)
        if statusword & TARGET_REACHED:
            return statusword
    raise AssertionError("the target is never reached")


# ---------------------------------------------------------------------- cyclic modes


def test_csp_follows_a_moving_target_with_a_small_lag(bench: Bench) -> None:
    bench.enable()
    target = bench.position
    for _ in range(400):
        target += 200
        statusword, mode, position = bench.cycle(ENABLE, target)
    assert mode == Mode.CYCLIC_POSITION
    assert statusword & BIT_12
    # a target that is applied at one SYNC is reached at the next one, but for the servo's own lag
    assert 0 < target - 200 - position <= 5
    bench.cycles(100, ENABLE)
    assert bench.position == target


def test_csp_without_interpolation_time_would_not_follow_and_60c2h_is_the_period(bench: Bench) -> None:
    bench.write(0x60C2, 1, "B", 1)
    bench.enable()
    start = bench.position
    bench.cycle(ENABLE, start + 1000)
    before = bench.node.motor.position
    bench.cycle(ENABLE)
    after = bench.node.motor.position
    # one SYNC moves the motor by 1 ms, however long the SYNC took to come
    assert 0.0 < after - before < 0.5 * 1000 / COUNTS


def test_enabling_onto_a_target_where_the_drive_is_does_not_move_it() -> None:
    chance = random.Random(402)
    for _ in range(100):
        bench = Bench(position=chance.uniform(-30000.0, 30000.0)).operate()
        before = bench.position
        bench.enable()
        bench.cycles(20)
        assert bench.position == before


def test_a_far_target_is_reached_at_the_motors_limits_and_shown(bench: Bench) -> None:
    bench.enable()
    seen = 0
    target = bench.position + 20 * COUNTS
    speeds = []
    for _ in range(200):
        seen |= bench.cycle(ENABLE, target)[0]
        speeds.append(bench.node.motor.velocity)
    hardware = bench.node.motor.hardware
    assert seen & INTERNAL_LIMIT
    assert max(speeds) <= hardware.max_speed
    steps = [abs(b - a) for a, b in pairwise(speeds)]
    assert max(steps) <= hardware.max_acceleration * PERIOD_S * 1.001
    bench.cycles(400, ENABLE)
    assert bench.position == target


def test_positions_wrap_at_32_bits_and_motion_goes_on() -> None:
    start = (1 << 31) - 5000
    bench = Bench(position=start / COUNTS).operate().enable()
    target = bench.position
    assert target == start
    for _ in range(100):
        target += 100
        bench.cycle(ENABLE, (target + (1 << 31)) % (1 << 32) - (1 << 31))
    bench.cycles(50)
    assert bench.position == start + 100 * 100 - (1 << 32)
    assert bench.node.motor.position * COUNTS == pytest.approx(start + 10_000, abs=1.0)


def test_csv_turns_at_its_speed_from_where_it_is(bench: Bench) -> None:
    bench.mode = Mode.CYCLIC_VELOCITY
    bench.enable()
    before = bench.position
    drive(bench, 200, velocity=100_000)
    assert bench.read(0x606C, 0, "i") == pytest.approx(100_000, rel=0.01)
    # one second less the start
    assert bench.position - before == pytest.approx(100_000, rel=0.05)
    drive(bench, 100)
    assert bench.read(0x606C, 0, "i") == 0


def test_cst_accelerates_by_torque_over_inertia() -> None:
    hardware = Hardware(inertia=0.01, rated_torque=2.0, friction=0.0)
    bench = Bench(hardware=hardware).operate()
    bench.mode = Mode.CYCLIC_TORQUE
    bench.enable()
    drive(bench, 41, torque=500)
    # 1 N·m on 0.01 kg·m² for 0.2 s: 20 rad/s
    assert bench.read(0x606C, 0, "i") / COUNTS * 6.2832 == pytest.approx(20.0, rel=0.03)
    assert bench.read(0x6077, 0, "h") == 500


def test_a_change_of_mode_in_motion_goes_on_from_there(bench: Bench) -> None:
    bench.mode = Mode.CYCLIC_VELOCITY
    bench.enable()
    drive(bench, 100, velocity=50_000)
    bench.mode = Mode.CYCLIC_POSITION
    bench.target = bench.position + 500
    _, mode, _ = bench.cycle()
    positions = [bench.cycle()[2] for _ in range(40)]
    assert bench.cycle()[1] == Mode.CYCLIC_POSITION
    assert mode == Mode.CYCLIC_VELOCITY
    assert max(abs(b - a) for a, b in pairwise(positions)) < 1000
    assert bench.position == bench.target


def test_ip_stands_until_bit_4_starts_it_and_then_follows_60c1h(bench: Bench) -> None:
    bench.mode = Mode.INTERPOLATED_POSITION
    start = bench.position
    bench.write(0x60C1, 1, "i", start + 3000)
    bench.enable()
    assert bench.cycles(20, ENABLE) & BIT_12 == 0
    assert bench.position == start
    assert bench.cycles(100, ENABLE | INTERPOLATE) & BIT_12
    assert bench.position == start + 3000


def test_cst_meets_friction_and_stands_below_it() -> None:
    bench = Bench(hardware=Hardware(rated_torque=1.0, inertia=0.001, friction=10.0)).operate()
    bench.mode = Mode.CYCLIC_TORQUE
    bench.enable()
    # 10 turns/s² of friction take 0.063 N·m
    drive(bench, 50, torque=50)
    assert bench.node.motor.velocity == 0.0
    drive(bench, 51, torque=163)
    assert bench.node.motor.velocity == pytest.approx(0.1 / 0.001 / math.tau * 50 * PERIOD_S, rel=0.05)


def test_a_mode_that_the_drive_has_not_is_not_taken(bench: Bench) -> None:
    bench.enable()
    bench.mode = Mode.PROFILE_VELOCITY
    assert [bench.cycle()[1] for _ in range(3)] == [Mode.CYCLIC_POSITION] * 3


def test_halt_stops_without_leaving_operation(bench: Bench) -> None:
    bench.write(0x6084, 0, "I", 4_000_000)
    bench.enable()
    for _ in range(20):
        bench.cycle(ENABLE, (bench.target or 0) + 2000)
    statusword = bench.cycles(60, HALT)
    assert statusword & STATE_MASK == ENABLED
    assert statusword & TARGET_REACHED
    assert bench.read(0x606C, 0, "i") == 0


# ---------------------------------------------------------------------- profile position


def test_pp_takes_a_setpoint_by_its_handshake_and_reaches_it(bench: Bench) -> None:
    bench.write(0x6081, 0, "I", 2 * COUNTS)
    bench.write(0x6083, 0, "I", 20 * COUNTS)
    bench.write(0x6084, 0, "I", 20 * COUNTS)
    bench.mode = Mode.PROFILE_POSITION
    bench.enable()
    start = bench.position
    assert bench.cycles(2, ENABLE, start + COUNTS) & BIT_12 == 0
    assert bench.position == start
    taken = bench.cycles(3, ENABLE | NEW_SETPOINT)
    assert taken & BIT_12
    assert not taken & TARGET_REACHED
    assert bench.cycles(3, ENABLE) & BIT_12 == 0
    bench.cycles(40, ENABLE)
    assert bench.read(0x606C, 0, "i") == pytest.approx(2 * COUNTS, rel=0.02)
    until_rest(bench, ENABLE)
    bench.cycles(40, ENABLE)
    assert bench.position == start + COUNTS


def test_pp_takes_its_time_from_the_clock_and_not_from_60c2h(bench: Bench) -> None:
    bench.write(0x60C2, 1, "B", 1)
    bench.write(0x6081, 0, "I", 2 * COUNTS)
    bench.mode = Mode.PROFILE_POSITION
    bench.enable()
    start = bench.position
    bench.cycles(3, ENABLE | NEW_SETPOINT, start + COUNTS)
    bench.cycles(100, ENABLE)
    # 0.5 s for a turn at two turns a second
    assert bench.position == pytest.approx(start + COUNTS, abs=COUNTS // 50)


def test_pp_queues_one_setpoint_and_takes_relative_ones(bench: Bench) -> None:
    bench.write(0x6083, 0, "I", 20 * COUNTS)
    bench.write(0x6084, 0, "I", 20 * COUNTS)
    bench.mode = Mode.PROFILE_POSITION
    bench.enable()
    start = bench.position
    bench.cycles(3, ENABLE | NEW_SETPOINT, start + COUNTS)
    bench.cycles(3, ENABLE)
    bench.cycles(3, ENABLE | NEW_SETPOINT | RELATIVE, COUNTS)
    # the second is acknowledged once there is room for it
    assert bench.cycles(3, ENABLE) & BIT_12
    until_rest(bench, ENABLE)
    bench.cycles(60, ENABLE)
    assert bench.position == start + 2 * COUNTS


def test_pp_changes_its_target_at_once_where_bit_5_says_so(bench: Bench) -> None:
    bench.write(0x6081, 0, "I", COUNTS)
    bench.mode = Mode.PROFILE_POSITION
    bench.enable()
    start = bench.position
    bench.cycles(20, ENABLE | NEW_SETPOINT, start + 100 * COUNTS)
    bench.cycles(3, ENABLE)
    bench.cycles(3, ENABLE | NEW_SETPOINT | AT_ONCE, start)
    until_rest(bench, ENABLE)
    bench.cycles(60, ENABLE)
    assert bench.position == start


# ---------------------------------------------------------------------- limits and errors


def test_a_software_limit_holds_the_demand_and_is_shown(bench: Bench) -> None:
    bench.write(0x607D, 1, "i", -1000)
    bench.write(0x607D, 2, "i", 1000)
    bench.enable()
    bench.cycles(100, ENABLE, 0)
    statusword = bench.cycles(100, ENABLE, 5000)
    assert statusword & INTERNAL_LIMIT
    assert bench.position == 1000


def test_a_following_error_beyond_its_window_and_time_is_a_fault(bench: Bench) -> None:
    bench.write(0x6065, 0, "I", 5000)
    bench.write(0x6066, 0, "H", 50)
    bench.enable()
    bench.node.request("following_error", {}, bench.now)
    shown = []
    for _ in range(40):
        shown.append(bench.cycle(ENABLE, (bench.target or 0) + 1000)[0])
    assert shown[-1] & STATE_MASK == FAULT
    assert shown[-1] & BIT_13
    # 6 cycles to leave the window, 50 ms, one SYNC to be seen
    first = next(cycle for cycle, word in enumerate(shown) if word & BIT_13)
    assert 14 <= first <= 18
    assert bench.read(0x603F, 0, "H") == 0x8611
    assert bench.emergencies() == [0x8611]


def test_the_default_window_lets_any_error_pass(bench: Bench) -> None:
    bench.enable()
    bench.node.request("following_error", {}, bench.now)
    assert bench.cycles(100, ENABLE, bench.position + 10 * COUNTS) & STATE_MASK == ENABLED
    assert bench.read(0x60F4, 0, "i") == 10 * COUNTS


# ---------------------------------------------------------------------- units


def test_gear_and_feed_make_the_units_of_position(bench: Bench) -> None:
    bench = Bench(position=10.0).boot()
    assert bench.position == 10 * COUNTS
    for index, pair in ((0x608F, (COUNTS, 1)), (0x6091, (5, 1)), (0x6092, (36_000, 1))):
        for subindex, value in enumerate(pair, start=1):
            bench.write(index, subindex, "I", value)
    # 10 turns of the motor, 2 of the shaft, 360.00° each
    assert bench.position == 72_000


@pytest.mark.parametrize(("increments", "pair"), [(20_000.0, (20_000, 1)), (10_000 / 3, (10_000, 3))])
def test_a_drive_says_the_encoder_that_it_has(increments: float, pair: tuple[int, int]) -> None:
    bench = Bench(position=3.0, hardware=Hardware(increments_per_turn=increments)).boot()
    assert tuple(bench.node.store.entry(0x608F, subindex).value for subindex in (1, 2)) == pair
    assert bench.position == 3 * increments


def test_an_unwritten_feed_constant_leaves_increments(bench: Bench) -> None:
    bench = Bench(position=3.0, hardware=Hardware(increments_per_turn=4096)).boot()
    bench.write(0x608F, 1, "I", 4096)
    assert bench.position == 3 * 4096


def test_an_encoder_resolution_that_is_wrong_gives_wrong_positions() -> None:
    bench = Bench(position=1.0, hardware=Hardware(increments_per_turn=4096)).boot()
    bench.write(0x608F, 1, "I", 1024)
    bench.write(0x6092, 1, "I", 1000)
    assert bench.position == 4000


def test_a_polarity_turns_positions_round() -> None:
    bench = Bench(position=1.0).operate()
    bench.write(0x607E, 0, "B", 0xC0)
    assert bench.position == -COUNTS
    bench.enable()
    bench.cycles(200, ENABLE, -2 * COUNTS)
    assert bench.node.motor.position == pytest.approx(2.0)


def test_a_motor_that_is_off_runs_out_by_friction_or_its_brake() -> None:
    gone = []
    for brake in (False, True):
        bench = Bench(hardware=Hardware(friction=5.0, max_acceleration=500.0, brake=brake)).operate().enable()
        for _ in range(40):
            bench.cycle(ENABLE, (bench.target or 0) + 3000)
        before = bench.node.motor.position
        assert bench.cycles(500, DISABLE_VOLTAGE) & STATE_MASK == SWITCH_ON_DISABLED
        gone.append(bench.node.motor.position - before)
    # 9.2 turn/s: v²/2a by friction, and next to nothing by the brake
    assert gone[0] == pytest.approx(9.155**2 / 10.0, rel=0.05)
    assert gone[1] < 0.2


def test_the_second_tpdo_tells_speed_and_torque_at_every_tenth_sync(bench: Bench) -> None:
    bench.mode = Mode.CYCLIC_VELOCITY
    bench.enable()
    bench.taken()
    drive(bench, 100, velocity=70_000)
    received = bench.taken(Function.TPDO2 + NODE)
    assert len(received) == 10
    velocity, _ = TPDO2.packing.unpack(received[-1])
    assert velocity == pytest.approx(70_000, rel=0.01)


def test_a_node_in_pre_operational_tells_where_it_is_by_sdo_and_not_by_pdo() -> None:
    bench = Bench(position=-1.5).boot()
    bench.receive(SYNC)
    assert bench.taken(Function.TPDO1 + NODE) == []
    assert bench.position == -1.5 * COUNTS
    with pytest.raises(Aborted):
        bench.write(0x6064, 0, "i", 0)
