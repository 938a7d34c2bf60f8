"""The simulated Servosila drive: streamed commands, free-running telemetry, faults."""

from __future__ import annotations

import struct

import pytest

from mcserver.can.cob import Function
from mcserver.can.port import Frame
from mcserver.drive_sim.fault_injection import BadRequest
from mcserver.drive_sim.motor import Hardware
from mcserver.drive_sim.servosila_node import ServosilaNode

NODE = 7
PERIOD_S = 0.005
TIMEOUT_S = 0.1
COUNTS = 4096.0
PAIRS = 7
RESET, STOP, SPEED, SERVO, STEPPER, RESET_WORK_ZONE = 0x01, 0x04, 0x20, 0x30, 0x38, 0xE0
OFF, RPM, TORQUE = 0x02, 0x21, 0x22
CODES = {
    "reset": RESET,
    "stop": STOP,
    "speed": SPEED,
    "servo": SERVO,
    "reset_work_zone": RESET_WORK_ZONE,
    "off": OFF,
    "rpm": RPM,
    "torque": TORQUE,
}


class Rig:
    """A drive, a clock, and the last of its telemetry."""

    def __init__(self, position: float = 3.25, *, absolute: bool = False) -> None:
        self.now = 10.0
        self.sent: list[Frame] = []
        hardware = Hardware(increments_per_turn=COUNTS, inertia=0.01, friction=2.0)
        self.node = ServosilaNode(
            NODE,
            lambda identifier, payload: self.sent.append((identifier, payload)),
            CODES,
            hardware,
            position,
            pole_pairs=PAIRS,
            telemetry_s=PERIOD_S,
            timeout_s=TIMEOUT_S,
            absolute=absolute,
        )
        self.node.switch_on(self.now)
        self.wait(0.1)

    def wait(self, time_s: float) -> None:
        end = self.now + time_s
        while self.node.wake <= end:
            self.now = max(self.now, self.node.wake)
            self.node.poll(self.now)
        self.now = end

    def command(self, code: int, value: float = 0.0) -> None:
        self.node.receive(Function.RPDO1 + NODE, struct.pack("<B3xf", code, value), self.now)

    def stream(self, cycles: int, code: int, value: float = 0.0) -> None:
        for _ in range(cycles):
            self.command(code, value)
            self.wait(PERIOD_S)

    def last(self, function: Function) -> bytes:
        return [payload for identifier, payload in self.sent if identifier == function + NODE][-1]

    @property
    def fault_bits(self) -> int:
        bits: int = struct.unpack_from("<H", self.last(Function.TPDO1))[0]
        return bits

    @property
    def electrical_hz(self) -> float:
        speed: float = struct.unpack_from("<f", self.last(Function.TPDO1), 4)[0]
        return speed

    @property
    def work_zone(self) -> float:
        count: float = struct.unpack("<ff", self.last(Function.TPDO2))[1]
        return count


def test_telemetry_runs_by_itself_at_its_rate_on_three_identifiers() -> None:
    rig = Rig()
    rig.sent.clear()
    rig.wait(0.5)
    for function in (Function.TPDO1, Function.TPDO2, Function.TPDO3):
        frames = [payload for identifier, payload in rig.sent if identifier == function + NODE]
        assert len(frames) == 100
        assert {len(payload) for payload in frames} == {8}


def test_the_work_zone_begins_at_0_wherever_the_motor_stands() -> None:
    assert Rig(position=-123.4).work_zone == 0.0


def test_a_servo_command_moves_to_counts_of_the_work_zone() -> None:
    rig = Rig()
    rig.stream(200, SERVO, 1000.0)
    assert rig.work_zone == pytest.approx(1000.0, abs=0.5)
    rig.stream(200, SERVO, -500.0)
    assert rig.work_zone == pytest.approx(-500.0, abs=0.5)
    assert rig.node.motor.position == pytest.approx(3.25 - 500.0 / COUNTS, abs=1e-3)


def test_a_stepper_command_is_an_offset_and_a_stream_of_them_runs_away() -> None:
    rig = Rig()
    rig.stream(200, SERVO, 1000.0)
    rig.command(STEPPER, -500.0)
    rig.stream(200, SERVO, 500.0)
    assert rig.work_zone == pytest.approx(500.0, abs=0.5)
    rig.stream(200, STEPPER, -500.0)
    assert rig.work_zone < -10_000.0


def test_with_an_absolute_encoder_the_angle_within_the_turn_stays_after_a_reset() -> None:
    rig = Rig(position=3.25, absolute=True)
    assert rig.work_zone == pytest.approx(0.25 * COUNTS)
    rig.stream(200, SERVO, 2.5 * COUNTS)
    rig.command(RESET)
    rig.wait(0.1)
    assert rig.work_zone == pytest.approx(0.5 * COUNTS, abs=1.0)


def test_the_dc_bus_voltage_is_in_bytes_2_and_3_of_the_status() -> None:
    (raw,) = struct.unpack_from("<h", Rig().last(Function.TPDO1), 2)
    assert raw * 128.0 / 32767.0 == pytest.approx(48.0, abs=0.01)


