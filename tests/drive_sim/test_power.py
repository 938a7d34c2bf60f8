"""The power state machine of the simulated drive (CiA 402-2, clause 6)."""

from __future__ import annotations

import pytest

from mcserver.can.cob import SYNC
from tests.drive_sim.bench import (
    DISABLE_VOLTAGE,
    ENABLE,
    ENABLED,
    FAULT,
    FAULT_RESET,
    PERIOD_S,
    QUICK_STOP,
    QUICK_STOPPED,
    READY,
    SHUTDOWN,
    STATE_MASK,
    SWITCH_ON,
    SWITCH_ON_DISABLED,
    SWITCHED_ON,
    Bench,
)

START_CYCLES = 12
RUN_COUNTS = 2000


@pytest.fixture
def bench() -> Bench:
    return Bench().operate()


def state(bench: Bench, controlword: int, cycles: int = START_CYCLES) -> int:
    return bench.cycles(cycles, controlword) & STATE_MASK


def run(bench: Bench, cycles: int = 20) -> None:
    """Lets the enabled drive travel evenly."""
    for _ in range(cycles):
        bench.cycle(ENABLE, (bench.target or 0) + RUN_COUNTS)


def test_the_way_up_and_down_is_the_standards(bench: Bench) -> None:
    way = [
        (DISABLE_VOLTAGE, SWITCH_ON_DISABLED),
        (SWITCH_ON, SWITCH_ON_DISABLED),
        (ENABLE, SWITCH_ON_DISABLED),
        (SHUTDOWN, READY),
        (SWITCH_ON, SWITCHED_ON),
        (ENABLE, ENABLED),
        (SWITCH_ON, SWITCHED_ON),
        (SHUTDOWN, READY),
        (ENABLE, ENABLED),
        (SHUTDOWN, READY),
        (SWITCH_ON, SWITCHED_ON),
        (DISABLE_VOLTAGE, SWITCH_ON_DISABLED),
        (SHUTDOWN, READY),
        (QUICK_STOP, SWITCH_ON_DISABLED),
        (SHUTDOWN, READY),
        (ENABLE, ENABLED),
        (DISABLE_VOLTAGE, SWITCH_ON_DISABLED),
    ]
    assert [state(bench, controlword) for controlword, _ in way] == [shown for _, shown in way]


def test_the_statusword_shows_voltage_and_remote(bench: Bench) -> None:
    assert bench.cycles(2, SHUTDOWN) & 0x0210 == 0x0210


def test_energizing_takes_its_time_and_a_command_in_between_counts() -> None:
    bench = Bench(energize_s=0.1).operate()
    bench.cycles(3, SHUTDOWN)
    assert state(bench, SWITCH_ON, 15) == READY
    assert state(bench, SWITCH_ON, 10) == SWITCHED_ON
    assert state(bench, ENABLE, 15) == SWITCHED_ON
    assert state(bench, SHUTDOWN, 2) == READY
    assert state(bench, ENABLE, 60) == ENABLED


def test_commands_answer_one_sync_after_the_one_they_are_applied_at(bench: Bench) -> None:
    answers = [bench.cycle(SHUTDOWN)[0] & STATE_MASK for _ in range(3)]
    assert answers == [SWITCH_ON_DISABLED, READY, READY]


def test_a_quick_stop_brings_a_moving_motor_to_rest_and_then_off(bench: Bench) -> None:
    bench.write(0x6085, 0, "I", 2_000_000)
    bench.enable()
    run(bench)
    # 400 000 counts/s at 2 000 000 counts/s²: 0.2 s
    assert state(bench, QUICK_STOP, 20) == QUICK_STOPPED
    assert 0 < bench.read(0x606C, 0, "i") < 400_000
    assert state(bench, QUICK_STOP, 60) == SWITCH_ON_DISABLED
    assert bench.read(0x606C, 0, "i") == 0


def test_a_quick_stop_that_stays_holds_and_can_be_left_by_enabling(bench: Bench) -> None:
    bench.write(0x605A, 0, "h", 6)
    bench.enable()
    run(bench)
    assert state(bench, QUICK_STOP, 60) == QUICK_STOPPED
    bench.target = bench.position
    assert state(bench, ENABLE, 3) == ENABLED


