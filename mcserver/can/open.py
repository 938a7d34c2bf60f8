"""From an address to a port on that bus."""

from __future__ import annotations

from typing import Any

from mcserver.can.address import BusAddress, Transport, parse_address
from mcserver.can.port import CanPort
from mcserver.can.socketcan import SocketCanPort
from mcserver.can.socketcand import SocketcandPort
from mcserver.can.udp_multicast import HOP_LIMIT, UdpMulticastPort


def open_port(address: str | BusAddress) -> CanPort:
    """A port on a bus; only this call may wait (some seconds, for a server that does not answer).

    Raises:
        ConfigurationError: MC009 the text is no address.
        RuntimeFault: MC424 the bus cannot be opened.
    """
    where = parse_address(address) if isinstance(address, str) else address
    if where.transport is Transport.SOCKETCAN:
        return SocketCanPort(where.channel)
    if where.transport is Transport.SOCKETCAND:
        return SocketcandPort(where.host, where.port, where.channel)
    return UdpMulticastPort(where.host, where.port)


def python_can_arguments(address: str | BusAddress) -> dict[str, Any]:
    """Arguments for python-can's ``can.Bus`` on the same bus.

    Raises:
        ConfigurationError: MC009 the text is no address.
    """
    where = parse_address(address) if isinstance(address, str) else address
    if where.transport is Transport.SOCKETCAN:
        return {"interface": "socketcan", "channel": where.channel}
    if where.transport is Transport.SOCKETCAND:
        return {
            "interface": "socketcand",
            "channel": where.channel,
            "host": where.host,
            "port": where.port,
            "tcp_tune": True,
        }
    return {
        "interface": "udp_multicast",
        "channel": where.host,
        "port": where.port,
        "hop_limit": HOP_LIMIT,
        "fd": False,
    }
