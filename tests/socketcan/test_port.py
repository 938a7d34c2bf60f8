"""What only a SocketCAN port has: kernel frames as they are, and those that are left out."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

import pytest

from mcserver.can.frame import ERROR_FLAG, REMOTE_FLAG
from mcserver.can.port import EXTENDED
from mcserver.can.socketcan import CAN_RAW, ERROR_BUS_OFF, ERROR_RESTARTED, PF_CAN
from tests.socketcan.conftest import Open
from tests.socketcan.interfaces import receive

FRAME = struct.Struct("=IB3x8s")


@pytest.fixture
def stranger(socketcan: None) -> Iterator[socket.socket]:  # noqa: ARG001 - skips first where there is no CAN
    """A socket that sends whatever it is given."""
    with socket.socket(PF_CAN, socket.SOCK_RAW, CAN_RAW) as opened:
        opened.bind(("vcan0",))
        yield opened


def test_a_prepared_frame_is_the_kernels_own(opened: Open, stranger: socket.socket) -> None:
    port = opened("vcan0")
    buffer = port.prepare(0x201, 3)
    buffer[port.payload_offset :] = b"\x01\x02\x03" + bytes(5)
    assert port.send_prepared(buffer)
    assert FRAME.unpack(stranger.recv(16)) == (0x201, 3, b"\x01\x02\x03" + bytes(5))


def test_remote_frames_are_counted_and_left_out_and_extended_ones_marked(
    opened: Open, stranger: socket.socket
) -> None:
    port = opened("vcan0")
    for identifier in (0x12345678 | EXTENDED, 0x123 | REMOTE_FLAG):
        stranger.send(FRAME.pack(identifier, 0, bytes(8)))
    stranger.send(FRAME.pack(0x124, 1, b"\x09" + bytes(7)))
    assert receive(port, 2) == [(0x12345678 | EXTENDED, b""), (0x124, b"\x09")]
    assert port.counters.malformed == 1
    port.send(0x1200FD01 | EXTENDED, b"\x05")
    assert FRAME.unpack(stranger.recv(16))[:2] == (0x1200FD01 | EXTENDED, 1)


def test_a_controller_that_is_bus_off_makes_the_port_down_until_it_is_restarted(
    opened: Open, stranger: socket.socket
) -> None:
    port, other = opened("vcan0"), opened("vcan0")
    stranger.send(FRAME.pack(ERROR_FLAG | ERROR_BUS_OFF, 8, bytes(8)))
    port.drain()
    assert port.counters.down
    assert port.counters.errors == 1
    stranger.send(FRAME.pack(ERROR_FLAG | ERROR_RESTARTED, 8, bytes(8)))
    port.drain()
    assert not port.counters.down
    other.send(0x100, b"")
    assert receive(port, 1) == [(0x100, b"")]