def test_quick_stop_option_0_switches_off_at_once(bench: Bench) -> None:
    bench.write(0x605A, 0, "h", 0)
    bench.enable()
    run(bench)
    assert state(bench, QUICK_STOP, 2) == SWITCH_ON_DISABLED


def test_disabling_operation_comes_to_rest_first(bench: Bench) -> None:
    bench.write(0x6084, 0, "I", 4_000_000)
    bench.enable()
    run(bench)
    assert state(bench, SWITCH_ON, 5) == ENABLED
    assert state(bench, SWITCH_ON, 60) == SWITCHED_ON


def test_disabling_voltage_lets_the_motor_run_out(bench: Bench) -> None:
    bench.enable()
    run(bench)
    assert state(bench, DISABLE_VOLTAGE, 2) == SWITCH_ON_DISABLED
    assert bench.read(0x606C, 0, "i") > 300_000
    bench.cycles(2000, DISABLE_VOLTAGE)
    assert bench.read(0x606C, 0, "i") == 0


def test_a_fault_is_left_by_the_rising_edge_of_bit_7_alone(bench: Bench) -> None:
    bench.enable()
    bench.node.request("emcy", {"code": 0x2310}, bench.now)
    assert state(bench, ENABLE, 30) == FAULT
    for controlword in (SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE):
        assert state(bench, controlword, 3) == FAULT
    assert state(bench, FAULT_RESET, 3) == SWITCH_ON_DISABLED
    assert bench.read(0x603F, 0, "H") == 0


def test_a_bit_7_that_was_there_before_the_fault_resets_nothing(bench: Bench) -> None:
    bench.cycles(3, FAULT_RESET)
    bench.node.request("emcy", {"code": 0x2310}, bench.now)
    assert state(bench, FAULT_RESET, 5) == FAULT
    assert state(bench, 0, 3) == FAULT
    assert state(bench, FAULT_RESET, 3) == SWITCH_ON_DISABLED


def test_after_a_fault_nothing_is_enabled_by_a_command_that_was_held(bench: Bench) -> None:
    bench.enable()
    bench.node.request("emcy", {"code": 0x2310}, bench.now)
    bench.cycles(30, ENABLE)
    assert state(bench, ENABLE | FAULT_RESET, 3) == SWITCH_ON_DISABLED
    assert state(bench, ENABLE, 30) == SWITCH_ON_DISABLED


def test_a_fault_brings_a_moving_motor_to_rest(bench: Bench) -> None:
    bench.write(0x6085, 0, "I", 2_000_000)
    bench.enable()
    run(bench)
    bench.node.request("emcy", {"code": 0x4310}, bench.now)
    assert state(bench, ENABLE, 10) == 0x0F
    assert state(bench, ENABLE, 60) == FAULT
    assert bench.read(0x606C, 0, "i") == 0


def test_fault_reaction_option_0_switches_off_at_once(bench: Bench) -> None:
    bench.write(0x605E, 0, "h", 0)
    bench.enable()
    run(bench)
    bench.node.request("emcy", {"code": 0x4310}, bench.now)
    assert state(bench, ENABLE, 1) == FAULT


def test_a_drive_without_syncs_goes_on_by_its_own_clock() -> None:
    bench = Bench().boot()
    for controlword, shown in ((SHUTDOWN, READY), (ENABLE, ENABLED), (DISABLE_VOLTAGE, SWITCH_ON_DISABLED)):
        bench.write(0x6040, 0, "H", controlword)
        bench.wait(0.2)
        assert bench.state == shown


def test_a_motor_runs_on_to_its_target_when_the_sync_goes_away_in_motion(bench: Bench) -> None:
    bench.enable()
    run(bench)
    assert bench.node.motor.velocity > 1.0
    bench.wait(0.5)
    assert bench.node.motor.velocity == 0.0


def test_an_enabled_drive_that_loses_the_sync_stops_moving(bench: Bench) -> None:
    bench.enable()
    run(bench)
    bench.wait(0.5)
    assert abs((bench.target or 0) - bench.position) < 10
    assert bench.read(0x606C, 0, "i") == 0
    bench.wait(PERIOD_S)
    bench.receive(SYNC)
    assert bench.state == ENABLED
