"""From an address to a port on that bus."""

from __future__ import annotations

from mcserver.can.address import BusAddress, Transport, parse_address
from mcserver.can.port import CanPort
from mcserver.can.socketcan import SocketCanPort
from mcserver.can.socketcand import SocketcandPort
from mcserver.can.udp_multicast import UdpMulticastPort


def open_port(address: str | BusAddress) -> CanPort:
    """Return a port on a bus; only this call may wait (some seconds, for a server that does not answer).

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
