"""Damiao's motors: frames, what is read of a motor before it is energized, and faults.

The motor is the simulated one, on a bus in memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.drive_sim.damiao_node import DamiaoNode
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.drives.damiao.codec import (
    REGISTERS,
    Order,
    Ranges,
    Register,
    Status,
    register_request,
)
from mcserver.drives.mit_numbers import Feedback
from mcserver.errors import ConfigurationError, RuntimeFault
from mcserver.machine.machine_file import Machine
from tests.drives.mit_bench import TRAVEL, MitBench, mit_machine

RANGES = Ranges(12.5, 30.0, 10.0)
KEYS = "p_max = 12.5\nv_max = 30.0\nt_max = 10.0\nkp = 50.0\nkd = 1.0\n"


def machine(drive: str = KEYS, axis: str = TRAVEL) -> Machine:
    """One joint whose motor answers by 13h."""
    return mit_machine("damiao", drive, axis)


@dataclass
class Bench(MitBench):
    """A bus and its motor, exchange by exchange."""

    described: Machine = field(default_factory=machine)

    @property
    def said(self) -> set[bytes]:
        """Last bytes of the orders that were sent."""
        return {
            payload for identifier, payload in self.port.sent if identifier == 3 and payload[:1] == b"\xff"
        }


# ---------------------------------------------------------------------- frames


def test_a_command_is_five_numbers_in_eight_bytes() -> None:
    # the ends and the middle of each range, by the maker's manual: 16, 12, 12, 12 and 12 bits
    assert RANGES.command(-12.5, -30.0, 0.0, 0.0, -10.0) == bytes(8)
    assert RANGES.command(12.5, 30.0, 500.0, 5.0, 10.0) == b"\xff" * 8
    assert RANGES.command(-12.5, 30.0, 0.0, 5.0, -10.0) == bytes.fromhex("0000fff000fff000")


@given(
    st.tuples(
        st.floats(-12.5, 12.5),
        st.floats(-30.0, 30.0),
        st.floats(0.0, 500.0),
        st.floats(0, 5.0),
        st.floats(-10, 10),
    )
)
def test_a_command_says_each_number_within_half_a_step(
    values: tuple[float, float, float, float, float],
) -> None:
    decoded = RANGES.decode_command(RANGES.command(*values))
    steps = (25.0 / 65535, 60.0 / 4095, 500.0 / 4095, 5.0 / 4095, 20.0 / 4095)
    for value, got, step in zip(values, decoded, steps, strict=True):
        assert abs(value - got) <= 0.5 * step * (1 + 1e-9)


@given(st.binary(max_size=9))
def test_no_frame_is_feedback_that_is_none(payload: bytes) -> None:
    feedback = RANGES.decode_feedback(3, payload)
    known = len(payload) == 8 and payload[0] & 0xF == 3 and payload[0] >> 4 in list(Status)
    assert (feedback is not None) == known


def test_feedback_has_state_place_speed_torque_and_temperatures() -> None:
    said = Feedback(Status.ENABLED, 1.25, -3.0, 2.5, 40, 35)
    got = RANGES.decode_feedback(3, RANGES.feedback(3, said))
    assert got is not None
    assert (got.status, got.mos_celsius, got.coil_celsius) == (1, 40, 35)
    assert (got.position, got.velocity, got.torque) == pytest.approx((1.25, -3.0, 2.5), abs=0.01)


# ---------------------------------------------------------------------- what has to be so before


def test_a_motor_gets_the_time_out_of_the_machine_file_before_it_is_energized() -> None:
    bench = Bench().boot()
    assert bench.motor.registers[Register.TIMEOUT] == 400  # 20 ms by 50 µs
    assert Order.ENABLE.payload not in bench.said


@pytest.mark.parametrize(
    ("register", "value", "said"),
    [
        (Register.PMAX, 3.14159, "PMAX of the motor is 3.14159, 12.5 is needed"),
        (Register.VMAX, 45.0, "VMAX of the motor is 45, 30 is needed"),
        (Register.TMAX, 28.0, "TMAX of the motor is 28, 10 is needed"),
        (Register.CTRL_MODE, 2.0, "CTRL_MODE of the motor is 2, 1 is needed"),
    ],
)
def test_a_motor_with_other_registers_is_refused_with_what_it_has(
    register: Register, value: float, said: str
) -> None:
    with pytest.raises(RuntimeFault) as refused:
        Bench(stored={register: value}).boot()
    assert refused.value.code == "MC470"
    assert said in refused.value.message


def test_frames_of_another_protocol_are_named() -> None:
    bench = Bench()
    bench.motor.receive = lambda *_args: bench._answer(0x13, b"\x15\x00\x01")
    with pytest.raises(RuntimeFault, match="no feedback of motor 3") as refused:
        bench.boot()
    assert refused.value.code == "MC470"
    assert "15 00 01" in refused.value.message


@pytest.mark.parametrize(
    ("drive", "axis", "said"),
    [
        (KEYS.replace("kp = 50.0", ""), "min_position = -90.0\nmax_position = 90.0\n", "kp"),
        (KEYS.replace("50.0", "501.0"), "min_position = -90.0\nmax_position = 90.0\n", "kp"),
        (KEYS.replace("v_max = 30.0", "v_max = 6.0"), "min_position = -90.0\nmax_position = 90.0\n", "v_max"),
        (KEYS, "", "positions go from"),
        (KEYS, "min_position = -90.0\nmax_position = 717.0\n", "positions go from"),
        (KEYS + "feedback_id = 3\n", "min_position = -90.0\nmax_position = 90.0\n", "feedback_id"),
    ],
)
def test_a_machine_file_whose_motion_no_frame_can_say_is_refused(drive: str, axis: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        machine(drive, axis)


# ---------------------------------------------------------------------- faults


@pytest.mark.parametrize(
    ("status", "fault"),
    [(0xA, DriveFault.OVER_CURRENT), (0xB, DriveFault.OVER_TEMPERATURE), (0x9, DriveFault.VOLTAGE)],
)
def test_a_fault_of_the_motor_is_latched_and_reset(status: int, fault: DriveFault) -> None:
    bench = Bench().boot().energize()
    bench.motor.request("emcy", {"code": status}, bench.now)
    bench.exchange(DriveMode.POSITION, 2)
    assert (bench.state, bench.feedback.fault[0]) == (DriveState.FAULT, fault)
    bench.exchange(DriveMode.RESET, 10)
    assert (bench.state, bench.feedback.fault[0]) == (DriveState.OFF, DriveFault.NONE)
    bench.energize()


def test_a_motor_that_was_switched_off_and_on_between_two_cycles_is_disabled_and_never_enabled_unseen() -> (
    None
):
    bench = Bench().boot().energize()
    bench.motor._status = int(Status.DISABLED)
    bench.port.sent.clear()
    bench.exchange(DriveMode.POSITION, 2)
    assert bench.state is not DriveState.ENERGIZED
    assert Order.ENABLE.payload not in bench.said


@given(st.lists(st.binary(max_size=9), max_size=12))
def test_no_answer_breaks_an_axis(answers: list[bytes]) -> None:
    bench = Bench().boot()
    for answer in answers:
        bench.port.waiting.append((0x13, answer))
        bench.exchange(DriveMode.OFF)
    assert all(identifier in (3, REGISTERS) for identifier, _ in bench.port.sent)


@given(st.lists(st.tuples(st.sampled_from([3, REGISTERS]), st.binary(max_size=9)), max_size=12))
def test_no_frame_breaks_a_motor(frames: list[tuple[int, bytes]]) -> None:
    sent: list[int] = []
    motor = DamiaoNode(3, 0x13, lambda identifier, _payload: sent.append(identifier), RANGES)
    motor.switch_on(0.0)
    motor.poll(1.0)
    for number, (identifier, payload) in enumerate(frames):
        motor.receive(identifier, payload, 1.0 + 1e-3 * number)
    motor.receive(REGISTERS, register_request(3, Register.PMAX), 2.0)
    assert set(sent) == {0x13}
