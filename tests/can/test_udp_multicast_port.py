"""The port on a multicast group, beside python-can on the same group."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import can
import msgspec
import pytest

from mcserver.can.open import open_port
from mcserver.can.port import EXTENDED, CanPort
from tests.can.hubs import LIMIT_S, receive, wait_until
from tests.can.python_can import python_can_bus

GROUP = "239.74.163.2"


@pytest.fixture
def address() -> str:
    """A group whose port nobody else uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("", 0))
        return f"udp:{GROUP}:{free.getsockname()[1]}"


@pytest.fixture
def pair(address: str) -> Iterator[tuple[CanPort, CanPort]]:
    one, other = open_port(address), open_port(address)
    yield one, other
    one.close()
    other.close()


def test_frames_go_between_members_and_not_back(pair: tuple[CanPort, CanPort]) -> None:
    one, other = pair
    frames = [(0x080, b""), (0x181, bytes(range(8)))]
    for identifier, payload in frames:
        assert one.send(identifier, payload)
    assert receive(other, 2) == frames
    assert one.drain() == []
    buffer = other.prepare(0x201, 2)
    buffer[other.payload_offset :] = b"\x07\x08"
    assert other.send_prepared(buffer)
    assert receive(one, 1) == [(0x201, b"\x07\x08")]


def test_python_can_and_the_port_understand_each_other(address: str) -> None:
    port = open_port(address)
    with python_can_bus(address) as bus:
        port.send(0x181, bytes(range(8)))
        message = bus.recv(LIMIT_S)
        assert message is not None
        assert (message.arbitration_id, bytes(message.data)) == (0x181, bytes(range(8)))
        assert not message.is_extended_id
        bus.send(can.Message(arbitration_id=0x601, data=b"\x40\x00\x10", is_extended_id=False))
        assert receive(port, 1) == [(0x601, b"\x40\x00\x10")]
        bus.send(can.Message(arbitration_id=0x601, is_extended_id=True, data=b"\x07"))
        assert receive(port, 1) == [(0x601 | EXTENDED, b"\x07")]
        port.send(0x1200FD01 | EXTENDED, b"")
        # it hears what it has sent itself, too
        heard = [bus.recv(LIMIT_S) for _ in range(3)]
        assert [each.is_extended_id for each in heard if each and each.arbitration_id == 0x1200FD01] == [True]
        bus.send(can.Message(arbitration_id=0x601, is_extended_id=False, is_remote_frame=True))
        wait_until(lambda: port.drain() == [] and port.counters.malformed == 1, "it is counted")
    port.close()


def test_packets_that_are_no_frames_are_counted(address: str, pair: tuple[CanPort, CanPort]) -> None:
    one, other = pair
    number = int(address.rpartition(":")[2])
    packets = [b"", b"\xc1", b"\x80", msgspec.msgpack.encode({"arbitration_id": 0x900, "data": b""})]
    packets += [msgspec.msgpack.encode({"arbitration_id": "x"}), msgspec.msgpack.encode({"data": bytes(9)})]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        for packet in packets:
            stranger.sendto(packet, (GROUP, number))
    one.send(0x100, b"\x01")
    assert receive(other, 1) == [(0x100, b"\x01")]
    # b"\x80" is an empty map: a frame of defaults would be one that nobody sent
    assert other.counters.malformed == len(packets)


def test_a_closed_port_sends_nothing_more(pair: tuple[CanPort, CanPort]) -> None:
    pair[0].close()
    assert not pair[0].send(0x100, b"")
    assert pair[0].drain() == []
    assert pair[0].fileno() == -1
