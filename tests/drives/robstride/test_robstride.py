"""RobStride's motors: frames, what is made so before a motor is energized, and faults.

The motor is the simulated one, on a bus in memory.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.can.port import EXTENDED
from mcserver.drive_sim.robstride_node import RobstrideNode
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.drives.robstride.codec import (
    HOST,
    FaultBit,
    Kind,
    Mode,
    Parameter,
    Ranges,
    State,
    feedback_identifier,
    feedback_identifiers,
    parameter_of,
    parameter_payload,
    to_motor,
)
from mcserver.drives.robstride.drive import RobstrideDrive
from mcserver.errors import ConfigurationError, RuntimeFault
from mcserver.machine.bus_load import frame_bits
from mcserver.machine.machine_file import Machine
from tests.drives.mit_bench import TRAVEL, MitBench, mit_machine

RANGES = Ranges(12.57, 44.0, 17.0, 500.0, 5.0)
KEYS = "v_max = 44.0\nt_max = 17.0\nkp_max = 500.0\nkd_max = 5.0\nkp = 50.0\nkd = 1.0\n"


def machine(drive: str = KEYS, axis: str = TRAVEL) -> Machine:
    """One joint with a motor of the model RS02."""
    return mit_machine("robstride", drive, axis)


@dataclass
class Bench(MitBench):
    """A bus and its motor, exchange by exchange."""

    described: Machine = field(default_factory=machine)

    @property
    def kinds(self) -> set[int]:
        """Kinds of the frames that were sent."""
        return {identifier >> 24 & 0x1F for identifier, _ in self.port.sent}


# ---------------------------------------------------------------------- frames


def test_frames_are_those_of_the_makers_manual() -> None:
    # reading loc_kp of motor 7Fh: 1100FD7Fh, answered by 11007FFDh with 30.0; writing run_mode of motor 1
    assert to_motor(Kind.READ, 0x7F) == EXTENDED | 0x1100FD7F
    assert to_motor(Kind.WRITE, 1) == EXTENDED | 0x1200FD01
    assert parameter_payload(Parameter.RUN_MODE, 0) == bytes.fromhex("0570000000000000")
    assert parameter_payload(Parameter.LIMIT_TORQUE, 30.0) == bytes.fromhex("0b7000000000f041")
    # the torque of a command is in the identifier, the other numbers begin with the high byte
    whole, payload = RANGES.command(1, -12.57, 44.0, 0.0, 5.0, 17.0)
    assert (whole, payload) == (EXTENDED | 0x01FFFF01, bytes.fromhex("0000ffff0000ffff"))
    assert feedback_identifier(1, State(Mode.RUN, FaultBit.OVER_TEMPERATURE)) == EXTENDED | 0x028401FD


@given(
    st.tuples(
        st.floats(-12.57, 12.57),
        st.floats(-44.0, 44.0),
        st.floats(0.0, 500.0),
        st.floats(0, 5.0),
        st.floats(-17, 17),
    )
)
def test_a_command_says_each_number_within_half_a_step(
    values: tuple[float, float, float, float, float],
) -> None:
    decoded = RANGES.decode_command(*RANGES.command(3, *values))
    for value, got, span in zip(values, decoded, (25.14, 88.0, 500.0, 5.0, 34.0), strict=True):
        assert abs(value - got) <= 0.5 * span / 65535 * (1 + 1e-9)


@given(st.binary(max_size=9))
def test_no_payload_is_a_parameter_that_is_none(payload: bytes) -> None:
    known = len(payload) == 8 and struct.unpack("<H", payload[:2])[0] in list(Parameter)
    assert (parameter_of(payload) is not None) == known


def test_a_frame_takes_the_room_of_an_extended_one() -> None:
    assert (frame_bits(8), frame_bits(8, extended=True)) == (135, 160)
    described = machine()
    shares = RobstrideDrive.shares(described.axes, 1000.0)
    assert [(share.frames, share.bits) for share in shares] == [(1.0, 160), (1.0, 160)]


# ---------------------------------------------------------------------- what has to be so before


def test_mode_and_time_out_are_set_before_a_motor_is_energized() -> None:
    bench = Bench(stored={Parameter.RUN_MODE: 2.0}).boot()
    assert bench.motor.parameters[Parameter.RUN_MODE] == 0
    assert bench.motor.parameters[Parameter.CAN_TIMEOUT] == 400  # 20 ms by 50 µs
    assert Kind.ENABLE not in bench.kinds


def test_a_write_that_is_lost_is_written_again() -> None:
    bench = Bench()
    receive, lost = bench.motor.receive, [Kind.WRITE] * 2

    def losing(identifier: int, payload: bytes, now: float) -> None:
        if lost and identifier >> 24 & 0x1F == lost[0]:
            lost.pop()
            return
        receive(identifier, payload, now)

    bench.motor.receive = losing
    bench.boot()
    assert bench.motor.parameters[Parameter.CAN_TIMEOUT] == 400


def test_a_motor_of_a_stronger_model_is_refused() -> None:
    with pytest.raises(RuntimeFault, match="LIMIT_TORQUE of the motor is 60, 17 at most fits") as refused:
        Bench(stored={Parameter.LIMIT_TORQUE: 60.0}).boot()
    assert refused.value.code == "MC470"


def test_a_motor_without_a_time_out_is_refused() -> None:
    bench = Bench()
    del bench.motor.parameters[Parameter.CAN_TIMEOUT]
    bench.motor.__class__ = type("Old", (RobstrideNode,), {"timeout_s": 0.0})
    with pytest.raises(RuntimeFault, match="no parameter CAN_TIMEOUT") as refused:
        bench.boot()
    assert refused.value.code == "MC470"


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ((feedback_identifier(3, State(Mode.RUN, 0)), b"\x15\x00\x01"), "15 00 01"),
        ((feedback_identifier(3, State(3, 0)), bytes(8)), "mode 3"),
        ((0x703, b"\x05"), "motor 3 speaks CANopen"),
    ],
)
def test_frames_of_another_protocol_are_named(answer: tuple[int, bytes], said: str) -> None:
    bench = Bench()
    bench.motor.receive = lambda *_args: bench._answer(*answer)
    with pytest.raises(RuntimeFault, match=said) as refused:
        bench.boot()
    assert refused.value.code == "MC470"


@pytest.mark.parametrize(
    ("drive", "axis", "said"),
    [
        (KEYS.replace("kd_max = 5.0\n", ""), TRAVEL, "kd_max"),
        (KEYS.replace("v_max = 44.0\n", ""), TRAVEL, "v_max"),
        (KEYS.replace("kp = 50.0", "kp = 501.0"), TRAVEL, "beyond kp_max"),
        (KEYS.replace("v_max = 44.0", "v_max = 6.0"), TRAVEL, "v_max"),
        (KEYS, "min_position = -90.0\nmax_position = 720.1\n", "positions go from"),
    ],
)
def test_a_machine_file_whose_motion_no_frame_can_say_is_refused(drive: str, axis: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        machine(drive, axis)


# ---------------------------------------------------------------------- faults


@pytest.mark.parametrize(
    ("bits", "fault"),
    [
        (FaultBit.OVER_CURRENT, DriveFault.OVER_CURRENT),
        (FaultBit.OVER_TEMPERATURE | FaultBit.UNDER_VOLTAGE, DriveFault.OVER_TEMPERATURE),
        (FaultBit.UNDER_VOLTAGE, DriveFault.VOLTAGE),
        (FaultBit.NOT_CALIBRATED, DriveFault.ENCODER),
        (0, DriveFault.OVER_CURRENT),  # it is stalled
    ],
)
def test_a_fault_of_the_motor_is_latched_and_reset(bits: int, fault: DriveFault) -> None:
    bench = Bench().boot().energize()
    bench.motor.trip(bits)
    bench.exchange(DriveMode.POSITION, 2)
    assert (bench.state, bench.feedback.fault[0]) == (DriveState.FAULT, fault)
    bench.exchange(DriveMode.RESET, 10)
    assert (bench.state, bench.feedback.fault[0]) == (DriveState.OFF, DriveFault.NONE)
    bench.energize()


@given(
    st.lists(st.tuples(st.sampled_from(sorted(feedback_identifiers(3))), st.binary(max_size=9)), max_size=12)
)
def test_no_answer_breaks_an_axis(answers: list[tuple[int, bytes]]) -> None:
    bench = Bench().boot()
    for answer in answers:
        bench.port.waiting.append(answer)
        bench.exchange(DriveMode.OFF)
    assert all(identifier & (EXTENDED | 0xFF) == EXTENDED | 3 for identifier, _ in bench.port.sent)


@given(st.lists(st.tuples(st.integers(0, 31), st.integers(0, 0xFFFF), st.binary(max_size=9)), max_size=12))
def test_no_frame_breaks_a_motor(frames: list[tuple[int, int, bytes]]) -> None:
    sent: list[int] = []
    motor = RobstrideNode(3, lambda identifier, _payload: sent.append(identifier), RANGES)
    motor.switch_on(0.0)
    motor.poll(1.0)
    for number, (kind, middle, payload) in enumerate(frames):
        motor.receive(EXTENDED | kind << 24 | middle << 8 | 3, payload, 1.0 + 1e-3 * number)
    motor.receive(to_motor(Kind.READ, 3), parameter_payload(Parameter.MECH_POS), 2.0)
    assert sent
    assert all(identifier & 0xFFFF == 3 << 8 | HOST for identifier in sent)