@pytest.mark.parametrize(("code", "value"), [(SPEED, 2.0 * PAIRS), (RPM, 120.0)])
def test_speeds_are_electrical_hertz_or_turns_a_minute(code: int, value: float) -> None:
    rig = Rig()
    rig.stream(200, code, value)
    assert rig.electrical_hz == pytest.approx(2.0 * PAIRS, rel=0.01)


def test_a_torque_accelerates_the_motor() -> None:
    rig = Rig()
    rig.stream(40, TORQUE, 1.0)
    # 1 N·m on 0.01 kg·m² for 0.2 s less friction of 2 turn/s²
    assert rig.node.motor.velocity == pytest.approx((100.0 / 6.2832 - 2.0) * 0.2, rel=0.05)


def test_stop_brakes_and_off_lets_it_run_out() -> None:
    rig = Rig()
    rig.stream(100, RPM, 600.0)
    rig.stream(10, STOP)
    assert rig.electrical_hz == pytest.approx(0.0, abs=0.5)
    rig.stream(100, RPM, 600.0)
    rig.stream(10, OFF)
    assert rig.node.motor.velocity == pytest.approx(10.0, rel=0.05)


def test_commands_have_to_be_streamed_or_the_motor_stops() -> None:
    rig = Rig()
    rig.stream(100, RPM, 600.0)
    rig.wait(TIMEOUT_S - 0.02)
    assert rig.node.motor.velocity == pytest.approx(10.0, rel=0.05)
    rig.wait(0.2)
    assert rig.node.motor.velocity == 0.0
    rig.stream(100, RPM, 600.0)
    assert rig.node.motor.velocity == pytest.approx(10.0, rel=0.05)


def test_after_a_fault_only_reset_counts_and_it_zeroes_the_work_zone() -> None:
    rig = Rig()
    rig.stream(200, SERVO, 1000.0)
    rig.node.request("emcy", {"code": 0x0010}, rig.now)
    for code in (SERVO, RPM, STOP, OFF, RESET_WORK_ZONE):
        rig.stream(20, code, 2000.0)
        assert rig.fault_bits == 0x0010
    assert rig.work_zone == pytest.approx(1000.0, abs=1.0)
    rig.stream(1, RESET)
    assert rig.fault_bits == 0
    assert rig.work_zone == 0.0
    rig.stream(200, SERVO, 100.0)
    assert rig.work_zone == pytest.approx(100.0, abs=0.5)


def test_the_work_zone_can_be_zeroed_without_a_fault() -> None:
    rig = Rig()
    rig.stream(200, SERVO, 1000.0)
    rig.stream(20, OFF)
    rig.stream(1, RESET_WORK_ZONE)
    assert rig.work_zone == pytest.approx(0.0, abs=0.5)


@pytest.mark.parametrize(
    "payload", [b"", b"\x30", struct.pack("<B3xf", 0x99, 5.0), struct.pack("<B3xf", SERVO, float("nan"))]
)
def test_what_is_no_command_is_left_out(payload: bytes) -> None:
    rig = Rig()
    rig.node.receive(Function.RPDO1 + NODE, payload, rig.now)
    rig.wait(0.3)
    assert rig.node.motor.velocity == 0.0
    assert rig.node.describe()["power"] == "OFF"


def test_a_jammed_shaft_is_a_fault_once_it_stays_behind() -> None:
    rig = Rig()
    rig.stream(20, SERVO, 0.0)
    rig.node.request("following_error", {}, rig.now)
    rig.stream(200, SERVO, 10_000.0)
    assert rig.fault_bits != 0
    assert rig.work_zone == 0.0


def test_a_reboot_is_silence_and_a_work_zone_that_begins_anew() -> None:
    rig = Rig()
    rig.stream(200, SERVO, 1000.0)
    rig.sent.clear()
    rig.node.request("reboot", {}, rig.now)
    rig.wait(0.04)
    assert rig.sent == []
    rig.wait(0.1)
    assert rig.work_zone == 0.0


def test_mute_late_and_short_telemetry() -> None:
    rig = Rig()
    rig.sent.clear()
    rig.node.request("mute", {}, rig.now)
    rig.wait(0.1)
    assert rig.sent == []
    rig.node.request("clear", {}, rig.now)
    rig.node.request("short_tpdo", {}, rig.now)
    rig.wait(0.1)
    assert {len(payload) for _, payload in rig.sent} == {7}
    rig.node.request("clear", {}, rig.now)
    rig.node.request("late_tpdo", {"syncs": 4}, rig.now)
    rig.sent.clear()
    rig.wait(3.9 * PERIOD_S)
    assert rig.sent == []
    rig.wait(2.0 * PERIOD_S)
    assert rig.work_zone == 0.0


def test_faults_of_canopen_are_refused() -> None:
    rig = Rig()
    refused: dict[str, dict[str, int]] = {
        "sdo_delay": {},
        "sdo_abort": {"index": 0x1000},
        "drop_sync": {},
        "ignore_setpoints": {},
        "reverse_torque": {},
        "inputs": {"bits": 1},
    }
    for fault, values in refused.items():
        with pytest.raises(BadRequest):
            rig.node.request(fault, values, rig.now)
