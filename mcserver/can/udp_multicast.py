"""A port on a multicast group, with the packets of python-can's ``udp_multicast`` (one msgpack map a frame).

For computers whose kernel has no CAN, and programs that share one computer: packets do not leave it
(`HOP_LIMIT`). Multicast gives no promise of delivery.
"""

from __future__ import annotations

import errno
import ipaddress
import socket
import struct
from contextlib import suppress
from typing import Any

import msgspec

from mcserver.can.frame import HEADER, PAYLOAD_OFFSET
from mcserver.can.port import EXTENDED, EXTENDED_MASK, MAX_PAYLOAD, STANDARD_MASK, Frame
from mcserver.can.socket_port import SocketPort
from mcserver.errors import RuntimeFault

HOP_LIMIT = 0
MAX_PACKET = 1024
RECEIVE_BUFFER = 1 << 20


class Packet(msgspec.Struct, kw_only=True):
    """The fields of python-can's ``Message``, as its udp_multicast interface packs them."""

    timestamp: float = 0.0
    arbitration_id: int
    is_extended_id: bool = False
    is_remote_frame: bool = False
    is_error_frame: bool = False
    channel: Any = None
    dlc: int = 0
    data: bytes
    is_fd: bool = False
    bitrate_switch: bool = False
    error_state_indicator: bool = False


_DECODER = msgspec.msgpack.Decoder(Packet)


class UdpMulticastPort(SocketPort):
    """A member of a group. It sends from a socket of its own, by whose port its own packets are left out."""

    GONE = frozenset((errno.ENETDOWN, errno.ENODEV, errno.ENETUNREACH, errno.EBADF))

    def __init__(self, group: str, port: int) -> None:
        """Join the group.

        Raises:
            RuntimeFault: MC424 this computer cannot join it.
        """
        super().__init__()
        self._group = ipaddress.ip_address(group)
        self._port = port
        self._sender: socket.socket | None = None
        self._own_port = 0
        self._message = Packet(arbitration_id=0, data=b"")
        self._encoder = msgspec.msgpack.Encoder()
        try:
            self._open()
        except OSError as error:
            raise RuntimeFault(
                "MC424",
                f"the multicast group {group}:{port} cannot be joined: {error.strerror or error}",
                "check with ip route get that this computer has a route to the group",
            ) from error

    def _transmit(self, buffer: bytearray) -> None:
        assert self._sender is not None
        identifier, length = HEADER.unpack_from(buffer)
        message = self._message
        message.arbitration_id = identifier & EXTENDED_MASK
        message.is_extended_id = bool(identifier & EXTENDED)
        message.dlc = length
        message.data = bytes(buffer[PAYLOAD_OFFSET : PAYLOAD_OFFSET + length])
        self._sender.send(self._encoder.encode(message))

    def _receive(self) -> Frame | None:
        assert self._socket is not None
        packet, source = self._socket.recvfrom(MAX_PACKET)
        if source[1] == self._own_port:
            return None
        frame = _frame_of(packet)
        self.counters.malformed += frame is None
        return frame

    def _give_back(self) -> None:
        super()._give_back()
        if self._sender is not None:
            self._sender.close()
            self._sender = None

    def _open(self) -> None:
        family = socket.AF_INET if self._group.version == 4 else socket.AF_INET6
        flags = socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
        try:
            self._socket = socket.socket(family, flags)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            with suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            self._sender = socket.socket(family, flags)
            group = self._group.packed
            if family == socket.AF_INET:
                # bound to the group's own address: other groups on this port are not heard
                self._socket.bind((str(self._group), self._port))
                joined = group + struct.pack("=I", socket.INADDR_ANY)
                self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, joined)
                self._sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, HOP_LIMIT)
            else:
                self._socket.bind((str(self._group), self._port))
                joined = group + struct.pack("=I", 0)
                self._socket.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, joined)
                self._sender.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS, HOP_LIMIT)
            self._sender.connect((str(self._group), self._port))
            self._own_port = self._sender.getsockname()[1]
        except OSError:
            self._give_back()
            raise


def _frame_of(packet: bytes) -> Frame | None:
    """Return the classic data frame that a packet holds, None where it holds none."""
    try:
        message = _DECODER.decode(packet)
    except (msgspec.MsgspecError, ValueError):
        return None
    if message.is_remote_frame or message.is_error_frame or message.is_fd:
        return None
    greatest = EXTENDED_MASK if message.is_extended_id else STANDARD_MASK
    if not 0 <= message.arbitration_id <= greatest or len(message.data) > MAX_PAYLOAD:
        return None
    return message.arbitration_id | (EXTENDED if message.is_extended_id else 0), message.data
