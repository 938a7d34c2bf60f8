"""Ports on real SocketCAN interfaces: the traffic of several buses, and other programs on them."""

from __future__ import annotations

import can
import pytest

from mcserver.can.open import open_port
from mcserver.doctor.can import judge_can, probe_can
from mcserver.errors import RuntimeFault
from tests.can.python_can import python_can_bus
from tests.socketcan.conftest import Open
from tests.socketcan.interfaces import BUSES, LIMIT_S, receive


def test_every_bus_has_its_own_traffic(opened: Open) -> None:
    senders = [opened(bus) for bus in BUSES]
    receivers = [opened(f"socketcan:{bus}") for bus in BUSES]
    for number, sender in enumerate(senders):
        assert sender.send(0x180 + number, bytes([number] * 8))
    for number, receiver in enumerate(receivers):
        assert receive(receiver, 1) == [(0x180 + number, bytes([number] * 8))]
        assert receiver.drain() == []
    for sender in senders:
        assert sender.drain() == [], "own frames do not come back"


def test_frames_of_a_cycle_come_whole_and_in_order(opened: Open) -> None:
    sender, receiver = opened("vcan0"), opened("vcan0")
    buffers = [sender.prepare(0x200 + node, 7) for node in range(1, 13)]
    at = sender.payload_offset
    for cycle in range(50):
        expected = []
        for node, buffer in enumerate(buffers, 1):
            buffer[at : at + 7] = bytes([cycle, node, 0, 0, 0, 0, 0xFF])
            assert sender.send_prepared(buffer)
            expected.append((0x200 + node, bytes([cycle, node, 0, 0, 0, 0, 0xFF])))
        assert sender.send(0x080, b"")
        expected.append((0x080, b""))
        assert receive(receiver, len(expected)) == expected
    assert (sender.counters.sent, sender.counters.unsent) == (650, 0)


def test_python_can_and_a_port_understand_each_other(opened: Open) -> None:
    port = opened("vcan0")
    with python_can_bus("vcan0") as bus:
        bus.send(can.Message(arbitration_id=0x601, data=b"\x40\x41\x60\x00", is_extended_id=False))
        assert receive(port, 1) == [(0x601, b"\x40\x41\x60\x00")]
        assert port.send(0x581, b"\x4b\x41\x60\x00\x37\x02")
        message = bus.recv(LIMIT_S)
    assert message is not None
    assert (message.arbitration_id, bytes(message.data)) == (0x581, b"\x4b\x41\x60\x00\x37\x02")
    assert not message.is_extended_id


def test_remote_frames_are_counted_and_left_out(opened: Open) -> None:
    port = opened("vcan0")
    with python_can_bus("vcan0") as bus:
        bus.send(can.Message(arbitration_id=0x181, is_remote_frame=True, is_extended_id=False, dlc=2))
        bus.send(can.Message(arbitration_id=0x181, data=b"\7", is_extended_id=False))
    assert receive(port, 1) == [(0x181, b"\7")]
    assert port.counters.malformed == 1


def test_an_interface_that_is_not_there_is_refused_by_name() -> None:
    with pytest.raises(RuntimeFault, match="vcan9") as refused:
        open_port("vcan9")
    assert refused.value.code == "MC424"


def test_the_doctor_finds_the_buses_and_nothing_wrong_with_them() -> None:
    fixes = {finding.title: finding.fix for finding in judge_can(probe_can())}
    assert {bus: fixes[bus] for bus in BUSES} == dict.fromkeys(BUSES, "")
