"""python-can on a bus of the product: another program that the ports have to understand."""

from __future__ import annotations

import can

from mcserver.can.address import Transport, parse_address
from mcserver.can.udp_multicast import HOP_LIMIT


def python_can_bus(address: str) -> can.BusABC:
    """The same bus, opened by python-can."""
    where = parse_address(address)
    if where.transport is Transport.SOCKETCAN:
        return can.Bus(where.channel, "socketcan")
    if where.transport is Transport.SOCKETCAND:
        return can.Bus(where.channel, "socketcand", host=where.host, port=where.port, tcp_tune=True)
    return can.Bus(where.host, "udp_multicast", port=where.port, hop_limit=HOP_LIMIT, fd=False)
