"""A port on a SocketCAN interface: a raw socket that never waits.

An interface that goes down or away (ENETDOWN, ENODEV) or a controller that is bus-off makes the port `down`.
The socket is opened again by itself once the interface is back.
"""

from __future__ import annotations

import errno
import socket
import struct
from contextlib import suppress

from mcserver.can.frame import ERROR_FLAG, FRAME_SIZE, HEADER, NOT_DATA
from mcserver.can.port import MAX_PAYLOAD, Frame
from mcserver.can.socket_port import SocketPort
from mcserver.errors import RuntimeFault

# linux/can.h, linux/can/raw.h, linux/can/error.h: this interpreter may be built without CAN's constants.
PF_CAN = 29
CAN_RAW = 1
SOL_CAN_RAW = 101
CAN_RAW_ERR_FILTER = 2
CAN_RAW_RECV_OWN_MSGS = 4
ALL_ERRORS = 0x1FFFFFFF
ERROR_BUS_OFF = 0x40
ERROR_RESTARTED = 0x100
RECEIVE_BUFFER = 1 << 20
SO_RCVBUFFORCE = 33


class SocketCanPort(SocketPort):
    """A raw socket on an interface. Own frames are not received; other sockets of this computer get them."""

    GONE = frozenset((errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF))

    def __init__(self, interface: str) -> None:
        """Open the interface.

        Raises:
            RuntimeFault: MC424 there is no such interface, it is down, or the kernel has no CAN.
        """
        super().__init__()
        self._interface = interface
        self._incoming = bytearray(FRAME_SIZE)
        try:
            self._open()
        except OSError as error:
            raise _cannot_open(interface, error) from error

    def _transmit(self, buffer: bytearray) -> None:
        assert self._socket is not None
        self._socket.send(buffer)

    def _receive(self) -> Frame | None:
        assert self._socket is not None
        buffer = self._incoming
        size = self._socket.recv_into(buffer)
        identifier, length = HEADER.unpack_from(buffer)
        if size != FRAME_SIZE or identifier & NOT_DATA or length > MAX_PAYLOAD:
            self._not_data(identifier)
            return None
        self.counters.down = False
        return identifier, bytes(buffer[8 : 8 + length])

    def _not_data(self, identifier: int) -> None:
        if not identifier & ERROR_FLAG:
            self.counters.malformed += 1
            return
        self.counters.errors += 1
        if identifier & ERROR_BUS_OFF:
            self.counters.down = True
        if identifier & ERROR_RESTARTED:
            self.counters.down = False

    def _open(self) -> None:
        self._socket = _raw_socket(self._interface)


def _raw_socket(interface: str) -> socket.socket:
    opened = socket.socket(PF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC, CAN_RAW)
    try:
        opened.setsockopt(SOL_CAN_RAW, CAN_RAW_ERR_FILTER, struct.pack("=I", ALL_ERRORS))
        opened.setsockopt(SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, struct.pack("=i", 0))
        # beyond net.core.rmem_max only root may go
        for option in (SO_RCVBUFFORCE, socket.SO_RCVBUF):
            with suppress(OSError):
                opened.setsockopt(socket.SOL_SOCKET, option, RECEIVE_BUFFER)
                break
        opened.bind((interface,))
        # binding to an interface that is down succeeds and leaves ENETDOWN
        pending = opened.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if pending:
            raise OSError(pending, "the interface is down")
    except OSError:
        opened.close()
        raise
    return opened


def _cannot_open(interface: str, error: OSError) -> RuntimeFault:
    if error.errno in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        return RuntimeFault(
            "MC424",
            f"the CAN interface {interface} cannot be opened: this kernel has no CAN",
            "load the modules can, can_raw and the adapter's driver (or vcan), or use a kernel that has them",
        )
    if error.errno == errno.ENODEV:
        return RuntimeFault(
            "MC424",
            f"there is no CAN interface {interface}",
            "ip -brief link show type can lists them; plug the adapter in and load its driver",
        )
    if error.errno == errno.ENETDOWN:
        return RuntimeFault(
            "MC424",
            f"the CAN interface {interface} is down",
            f"ip link set {interface} up type can bitrate 1000000 restart-ms 100",
        )
    return RuntimeFault(
        "MC424",
        f"the CAN interface {interface} cannot be opened: {error.strerror or error}",
        "check the interface with ip -details link show",
    )
