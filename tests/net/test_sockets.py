"""Connections that are cut below the library that has opened them."""

from __future__ import annotations

import os
import socket

from mcserver.net.sockets import shut_down


def test_connections_of_a_port_are_shut_down_and_no_descriptor_is_left_behind() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        socket.create_connection(listener.getsockname()) as client,
        socket.create_connection(listener.getsockname()) as other,
    ):
        accepted, _ = listener.accept()
        with accepted:
            before = os.listdir("/proc/self/fd")
            shut_down({str(client.getsockname()[1])})
            assert os.listdir("/proc/self/fd") == before
            assert accepted.recv(1) == b""
            other.sendall(b"1")
