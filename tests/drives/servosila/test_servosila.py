"""Servosila's drives: streamed commands, telemetry, faults and a work zone that is zeroed."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.drives.bus import DriveFault, DriveMode, DriveState, Setpoints
from mcserver.drives.servosila.codec import COMMAND_PACKING, LENGTH, unpack_reading, unpack_status
from mcserver.errors import ConfigurationError
from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode, remedy_of
from mcserver.executor.shm.feedback import AxisCondition
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import AxisOperation
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.drives.can_rig import bus_in_memory
from tests.drives.fake_can import FakeBus, FakeServosila
from tests.executor.rig import Rig
from tests.machine_text import axes_text

OFF, RESET, STOP, SPEED, SERVO, TORQUE = 0x02, 0x01, 0x04, 0x20, 0x30, 0x77
COUNT_M = 1e-6


def machine(drive: str = "pole_pairs = 4", codes: str = "off = 2, torque = 0x77") -> Machine:
    """One axis of 10 mm and 10 000 counts a motor turn."""
    keys = "max_following_error = 2.0\nunits_per_motor_rev = 10.0"
    drive = f'bus = "can0"\nnode = 5\ncounts_per_motor_rev = 10000\ncodes = {{ {codes} }}\n{drive}'
    axes = axes_text(velocity=1e3, acceleration=1e4, keys=keys, drive="servosila", drive_keys=drive)
    return parse_machine(f'[machine]\nname = "m"\n{axes}')


@dataclass
class ServosilaRig(Rig):
    """An executor and one fake drive."""

    count: float = 0.0
    port: FakeBus = field(default_factory=FakeBus)

    def __post_init__(self) -> None:
        self.drive = FakeServosila(self.port, 5, self.count)
        bus = bus_in_memory(self.machine, self.port)
        self.executor = VirtualExecutor(self.machine, buses=[bus], recorder=self._record)
        self.program = self.open(0)

    @property
    def latest(self) -> tuple[int, float]:
        return self.drive.commands[-1]


class Bench:
    """A bus and its drive, exchange by exchange."""

    def __init__(self, described: Machine, count: float = 0.0, every: int = 1) -> None:
        self.port = FakeBus()
        self.drive = FakeServosila(self.port, 5, count, every)
        self.bus = bus_in_memory(described, self.port)
        self.feedback = self.bus.boot()
        self.setpoints = Setpoints.of(1)

    def exchange(self, mode: DriveMode, cycles: int = 1) -> None:
        self.setpoints.mode[:] = mode
        for _ in range(cycles):
            if self.feedback.state[0] != DriveState.ENERGIZED:
                self.setpoints.position[:] = self.feedback.position
            self.bus.exchange(self.setpoints)

    @property
    def state(self) -> DriveState:
        return DriveState(int(self.feedback.state[0]))


# ---------------------------------------------------------------------- frames


def test_a_command_is_its_code_and_a_float_at_byte_4() -> None:
    assert COMMAND_PACKING.pack(SERVO, 1.5) == b"\x30\x00\x00\x00" + struct.pack("<f", 1.5)
    assert COMMAND_PACKING.size == LENGTH == 8


def test_telemetry_has_fault_bits_and_speed_and_the_work_zone_s_count() -> None:
    status = unpack_status(b"\x04\x01\x00\x30" + struct.pack("<f", -12.5))
    assert status is not None
    assert (status.fault_bits, status.electrical_hz) == (0x0104, -12.5)
    assert status.dc_bus_volts == pytest.approx(48.0, abs=0.01)
    reading = unpack_reading(struct.pack("<ff", 3.25, -100.0))
    assert reading is not None
    assert (reading.electrical, reading.work_zone) == (3.25, -100.0)


@given(st.binary(max_size=8).filter(lambda payload: len(payload) != 8))
def test_telemetry_of_another_length_is_none(payload: bytes) -> None:
    assert unpack_status(payload) is None
    assert unpack_reading(payload) is None


# ---------------------------------------------------------------------- commands


def test_a_command_is_streamed_in_every_cycle() -> None:
    bench = Bench(machine())
    bench.drive.commands.clear()
    bench.exchange(DriveMode.OFF, 10)
    assert bench.drive.commands == [(OFF, 0.0)] * 10
    assert {cob for cob, _ in bench.port.sent} == {0x205}


def test_a_capture_commands_the_count_that_was_read() -> None:
    rig = ServosilaRig(machine(), count=1234.0)
    rig.drive.commands.clear()
    rig.program.capture()
    rig.run_until(EventKind.AXIS_DONE)
    rig.step(5)
    servo = [value for code, value in rig.drive.commands if code == SERVO]
    assert servo
    assert set(servo) == {1234.0}
    assert rig.executor.feedback.condition[0] == AxisCondition.HOLDING
    assert rig.executor.feedback.actual[0] == pytest.approx(1234 * COUNT_M)


def test_a_path_is_streamed_as_counts_of_the_work_zone() -> None:
    rig = ServosilaRig(machine())
    rig.program.capture()
    rig.step(20)
    rig.program.start_line(1)
    rig.program.move({0: 0.1}, 400)
    rig.program.wait(1)
    rig.play(line=True)
    assert not rig.of(EventKind.FAULT)
    assert rig.latest == (SERVO, pytest.approx(100_000.0, rel=1e-6))


def test_g1030_is_an_electrical_speed_by_the_pole_pairs() -> None:
    rig = ServosilaRig(machine())
    rig.program.speed({0: 0.05})
    rig.program.dwell(1.0)
    rig.step(200)
    # 5 turns a second of a motor with 4 pole pairs
    assert rig.latest == (SPEED, pytest.approx(20.0))
    assert rig.executor.feedback.actual_velocity[0] == pytest.approx(0.05)


def test_g1030_is_rpm_where_the_machine_file_has_that_code() -> None:
    rig = ServosilaRig(machine("", "off = 2, rpm = 0x66"))
    rig.program.speed({0: 0.05})
    rig.program.dwell(1.0)
    rig.step(200)
    assert rig.latest == (0x66, pytest.approx(300.0))


def test_g1040_is_a_torque_by_the_machine_file_s_code() -> None:
    rig = ServosilaRig(machine())
    rig.program.torque({0: 0.75})
    rig.program.dwell(1.0)
    rig.step(50)
    assert rig.latest == (TORQUE, 0.75)


@pytest.mark.parametrize("what", ["speed", "torque"])
def test_a_command_without_a_code_is_refused_and_the_axis_stays_as_it_was(what: str) -> None:
    rig = ServosilaRig(machine("", "off = 2"))
    rig.program.start_line(8)
    getattr(rig.program, what)({0: 0.05})
    fault = rig.run_until(EventKind.FAULT)
    assert (fault.code, fault.axis, fault.line) == (FaultCode.MODE_NOT_CONFIGURED, 0, 8)
    assert {code for code, _ in rig.drive.commands} == {OFF}


def test_stop_is_streamed_until_the_motor_stands_and_then_off() -> None:
    bench = Bench(machine())
    bench.exchange(DriveMode.POSITION, 10)
    bench.drive.hertz = 10.0
    bench.drive.receive = lambda *_args: None  # type: ignore[method-assign]
    bench.exchange(DriveMode.STOP, 10)
    assert bench.state is DriveState.STOPPING
    bench.drive.hertz = 0.0
    bench.exchange(DriveMode.STOP, 2)
    assert bench.state is DriveState.OFF
    assert bench.port.sent[-1][1][0] == STOP


def test_a_released_drive_hears_nothing() -> None:
    rig = ServosilaRig(machine())
    rig.program.capture()
    rig.program.axis(AxisOperation.RELEASE)
    rig.play()
    rig.drive.commands.clear()
    rig.step(20)
    assert rig.drive.commands == []
    assert rig.executor.feedback.condition[0] == AxisCondition.RELEASED


# ---------------------------------------------------------------------- faults


def moving() -> ServosilaRig:
    rig = ServosilaRig(machine())
    rig.program.capture()
    rig.step(20)
    rig.program.start_line(3)
    rig.program.move({0: 0.1}, 600)
    rig.program.end_line()
    rig.program.finish()
    rig.step(300)
    return rig


def test_fault_bits_stop_the_axis_within_three_cycles_and_are_reported() -> None:
    rig = moving()
    rig.drive.bits = 0x0104
    rig.step(3)
    (fault,) = rig.of(EventKind.FAULT)
    assert (fault.code, fault.axis, fault.line) == (FaultCode.DRIVE_FAULT, 0, 3)
    message = remedy_of(fault.code, fault.axis, fault.values)[0]
    assert "fault bits 0104h: overheating protection, SPI encoder fault" in message
    assert rig.latest == (OFF, 0.0)


def test_a_mute_drive_is_lost_in_the_third_cycle() -> None:
    rig = moving()
    rig.drive.muted = True
    rig.step(2)
    assert not rig.of(EventKind.FAULT)
    rig.step()
    assert [event.code for event in rig.of(EventKind.FAULT)] == [FaultCode.DRIVE_SILENT]


def test_a_reset_zeroes_the_work_zone_and_the_axis_stays_where_it_is() -> None:
    rig = moving()
    rig.drive.bits = 0x0001
    rig.run()
    place = float(rig.executor.feedback.actual[0])
    count = rig.drive.count
    assert count > 1000.0
    program = rig.open(0)
    program.axis(AxisOperation.RESET)
    program.capture()
    program.finish()
    sent = len(rig.drive.commands)
    start = len(rig.setpoints)
    rig.run()
    assert rig.drive.count == 0.0
    assert rig.executor.feedback.condition[0] == AxisCondition.HOLDING
    assert rig.actual[start:, 0] == pytest.approx(place, abs=COUNT_M)
    # the drive itself was never commanded to go anywhere
    after = [value for code, value in rig.drive.commands[sent:] if code == SERVO]
    assert after == pytest.approx([0.0] * len(after), abs=1e-3)


@pytest.mark.parametrize("residue", [0.0, 234.0, -9_766.0, 9_999.0])
def test_what_the_count_shows_after_a_reset_is_read_and_the_axis_stays_where_it_is(residue: float) -> None:
    bench = Bench(machine(), count=50_234.0)
    place = float(bench.feedback.position[0])
    bench.drive.residue = residue
    bench.exchange(DriveMode.RESET, 8)
    bench.exchange(DriveMode.POSITION, 10)
    assert bench.state is DriveState.ENERGIZED
    assert bench.feedback.position[0] == pytest.approx(place, abs=COUNT_M)
    targets = [value for code, value in bench.drive.commands if code == SERVO]
    assert targets == pytest.approx([residue] * len(targets), abs=0.5)


def test_a_shaft_that_turns_through_zero_while_it_is_reset_is_followed() -> None:
    bench = Bench(machine(), count=5.0)
    place = float(bench.feedback.position[0])
    bench.drive.receive = lambda *_args: None  # type: ignore[method-assign]
    bench.exchange(DriveMode.RESET, 3)
    bench.drive.count = -3.0
    bench.exchange(DriveMode.RESET)
    assert bench.feedback.position[0] == pytest.approx(place - 8 * COUNT_M)


@pytest.mark.parametrize(
    ("codes", "said"),
    [
        ("off = 2, servo = 0x38", "38h is Servo Stepper, an offset from the current position"),
        ("off = 4", "04h is Stop"),
        ("off = 2, torque = 0x58", "58h is Kickstart"),
        ("off = 2, torque = 2", "02h is the code of torque and of off"),
    ],
)
def test_a_code_that_the_reference_gives_to_another_command_is_refused(codes: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        machine(codes=codes)


def test_a_drive_that_stays_faulty_is_not_reset() -> None:
    bench = Bench(machine())
    bench.drive.bits = 1
    bench.exchange(DriveMode.OFF, 3)
    assert bench.state is DriveState.FAULT
    bench.drive.receive = lambda *_args: None  # type: ignore[method-assign]
    bench.exchange(DriveMode.RESET, 50)
    assert bench.state is DriveState.FAULT
    assert bench.port.sent[-1][1][0] == RESET


def test_a_count_that_jumps_is_a_lost_position() -> None:
    bench = Bench(machine(), count=500_000.0)
    bench.exchange(DriveMode.POSITION, 10)
    assert bench.state is DriveState.ENERGIZED
    bench.drive.receive = lambda *_args: None  # type: ignore[method-assign]
    bench.drive.count = 0.0
    bench.exchange(DriveMode.POSITION)
    assert (bench.state, bench.feedback.fault[0]) == (DriveState.FAULT, DriveFault.POSITION_LOST)


def test_telemetry_may_be_slower_than_the_cycle() -> None:
    bench = Bench(machine("telemetry_hz = 250.0"), every=4)
    for _ in range(40):
        bench.exchange(DriveMode.POSITION)
        assert bench.feedback.fresh[0]
    assert bench.state is DriveState.ENERGIZED
    bench.drive.muted = True
    bench.exchange(DriveMode.POSITION, 8)
    assert (bench.state, bench.feedback.fault[0]) == (DriveState.FAULT, DriveFault.COMMUNICATION)
