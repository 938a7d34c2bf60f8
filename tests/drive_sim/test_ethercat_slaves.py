"""Simulated slaves by themselves: frames of any content, states, PDO assignment, faults by name."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.drive_sim.described import Identity
from mcserver.drive_sim.ethercat import registers as reg
from mcserver.drive_sim.ethercat.drive import EthercatDrive
from mcserver.drive_sim.ethercat.frames import Command, pass_through
from mcserver.drive_sim.ethercat.registers import AlCode, AlState
from mcserver.drive_sim.fault_injection import ETHERCAT_FAULTS, FAULTS, BadRequest
from mcserver.drive_sim.motor import Hardware
from mcserver.drive_sim.sdo_abort import Abort, SdoAbort


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def slave(clock: Clock | None = None, node: int = 1) -> EthercatDrive:
    drive = EthercatDrive(node, Hardware(), 0.0, Identity(), clock or Clock())
    drive.switch_on(0.0)
    drive.poll(0.1)
    return drive


def datagram(command: int, low: int, high: int, data: bytes) -> bytes:
    body = struct.pack("<BBHHHH", command, 0, low, high, len(data), 0) + data + b"\x00\x00"
    return b"\xff" * 6 + b"\x01" * 6 + b"\x88\xa4" + struct.pack("<H", 0x1000 | len(body)) + body


def passed(drives: list[EthercatDrive], command: int, low: int, high: int, data: bytes) -> tuple[bytes, int]:
    """What a datagram brings back, and its working counter."""
    frame = pass_through(datagram(command, low, high, data), [drive.controller for drive in drives])
    assert frame is not None
    content = frame[26 : 26 + len(data)]
    return content, int.from_bytes(frame[26 + len(data) : 28 + len(data)], "little")


@given(st.binary(max_size=200))
def test_no_frame_stops_a_slave(content: bytes) -> None:
    drive = slave()
    head = b"\xff" * 6 + b"\x01" * 6 + b"\x88\xa4"
    for frame in (content, head + content, head + struct.pack("<H", 0x1000 | len(content)) + content):
        answer = pass_through(frame, [drive.controller])
        assert answer is None or len(answer) == len(frame)


@given(st.sampled_from(list(Command)), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF), st.binary(max_size=64))
def test_any_datagram_passes(command: Command, low: int, high: int, data: bytes) -> None:
    _, counted = passed([slave(), slave(node=2)], command, low, high, data)
    assert 0 <= counted <= 6


def test_slaves_are_counted_and_addressed_by_their_place() -> None:
    drives = [slave(), slave(node=2), slave(node=3)]
    assert passed(drives, Command.BRD, 0, reg.TYPE, bytes(2))[1] == 3
    assert passed(drives, Command.APWR, 0xFFFF, reg.STATION_ADDRESS, b"\x02\x10")[1] == 1
    assert [drive.controller.station_address for drive in drives] == [0, 0x1002, 0]
    assert passed(drives, Command.FPRD, 0x1002, reg.AL_STATUS, bytes(2)) == (b"\x01\x00", 1)


@pytest.mark.parametrize(
    ("wanted", "code"),
    [
        (AlState.OP, AlCode.INVALID_STATE_CHANGE),
        (AlState.PREOP, AlCode.INVALID_MAILBOX),
        (AlState.BOOT, AlCode.BOOT_NOT_SUPPORTED),
    ],
)
def test_a_state_that_cannot_be_gone_to_is_refused_with_its_code(wanted: AlState, code: AlCode) -> None:
    drive = slave()
    passed([drive], Command.BWR, 0, reg.AL_CONTROL, bytes((wanted, 0)))
    status, _ = passed([drive], Command.BRD, 0, reg.AL_STATUS, bytes(6))
    assert status[0] == AlState.INIT | reg.ERROR
    assert int.from_bytes(status[4:6], "little") == code
    passed([drive], Command.BWR, 0, reg.AL_CONTROL, bytes((AlState.INIT | reg.ERROR, 0)))
    assert not drive.controller.failed


def test_an_assignment_is_changed_only_where_and_as_it_may_be() -> None:
    drive = slave()
    with pytest.raises(SdoAbort) as refused:
        drive.write(0x1C12, 0, b"\x00")
    assert refused.value.code == Abort.DEVICE_STATE
    for index in (0x1017, 0x1400, 0x1014):
        with pytest.raises(SdoAbort) as refused:
            drive.read(index, 0)
        assert refused.value.code == Abort.NO_OBJECT
    assert drive.read(0x1C12, 1) == b"\x00\x16"
    assert drive.read(0x1C00, 3) == b"\x03"


@pytest.mark.parametrize("fault", sorted(set(FAULTS) - set(ETHERCAT_FAULTS)))
def test_faults_of_can_are_refused(fault: str) -> None:
    with pytest.raises(BadRequest):
        slave().request(fault, {}, 0.0)


def test_without_process_data_a_slave_leaves_op_by_its_watchdog() -> None:
    clock = Clock()
    drive = slave(clock)
    drive.controller.fail(AlState.OP, 0)
    clock.now = 0.05
    drive.controller.watch()
    clock.now = 60.0
    drive.controller.watch()
    assert (drive.controller.state, drive.controller.failed) == (AlState.SAFEOP, True)
