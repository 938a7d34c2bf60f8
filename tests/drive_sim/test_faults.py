"""Faults on demand: each does what its name says, and ends with clear."""

from __future__ import annotations

import struct

import pytest

from mcserver.can.cob import SYNC, Function
from mcserver.can.pdo_layout import Mode
from mcserver.drive_sim.fault_injection import FAULTS, BadRequest
from mcserver.drive_sim.motor import Hardware
from tests.drive_sim.bench import (
    DISABLE_VOLTAGE,
    ENABLE,
    ENABLED,
    FAULT,
    NODE,
    PERIOD_S,
    SHUTDOWN,
    STATE_MASK,
    SWITCH_ON_DISABLED,
    Aborted,
    Bench,
)

NEW_SETPOINT, ACKNOWLEDGED = 1 << 4, 1 << 12
TPDO1 = Function.TPDO1 + NODE
HEARTBEAT = Function.HEARTBEAT + NODE


@pytest.fixture
def bench() -> Bench:
    bench = Bench().operate()
    bench.write(0x1017, 0, "H", 20)
    bench.enable()
    bench.taken()
    return bench


def ask(bench: Bench, fault: str, **values: object) -> None:
    bench.node.request(fault, values, bench.now)


def sync(bench: Bench, count: int = 1) -> list[int]:
    """How many TPDO1 came with each of so many SYNCs."""
    came = []
    for _ in range(count):
        bench.wait(PERIOD_S)
        bench.receive(SYNC)
        came.append(len(bench.taken(TPDO1)))
    return came


def test_a_mute_drive_sends_nothing_at_all_and_goes_on_inside(bench: Bench) -> None:
    ask(bench, "mute")
    assert sync(bench, 20) == [0] * 20
    bench.receive(Function.SDO_REQUEST + NODE, struct.pack("<BHB4x", 0x40, 0x1000, 0))
    assert bench.sent == []
    ask(bench, "clear")
    assert sync(bench) == [1]
    assert bench.state == ENABLED


def test_late_tpdos_come_so_many_syncs_late_with_what_they_had(bench: Bench) -> None:
    ask(bench, "late_tpdo", syncs=2)
    assert sync(bench, 4) == [0, 0, 1, 1]
    moved = []
    for step in range(1, 8):
        bench.wait(PERIOD_S)
        bench.receive(Function.RPDO1 + NODE, struct.pack("<Hbi", ENABLE, 8, (bench.target or 0) + 100 * step))
        bench.receive(SYNC)
        moved.append(struct.unpack_from("<i", bench.taken(TPDO1)[0], 3)[0])
    # applied at the SYNC, reached at the next one, reported two later
    assert moved[:3] == [bench.target] * 3
    assert moved[4] == pytest.approx((bench.target or 0) + 200, abs=30)
    ask(bench, "clear")
    assert sync(bench, 3) == [1, 1, 1]


def test_short_tpdos_lack_a_byte(bench: Bench) -> None:
    ask(bench, "short_tpdo")
    bench.receive(SYNC)
    assert [len(payload) for payload in bench.taken(TPDO1)] == [6]
    ask(bench, "clear")
    bench.receive(SYNC)
    assert [len(payload) for payload in bench.taken(TPDO1)] == [7]


def test_an_emergency_takes_the_drive_into_fault_unless_it_is_only_reported(bench: Bench) -> None:
    ask(bench, "emcy", code=0x4210, fatal=0)
    assert bench.emergencies() == [0x4210]
    assert bench.cycles(20, ENABLE) & STATE_MASK == ENABLED
    ask(bench, "emcy", code=0x7305)
    assert bench.emergencies() == [0x7305]
    assert bench.cycles(20, ENABLE) & STATE_MASK == FAULT


def test_a_stuck_drive_ignores_controlwords(bench: Bench) -> None:
    ask(bench, "stuck")
    assert bench.cycles(20, DISABLE_VOLTAGE) & STATE_MASK == ENABLED
    ask(bench, "clear")
    assert bench.cycles(3, DISABLE_VOLTAGE) & STATE_MASK == SWITCH_ON_DISABLED


def test_an_object_can_be_refused_by_any_abort_code(bench: Bench) -> None:
    ask(bench, "sdo_abort", index=0x6065, code=0x08000022)
    ask(bench, "sdo_abort", index=0x1018, subindex=2, code=0x06060000)
    for index, subindex, code in ((0x6065, 0, 0x08000022), (0x1018, 2, 0x06060000)):
        with pytest.raises(Aborted) as aborted:
            bench.read(index, subindex, "I")
        assert aborted.value.args == (code,)
    assert bench.read(0x1018, 1, "I") == 0
    ask(bench, "clear")
    assert bench.read(0x6065, 0, "I") == 0xFFFFFFFF


def test_answers_of_sdo_can_be_late(bench: Bench) -> None:
    ask(bench, "sdo_delay", seconds=0.5)
    bench.receive(Function.SDO_REQUEST + NODE, struct.pack("<BHB4x", 0x40, 0x1000, 0))
    bench.wait(0.49)
    assert bench.taken(Function.SDO_RESPONSE + NODE) == []
    bench.wait(0.02)
    assert len(bench.taken(Function.SDO_RESPONSE + NODE)) == 1


def test_a_reboot_in_motion_is_seen_by_silence_and_the_boot_up_message(bench: Bench) -> None:
    for _ in range(20):
        bench.cycle(ENABLE, (bench.target or 0) + 2000)
    bench.taken()
    before = bench.node.motor.position
    ask(bench, "reboot")
    assert sync(bench, 3) == [0, 0, 0]
    bench.wait(0.1)
    assert bench.taken(HEARTBEAT) == [b"\x00"]
    assert bench.read(0x6041, 0, "H") & STATE_MASK == SWITCH_ON_DISABLED
    assert bench.read(0x1A00, 0, "B") == 1
    # the motor ran out, and its encoder knows where it is
    bench.wait(3.0)
    assert bench.node.motor.velocity == 0.0
    assert bench.position == round(bench.node.motor.position * 65536)
    assert bench.node.motor.position > before


def test_a_heartbeat_can_stop_alone(bench: Bench) -> None:
    ask(bench, "heartbeat_stop")
    bench.taken()
    assert sync(bench, 40) == [1] * 40
    assert bench.taken(HEARTBEAT) == []
    ask(bench, "clear")
    bench.wait(0.1)
    assert len(bench.taken(HEARTBEAT)) >= 4


def test_a_jammed_shaft_stands_whatever_the_drive_does(bench: Bench) -> None:
    before = bench.position
    ask(bench, "following_error")
    assert bench.cycles(50, ENABLE, before + 5000) & STATE_MASK == ENABLED
    assert bench.position == before
    ask(bench, "clear")
    bench.cycles(100, ENABLE)
    assert bench.position == before + 5000


def test_a_following_error_of_the_drives_own_is_8611h(bench: Bench) -> None:
    ask(bench, "following_error", trip=1)
    assert bench.emergencies() == [0x8611]
    assert bench.cycles(20, ENABLE) & STATE_MASK == FAULT


def test_dropped_syncs_are_not_answered_and_not_applied(bench: Bench) -> None:
    ask(bench, "drop_sync", syncs=3)
    assert sync(bench, 5) == [0, 0, 0, 1, 1]


def test_setpoints_of_profile_position_can_stay_without_an_acknowledgement() -> None:
    bench = Bench().operate()
    bench.mode = Mode.PROFILE_POSITION
    bench.enable()
    start = bench.position
    ask(bench, "ignore_setpoints")
    assert bench.cycles(40, ENABLE | NEW_SETPOINT, start + 5000) & ACKNOWLEDGED == 0
    assert bench.position == start
    ask(bench, "clear")
    bench.cycles(2, ENABLE)
    assert bench.cycles(2, ENABLE | NEW_SETPOINT) & ACKNOWLEDGED


def test_a_reversed_motor_turns_against_its_torque() -> None:
    bench = Bench().operate()
    bench.mode = Mode.CYCLIC_TORQUE
    bench.enable()
    ask(bench, "reverse_torque")
    for _ in range(10):
        bench.receive(Function.RPDO2 + NODE, struct.pack("<Hih", ENABLE, 0, 200))
        bench.cycle(ENABLE)
    assert bench.node.motor.velocity < 0.0
    assert bench.node.describe()["faults"] == ["reverse_torque"]


def test_pins_of_the_drive_can_be_set_and_its_home_switch_is_where_the_shaft_is() -> None:
    bench = Bench(hardware=Hardware(home_switch=(-1.0, -0.5))).operate()
    ask(bench, "inputs", bits=1 << 31 | 1)
    assert bench.read(0x60FD, 0, "I") == 1 << 31 | 1
    bench.node.motor.position = -0.75
    bench.cycles(2)
    assert bench.read(0x60FD, 0, "I") == 1 << 31 | 1 | 4
    bench.write(0x60FE, 1, "I", 0x30000)
    bench.write(0x60FE, 2, "I", 0x10000)
    assert bench.node.describe()["outputs"] == 0x10000


def test_what_a_drive_does_wrong_can_be_asked(bench: Bench) -> None:
    ask(bench, "stuck")
    ask(bench, "late_tpdo", syncs=1)
    ask(bench, "following_error")
    assert set(bench.node.describe()["faults"]) == {"stuck", "late_tpdo", "following_error"}  # type: ignore[call-overload]
    ask(bench, "clear")
    assert bench.node.describe()["faults"] == []
    assert bench.node.describe()["power"] == "OPERATION_ENABLED"


@pytest.mark.parametrize(
    ("fault", "values"),
    [
        ("explode", {}),
        ("mute", {"syncs": 1}),
        ("late_tpdo", {"syncs": 0}),
        ("late_tpdo", {"syncs": "two"}),
        ("sdo_abort", {}),
        ("emcy", {"code": 0x10000}),
    ],
)
def test_a_request_that_cannot_be_meant_is_refused(
    bench: Bench, fault: str, values: dict[str, object]
) -> None:
    with pytest.raises(BadRequest):
        ask(bench, fault, **values)
    assert bench.cycles(3, ENABLE) & STATE_MASK == ENABLED


def test_every_fault_can_be_asked_of_a_drive_that_is_off_and_cleared() -> None:
    for fault, values in FAULTS.items():
        bench = Bench().operate()
        given = {name: default for name, (_, _, default) in values.items() if default is not None}
        given |= {"sdo_abort": {"index": 0x1000}, "inputs": {"bits": 1}}.get(fault, {})
        ask(bench, fault, **given)
        bench.wait(0.5)
        ask(bench, "clear")
        bench.wait(0.5)
        bench.write(0x6040, 0, "H", 0x80)
        bench.write(0x6040, 0, "H", SHUTDOWN)
        assert bench.state == 0x21, fault
